//! Reading.

use crate::PictureError;
use crate::npy::{from_npy, is_npy};
use image::{ColorType, DynamicImage, ImageFormat};
use reference::{Picture, Pixel};
use std::fs;
use std::path::Path;

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

/// What a file held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Float data: colour, opacity and depth.
    Data,
    /// A PNG with opacity, without depth.
    TransparentPng,
    /// A PNG without opacity: a picture before its background.
    OpaquePng,
}

/// A picture that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// Colours multiplied by opacity. An opaque PNG has opacity 1 everywhere.
    pub picture: Picture,
    /// What the file held.
    pub kind: Kind,
}

/// Reads a picture, whichever kind its first bytes say it is.
///
/// # Errors
/// If it cannot be read, is no picture, or has a sample that is no number.
pub fn load(path: &Path) -> Result<Loaded, PictureError> {
    let owned = || path.to_owned();
    let bytes = fs::read(path).map_err(|source| PictureError::Read { path: owned(), source })?;
    if is_npy(&bytes) {
        let picture = from_npy(&bytes).map_err(|source| PictureError::Data { path: owned(), source })?;
        return Ok(Loaded { picture, kind: Kind::Data });
    }
    if bytes.starts_with(PNG_MAGIC) {
        let image = image::load_from_memory_with_format(&bytes, ImageFormat::Png)
            .map_err(|source| PictureError::Png { path: owned(), source })?;
        return Ok(of_png(&image));
    }
    Err(PictureError::Unknown { path: owned(), begins: bytes.into_iter().take(8).collect() })
}

fn of_png(image: &DynamicImage) -> Loaded {
    let kind = if image.color().has_alpha() { Kind::TransparentPng } else { Kind::OpaquePng };
    let (width, height) = (image.width(), image.height());
    // PNG's colours are not multiplied by opacity.
    let pixel = |[r, g, b, a]: [f64; 4]| Pixel { rgba: [r * a, g * a, b * a, a], depth_mm: None };
    let deep =
        matches!(image.color(), ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16);
    let pixels: Vec<Pixel> = if deep {
        image.to_rgba16().pixels().map(|p| pixel(p.0.map(|x| f64::from(x) / 65535.0))).collect()
    } else {
        image.to_rgba8().pixels().map(|p| pixel(p.0.map(|x| f64::from(x) / 255.0))).collect()
    };
    // A decoded PNG has at least one pixel, and as many as its sides say.
    let picture = Picture::new(width, height, pixels).expect("a PNG of its own size");
    Loaded { picture, kind }
}
