//! A whole run, and the report of it.

use crate::check::Check;
use crate::headset::stage_times;
use crate::{
    Distribution, HeadsetReport, HeadsetRun, JsonError, Machine, Process, Server, StageNames, StageTimes,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name and version of the report's format, as `docs/report-format.md` describes it.
pub const FORMAT: &str = "holocast-report/1";

/// All that is known when a run is over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// What the run was, for people: the command, or the name of a demo.
    pub title: String,
    /// When it began, as RFC 3339 text in UTC, such as `2026-03-01T09:30:00Z`.
    pub started_at: String,
    /// How long it took, in seconds.
    pub seconds: f64,
    /// Versions of programs and libraries, by name.
    pub versions: BTreeMap<String, String>,
    /// The machine that ran the headsets.
    pub machine: Machine,
    /// The server; `None` if none was ever reached.
    pub server: Option<Server>,
    /// What the processes used.
    pub processes: Vec<Process>,
    /// The stages of each frame.
    pub stages: StageNames,
    /// The headsets, with their frames.
    pub headsets: Vec<HeadsetRun>,
}

/// The figures of a run, without its frames. Written as JSON or, by its `Display`, as tables of plain text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Always [`FORMAT`].
    pub format: String,
    /// What the run was, for people.
    pub title: String,
    /// When it began, as RFC 3339 text in UTC.
    pub started_at: String,
    /// How long it took, in seconds.
    pub seconds: f64,
    /// Versions of programs and libraries, by name.
    pub versions: BTreeMap<String, String>,
    /// The machine that ran the headsets.
    pub machine: Machine,
    /// The server.
    pub server: Option<Server>,
    /// What the processes used.
    pub processes: Vec<Process>,
    /// All headsets together.
    pub all: Everyone,
    /// Each headset.
    pub headsets: Vec<HeadsetReport>,
}

/// All headsets of a run together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Everyone {
    /// How many headsets.
    pub headsets: u64,
    /// Mean of the headsets' achieved rates, in frames a second; `None` if there was no headset.
    pub mean_hz: Option<f64>,
    /// The least of them.
    pub worst_hz: Option<f64>,
    /// The name of the headset that has it; the first of several.
    pub worst: Option<String>,
    /// The least rate over the mean, 0 to 1: 1 if all got the same. `None` if nobody got a frame.
    pub worst_over_mean: Option<f64>,
    /// Frames that were not what was asked for, of all headsets and kinds.
    pub violations: u64,
    /// Whether the frames' numbers hold together.
    pub check: Check,
    /// Each stage, in order, over all frames of all headsets.
    pub stages: Vec<StageTimes>,
    /// From the pose to the decoded picture, in microseconds.
    pub pose_to_decoded_us: Option<Distribution>,
    /// Age of the pose when the renderer began, in microseconds.
    pub pose_age_at_render_us: Option<Distribution>,
    /// Decoding minus predicted display time, in microseconds; positive is late.
    pub lateness_us: Option<Distribution>,
}

impl From<&Run> for RunReport {
    fn from(run: &Run) -> Self {
        let headsets: Vec<_> =
            run.headsets.iter().map(|headset| HeadsetReport::new(headset, &run.stages)).collect();
        Self {
            format: FORMAT.to_owned(),
            title: run.title.clone(),
            started_at: run.started_at.clone(),
            seconds: run.seconds,
            versions: run.versions.clone(),
            machine: run.machine.clone(),
            server: run.server.clone(),
            processes: run.processes.clone(),
            all: Everyone::new(run, &headsets),
            headsets,
        }
    }
}

impl RunReport {
    /// The report as indented JSON, in the form that `docs/report-format.md` describes, with a line break at its end.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Only a map with keys that are no text, or a failing writer, could fail; there is neither.
        serde_json::to_string_pretty(self).expect("a report is plain data") + "\n"
    }

    /// Reads what [`RunReport::to_json`] wrote. Fields that this version does not know are passed over.
    ///
    /// # Errors
    /// If it is not JSON, not a report, or of another format.
    pub fn from_json(json: &str) -> Result<Self, JsonError> {
        #[derive(Deserialize)]
        struct Format {
            format: String,
        }
        let Format { format: found } = serde_json::from_str(json)?;
        if found != FORMAT {
            return Err(JsonError::Format { found, expected: FORMAT });
        }
        Ok(serde_json::from_str(json)?)
    }

    /// The headset with the least achieved rate; the first of several. `None` if there is no headset.
    #[must_use]
    pub fn worst(&self) -> Option<&HeadsetReport> {
        worst(&self.headsets)
    }
}

fn worst(headsets: &[HeadsetReport]) -> Option<&HeadsetReport> {
    headsets.iter().min_by(|a, b| a.achieved_hz.total_cmp(&b.achieved_hz))
}

impl Everyone {
    fn new(run: &Run, headsets: &[HeadsetReport]) -> Self {
        let frames = || run.headsets.iter().flat_map(|headset| &headset.frames);
        let worst = worst(headsets);
        let mean_hz = worst.map(|_| {
            let sum: f64 = headsets.iter().map(|headset| headset.achieved_hz).sum();
            sum / headsets.len() as f64
        });
        let worst_hz = worst.map(|headset| headset.achieved_hz);
        Self {
            headsets: headsets.len() as u64,
            mean_hz,
            worst_hz,
            worst: worst.map(|headset| headset.name.clone()),
            worst_over_mean: mean_hz
                .zip(worst_hz)
                .filter(|(mean, _)| *mean > 0.0)
                .map(|(mean, worst)| worst / mean),
            violations: headsets.iter().flat_map(|headset| headset.violations.values()).sum(),
            check: headsets.iter().fold(Check::default(), |sum, headset| sum.plus(headset.check)),
            stages: stage_times(&run.stages, frames),
            pose_to_decoded_us: Distribution::of_whole(frames().map(|frame| frame.pose_to_decoded_us)),
            pose_age_at_render_us: Distribution::of_whole(frames().map(|frame| frame.pose_age_at_render_us)),
            lateness_us: Distribution::of_whole(frames().map(|frame| frame.lateness_us)),
        }
    }
}
