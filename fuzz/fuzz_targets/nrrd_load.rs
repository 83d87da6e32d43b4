//! Whatever a NRRD header says, loading ends with a volume within the memory allowed, or with an error.
//!
//! An input is a file, and after the separator the file of voxels `a.raw` beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use volume_io::{LoadOptions, load_parts};

const FIRST_LINE: &[u8] = b"NRRD0004\n";
const SEPARATOR: &[u8] = b"\n--beside--\n";
const MAX_BYTES: u64 = 4 << 20;

fuzz_target!(|data: &[u8]| {
    let cut = data.windows(SEPARATOR.len()).position(|window| window == SEPARATOR);
    let (file, beside) = cut.map_or((data, &[][..]), |at| (&data[..at], &data[at + SEPARATOR.len()..]));
    // The first line decides what the file is: it is not the fuzzer's to guess.
    let file = [FIRST_LINE, file].concat();
    let options = LoadOptions { max_bytes: MAX_BYTES, ..LoadOptions::default() };
    if let Ok(loaded) = load_parts("a.header", &file, &[("a.raw", beside)], &options) {
        assert!(loaded.volume.sample_bytes() as u64 <= MAX_BYTES);
    }
});
