//! Whatever bytes come in, loading ends with a volume within the memory allowed, or with an error.
//!
//! An input is a file, and after the separator a file that lies beside it: the voxels `a.raw` of a JSON header, or the
//! JSON of a slice atlas `a.png`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use volume_io::describe::VolumeDescription;
use volume_io::{LoadOptions, load_parts};

const SEPARATOR: &[u8] = b"\n--beside--\n";
const MAX_BYTES: u64 = 4 << 20;

fuzz_target!(|data: &[u8]| {
    let cut = data.windows(SEPARATOR.len()).position(|window| window == SEPARATOR);
    let (file, beside) = match cut {
        Some(at) => (&data[..at], Some(&data[at + SEPARATOR.len()..])),
        None => (data, None),
    };
    let (name, other) = if file.starts_with(b"\x89PNG") { ("a.png", "a.json") } else { ("a.json", "a.raw") };
    let beside: Vec<_> = beside.map(|bytes| (other, bytes)).into_iter().collect();
    let options = LoadOptions { max_bytes: MAX_BYTES, ..LoadOptions::default() };
    if let Ok(loaded) = load_parts(name, file, &beside, &options) {
        assert!(loaded.volume.sample_bytes() as u64 <= MAX_BYTES);
        let page = VolumeDescription::of(name, &loaded).to_string();
        assert!(!page.is_empty());
    }
});
