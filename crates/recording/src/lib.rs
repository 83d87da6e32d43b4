//! A stream of access units as a playable video file.
//!
//! The pictures are not coded again: the file (MP4, `avc1`) holds the access units that were sent, each with the time
//! at which it was shown, so that a recording shows what a headset got, when it got it.
//!
//! This crate knows no network and no picture; of H.264 it knows what `codec` tells it.

mod error;
mod movie;
mod recording;

pub use error::RecordingError;
pub use recording::{Recording, Summary};
