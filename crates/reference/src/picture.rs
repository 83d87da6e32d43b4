//! Pixels, and pictures of them.

use crate::ReferenceError;

/// One pixel of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Colour times opacity (RGB), and opacity.
    pub rgba: [f64; 4],
    /// Distance from the eye along the ray, millimetres of the volume; `None` where the picture has no depth.
    pub depth_mm: Option<f64>,
}

impl Pixel {
    /// Nothing there.
    pub const NOTHING: Self = Self { rgba: [0.0; 4], depth_mm: None };
}

/// A picture in float64, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    pixels: Vec<Pixel>,
}

impl Picture {
    /// A picture of given pixels, rows from the top.
    ///
    /// # Errors
    /// If there is no pixel, or their number is not width times height.
    pub fn new(width: u32, height: u32, pixels: Vec<Pixel>) -> Result<Self, ReferenceError> {
        check(width, height, 1, "pixels", pixels.len())?;
        Ok(Self { width, height, pixels })
    }

    /// A picture of 8-bit samples, colour already multiplied by opacity, four bytes a pixel; without depth.
    ///
    /// # Errors
    /// If there is no pixel, or the bytes are not four times width times height.
    pub fn from_rgba8(width: u32, height: u32, bytes: &[u8]) -> Result<Self, ReferenceError> {
        check(width, height, 4, "bytes", bytes.len())?;
        let pixel =
            |p: &[u8]| Pixel { rgba: std::array::from_fn(|i| f64::from(p[i]) / 255.0), depth_mm: None };
        Ok(Self { width, height, pixels: bytes.chunks_exact(4).map(pixel).collect() })
    }

    /// A picture of float32 samples as a renderer leaves them: colour already multiplied by opacity, and distances in
    /// millimetres, of which those that are not finite, or not above 0, mean that there is none. An empty `depth_mm`
    /// gives no depth.
    ///
    /// # Errors
    /// If there is no pixel, or a buffer does not hold as many.
    pub fn from_f32(
        width: u32,
        height: u32,
        rgba: &[[f32; 4]],
        depth_mm: &[f32],
    ) -> Result<Self, ReferenceError> {
        check(width, height, 1, "colours", rgba.len())?;
        if !depth_mm.is_empty() {
            check(width, height, 1, "depths", depth_mm.len())?;
        }
        let depth = |i: usize| depth_mm.get(i).filter(|d| d.is_finite() && **d > 0.0).map(|&d| f64::from(d));
        let pixels = rgba
            .iter()
            .enumerate()
            .map(|(i, rgba)| Pixel { rgba: rgba.map(f64::from), depth_mm: depth(i) })
            .collect();
        Ok(Self { width, height, pixels })
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All pixels, rows from the top.
    #[must_use]
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// A pixel, counted from the upper left. Panics outside the picture, as a slice does.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> Pixel {
        assert!(x < self.width, "pixel {x} of a row of {}", self.width);
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// The picture before a background (RGB, 0 to 1): `colour + (1 - α) · background`, opacity 1, depth kept.
    #[must_use]
    pub fn over(&self, background: [f64; 3]) -> Self {
        let pixels = self.pixels.iter().map(|p| {
            let mixed = |i: usize| p.rgba[i] + (1.0 - p.rgba[3]) * background[i];
            Pixel { rgba: [mixed(0), mixed(1), mixed(2), 1.0], ..*p }
        });
        Self { width: self.width, height: self.height, pixels: pixels.collect() }
    }

    /// This picture with another one at its right.
    ///
    /// # Errors
    /// If they are not of one height.
    pub fn beside(&self, right: &Self) -> Result<Self, ReferenceError> {
        if self.height != right.height {
            let (first, second) = ((self.width, self.height), (right.width, right.height));
            return Err(ReferenceError::Sizes { first, second });
        }
        let rows = self.pixels.chunks_exact(self.width as usize);
        let rows = rows.zip(right.pixels.chunks_exact(right.width as usize));
        let pixels = rows.flat_map(|(left, right)| left.iter().chain(right)).copied().collect();
        Self::new(self.width + right.width, self.height, pixels)
    }

    /// The picture as 8-bit samples, rounded to the nearest and held to 0 to 1, four bytes a pixel.
    #[must_use]
    pub fn to_rgba8(&self) -> Vec<u8> {
        let byte = |x: f64| (x * 255.0).round().clamp(0.0, 255.0) as u8;
        self.pixels.iter().flat_map(|p| p.rgba.map(byte)).collect()
    }
}

fn check(
    width: u32,
    height: u32,
    each: usize,
    what: &'static str,
    found: usize,
) -> Result<(), ReferenceError> {
    if width == 0 || height == 0 {
        return Err(ReferenceError::Empty { width, height });
    }
    let expected = width as usize * height as usize * each;
    if found == expected {
        Ok(())
    } else {
        Err(ReferenceError::Length { what, width, height, expected, found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_must_hold_the_picture() {
        assert!(matches!(Picture::new(2, 2, vec![Pixel::NOTHING; 3]), Err(ReferenceError::Length { .. })));
        assert!(matches!(Picture::new(0, 2, vec![]), Err(ReferenceError::Empty { .. })));
        assert!(matches!(Picture::from_rgba8(1, 1, &[0; 3]), Err(ReferenceError::Length { .. })));
        assert!(matches!(
            Picture::from_f32(1, 1, &[[0.0; 4]], &[0.0; 2]),
            Err(ReferenceError::Length { what: "depths", .. })
        ));
    }

    #[test]
    fn eight_bits_survive_a_round_trip() {
        let bytes: Vec<u8> = (0..=255).collect();
        assert_eq!(Picture::from_rgba8(8, 8, &bytes).unwrap().to_rgba8(), bytes);
    }

    #[test]
    fn a_background_shows_where_the_picture_is_transparent() {
        let half = Pixel { rgba: [0.25, 0.0, 0.0, 0.5], depth_mm: Some(3.0) };
        let over = Picture::new(1, 1, vec![half]).unwrap().over([1.0, 0.5, 0.0]);
        assert_eq!(over.pixel(0, 0), Pixel { rgba: [0.75, 0.25, 0.0, 1.0], depth_mm: Some(3.0) });
    }

    #[test]
    fn a_depth_that_is_no_number_is_none() {
        for none in [f32::INFINITY, f32::NAN, 0.0] {
            let picture = Picture::from_f32(1, 1, &[[1.0; 4]], &[none]).unwrap();
            assert_eq!(picture.pixel(0, 0).depth_mm, None, "{none}");
        }
    }

    #[test]
    fn pictures_stand_side_by_side() {
        let one = |x: f64| Pixel { rgba: [x; 4], depth_mm: Some(x) };
        let left = Picture::new(2, 2, [1.0, 2.0, 3.0, 4.0].map(one).to_vec()).unwrap();
        let right = Picture::new(1, 2, [5.0, 6.0].map(one).to_vec()).unwrap();
        let both = left.beside(&right).unwrap();
        assert_eq!((both.width(), both.height()), (3, 2));
        assert_eq!(both.pixels(), [1.0, 2.0, 5.0, 3.0, 4.0, 6.0].map(one));
        assert!(matches!(
            left.beside(&Picture::new(1, 1, vec![one(0.0)]).unwrap()),
            Err(ReferenceError::Sizes { .. })
        ));
    }
}
