//! Raw voxels with a JSON header.

use crate::assert_field;
use std::path::Path;
use volume::{ChannelKind, Voxels};
use volume_io::{Format, LoadError, LoadOptions, Loaded, load, load_parts};

fn parts(header: &str, raw: &[u8]) -> Result<Loaded, LoadError> {
    load_parts("scan.json", header.as_bytes(), &[("scan.raw", raw)], &LoadOptions::default())
}

/// A header of 2 × 1 × 2 int16 with more fields.
fn header(more: &str) -> String {
    format!(r#"{{"raw": "scan.raw", "dims": [2, 1, 2], "type": "int16", "endian": "big"{more}}}"#)
}

const SPACING: &str = r#", "spacing_mm": [0.5, 0.5, 2]"#;
const EIGHT: &[u8] = &[0, 1, 255, 255, 1, 0, 0, 4];

#[test]
fn values_have_the_byte_order_slope_and_intercept_of_the_header() {
    let more = format!(r#"{SPACING}, "slope": 2, "intercept": -1000, "name": "ct""#);
    let loaded = parts(&header(&more), EIGHT).unwrap();
    assert_eq!(loaded.report.format, Format::Raw);
    let channel = &loaded.volume.channels()[0];
    assert_eq!(channel.voxels, Voxels::I16(vec![1, -1, 256, 4].into()));
    assert_eq!((channel.name.as_str(), channel.value(2)), ("ct", -488.0));
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [0.5, 0.5, 2.0]);
    assert_eq!(loaded.volume.grid().orientation().0, "LPS");
    let little = header(SPACING).replace("big", "little");
    let little = parts(&little, EIGHT).unwrap();
    assert_eq!(little.volume.channels()[0].voxels, Voxels::I16(vec![256, -1, 1, 1024].into()));
}

#[test]
fn each_type_is_read() {
    let read = |name: &str, bytes: &[u8]| {
        let header = format!(
            r#"{{"raw": "scan.raw", "dims": [1, 1, 2], "type": "{name}", "endian": "little", "spacing_mm": [1, 1, 1]}}"#
        );
        parts(&header, bytes).unwrap().volume.channels()[0].voxels.clone()
    };
    assert_eq!(read("uint8", &[1, 2]), Voxels::U8(vec![1, 2].into()));
    assert_eq!(read("uint16", &[1, 2, 255, 255]), Voxels::U16(vec![513, 65535].into()));
    assert_eq!(read("float32", &[0, 0, 128, 63, 0, 0, 0, 0]), Voxels::F32(vec![1.0, 0.0].into()));
}

#[test]
fn samples_that_are_no_numbers_are_counted() {
    let header = r#"{"raw": "scan.raw", "dims": [1, 1, 2], "type": "float32", "endian": "little", "spacing_mm": [1, 1, 1]}"#;
    let loaded = parts(header, &[0, 0, 192, 127, 0, 0, 128, 63]).unwrap();
    assert_eq!(loaded.report.non_finite[0].nan, 1);
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::F32(vec![1.0, 1.0].into()));
}

#[test]
fn channels_follow_each_other() {
    let json = r#"{"raw": "scan.raw", "dims": [2, 1, 1], "type": "uint8", "spacing_mm": [1, 1, 1], "offset_bytes": 3,
        "channels": [{"name": "ct", "slope": 4}, {"name": "organs", "kind": "label"}]}"#;
    let loaded = parts(json, &[9, 9, 9, 1, 2, 3, 4]).unwrap();
    let [ct, organs] = loaded.volume.channels() else { panic!() };
    assert_eq!((&ct.voxels, ct.slope), (&Voxels::U8(vec![1, 2].into()), 4.0));
    assert_eq!((&organs.voxels, organs.kind), (&Voxels::U8(vec![3, 4].into()), ChannelKind::Label));
    let both = json.replace("\"offset_bytes\"", "\"slope\": 2, \"offset_bytes\"");
    assert_field(&parts(&both, &[0; 7]).unwrap_err(), "channels", &[]);
}

#[test]
fn a_transform_may_stand_instead_of_the_spacing() {
    let rows = r#", "volume_from_index": [[-2, 0, 0, 10], [0, 0, 3, 20], [0, 1, 0, 30]]"#;
    let grid = parts(&header(rows), EIGHT).unwrap().volume.grid().clone();
    assert_eq!(grid.spacing_mm().to_array(), [2.0, 1.0, 3.0]);
    assert_eq!(grid.volume_from_index().translation.to_array(), [10.0, 20.0, 30.0]);
    assert_eq!(grid.orientation().0, "RSP");
    assert_field(&parts(&header(&format!("{rows}{SPACING}")), EIGHT).unwrap_err(), "spacing_mm", &["both"]);
    assert_field(&parts(&header(""), EIGHT).unwrap_err(), "spacing_mm", &["neither"]);
}

