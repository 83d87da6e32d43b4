//! Whatever bytes come in, loading ends with a volume within the memory allowed, or with an error.
//!
//! An input is a file, and after the separator a file that lies beside it: the voxels `a.raw` of a JSON header, or the
//! JSON of a slice atlas `a.png`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let files = holocast_fuzz::files(data);
    let is_atlas = files[0].starts_with(b"\x89PNG");
    let (name, other) = if is_atlas { ("a.png", "a.json") } else { ("a.json", "a.raw") };
    let beside: Vec<_> = files.get(1).map(|bytes| (other, *bytes)).into_iter().collect();
    holocast_fuzz::load(name, files[0], &beside);
});
