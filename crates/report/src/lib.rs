//! What a run of one or many headsets was, for people and for machines.
//!
//! A program that runs headsets fills a [`Run`]: facts, counters, and one [`FrameRecord`] for each decoded frame.
//! [`RunReport::from`] makes the figures: every stage's distribution, each headset's rate and quality, and the worst
//! of them. A report is written as JSON ([`RunReport::to_json`]) and as tables for a terminal (its `Display`);
//! the frames go into a table of their own ([`write_frames_csv`]).
//!
//! Times are in microseconds of one clock, the headset's; a field's name ends in its unit. This crate plots and counts:
//! it knows no network, no codec, no GPU and no clock. Its types are plain, so that whoever runs headsets fills them in.

mod check;
mod csv;
mod distribution;
mod error;
mod facts;
mod frame;
mod headset;
mod plot;
mod registration;
mod run;
mod table;
mod verification;

pub use check::Check;
pub use csv::{read_frames_csv, write_frames_csv};
pub use distribution::Distribution;
pub use error::{CheckError, CsvError, JsonError};
pub use facts::{Machine, Process, Server, Volume};
pub use frame::{FrameRecord, StageNames};
pub use headset::{BitRate, Clock, Counters, HeadsetReport, HeadsetRun, QualityGivenUp, StageTimes};
pub use plot::{Axis, Picture, Plot, Point, Scale, Sheet, Tile, latency, latency_of, pareto_front};
pub use registration::{Registration, RegistrationClass};
pub use run::{Everyone, FORMAT, Run, RunReport};
pub use verification::{PictureError, Verification, VerificationReport, VerifiedClass, VerifiedFrame};
