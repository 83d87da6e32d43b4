//! NRRD: what headers may and may not say.

use crate::{assert_field, assert_noted, fixtures, load_err, load_ok};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::io::Write as _;
use volume::{ChannelKind, Voxels};
use volume_io::{Format, LoadError, LoadOptions, Sequence, load, load_bytes, load_parts};

const SPACE: &str = "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\n";

/// A header of 2 × 2 × 2 bytes with more fields.
fn header(more: &str) -> String {
    format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\n{more}")
}

fn raw() -> Vec<u8> {
    format!("{}encoding: raw\n{SPACE}\n12345678", header("")).into_bytes()
}

/// The same file with one line changed.
fn with(from: &str, to: &str) -> LoadError {
    let text = String::from_utf8(raw()).unwrap();
    assert!(text.contains(from), "{from}");
    load_err(text.replace(from, to).as_bytes())
}

#[test]
fn the_patient_is_where_the_space_says() {
    let at = |space: &str| {
        let text = String::from_utf8(raw()).unwrap().replace("LPS", space).replace("(0,0,0)", "(10,20,30)");
        load_ok(text.as_bytes()).volume.grid().volume_from_index().translation.to_array()
    };
    assert_eq!(at("LPS"), [10.0, 20.0, 30.0]);
    assert_eq!(at("right-anterior-superior"), [-10.0, -20.0, 30.0]);
    assert_eq!(at("left-anterior-superior"), [10.0, -20.0, 30.0]);
    assert_eq!(at("scanner-xyz"), [10.0, 20.0, 30.0]);
    let loaded = load_ok(String::from_utf8(raw()).unwrap().replace("LPS", "3D-left-handed").as_bytes());
    assert_noted(&loaded, "not the patient's");
    assert_eq!(loaded.report.format, Format::Nrrd);
    assert_field(&with("space: LPS", "space: somewhere"), "space", &["somewhere"]);
}

#[test]
fn lines_may_end_as_on_windows_and_comments_are_passed_over() {
    let text =
        String::from_utf8(raw()).unwrap().replace("encoding", "# a: b\nencoding").replace('\n', "\r\n");
    assert_eq!(load_ok(text.as_bytes()).volume.channels()[0].voxels, Voxels::U8(b"12345678".to_vec().into()));
}

#[test]
fn units_of_length_become_millimetres() {
    let text = String::from_utf8(raw())
        .unwrap()
        .replace("space origin", "space units: \"cm\" \"cm\" \"cm\"\nspace origin");
    let loaded = load_ok(text.as_bytes());
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [10.0, 10.0, 20.0]);
    assert_noted(&loaded, "cm");
}

#[test]
fn a_segmentation_of_3d_slicer_holds_labels() {
    let keys = "Segment0_ID:=Segment_1\nSegment0_Name:=liver: left lobe\nSegment0_Color:=0.5 0 1\nSegment0_LabelValue:=2\n";
    let text = String::from_utf8(raw()).unwrap().replace("encoding", &format!("{keys}encoding"));
    let loaded = load_ok(text.as_bytes());
    assert_eq!(loaded.volume.channels()[0].kind, ChannelKind::Label);
    let label = loaded.report.labels.get(2).unwrap();
    assert_eq!((label.name.as_str(), label.color), ("liver: left lobe", Some([0.5, 0.0, 1.0])));
    assert_eq!(load_ok(&raw()).volume.channels()[0].kind, ChannelKind::Intensity);
}

