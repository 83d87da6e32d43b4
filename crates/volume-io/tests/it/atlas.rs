//! Slice atlases.

use crate::{assert_field, assert_noted, shared};
use png::{BitDepth, ColorType};
use std::sync::OnceLock;
use volume::{ChannelKind, Voxels};
use volume_io::{Format, LoadError, LoadOptions, Loaded, load, load_parts};

fn encode(width: u32, height: u32, color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fastest);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

fn small(json: &str, png: &[u8]) -> Result<Loaded, LoadError> {
    load_parts("scan.png", png, &[("scan.json", json.as_bytes())], &LoadOptions::default())
}

/// 4 × 2 px RGBA: 2 × 1 tiles of 2 × 2. R counts pixels from 1, G is 10 more, B is 0, A is 255.
fn four_components() -> Vec<u8> {
    let data: Vec<u8> = (1..=8).flat_map(|i| [i, i + 10, 0, 255]).collect();
    encode(4, 2, ColorType::Rgba, BitDepth::Eight, &data)
}

const TILES: &str = r#"{"columns": 2, "rows": 1, "tile_px": [2, 2], "spacing_mm": [1, 2, 3]}"#;

/// A pixel of the full-size atlas: three slices in use, each component different.
fn holom3d_pixel(x: usize, y: usize) -> [u8; 4] {
    let slice = (y / 256) * 16 + x / 256;
    if slice >= 19 {
        return [0; 4];
    }
    [slice as u8 + 1, (x % 256) as u8, (y % 256) as u8, ((x + y) % 7) as u8]
}

fn holom3d() -> &'static [u8] {
    static PNG: OnceLock<Vec<u8>> = OnceLock::new();
    PNG.get_or_init(|| {
        let data: Vec<u8> = (0..4096 * 4096).flat_map(|i| holom3d_pixel(i % 4096, i / 4096)).collect();
        encode(4096, 4096, ColorType::Rgba, BitDepth::Eight, &data)
    })
}

#[test]
fn tiles_row_by_row_are_slices_and_components_are_channels() {
    let loaded = load_parts("scan.png", holom3d(), &[], &LoadOptions::default()).unwrap();
    assert_eq!(loaded.report.format, Format::Atlas);
    assert_noted(&loaded, "spacing is not in the file");
    assert_noted(&loaded, "237 empty slices after the first 19 are left out");
    assert_eq!(loaded.volume.grid().dims(), [256, 256, 19]);
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [1.0; 3]);
    let channels = loaded.volume.channels();
    let names: Vec<_> = channels.iter().map(|c| (c.name.as_str(), c.kind)).collect();
    let (intensity, label) = (ChannelKind::Intensity, ChannelKind::Label);
    assert_eq!(names, [("pet", intensity), ("ct", intensity), ("labels", label), ("spare", intensity)]);
    for (x, y, slice) in [(0, 0, 0), (255, 255, 15), (17, 200, 16), (100, 3, 18)] {
        let at = (slice * 256 + y) * 256 + x;
        let expected = holom3d_pixel((slice % 16) * 256 + x, (slice / 16) * 256 + y);
        for (channel, expected) in channels.iter().zip(expected) {
            assert_eq!(channel.value(at), f64::from(expected), "{} {x} {y} {slice}", channel.name);
        }
    }
}

#[test]
fn a_picture_of_another_size_names_both() {
    let error = load_parts("scan.png", &four_components(), &[], &LoadOptions::default()).unwrap_err();
    assert_field(
        &error,
        "size of the atlas",
        &["4096 × 4096 px (16 × 16 tiles of 256 × 256)", "found 4 × 2 px"],
    );
}

#[test]
fn a_json_beside_it_describes_other_tilings() {
    let loaded = small(TILES, &four_components()).unwrap();
    assert_eq!(loaded.volume.grid().dims(), [2, 2, 2]);
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [1.0, 2.0, 3.0]);
    assert_noted(&loaded, "the alpha component is 255 everywhere");
    let [pet, ct, labels] = loaded.volume.channels() else { panic!() };
    assert_eq!(pet.voxels, Voxels::U8(vec![1, 2, 5, 6, 3, 4, 7, 8].into()));
    assert_eq!(ct.voxels, Voxels::U8(vec![11, 12, 15, 16, 13, 14, 17, 18].into()));
    assert_eq!(labels.voxels, Voxels::U8(vec![0; 8].into()));
}

#[test]
fn a_json_names_channels_and_slices() {
    let json = r#"{"columns": 2, "rows": 1, "tile_px": [2, 2], "slices": 1, "spacing_mm": [1, 1, 1], "channels": [
        {"component": "A", "name": "mask", "kind": "label"},
        {"component": "G", "name": "ct", "slope": 16, "intercept": -1000}]}"#;
    let loaded = small(json, &four_components()).unwrap();
    let [mask, ct] = loaded.volume.channels() else { panic!() };
    assert_eq!((&mask.voxels, mask.kind), (&Voxels::U8(vec![255; 4].into()), ChannelKind::Label));
    assert_eq!((ct.value(0), ct.name.as_str()), (11.0 * 16.0 - 1000.0, "ct"));
    assert_eq!(loaded.report.notes, [""; 0]);
}

#[test]
fn equal_components_are_one_channel() {
    let data: Vec<u8> = (1..=8).flat_map(|i| [i; 4]).collect();
    let loaded = small(TILES, &encode(4, 2, ColorType::Rgba, BitDepth::Eight, &data)).unwrap();
    assert_noted(&loaded, "the 4 components of every pixel are equal");
    let [image] = loaded.volume.channels() else { panic!() };
    assert_eq!(
        (image.name.as_str(), &image.voxels),
        ("image", &Voxels::U8(vec![1, 2, 5, 6, 3, 4, 7, 8].into()))
    );
}

