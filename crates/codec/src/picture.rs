//! Planar pictures in one buffer.

use std::ops::Range;

/// Largest width or height that a layout may have, in pixels. Far above what is encoded or decoded (see
/// [`crate::SettingsError`] and [`crate::SpsError`]); it keeps the arithmetic on sizes from overflowing.
const LARGEST_SIDE_PX: u32 = 16_384;

/// Where the three planes of a 4:2:0 picture lie in one buffer: Y, then U, then V, without gaps.
/// The chroma planes have half the width, half the height and half the stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneLayout {
    width_px: u32,
    height_px: u32,
    y_stride: usize,
}

/// Why a size, a stride or a buffer is not a picture's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// A side is odd: 4:2:0 has one chroma sample for two by two pixels.
    #[error("picture of {width_px}x{height_px} pixels has an odd side, expected both to be even")]
    Odd {
        /// Width in pixels.
        width_px: u32,
        /// Height in pixels.
        height_px: u32,
    },
    /// A side is zero or beyond any picture.
    #[error("picture of {width_px}x{height_px} pixels, expected sides of 2 to {LARGEST_SIDE_PX}")]
    Side {
        /// Width in pixels.
        width_px: u32,
        /// Height in pixels.
        height_px: u32,
    },
    /// Rows overlap, or the chroma stride would not be whole.
    #[error(
        "luma stride of {y_stride} bytes for a width of {width_px} pixels, expected an even number, at least the width"
    )]
    Stride {
        /// Width in pixels.
        width_px: u32,
        /// Luma stride in bytes.
        y_stride: usize,
    },
    /// The buffer is too short for the planes.
    #[error("picture buffer has {found} bytes, expected {expected}")]
    Length {
        /// Bytes that the planes take.
        expected: usize,
        /// Bytes that were given.
        found: usize,
    },
}

impl PlaneLayout {
    /// The layout that this project uses throughout, on the GPU too: the luma stride is the width rounded up to a
    /// multiple of 8, so that each chroma row begins at a multiple of 4 bytes and a shader can write whole words.
    ///
    /// # Errors
    /// If a side is zero, odd or larger than 16 384 pixels.
    pub fn packed(width_px: u32, height_px: u32) -> Result<Self, PictureError> {
        // Saturating, since the size is only checked next.
        Self::with_stride(width_px, height_px, (width_px.saturating_add(7) / 8 * 8) as usize)
    }

    /// A layout with another luma stride, in bytes.
    ///
    /// # Errors
    /// As [`PlaneLayout::packed`], and if the stride is odd, less than the width or more than four times the largest
    /// side.
    pub fn with_stride(width_px: u32, height_px: u32, y_stride: usize) -> Result<Self, PictureError> {
        if [width_px, height_px].iter().any(|side| !(1..=LARGEST_SIDE_PX).contains(side)) {
            return Err(PictureError::Side { width_px, height_px });
        }
        if !width_px.is_multiple_of(2) || !height_px.is_multiple_of(2) {
            return Err(PictureError::Odd { width_px, height_px });
        }
        if y_stride < width_px as usize
            || !y_stride.is_multiple_of(2)
            || y_stride > 4 * LARGEST_SIDE_PX as usize
        {
            return Err(PictureError::Stride { width_px, y_stride });
        }
        Ok(Self { width_px, height_px, y_stride })
    }

    /// Width in pixels; even.
    #[must_use]
    pub const fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Height in pixels; even.
    #[must_use]
    pub const fn height_px(&self) -> u32 {
        self.height_px
    }

    /// Bytes from one luma row to the next.
    #[must_use]
    pub const fn y_stride(&self) -> usize {
        self.y_stride
    }

    /// Bytes from one chroma row to the next.
    #[must_use]
    pub const fn uv_stride(&self) -> usize {
        self.y_stride / 2
    }

    /// Bytes of all three planes.
    #[must_use]
    pub const fn len_bytes(&self) -> usize {
        self.y_len() + 2 * self.uv_len()
    }

    /// The luma plane's bytes in the buffer.
    #[must_use]
    pub const fn y_range(&self) -> Range<usize> {
        0..self.y_len()
    }

    /// The blue-difference plane's bytes in the buffer.
    #[must_use]
    pub const fn u_range(&self) -> Range<usize> {
        self.y_len()..self.y_len() + self.uv_len()
    }

    /// The red-difference plane's bytes in the buffer.
    #[must_use]
    pub const fn v_range(&self) -> Range<usize> {
        self.y_len() + self.uv_len()..self.len_bytes()
    }

    const fn y_len(&self) -> usize {
        self.y_stride * self.height_px as usize
    }

    const fn uv_len(&self) -> usize {
        self.uv_stride() * (self.height_px as usize / 2)
    }
}

/// A picture in somebody else's buffer, such as a mapped GPU read-back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct YuvFrame<'a> {
    layout: PlaneLayout,
    bytes: &'a [u8],
}

impl<'a> YuvFrame<'a> {
    /// Looks at a buffer as a picture. Bytes beyond the planes are ignored: a read-back buffer may be padded.
    ///
    /// # Errors
    /// If the buffer is shorter than the layout.
    pub fn new(layout: PlaneLayout, bytes: &'a [u8]) -> Result<Self, PictureError> {
        let expected = layout.len_bytes();
        match bytes.get(..expected) {
            Some(bytes) => Ok(Self { layout, bytes }),
            None => Err(PictureError::Length { expected, found: bytes.len() }),
        }
    }

    /// Where the planes lie.
    #[must_use]
    pub const fn layout(&self) -> PlaneLayout {
        self.layout
    }

