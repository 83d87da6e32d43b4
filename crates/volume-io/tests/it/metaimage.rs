//! MetaImage: what headers may and may not say.

use crate::{assert_field, assert_noted, load_err, load_ok};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write as _;
use volume::Voxels;
use volume_io::{Format, LoadError, LoadOptions, Sequence, load_bytes, load_parts};

const HEADER: &str = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n\
                      Offset = 1 2 3\nElementSpacing = 1 1 2\nElementType = MET_UCHAR\n";

fn local(header: &str) -> Vec<u8> {
    format!("{header}ElementDataFile = LOCAL\n12345678").into_bytes()
}

fn with(from: &str, to: &str) -> LoadError {
    assert!(HEADER.contains(from), "{from}");
    load_err(&local(&HEADER.replace(from, to)))
}

#[test]
fn voxels_follow_the_header() {
    let loaded = load_ok(&local(HEADER));
    assert_eq!(loaded.report.format, Format::MetaImage);
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(b"12345678".to_vec().into()));
    assert_eq!(loaded.volume.grid().volume_from_index().translation.to_array(), [1.0, 2.0, 3.0]);
    assert!(loaded.report.notes.is_empty(), "{:?}", loaded.report.notes);
}

#[test]
fn what_the_header_does_not_say_is_noted() {
    let bare = "NDims = 3\r\nDimSize = 2 2 2\r\nElementType = MET_UCHAR\r\n";
    let loaded = load_ok(&local(bare));
    assert_noted(&loaded, "spacing is not in the file");
    assert_noted(&loaded, "orientation is not in the file");
}

#[test]
fn values_have_the_scale_of_the_header() {
    let scaled =
        format!("{HEADER}ElementToIntensityFunctionSlope = 0.5\nElementToIntensityFunctionOffset = -1000\n");
    assert_eq!(load_ok(&local(&scaled)).volume.channels()[0].value(0), f64::from(b'1') * 0.5 - 1000.0);
}

#[test]
fn fields_of_other_programs_are_passed_over() {
    let more = format!("Comment = of Mr. Nobody\n{HEADER}ITK_InputFilterName = MetaImageIO\n");
    load_ok(&local(&more));
}

#[test]
fn of_a_series_the_volume_that_was_asked_for_is_loaded() {
    let series = "NDims = 4\nDimSize = 2 2 1 2\nTransformMatrix = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\nOffset = 1 2 3 0\n\
                  ElementSpacing = 1 1 2 0.5\nElementType = MET_UCHAR\n";
    let loaded = load_ok(&local(series));
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(b"1234".to_vec().into()));
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [1.0, 1.0, 2.0]);
    assert_noted(&loaded, "a series of 2 volumes");
    let second = LoadOptions { time: 1, ..LoadOptions::default() };
    let loaded = load_bytes("test", &local(series), &second).unwrap();
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(b"5678".to_vec().into()));
    let sequence = Sequence { steps: 2, loaded: 1, step_secs: Some(0.5) };
    assert_eq!(loaded.report.sequence, Some(sequence));
    // Where only the voxels at the end of a file are said, they are those of all volumes.
    let header = format!("{series}HeaderSize = -1\nElementDataFile = a.raw\n");
    for (options, expected) in [(LoadOptions::default(), b"1234"), (second, b"5678")] {
        let loaded =
            load_parts("a.mhd", header.as_bytes(), &[("a.raw", b"before12345678")], &options).unwrap();
        assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(expected.to_vec().into()));
    }
}

