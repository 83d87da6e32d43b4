//! What fuzz targets of volume files share.

use std::sync::Once;
use volume_io::describe::VolumeDescription;
use volume_io::{LoadOptions, load_parts};

/// Most bytes that the voxels of an input may take.
const MAX_BYTES: u64 = 4 << 20;
/// What stands between the files of an input.
const SEPARATOR: &[u8] = b"\n--beside--\n";

/// The files of an input, at least one: one, and after each separator another of the same folder.
pub fn files(data: &[u8]) -> Vec<&[u8]> {
    let (mut files, mut rest) = (Vec::new(), data);
    while let Some(at) = rest.windows(SEPARATOR.len()).position(|window| window == SEPARATOR) {
        files.push(&rest[..at]);
        rest = &rest[at + SEPARATOR.len()..];
    }
    files.push(rest);
    files
}

/// libFuzzer's own hook ends the process where a panic begins, so it would take a panic that a loader contains (that of a
/// library's decoder) for a failure. A panic that nobody contains still ends it, when it reaches libFuzzer.
fn let_loaders_contain_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| std::panic::set_hook(Box::new(|panic| eprintln!("{panic}"))));
}

/// Loads a file with those beside it: that ends with a volume within the memory allowed, which can be described and says
/// nothing of the patient, or with an error.
pub fn load(name: &str, file: &[u8], beside: &[(&str, &[u8])]) {
    let_loaders_contain_panics();
    let options = LoadOptions { max_bytes: MAX_BYTES, force: true, ..LoadOptions::default() };
    if let Ok(loaded) = load_parts(name, file, beside, &options) {
        assert!(loaded.volume.sample_bytes() as u64 <= MAX_BYTES);
        assert!(loaded.report.identity.is_empty());
        assert!(!VolumeDescription::of(name, &loaded).to_string().is_empty());
    }
}

/// Loads a header of text, whose first line is given, with the file of voxels `a.raw` beside it.
pub fn load_header(first_line: &str, data: &[u8]) {
    let files = files(data);
    // The first line decides what the file is: it is not the fuzzer's to guess.
    let header = [first_line.as_bytes(), files[0]].concat();
    load("a.header", &header, &[("a.raw", files.get(1).copied().unwrap_or_default())]);
}