#[test]
fn of_a_series_the_volume_that_was_asked_for_is_loaded() {
    let series = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 2 1 3\nencoding: raw\nspace: LPS\n\
                  space directions: (1,0,0) (0,1,0) (0,0,2) none\nspace origin: (0,0,0)\n\n123456789abc";
    let loaded = load_ok(series.as_bytes());
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(b"1234".to_vec().into()));
    assert_noted(&loaded, "a series of 3 volumes");
    let time = series
        .replace("LPS", "LPST")
        .replace("0)", "0,0)")
        .replace("(0,0,2)", "(0,0,2,0)")
        .replace("none", "(0,0,0,1)");
    assert_eq!(load_ok(time.as_bytes()).volume.channels()[0].voxels, Voxels::U8(b"1234".to_vec().into()));
    let timed =
        series.replace("encoding", "spacings: nan nan nan 40\nunits: \"\" \"\" \"\" \"ms\"\nencoding");
    let mut gzip = ZlibEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(b"123456789abc").unwrap();
    let packed = timed.replace("raw", "gzip").replace("123456789abc", "").into_bytes();
    let packed = [packed, gzip.finish().unwrap()].concat();
    let detached = timed
        .replace("encoding", "data file: s%d 0 5 1 3\nbyte skip: -1\nencoding")
        .replace("123456789abc", "");
    let halves = [b"h12", b"h34", b"h56", b"h78", b"h9a", b"hbc"];
    let names = ["s0", "s1", "s2", "s3", "s4", "s5"];
    let beside: Vec<(&str, &[u8])> = names.into_iter().zip(halves.iter().map(|h| h.as_slice())).collect();
    let detached = detached.replace("2 2 1 3", "1 2 2 3").replace(" 1 3\nbyte", " 1 2\nbyte");
    for file in [timed.as_bytes(), &packed, detached.as_bytes()] {
        for (time, expected) in [(0, b"1234"), (1, b"5678"), (2, b"9abc")] {
            let loaded =
                load_parts("test", file, &beside, &LoadOptions { time, ..LoadOptions::default() }).unwrap();
            assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(expected.to_vec().into()));
            let sequence = Sequence { steps: 3, loaded: time, step_secs: Some(0.04) };
            assert_eq!(loaded.report.sequence, Some(sequence));
        }
    }
    let vectors = series.replace("(1,0,0) (0,1,0) (0,0,2) none", "none (1,0,0) (0,1,0) (0,0,2)");
    assert_field(&load_err(vectors.as_bytes()), "sizes", &["vectors"]);
}

#[test]
fn compressed_voxels_may_begin_as_gzip_or_zlib_and_end_with_their_checksum() {
    let head = format!("{}encoding: gzip\n{SPACE}\n", header("")).into_bytes();
    let mut gzip = GzEncoder::new(head.clone(), Compression::best());
    gzip.write_all(b"12345678").unwrap();
    let gzip = gzip.finish().unwrap();
    let mut zlib = ZlibEncoder::new(head, Compression::best());
    zlib.write_all(b"12345678").unwrap();
    for file in [&gzip, &zlib.finish().unwrap()] {
        assert_eq!(load_ok(file).volume.channels()[0].voxels, Voxels::U8(b"12345678".to_vec().into()));
    }
    let mut wrong = gzip.clone();
    let checksum = wrong.len() - 8;
    wrong[checksum] ^= 1;
    assert!(matches!(load_err(&wrong), LoadError::Damaged { what: "gzip data", .. }));
    let error = load_err(&gzip[..gzip.len() - 12]);
    assert!(matches!(error, LoadError::Truncated { .. } | LoadError::Damaged { .. }), "{error}");
}

#[test]
fn a_bomb_is_read_as_far_as_the_header_says() {
    let mut bomb =
        GzEncoder::new(format!("{}encoding: gzip\n{SPACE}\n", header("")).into_bytes(), Compression::best());
    bomb.write_all(&vec![7; 64 << 20]).unwrap();
    let loaded = load_ok(&bomb.finish().unwrap());
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(vec![7; 8].into()));
    assert_noted(&loaded, "65536 bytes or more after the voxels");
}

#[test]
fn headers_that_cannot_be_are_refused() {
    let sizes = |sizes: &str| with("sizes: 2 2 2", &format!("sizes: {sizes}"));
    for wrong in ["2 2 0", "2 2 -2", "2 2 2147483648", "2 2 18446744073709551616", "2 2", "2 2 2 2", "2 2 x"]
    {
        assert_field(&sizes(wrong), "sizes", &[]);
    }
    assert!(matches!(sizes("32767 32767 32767"), LoadError::TooLarge { .. }));
    assert!(matches!(sizes("2 2 3"), LoadError::Truncated { expected: 12, found: 8, .. }));
    for wrong in ["0", "-1", "17", "x"] {
        assert_field(&with("dimension: 3", &format!("dimension: {wrong}")), "dimension", &[]);
    }
    assert_field(&with("type: uchar", "type: block"), "type", &["block"]);
    assert_field(&with("type: uchar", "type: short"), "endian", &["none"]);
    assert_field(&with("encoding: raw", "encoding: bzip2"), "encoding", &["bzip2"]);
    assert_field(&with("encoding: raw\n", "encoding: raw\nencoding: raw\n"), "encoding", &["two"]);
    assert_field(&with("encoding: raw", "encoding: raw\nflavour: 3"), "header", &["flavour"]);
    assert_field(&with("encoding: raw", "encoding: raw\nline skip: 99999999"), "line skip", &[]);
    assert_field(&with("encoding: raw", "encoding: raw\nbyte skip: -2"), "byte skip", &[]);
    let skip = with("encoding: raw", "encoding: raw\nbyte skip: 9223372036854775807");
    assert!(matches!(skip, LoadError::Truncated { .. }), "{skip}");
    assert_field(&with("(0,0,2)", "(0,0)"), "space directions", &[]);
    assert!(matches!(with("(0,0,2)", "(1,0,0)"), LoadError::Grid { field: "space directions", .. }));
    assert!(matches!(with("(0,0,2)", "(0,0,inf)"), LoadError::Grid { .. }));
    assert_field(&with("NRRD0004", "NRRD0006"), "the first line", &["NRRD0006"]);
}

