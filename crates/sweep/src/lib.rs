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
//! [`cost`] tells what a stereo frame costs and how near it comes to what the device can do at best; [`scaling`] how cost
//! grows with pixels, voxels, matter and headsets; [`first_use`] what frames in hand feel of a scene that is being made.
//!
//! This crate reads the clock, since it measures; it knows no network, no codec and no format of volumes or scenes.

mod cost;
mod errors;
mod exact;
mod first_use;
mod journal;
mod outcome;
mod phantom;
mod row;
mod scaling;
mod setting;
mod subject;
mod sweep;
mod timing;
mod turns;

pub use cost::{CostRow, Watched, cost};
pub use errors::{BesideDoubt, Depths, Errors};
pub use first_use::{FirstUse, first_use};
pub use outcome::{LevelBounds, Outcome};
pub use phantom::{PhantomError, phantom};
pub use row::Row;
pub use scaling::{PowerLaw, ScaleCurve, ScaleError, ScaleOptions, ScalePoint, Scaling, VolumeCost, scaling};
pub use setting::{Curve, Setting, cost_settings, settings};
pub use subject::Subject;
pub use sweep::{Options, Progress, Sweep, SweepError, this_program};
pub use timing::Spread;
pub use turns::Ratio;
