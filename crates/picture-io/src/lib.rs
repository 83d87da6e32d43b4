//! A picture's files: float data, which hold all that a picture is, and PNG, which people look at.
//!
//! Data are NumPy's `.npy`: an array of shape `[height, width, 5]`, float32 or float64, rows from the top; red, green and
//! blue multiplied by opacity, opacity, and the depth in millimetres of the volume, NaN where there is none
//! (`docs/picture-format.md`). `numpy.load` opens them as they are.
//!
//! A file that is read is checked whole: its size, its header, and that colours are numbers. Nothing is allocated on a
//! header's word. This crate knows no renderer and no scene.

mod error;
mod load;
mod npy;
mod save;

pub use error::{NpyError, PictureError};
pub use load::{Kind, Loaded, load};
pub use npy::{Precision, from_npy, to_npy};
pub use save::{save_data, save_png};