#[test]
fn headers_that_cannot_be_are_refused() {
    let sizes = |sizes: &str| with("DimSize = 2 2 2", &format!("DimSize = {sizes}"));
    for wrong in ["2 2 0", "2 2 -2", "2 2 2147483648", "2 2", "2 2 2 2", "2 2 x"] {
        assert_field(&sizes(wrong), "DimSize", &[]);
    }
    assert!(matches!(sizes("32767 32767 32767"), LoadError::TooLarge { .. }));
    assert!(matches!(sizes("2 2 3"), LoadError::Truncated { expected: 12, found: 8, .. }));
    for wrong in ["2", "-1", "99999999999", "x"] {
        assert_field(&with("NDims = 3", &format!("NDims = {wrong}")), "NDims", &[]);
    }
    assert_field(&with("MET_UCHAR", "MET_UCHAR_ARRAY"), "ElementType", &["MET_UCHAR_ARRAY"]);
    assert_field(&with("ObjectType = Image", "ObjectType = Mesh"), "ObjectType", &["Mesh"]);
    assert_field(
        &with("NDims = 3", "NDims = 3\nElementNumberOfChannels = 3"),
        "ElementNumberOfChannels",
        &["3"],
    );
    assert_field(&with("NDims = 3", "NDims = 3\nNDims = 3"), "NDims", &["two"]);
    assert_field(&with("NDims = 3", "NDims = 3\nCompressedData = yes"), "CompressedData", &["yes"]);
    assert_field(&with("NDims = 3", "NDims = 3\nHeaderSize = -2"), "HeaderSize", &["-2"]);
    let slope = with("NDims = 3", "NDims = 3\nElementToIntensityFunctionSlope = 0");
    assert_field(&slope, "ElementToIntensityFunctionSlope", &[]);
    assert!(matches!(with("1 0 0 0 1 0 0 0 1", "1 0 0 1 0 0 0 0 1"), LoadError::Grid { .. }));
    assert!(matches!(load_err(HEADER.as_bytes()), LoadError::Truncated { what: "header", .. }));
    let bomb = with("NDims = 3", "NDims = 3\nCompressedData = True");
    assert!(matches!(bomb, LoadError::Damaged { what: "zlib data", .. }), "{bomb}");
}

#[test]
fn a_zlib_bomb_is_read_as_far_as_the_header_says() {
    let bomb = |header: &str| {
        let header = format!("{header}CompressedData = True\nElementDataFile = LOCAL\n");
        let mut packed = ZlibEncoder::new(header.into_bytes(), Compression::best());
        packed.write_all(&vec![7; 64 << 20]).unwrap();
        packed.finish().unwrap()
    };
    let file = bomb(HEADER);
    assert!(file.len() < 1 << 20);
    let loaded = load_ok(&file);
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(vec![7; 8].into()));
    assert_noted(&loaded, "65536 bytes or more after the voxels");
    // A header that promises more than packed bytes can hold is not believed: memory is taken for what they can.
    let error = load_err(&bomb(&HEADER.replace("2 2 2", "2048 2048 2048")));
    assert!(matches!(error, LoadError::Truncated { found, .. } if found == 64 << 20), "{error}");
}

#[test]
fn text_that_is_no_number_is_named() {
    let text = format!("BinaryData = False\n{HEADER}ElementDataFile = LOCAL\n1 2 3 4 5 6 7 x");
    let error = load_err(text.as_bytes());
    assert!(matches!(error, LoadError::Damaged { what: "text of numbers", .. }), "{error}");
    assert!(error.to_string().contains("\"x\""), "{error}");
    let short = load_err(text.replace(" x", "").as_bytes());
    assert!(matches!(short, LoadError::Truncated { expected: 8, found: 7, .. }), "{short}");
}

#[test]
fn files_beside_the_header_stay_in_its_folder() {
    let parts = |name: &str, beside: &[(&str, &[u8])]| {
        let header = format!("{HEADER}ElementDataFile = {name}\n");
        load_parts("a.mhd", header.as_bytes(), beside, &LoadOptions::default())
    };
    assert!(parts("a.raw", &[("a.raw", b"12345678")]).is_ok());
    assert!(matches!(parts("../a.raw", &[]), Err(LoadError::OutsideFolder { .. })));
    assert_field(&parts("a.mhd", &[]).unwrap_err(), "ElementDataFile", &["the header itself"]);
    assert_field(&parts("LIST\na\nb\nc", &[]).unwrap_err(), "ElementDataFile", &["2 files"]);
    assert_field(&parts("LIST 9D\na\nb", &[]).unwrap_err(), "ElementDataFile", &["LIST 9D"]);
    let loaded = parts("LIST 3D\na", &[("a", b"12345678")]).unwrap();
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8(b"12345678".to_vec().into()));
}