#[test]
fn a_file_of_another_size_names_both() {
    for length in [0, 7, 9, 4096] {
        let error = parts(&header(SPACING), &vec![0; length]).unwrap_err();
        let LoadError::FileSize { expected, found, .. } = error else { panic!("{error}") };
        assert_eq!((expected, found), (8, length as u64));
    }
}

#[test]
fn headers_that_cannot_be_are_refused() {
    let with = |from: &str, to: &str| parts(&header(SPACING).replace(from, to), EIGHT).unwrap_err();
    assert_field(&with("[2, 1, 2]", "[0, 1, 2]"), "dims[0]", &["1 to 32767", "found 0"]);
    assert_field(&with("[2, 1, 2]", "[2, -1, 2]"), "dims[1]", &["found -1"]);
    assert_field(&with("[2, 1, 2]", "[2, 1, 2147483648]"), "dims[2]", &["found 2147483648"]);
    assert!(matches!(with("[2, 1, 2]", "[32767, 32767, 32767]"), LoadError::TooLarge { .. }));
    assert_field(&with(", \"endian\": \"big\"", ""), "endian", &["int16"]);
    assert_field(&with("[0.5, 0.5, 2]", "[0.5, -0.5, 2]"), "spacing_mm", &["-0.5"]);
    assert!(matches!(with("[0.5, 0.5, 2]", "[0.5, 1e9, 2]"), LoadError::Grid { field: "spacing_mm", .. }));
    assert_field(&with("\"endian\"", "\"slope\": 0, \"endian\""), "slope", &["found 0"]);
    assert_field(&with("\"endian\"", "\"name\": \"\\u001b[2J\", \"endian\""), "name", &[]);
    for (from, to, word) in [
        ("\"endian\"", "\"endianness\"", "endianness"),
        ("int16", "int12", "int12"),
        ("\"big\"", "\"middle\"", "middle"),
        ("\"dims\"", "\"dim\"", "dim"),
        ("[2, 1, 2]", "[2, 1]", "length 2"),
        ("}", "", "EOF"),
    ] {
        let error = with(from, to);
        assert!(matches!(error, LoadError::Json { .. }) && error.to_string().contains(word), "{error}");
    }
}

#[test]
fn a_message_cannot_steer_the_terminal() {
    let error = parts("{\"\\u001b[2J\": 1}", EIGHT).unwrap_err();
    assert!(!error.to_string().contains('\u{1b}'), "{error:?}");
}

#[test]
fn voxels_come_from_the_headers_folder_only() {
    let outer = tempfile::tempdir().unwrap();
    let folder = outer.path().join("scan");
    std::fs::create_dir_all(folder.join("below")).unwrap();
    std::fs::write(outer.path().join("secret.raw"), EIGHT).unwrap();
    std::fs::write(folder.join("below/scan.raw"), EIGHT).unwrap();
    let named = |raw: &str| {
        std::fs::write(folder.join("scan.json"), header(SPACING).replace("scan.raw", raw)).unwrap();
        load(folder.join("scan.json"), &LoadOptions::default())
    };
    named("below/scan.raw").unwrap();
    let absolute = outer.path().join("secret.raw");
    for outside in ["../secret.raw", "below/../../secret.raw", absolute.to_str().unwrap(), "", "."] {
        let error = named(outside).unwrap_err();
        assert!(matches!(error, LoadError::OutsideFolder { .. }), "{outside}: {error}");
    }
    assert!(matches!(named("missing.raw").unwrap_err(), LoadError::Unreadable { .. }));
    assert!(matches!(named("below").unwrap_err(), LoadError::Unreadable { .. }));
    link(Path::new("../secret.raw"), &folder.join("link.raw"));
    #[cfg(unix)]
    assert!(matches!(named("link.raw").unwrap_err(), LoadError::OutsideFolder { .. }));
    link(Path::new("below/scan.raw"), &folder.join("inner.raw"));
    #[cfg(unix)]
    named("inner.raw").unwrap();
}

#[cfg(unix)]
fn link(to: &Path, from: &Path) {
    std::os::unix::fs::symlink(to, from).unwrap();
}

#[cfg(not(unix))]
fn link(_: &Path, _: &Path) {}
