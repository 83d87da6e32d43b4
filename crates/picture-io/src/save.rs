//! Writing.

use crate::PictureError;
use crate::npy::{Precision, to_npy};
use image::{ImageFormat, RgbImage};
use reference::Picture;
use std::fs;
use std::path::Path;

/// Writes a picture's data.
///
/// # Errors
/// If the system refuses.
pub fn save_data(path: &Path, picture: &Picture, precision: Precision) -> Result<(), PictureError> {
    fs::write(path, to_npy(picture, precision))
        .map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

/// Writes a picture before a background (RGB, 0 to 1) as a PNG of 8 bits, rounded to nearest.
///
/// # Errors
/// If the system refuses.
pub fn save_png(path: &Path, picture: &Picture, background: [f64; 3]) -> Result<(), PictureError> {
    let rgba = picture.over(background).to_rgba8();
    let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|p| &p[..3]).copied().collect();
    let image =
        RgbImage::from_raw(picture.width(), picture.height(), rgb).expect("three bytes for each pixel");
    let mut bytes = Vec::new();
    image
        .write_to(&mut std::io::Cursor::new(&mut bytes), ImageFormat::Png)
        .map_err(|source| PictureError::Png { path: path.to_owned(), source })?;
    fs::write(path, bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
}
