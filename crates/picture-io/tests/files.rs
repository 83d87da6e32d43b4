//! Files of both kinds, good and bad.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use image::{DynamicImage, LumaA, Rgb, Rgba};
use picture_io::{Kind, Precision, load, save_data, save_png};
use reference::{Picture, Pixel};
use std::fs;

fn half() -> Picture {
    let pixel = |i: u32| Pixel {
        rgba: [0.5, f64::from(i) / 255.0, 0.0, 0.5],
        depth_mm: (i > 1).then_some(f64::from(i) * 10.0),
    };
    Picture::new(4, 2, (0..8).map(pixel).collect()).unwrap()
}

#[test]
fn data_keep_everything() {
    let folder = tempfile::tempdir().unwrap();
    // The name does not matter, the content does.
    let path = folder.path().join("picture.data");
    save_data(&path, &half(), Precision::Float64).unwrap();
    let loaded = load(&path).unwrap();
    assert_eq!((loaded.picture, loaded.kind), (half(), Kind::Data));
}

#[test]
fn a_png_shows_the_picture_before_its_background() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    save_png(&path, &half(), [0.0, 0.0, 1.0]).unwrap();
    let loaded = load(&path).unwrap();
    assert_eq!(loaded.kind, Kind::OpaquePng);
    let rgba = loaded.picture.pixel(3, 1).rgba;
    assert_eq!(rgba.map(|x| (x * 255.0).round()), [128.0, 7.0, 128.0, 255.0]);
}

#[test]
fn pngs_of_any_depth_are_read_with_their_opacity() {
    let folder = tempfile::tempdir().unwrap();
    let check = |name: &str, image: DynamicImage, kind: Kind, expected: [f64; 4]| {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        let loaded = load(&path).unwrap();
        assert_eq!(loaded.kind, kind, "{name}");
        for (found, expected) in loaded.picture.pixel(1, 1).rgba.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{name}: {found}, expected {expected}");
        }
    };
    let rgb = image::ImageBuffer::from_pixel(2, 2, Rgb([255u8, 51, 0]));
    check("rgb8.png", rgb.into(), Kind::OpaquePng, [1.0, 0.2, 0.0, 1.0]);
    let rgba = image::ImageBuffer::from_pixel(2, 2, Rgba([255u8, 51, 0, 51]));
    check("rgba8.png", rgba.into(), Kind::TransparentPng, [0.2, 0.04, 0.0, 0.2]);
    let deep = image::ImageBuffer::from_pixel(2, 2, Rgb([1u16, 65535, 6553]));
    check("rgb16.png", deep.into(), Kind::OpaquePng, [1.0 / 65535.0, 1.0, 6553.0 / 65535.0, 1.0]);
    let grey = image::ImageBuffer::from_pixel(2, 2, LumaA([51u8, 255]));
    check("grey.png", grey.into(), Kind::TransparentPng, [0.2, 0.2, 0.2, 1.0]);
}

#[test]
fn what_is_no_picture_is_named_with_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    save_png(&path("whole.png"), &half(), [0.0; 3]).unwrap();
    let png = fs::read(path("whole.png")).unwrap();
    fs::write(path("cut.png"), &png[..png.len() / 2]).unwrap();
    fs::write(path("text.png"), "this is no picture").unwrap();
    fs::write(path("empty.npy"), "").unwrap();
    fs::write(path("cut.npy"), b"\x93NUMPY\x01\x00\x76").unwrap();
    for (name, expected) in [
        ("nowhere.png", "cannot be read: No such file"),
        ("cut.png", "PNG:"),
        ("text.png", "neither a PNG nor NumPy data"),
        ("empty.npy", "neither a PNG nor NumPy data"),
        ("cut.npy", "the header is cut"),
    ] {
        let error = load(&path(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(expected), "{error}");
    }
    let error = save_png(&path("nowhere/picture.png"), &half(), [0.0; 3]).unwrap_err().to_string();
    assert!(error.contains("nowhere/picture.png: cannot be written"), "{error}");
}
