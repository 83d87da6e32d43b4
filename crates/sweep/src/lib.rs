//! What each quality costs, and how far its picture is from the exact one.
//!
//! A sweep draws each [`Subject`] (a scene of a volume, seen by one eye) with each [`Setting`] and holds the picture
//! against the exact one, which the crate `reference` computes: [`Errors`]. A pixel that has several right answers in
//! float32 is counted apart, and only if it is proven to. Each frame is timed, with read-back and on the device.
//!
//! A sweep lives in a folder ([`Sweep::open`]). Exact pictures are kept there by what they show, so that none is computed
//! twice and a changed scene is noticed; each measurement is kept as soon as it is made, so that a sweep which was
//! interrupted goes on where it was. [`Outcome`] makes tables and plots of the measurements.
//!
//! This crate reads the clock, since it measures; it knows no network, no codec and no format of volumes or scenes.

mod errors;
mod exact;
mod journal;
mod outcome;
mod row;
mod setting;
mod subject;
mod sweep;
mod timing;

pub use errors::{BesideDoubt, Depths, Errors};
pub use outcome::{LevelBounds, Outcome};
pub use row::Row;
pub use setting::{Curve, Setting, settings};
pub use subject::Subject;
pub use sweep::{Options, Progress, Sweep, SweepError, this_program};
pub use timing::Spread;
