//! How far what a headset shows is from what it should show.
//!
//! A picture is made for where the head is thought to be when it is seen, and is seen where the head then is. So it can be
//! wrong in two ways, which are measured apart:
//!
//! - [`sweep`] replays a recorded head and tells the *registration error*: how far a point of the hologram seems to be from
//!   where it is, for each age of the pose and each speed of the head, with prediction and without.
//! - [`Exact`] makes the exact picture of a view, and [`Exact::verify`] holds a decoded picture against it: at the view
//!   that it was made for (what renderer and codec did to it) and at the view at display time (what the eye gets).
//!
//! This crate knows no network, GPU, codec or clock.

mod offset;
mod sweep;
mod verify;

pub use offset::offset_px;
pub use sweep::{Pair, Sample, SweepSettings, facing, sweep};
pub use verify::{Exact, PictureError, Shown, Verdict, VerifyError};