    /// All three planes.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The luma plane, 16 (black) to 235 (white).
    #[must_use]
    pub fn y(&self) -> &'a [u8] {
        &self.bytes[self.layout.y_range()]
    }

    /// The blue-difference plane, 16 to 240, 128 where grey.
    #[must_use]
    pub fn u(&self) -> &'a [u8] {
        &self.bytes[self.layout.u_range()]
    }

    /// The red-difference plane, 16 to 240, 128 where grey.
    #[must_use]
    pub fn v(&self) -> &'a [u8] {
        &self.bytes[self.layout.v_range()]
    }

    /// A copy that owns its buffer.
    #[must_use]
    pub fn to_picture(&self) -> YuvPicture {
        YuvPicture { layout: self.layout, bytes: self.bytes.to_vec() }
    }

    /// The picture as interleaved RGB, full range, sRGB coded, `3 * width * height` bytes from the upper left corner.
    /// Each chroma sample counts for its two by two pixels.
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        crate::colour::rgb8_from_yuv(*self)
    }
}

/// A picture that owns its buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct YuvPicture {
    layout: PlaneLayout,
    bytes: Vec<u8>,
}

impl YuvPicture {
    /// Takes a buffer for a picture, without copying it.
    ///
    /// # Errors
    /// If the buffer is not exactly as long as the layout.
    pub fn new(layout: PlaneLayout, bytes: Vec<u8>) -> Result<Self, PictureError> {
        let expected = layout.len_bytes();
        if bytes.len() != expected {
            return Err(PictureError::Length { expected, found: bytes.len() });
        }
        Ok(Self { layout, bytes })
    }

    /// A black picture.
    #[must_use]
    pub fn black(layout: PlaneLayout) -> Self {
        let mut bytes = vec![128; layout.len_bytes()];
        bytes[layout.y_range()].fill(16);
        Self { layout, bytes }
    }

    /// A packed picture from interleaved RGB (full range, sRGB coded, `3 * width * height` bytes). A chroma sample is
    /// the mean over its two by two pixels.
    ///
    /// # Errors
    /// If a side is odd, zero or too large, or the buffer has another length.
    pub fn from_rgb8(width_px: u32, height_px: u32, rgb: &[u8]) -> Result<Self, PictureError> {
        let layout = PlaneLayout::packed(width_px, height_px)?;
        let expected = 3 * width_px as usize * height_px as usize;
        if rgb.len() != expected {
            return Err(PictureError::Length { expected, found: rgb.len() });
        }
        Ok(Self { layout, bytes: crate::colour::yuv_from_rgb8(layout, rgb) })
    }

    /// Where the planes lie.
    #[must_use]
    pub const fn layout(&self) -> PlaneLayout {
        self.layout
    }

    /// The picture, borrowed.
    #[must_use]
    pub fn as_frame(&self) -> YuvFrame<'_> {
        YuvFrame { layout: self.layout, bytes: &self.bytes }
    }

    /// As [`YuvFrame::to_rgb8`].
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.as_frame().to_rgb8()
    }

    /// The buffer, to be filled again.
    #[must_use]
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_follow_each_other_without_gaps() {
        let layout = PlaneLayout::packed(90, 46).unwrap();
        assert_eq!((layout.y_stride(), layout.uv_stride()), (96, 48));
        assert_eq!(layout.y_range(), 0..96 * 46);
        assert_eq!(layout.u_range(), 96 * 46..96 * 46 + 48 * 23);
        assert_eq!(layout.v_range(), 96 * 46 + 48 * 23..layout.len_bytes());
        assert_eq!(layout.len_bytes(), 96 * 46 * 3 / 2);
    }

    #[test]
    fn refuses_odd_empty_and_enormous_sizes() {
        assert_eq!(
            PlaneLayout::packed(641, 180).unwrap_err().to_string(),
            "picture of 641x180 pixels has an odd side, expected both to be even"
        );
        assert!(matches!(PlaneLayout::packed(640, 181), Err(PictureError::Odd { .. })));
        assert!(matches!(PlaneLayout::packed(0, 180), Err(PictureError::Side { .. })));
        assert!(matches!(PlaneLayout::packed(640, u32::MAX - 1), Err(PictureError::Side { .. })));
        assert!(matches!(PlaneLayout::packed(u32::MAX, 2), Err(PictureError::Side { .. })));
    }

    #[test]
    fn refuses_strides_that_do_not_hold_a_row() {
        assert!(matches!(PlaneLayout::with_stride(640, 180, 638), Err(PictureError::Stride { .. })));
        assert!(matches!(PlaneLayout::with_stride(640, 180, 641), Err(PictureError::Stride { .. })));
        assert!(matches!(
            PlaneLayout::with_stride(640, 180, usize::MAX - 1),
            Err(PictureError::Stride { .. })
        ));
        assert_eq!(PlaneLayout::with_stride(640, 180, 768).unwrap().uv_stride(), 384);
    }

    #[test]
    fn a_padded_buffer_is_a_frame_and_a_short_one_is_not() {
        let layout = PlaneLayout::packed(16, 16).unwrap();
        let padded = vec![0; layout.len_bytes() + 100];
        assert_eq!(YuvFrame::new(layout, &padded).unwrap().bytes().len(), layout.len_bytes());
        let short = &padded[..layout.len_bytes() - 1];
        assert_eq!(YuvFrame::new(layout, short), Err(PictureError::Length { expected: 384, found: 383 }));
        assert!(YuvPicture::new(layout, padded).is_err());
    }

    #[test]
    fn black_is_black() {
        let black = YuvPicture::black(PlaneLayout::packed(18, 4).unwrap());
        assert!(black.to_rgb8().iter().all(|&value| value == 0));
    }
}
