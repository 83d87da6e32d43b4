//! Why a file is no picture, or could not become one.

use std::path::PathBuf;

/// Why a picture could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The system would not read it.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// The system would not write it.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// It begins like neither kind of file.
    #[error("{}: neither a PNG nor NumPy data (.npy): it begins with {begins:02x?}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        begins: Vec<u8>,
    },
    /// It is no PNG that can be read, or could not be made one.
    #[error("{}: PNG: {source}", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: image::ImageError,
    },
    /// Its data are no picture.
    #[error("{}: {source}", path.display())]
    Data {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        source: NpyError,
    },
}

/// Why bytes are no picture's data.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NpyError {
    /// They end before the header does.
    #[error("the header is cut: {found} bytes, expected {expected}")]
    Cut {
        /// Bytes there are.
        found: usize,
        /// Bytes that the header needs.
        expected: usize,
    },
    /// They do not begin as NumPy's data do.
    #[error("not NumPy data: begins with {0:02x?}")]
    Magic(Vec<u8>),
    /// A version of the format that is not known.
    #[error("NumPy format {major}.{minor}, expected 1.0, 2.0 or 3.0")]
    Version {
        /// Before the dot.
        major: u8,
        /// After the dot.
        minor: u8,
    },
    /// The header is no dictionary of the three entries that the format has.
    #[error("the header {0:?} is not one of NumPy's: expected 'descr', 'fortran_order' and 'shape'")]
    Header(String),
    /// Numbers of another type.
    #[error("numbers of type '{0}', expected float32 or float64 ('<f4', '>f4', '<f8', '>f8')")]
    Type(String),
    /// Columns before rows.
    #[error("the array is in Fortran's order, expected C's: numpy.ascontiguousarray makes it so")]
    Order,
    /// An array of another shape.
    #[error(
        "an array of shape {found:?}, expected [height, width, 5]: red, green, blue (times opacity), opacity, depth"
    )]
    Shape {
        /// Its shape.
        found: Vec<u64>,
    },
    /// More or fewer bytes than the shape needs.
    #[error("{found} bytes of numbers, a picture of {width} by {height} has {expected}")]
    Length {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// Bytes after the header.
        found: usize,
        /// Bytes that the picture needs.
        expected: u128,
    },
    /// A colour or an opacity is NaN or infinite.
    #[error("pixel ({x}, {y}): {channel} is {found}, expected a finite number")]
    NotFinite {
        /// Pixel from the left.
        x: u32,
        /// Pixel from the top.
        y: u32,
        /// Which sample.
        channel: &'static str,
        /// What it is.
        found: f64,
    },
    /// A depth is infinite or not before the eye.
    #[error("pixel ({x}, {y}): depth is {found} mm, expected a number from 0 up, or NaN for none")]
    Depth {
        /// Pixel from the left.
        x: u32,
        /// Pixel from the top.
        y: u32,
        /// What it is.
        found: f64,
    },
}
