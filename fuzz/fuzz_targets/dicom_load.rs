//! Whatever DICOM files lie in a folder, loading ends with a volume within the memory allowed, or with an error, and says
//! nothing of the patient.
//!
//! An input is one file, and after each separator another of the same folder.
#![no_main]

use libfuzzer_sys::fuzz_target;
use volume_io::describe::VolumeDescription;
use volume_io::{LoadOptions, load_parts};

const SEPARATOR: &[u8] = b"\n--beside--\n";
const MAX_BYTES: u64 = 4 << 20;
const NAMES: [&str; 8] = ["a.dcm", "b.dcm", "c.dcm", "d.dcm", "e.dcm", "f.dcm", "g.dcm", "h.dcm"];

fuzz_target!(|data: &[u8]| {
    let mut files = Vec::new();
    let mut rest = data;
    while let Some(at) = rest.windows(SEPARATOR.len()).position(|window| window == SEPARATOR) {
        files.push(&rest[..at]);
        rest = &rest[at + SEPARATOR.len()..];
    }
    files.push(rest);
    let named: Vec<_> = NAMES.iter().copied().zip(files).collect();
    let options = LoadOptions { max_bytes: MAX_BYTES, force: true, ..LoadOptions::default() };
    if let Ok(loaded) = load_parts(named[0].0, named[0].1, &named[1..], &options) {
        assert!(loaded.volume.sample_bytes() as u64 <= MAX_BYTES);
        assert!(loaded.report.identity.is_empty());
        assert!(!VolumeDescription::of("a.dcm", &loaded).to_string().is_empty());
    }
});