#[test]
fn a_header_without_end_is_not_kept_in_memory() {
    let mut endless = b"NRRD0004\n".to_vec();
    endless.extend(std::iter::repeat_n(b'#', 3 << 20));
    assert!(matches!(load_err(&endless), LoadError::TooLarge { what: "the header", .. }));
    assert!(matches!(load_err(b"NRRD0004\ntype: uchar\n"), LoadError::Truncated { what: "header", .. }));
}

#[test]
fn files_beside_the_header_stay_in_its_folder() {
    let named = |name: &str| format!("{}encoding: raw\n{SPACE}data file: {name}\n", header(""));
    let parts = |name: &str, beside: &[(&str, &[u8])]| {
        load_parts("a.nhdr", named(name).as_bytes(), beside, &LoadOptions::default())
    };
    assert!(parts("a.raw", &[("a.raw", b"12345678")]).is_ok());
    for outside in ["../a.raw", "/etc/passwd", "b/../../a.raw", "."] {
        assert!(matches!(parts(outside, &[]), Err(LoadError::OutsideFolder { .. })), "{outside}");
    }
    assert!(matches!(parts("a.raw", &[]), Err(LoadError::Unreadable { .. })));
    assert_field(&parts("a.nhdr", &[]).unwrap_err(), "data file", &["the header itself"]);
    assert_field(&parts("./a.nhdr", &[]).unwrap_err(), "data file", &["the header itself"]);
    let short = parts("a.raw", &[("a.raw", b"1234567")]).unwrap_err();
    assert!(matches!(short, LoadError::Truncated { expected: 8, found: 7, .. }), "{short}");
    assert!(short.to_string().starts_with("a.raw"), "{short}");

    assert_field(&parts("LIST\na.raw\nb.raw\nc.raw", &[]).unwrap_err(), "data file", &["2 files"]);
    let missing = parts("s%d.raw 1 2 1", &[("s1.raw", b"1234")]).unwrap_err();
    assert!(missing.to_string().starts_with("s2.raw"), "{missing}");
    let slices: &[(&str, &[u8])] = &[("s1.raw", b"1234"), ("s2.raw", b"567")];
    let short = parts("s%d.raw 1 2 1", slices).unwrap_err();
    assert!(short.to_string().starts_with("s2.raw"), "{short}");
}

#[cfg(unix)]
#[test]
fn a_link_does_not_lead_out_of_the_folder() {
    let outside = tempfile::tempdir().unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(outside.path().join("voxels"), b"12345678").unwrap();
    std::os::unix::fs::symlink(outside.path().join("voxels"), folder.path().join("a.raw")).unwrap();
    let path = folder.path().join("a.nhdr");
    std::fs::write(&path, format!("{}encoding: raw\n{SPACE}data file: a.raw\n", header(""))).unwrap();
    let error = load(&path, &LoadOptions::default()).unwrap_err();
    assert!(matches!(error, LoadError::OutsideFolder { .. }), "{error}");
    // A link to the header itself is the header.
    std::fs::remove_file(folder.path().join("a.raw")).unwrap();
    std::os::unix::fs::symlink(&path, folder.path().join("a.raw")).unwrap();
    assert_field(&load(&path, &LoadOptions::default()).unwrap_err(), "data file", &["the header itself"]);
}

#[test]
fn content_decides_and_not_the_name() {
    let bytes = std::fs::read(fixtures().join("nrrd/le_i16_axial.nrrd")).unwrap();
    assert_eq!(load_bytes("scan.dcm", &bytes, &LoadOptions::default()).unwrap().report.format, Format::Nrrd);
}
