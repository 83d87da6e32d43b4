//! The golden bytes in `proto/vectors/`: `NAME.bin` is what goes over the network, `NAME.json` says what it means.
//!
//! They change only with the protocol. To write them anew from [`samples::all`]:
//! `UPDATE_VECTORS=1 cargo test -p wire vectors`, then read the difference before committing it.

use crate::samples::{self, Sample};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A vector's `.json`.
#[derive(Serialize, Deserialize)]
struct Description {
    bytes: usize,
    #[serde(flatten)]
    sample: Sample,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../proto/vectors")
}

fn description(name: &str) -> Description {
    let path = folder().join(name).with_extension("json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn bytes(name: &str) -> Vec<u8> {
    let path = folder().join(name).with_extension("bin");
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Writes the folder anew where that is asked for; else leaves it as it is.
fn update_if_asked() {
    if std::env::var_os("UPDATE_VECTORS").is_none() {
        return;
    }
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        std::fs::create_dir_all(folder()).unwrap();
        for (name, sample) in samples::all() {
            let bytes = sample.encode();
            let description = Description { bytes: bytes.len(), sample };
            let json = serde_json::to_string_pretty(&description).unwrap() + "\n";
            std::fs::write(folder().join(name).with_extension("json"), json).unwrap();
            std::fs::write(folder().join(name).with_extension("bin"), bytes).unwrap();
        }
    });
}

#[test]
fn encoding_what_a_vector_describes_gives_its_bytes() {
    update_if_asked();
    for (name, _) in samples::all() {
        let description = description(name);
        let golden = bytes(name);
        assert_eq!(description.bytes, golden.len(), "{name}");
        assert_eq!(description.sample.encode(), golden, "{name}");
    }
}

#[test]
fn decoding_a_vector_gives_what_it_describes() {
    update_if_asked();
    for (name, _) in samples::all() {
        let description = description(name);
        assert_eq!(description.sample.decode_alike(&bytes(name)), description.sample, "{name}");
    }
}

#[test]
fn every_message_has_a_vector_and_every_vector_a_message() {
    update_if_asked();
    let named: BTreeSet<String> = samples::all().iter().map(|(name, _)| (*name).to_owned()).collect();
    for extension in ["bin", "json"] {
        let found: BTreeSet<String> = std::fs::read_dir(folder())
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == extension))
            .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
            .collect();
        assert_eq!(found, named, ".{extension} files of proto/vectors against samples.rs");
    }
    for (name, sample) in samples::all() {
        assert_eq!(description(name).sample, sample, "{name}: proto/vectors against samples.rs");
    }
}
