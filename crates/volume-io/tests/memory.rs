//! Memory at its highest while a volume is loaded. Alone in its process, since the system counts for all threads.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "functions that tests share fail by panicking")]

use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use volume::VoxelType;
use volume_io::{LoadOptions, load};

/// Voxels of the volume.
const SIDE: i16 = 400;

/// A figure of this process's memory, in bytes: `VmRSS:` is resident now, `VmHWM:` was at the highest.
fn memory(figure: &str) -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix(figure)).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() * 1024
}

#[test]
fn the_peak_stays_within_1_3_times_the_voxels() {
    let fixture = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/nifti/n1_le_i32_sagittal.nii");
    let mut header = std::fs::read(fixture).unwrap()[..352].to_vec();
    header[42..48].copy_from_slice(&[SIDE; 3].map(i16::to_le_bytes).concat());
    let folder = tempfile::tempdir().unwrap();
    let count = usize::from(SIDE.unsigned_abs()).pow(3);

    // Hounsfield units; then the last one does not fit int16, nor float32: the widest detours, all at the end. The larger
    // volume comes later, so that the highest is its own.
    let detours = [(2000i32, VoxelType::I16), (1 << 20, VoxelType::F32), (i32::MAX, VoxelType::F64)];
    for (last, expected) in detours {
        let path = folder.path().join("scan.nii.gz");
        let mut file = GzEncoder::new(std::fs::File::create(&path).unwrap(), Compression::fast());
        file.write_all(&header).unwrap();
        let mut row = Vec::new();
        for i in 0..count {
            let value = if i + 1 == count { last } else { (i / 1000 % 3000) as i32 - 1000 };
            row.extend(value.to_le_bytes());
            if row.len() >= 1 << 16 || i + 1 == count {
                file.write_all(&row).unwrap();
                row.clear();
            }
        }
        file.finish().unwrap();

        let before = memory("VmRSS:");
        let loaded = load(&path, &LoadOptions::default()).unwrap();
        let (peak, held) = (memory("VmHWM:") - before, loaded.volume.sample_bytes());
        assert_eq!(loaded.volume.channels()[0].voxels.voxel_type(), expected);
        println!("{expected:?}: {peak} bytes at the peak for {held} bytes of voxels");
        assert!(peak as f64 <= 1.3 * held as f64, "{expected:?}: {peak} for {held}");
    }
}
