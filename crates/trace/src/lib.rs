//! Recorded head-pose traces: read from four formats, sampled at any time, placed in front of a hologram.
//!
//! A [`Trace`] is a head's poses over time, in `world` as [`spatial`] has it: metres, right-handed, +Y up, and a head
//! that looks along its own -Z. Its time begins at 0. Between poses, positions are interpolated linearly and
//! orientations along the great arc; at the end, [`Ending`] says what follows.
//!
//! `docs/trace-format.md` describes the formats and what is assumed about each.
//!
//! This crate knows no clock, no headset and no network.

mod error;
mod parse;
mod placed;
mod synthetic;
mod trace;

pub use error::{Place, TraceError};
pub use parse::Format;
pub use placed::Stand;
pub use synthetic::Orbit;
pub use trace::{Ending, Trace};

/// Longest file that is read, in bytes.
pub const LARGEST_FILE_BYTES: u64 = 64 << 20;
/// Most poses that a trace may have: three hours at 90 Hz.
pub const MOST_POSES: usize = 1_000_000;
