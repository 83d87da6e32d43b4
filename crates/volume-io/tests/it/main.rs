//! Loading through the public interface.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "functions that tests share fail by panicking, and say what they skip"
)]

mod atlas;
mod describe;
mod dicom;
mod garbage;
mod golden;
mod metaimage;
mod nifti;
mod nrrd;
mod raw;
mod save;

use std::path::PathBuf;
use volume_io::{LoadError, LoadOptions, Loaded, load_bytes};

/// A small NIfTI file that `tools/golden_geometry.py` wrote.
fn fixture_path(name: &str) -> PathBuf {
    fixtures().join("nifti").join(name)
}

fn fixtures() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

fn fixture(name: &str) -> Vec<u8> {
    std::fs::read(fixture_path(name)).unwrap()
}

/// A file of the shared sample data; `None`, and a line that says so, where there are none on this machine.
fn shared(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(name);
    if path.exists() {
        return Some(path);
    }
    println!("SKIPPED: no {} on this machine", path.display());
    None
}

fn load_ok(bytes: &[u8]) -> Loaded {
    load_bytes("test", bytes, &LoadOptions::default()).unwrap()
}

fn load_err(bytes: &[u8]) -> LoadError {
    load_bytes("test", bytes, &LoadOptions::default()).unwrap_err()
}

/// A part of a note that must be there.
#[track_caller]
fn assert_noted(loaded: &Loaded, part: &str) {
    assert!(loaded.report.notes.iter().any(|n| n.contains(part)), "{part:?} in {:?}", loaded.report.notes);
}

/// The error must be about this field, and its message must hold these parts.
#[track_caller]
fn assert_field(error: &LoadError, name: &str, parts: &[&str]) {
    let LoadError::Field { field, .. } = error else { panic!("{error:?}") };
    assert_eq!(field, name, "{error}");
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "{part:?} in {message:?}");
    }
}
