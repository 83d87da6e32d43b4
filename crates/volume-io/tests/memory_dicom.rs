//! Memory at the peak of loading a DICOM series. One test in a process of its own, since the peak is the process's.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "functions that tests share fail by panicking")]

use volume_io::{LoadOptions, load};

const SIDE: usize = 512;
const SLICES: usize = 96;

/// A figure of this process in bytes: `VmRSS:` is now, `VmHWM:` was at the highest.
fn memory(figure: &str) -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix(figure)).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() * 1024
}

fn element(out: &mut Vec<u8>, group: u16, element: u16, vr: &str, value: &[u8]) {
    out.extend([group.to_le_bytes(), element.to_le_bytes()].concat());
    out.extend(vr.as_bytes());
    if vr == "OW" {
        out.extend([0, 0]);
        out.extend((value.len() as u32).to_le_bytes());
    } else {
        out.extend((value.len() as u16).to_le_bytes());
    }
    out.extend(value);
}

/// A slice at `z_mm`; with a slope of its own if `scaled`, so that values become float64.
fn slice(z_mm: usize, scaled: bool) -> Vec<u8> {
    let mut out = vec![0; 128];
    out.extend(b"DICM");
    element(&mut out, 2, 0x10, "UI", b"1.2.840.10008.1.2.1\0");
    element(&mut out, 0x20, 0x32, "DS", format!("0\\0\\{z_mm:<6}").as_bytes());
    element(&mut out, 0x20, 0x37, "DS", b"1\\0\\0\\0\\1\\0 ");
    for (name, number) in [(0x10, SIDE), (0x11, SIDE), (0x100, 16), (0x101, 12), (0x102, 11), (0x103, 0)] {
        element(&mut out, 0x28, name, "US", &(number as u16).to_le_bytes());
    }
    if scaled {
        element(&mut out, 0x28, 0x1053, "DS", format!("{:<8}", 1.0 + z_mm as f64 / 128.0).as_bytes());
    }
    let pixels: Vec<u8> = (0..SIDE * SIDE).flat_map(|i| ((i % 4096) as u16).to_le_bytes()).collect();
    element(&mut out, 0x7fe0, 0x10, "OW", &pixels);
    out
}

#[test]
fn the_peak_stays_within_1_3_times_the_voxels() {
    let folder = tempfile::tempdir().unwrap();
    // The larger volume comes second, so that the highest is its own; the last one has a gap to be filled.
    for (scaled, sample_bytes, gap) in [(false, 2, 0), (true, 8, 0), (true, 8, 1)] {
        for i in 0..SLICES {
            let z_mm = if i + 1 == SLICES { i + gap } else { i };
            std::fs::write(folder.path().join(format!("{i}.dcm")), slice(z_mm, scaled)).unwrap();
        }
        let before = memory("VmRSS:");
        let loaded = load(folder.path(), &LoadOptions::default()).unwrap();
        let (peak, held) = (memory("VmHWM:") - before, loaded.volume.sample_bytes());
        assert_eq!(held, SIDE * SIDE * (SLICES + gap) * sample_bytes);
        println!("{} notes: {peak} bytes at the peak for {held} bytes of voxels", loaded.report.notes.len());
        assert!(peak as f64 <= 1.3 * held as f64, "{peak} for {held}");
    }
}
