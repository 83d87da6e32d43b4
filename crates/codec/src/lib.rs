//! H.264 access units from planar pictures and back.
//!
//! A picture is planar YUV 4:2:0, 8 bit, in one buffer ([`PlaneLayout`] says where the planes lie). Its colours are sRGB
//! (so, of BT.709's primaries), by BT.709's matrix, in limited range, each chroma sample in the middle of its two by two
//! pixels; the stream says all of that of itself ([`ColourDescription`], [`ChromaSiting`]). An [`Encoder`] makes one [`AccessUnit`] of each picture, constrained baseline, in Annex B form; a
//! [`Decoder`] makes one picture of each access unit and never shows one that it knows to be damaged. There is no
//! reordering and no delay: picture in, access unit out, picture back.
//!
//! This crate is the only one that knows openh264. It knows no GPU, no network and no wire format.

mod access_unit;
mod bits;
mod colour;
mod decoder;
mod encoder;
mod nal;
mod picture;
mod sps;

pub use access_unit::{AccessUnit, ParameterSetError, ParameterSets};
pub use decoder::{DecodeError, Decoder, DecoderError};
pub use encoder::{Complexity, EncodeError, Encoder, EncoderSettings, SettingsError};
pub use nal::{NalKind, NalUnit, nal_units};
pub use picture::{PictureError, PlaneLayout, YuvFrame, YuvPicture};
pub use sps::{ChromaSiting, ColourDescription, Sps, SpsError};
