//! What is no volume at all, and random damage.

use crate::{fixture, fixtures, load_err};
use proptest::prelude::*;
use volume_io::{LoadError, LoadOptions, load, load_bytes, load_parts};

#[test]
fn a_missing_file_is_unreadable() {
    let error = load("no such file.nii", &LoadOptions::default()).unwrap_err();
    assert!(matches!(error, LoadError::Unreadable { .. }));
    assert!(error.to_string().contains("no such file.nii"), "{error}");
}

#[test]
fn a_folder_without_dicom_is_no_volume() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("readme.txt"), "hello").unwrap();
    let error = load(folder.path(), &LoadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a folder of 1 files, none of them DICOM"), "{error}");
}

#[test]
fn content_decides_and_not_the_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scan.png");
    std::fs::write(&path, fixture("n1_le_u8_sform.nii")).unwrap();
    load(&path, &LoadOptions::default()).unwrap();
}

#[test]
fn what_is_no_volume_is_named() {
    let check = |bytes: &[u8], expected: &str| {
        let error = load_err(bytes);
        assert!(matches!(error, LoadError::UnknownFormat { .. }), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    };
    check(b"", "an empty file");
    check(b"hello", "text");
    check(b"PK\x03\x04....", "a ZIP archive");
    check(&[0xde, 0xad, 0xbe, 0xef], "unknown bytes de ad be ef");
}

/// The fuzzer found it: the library asserts, where assertions are on, what this stream does not keep to.
#[cfg(debug_assertions)]
#[test]
fn a_decoder_that_panics_gives_an_error_that_names_the_file() {
    let file = std::fs::read(fixtures().join("damaged/htj2k.dcm")).unwrap();
    let error = load_err(&file).to_string();
    assert!(error.contains("JPEG 2000 pixels") && error.contains("the decoder stopped"), "{error}");
}

/// Damage must give an error or a volume, within the memory allowed; a panic fails the test.
fn survives(name: &str, bytes: &[u8], beside: &[(&str, &[u8])]) {
    let options = LoadOptions { max_bytes: 1 << 20, ..LoadOptions::default() };
    if let Ok(loaded) = load_parts(name, bytes, beside, &options) {
        assert!(loaded.volume.sample_bytes() <= 1 << 20);
    }
}

proptest! {
    #[test]
    fn random_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _ = load_bytes("random", &bytes, &LoadOptions::default());
    }

    #[test]
    fn damaged_headers_do_no_harm(
        one in 0usize..412, two in 0usize..412, a in any::<u8>(), b in any::<u8>(), kind in 0usize..4,
    ) {
        let name = [
            "n1_le_u8_sform.nii",
            "n1_be_f32_qform_oblique.nii.gz",
            "n1_le_i32_sagittal.nii",
            "n2_le_f32_sheared.nii",
        ][kind];
        let mut bytes = fixture(name);
        let length = bytes.len();
        bytes[one % length] = a;
        bytes[two % length] = b;
        survives(name, &bytes, &[]);
    }

    #[test]
    fn damaged_slices_do_no_harm(
        kind in 0usize..24, one in 0usize..4000, two in 0usize..4000, a in any::<u8>(), b in any::<u8>(),
    ) {
        let mut series: Vec<_> =
            std::fs::read_dir(fixtures().join("dicom")).unwrap().map(|e| e.unwrap().path()).collect();
        series.sort();
        let slice = std::fs::read_dir(&series[kind]).unwrap().map(|e| e.unwrap().path()).min().unwrap();
        let mut bytes = std::fs::read(slice).unwrap();
        let length = bytes.len();
        // From the end: pixels are where codecs are.
        bytes[length - 1 - one % length] = a;
        bytes[length - 1 - two % length] ^= b;
        survives("a.dcm", &bytes, &[]);
    }

    #[test]
    fn damaged_json_does_no_harm(at in 0usize..200, with in any::<u8>()) {
        let mut header = br#"{"raw": "a.raw", "dims": [2, 2, 2], "type": "int16", "endian": "big",
            "spacing_mm": [1, 1, 1], "slope": 2.5, "intercept": -1000, "name": "ct", "kind": "label"}"#.to_vec();
        let length = header.len();
        header[at % length] = with;
        survives("a.json", &header, &[("a.raw", &[0; 16])]);
    }
}

#[test]
fn the_seeds_of_the_fuzz_target_are_volumes() {
    // They are split as in `fuzz/fuzz_targets/volume_load.rs`.
    const SEPARATOR: &[u8] = b"\n--beside--\n";
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/volume_load");
    let mut seeds = 0;
    for entry in std::fs::read_dir(corpus).unwrap() {
        let path = entry.unwrap().path();
        // What a fuzzer finds is named by its hash and need not be a volume.
        if path.file_name().unwrap().len() == 40 {
            continue;
        }
        let seed = std::fs::read(&path).unwrap();
        let at = seed.windows(SEPARATOR.len()).position(|w| w == SEPARATOR);
        let (file, beside) =
            at.map_or((&seed[..], &[][..]), |at| (&seed[..at], &seed[at + SEPARATOR.len()..]));
        let (name, other) =
            if file.starts_with(b"\x89PNG") { ("a.png", "a.json") } else { ("a.json", "a.raw") };
        let loaded = load_parts(name, file, &[(other, beside)], &LoadOptions::default());
        assert!(loaded.is_ok(), "{}: {}", path.display(), loaded.unwrap_err());
        seeds += 1;
    }
    assert_eq!(seeds, 34);
}

#[test]
fn the_seeds_of_the_other_fuzz_targets_are_volumes() {
    const SEPARATOR: &[u8] = b"\n--beside--\n";
    let first_lines: [(&str, &[u8], usize); 3] = [
        ("dicom_load", b"", 24),
        ("nrrd_load", b"NRRD0004\n", 5),
        ("metaimage_load", b"ObjectType = Image\n", 5),
    ];
    for (target, first_line, expected) in first_lines {
        let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
        let mut seeds = 0;
        for entry in std::fs::read_dir(corpus).unwrap() {
            let path = entry.unwrap().path();
            if path.file_name().unwrap().len() == 40 {
                continue;
            }
            let seed = [first_line, &std::fs::read(&path).unwrap()].concat();
            let mut parts = Vec::new();
            let mut rest = &seed[..];
            while let Some(at) = rest.windows(SEPARATOR.len()).position(|w| w == SEPARATOR) {
                parts.push(&rest[..at]);
                rest = &rest[at + SEPARATOR.len()..];
            }
            parts.push(rest);
            let beside: Vec<(&str, &[u8])> =
                ["a.raw", "b.raw"].into_iter().zip(parts[1..].iter().copied()).collect();
            let loaded = load_parts("a.header", parts[0], &beside, &LoadOptions::default());
            assert!(loaded.is_ok(), "{}: {}", path.display(), loaded.unwrap_err());
            seeds += 1;
        }
        assert_eq!(seeds, expected, "{target}");
    }
}