#[test]
fn components_that_differ_in_the_last_row_only_are_four_channels() {
    let mut data: Vec<u8> = (1..=8).flat_map(|i| [i; 4]).collect();
    data[7 * 4 + 1] = 99;
    let loaded = small(TILES, &encode(4, 2, ColorType::Rgba, BitDepth::Eight, &data)).unwrap();
    let [pet, ct, labels, spare] = loaded.volume.channels() else { panic!() };
    assert_eq!(pet.voxels, Voxels::U8(vec![1, 2, 5, 6, 3, 4, 7, 8].into()));
    assert_eq!(ct.voxels, Voxels::U8(vec![1, 2, 5, 6, 3, 4, 7, 99].into()));
    assert_eq!((&labels.voxels, &spare.voxels), (&pet.voxels, &pet.voxels));
}

#[test]
fn grey_of_sixteen_bits_is_uint16() {
    let data: Vec<u8> = (0..8u16).flat_map(|i| (i * 5000).to_be_bytes()).collect();
    let loaded = small(TILES, &encode(4, 2, ColorType::Grayscale, BitDepth::Sixteen, &data)).unwrap();
    let expected = [0, 5000, 20_000, 25_000, 10_000, 15_000, 30_000, 35_000];
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U16(expected.to_vec().into()));
}

#[test]
fn an_empty_atlas_keeps_one_slice() {
    let loaded = small(TILES, &encode(4, 2, ColorType::Rgba, BitDepth::Eight, &[0; 32])).unwrap();
    assert_eq!(loaded.volume.grid().dims(), [2, 2, 1]);
    assert_noted(&loaded, "1 empty slices after the first 1");
}

#[test]
fn descriptions_that_cannot_be_are_refused() {
    let with = |from: &str, to: &str| small(&TILES.replace(from, to), &four_components()).unwrap_err();
    assert_field(&with("\"columns\": 2", "\"columns\": 0"), "columns", &["found 0"]);
    assert_field(&with("[2, 2]", "[2, 2147483648]"), "tile_px[1]", &["2147483648"]);
    assert_field(&with("\"rows\": 1", "\"rows\": 3"), "size of the atlas", &["4 × 6 px", "4 × 2 px"]);
    assert_field(&with("}", ", \"slices\": 3}"), "slices", &["2 tiles", "found 3"]);
    assert_field(&with("}", ", \"channels\": []}"), "channels", &["1 to 4"]);
    assert!(matches!(with("rows", "lines"), LoadError::Json { .. }));
    let grey = encode(4, 2, ColorType::Grayscale, BitDepth::Eight, &[1; 8]);
    let json = TILES.replace('}', r#", "channels": [{"component": "G", "name": "ct"}]}"#);
    assert_field(&small(&json, &grey).unwrap_err(), "component", &["[R]", "found G"]);
}

#[test]
fn pictures_of_other_kinds_are_refused() {
    let bits = encode(8, 2, ColorType::Grayscale, BitDepth::One, &[0; 2]);
    let json = TILES.replace("[2, 2]", "[4, 2]");
    assert_field(&small(&json, &bits).unwrap_err(), "bit depth", &["8 or 16", "1 bits"]);
}

#[test]
fn a_png_that_ends_anywhere_is_an_error() {
    let whole = four_components();
    for length in 8..whole.len() {
        let error = small(TILES, &whole[..length]).unwrap_err();
        assert!(
            matches!(error, LoadError::Damaged { .. } | LoadError::Truncated { .. }),
            "{length}: {error}"
        );
    }
    let full = holom3d();
    let error = load_parts("scan.png", &full[..full.len() / 2], &[], &LoadOptions::default()).unwrap_err();
    assert!(matches!(error, LoadError::Damaged { .. }), "{error}");
}

#[test]
fn memory_is_bounded_by_the_caller_and_by_the_file() {
    let options = LoadOptions { max_bytes: 1 << 20, ..LoadOptions::default() };
    let error = load_parts("scan.png", holom3d(), &[], &options).unwrap_err();
    assert!(matches!(error, LoadError::TooLarge { found: 0x400_0000, .. }), "{error}");
    // A header of a full-size atlas, and hardly anything after it.
    let error = load_parts("scan.png", &holom3d()[..200], &[], &LoadOptions::default()).unwrap_err();
    assert!(matches!(error, LoadError::Truncated { found: 200, .. }), "{error}");
}

#[test]
fn the_teapot_is_one_channel() {
    let Some(path) = shared("atlas/teapot_atlas_4096.png") else { return };
    let loaded = load(&path, &LoadOptions::default()).unwrap();
    // Of its 178 slices the last two are empty, which nothing but a JSON can tell from tiles that are not in use.
    assert_eq!(loaded.volume.grid().dims(), [256, 256, 176]);
    assert_eq!(loaded.volume.channels().len(), 1);
    assert_noted(&loaded, "80 empty slices after the first 176");
    let png = std::fs::read(path).unwrap();
    let loaded = small(r#"{"slices": 178, "spacing_mm": [1, 1, 1]}"#, &png).unwrap();
    assert_eq!(loaded.volume.grid().dims(), [256, 256, 178]);
    assert_eq!(loaded.volume.channels().len(), 1);
}
