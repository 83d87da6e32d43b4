//! From what headsets got to the report.

use crate::cli::Simulated;
use crate::machine;
use crate::terminal::say;
use anyhow::{Context as _, bail};
use headset::{FailedHeadset, HeadsetRun, ProcessUsage};
use report::{Clock, Counters, FrameRecord, Process, Run, RunReport, Server, StageNames, Verification};
use session::Stage;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Scale of the latency picture: two dots a point are sharp on every screen.
const PICTURE_SCALE: u32 = 2;

/// What is to be written when the run is over.
pub(crate) struct Reporting {
    title: String,
    started_at: String,
    report: Option<PathBuf>,
    frames_csv: Option<PathBuf>,
    latency_plot: Option<PathBuf>,
    json: bool,
}

impl Reporting {
    /// Notes when the run began.
    pub(crate) fn begin(arguments: &Simulated, title: &str) -> Self {
        Self {
            title: title.to_owned(),
            started_at: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            report: arguments.report.clone(),
            frames_csv: arguments.frames_csv.clone(),
            latency_plot: arguments.latency_plot.clone(),
            json: arguments.json,
        }
    }

    /// Writes and prints what was asked for; `verified` are pictures of the first headset.
    pub(crate) fn write(
        &self,
        headsets: &[HeadsetRun],
        took: Duration,
        usage: &ProcessUsage,
        verified: Option<Verification>,
    ) -> anyhow::Result<()> {
        let mut run = self.run(headsets, took, usage);
        if let Some(first) = run.headsets.first_mut() {
            first.verification = verified;
        }
        // That stages sum to their frame is no matter of luck: where they do not, no figure is worth printing.
        run.check()?;
        let report = RunReport::from(&run);
        if let Some(path) = &self.report {
            write(path, report.to_json().as_bytes())?;
        }
        if let Some(path) = &self.frames_csv {
            let mut csv = Vec::new();
            report::write_frames_csv(&run, &mut csv)?;
            write(path, &csv)?;
        }
        if let Some(path) = &self.latency_plot {
            write(path, &report::latency(&run).to_png(PICTURE_SCALE))?;
        }
        if self.json {
            say(report.to_json());
        } else {
            say(report);
        }
        Ok(())
    }

    fn run(&self, headsets: &[HeadsetRun], took: Duration, usage: &ProcessUsage) -> Run {
        let version = env!("CARGO_PKG_VERSION").to_owned();
        Run {
            title: self.title.clone(),
            started_at: self.started_at.clone(),
            seconds: took.as_secs_f64(),
            versions: [("holocast".to_owned(), version)].into(),
            machine: machine::facts(),
            server: headsets.iter().find_map(|h| h.session.as_ref()).map(|s| Server {
                name: s.server_name.clone(),
                address: s.server_address.clone(),
                protocol: s.protocol.clone(),
                codec: Some(s.codec.clone()),
                adapter: None,
                volume: None,
            }),
            processes: vec![Process {
                name: "headsets".into(),
                cpu_secs: usage.cpu_secs,
                rss_bytes: usage.rss_bytes,
                rss_peak_bytes: usage.rss_peak_bytes,
            }],
            stages: StageNames::new(Stage::ALL.map(Stage::name)),
            headsets: headsets.iter().map(headset_run).collect(),
        }
    }
}

fn headset_run(from: &HeadsetRun) -> report::HeadsetRun {
    let server = from.server_statistics.last();
    let counted = from.counters;
    report::HeadsetRun {
        name: from.name.clone(),
        device: from.device.clone(),
        eye_size_px: from.eye_size_px,
        trace: from.trace.clone(),
        started_at_secs: from.started_at_secs.unwrap_or_default(),
        seconds: from.seconds,
        asked_hz: from.asked_hz,
        // The stream tells steps as multiples of the quality's own.
        full_step_scale: 1.0,
        counters: Counters {
            rendered: server.map(|s| s.frames_rendered),
            sent: server.map(|s| s.frames_sent),
            reset: server.map(|s| s.frames_reset),
            skipped: server.map(|s| s.frames_skipped),
            received: counted.received,
            decoded: counted.decoded,
            late: counted.late,
            lost: counted.lost,
            stale: counted.stale,
            undecodable: counted.undecodable,
        },
        violations: from.violations.iter().map(|(kind, v)| ((*kind).to_owned(), v.count)).collect(),
        clock: from
            .clock
            .map(|c| Clock { server_minus_headset_us: c.server_minus_headset_us, error_us: c.error_us }),
        frames: from.frames.iter().filter_map(frame_record).collect(),
        verification: None,
    }
}

/// A frame from before the server's clock was known has no stages and is left out; it is counted all the same.
fn frame_record(from: &headset::FrameRecord) -> Option<FrameRecord> {
    let times = from.times?;
    Some(FrameRecord {
        frame: from.frame,
        decoded_at_secs: from.decoded_at_secs,
        stages_us: times.stages_us.to_vec(),
        clock_error_us: times.clock_error_us,
        pose_age_at_render_us: times.pose_age_at_render_us,
        pose_to_decoded_us: from.pose_to_decoded_us,
        lateness_us: from.lateness_us,
        bytes: from.bytes,
        key_frame: from.depends_on.is_none(),
        resolution_scale: f64::from(from.resolution_scale),
        step_scale: f64::from(from.step_scale),
        prediction_error_mm: from.prediction_error_mm,
        prediction_error_deg: from.prediction_error_deg,
        pose_to_shown_us: from.pose_to_shown_us,
        head_deg_per_sec: from.head_deg_per_sec,
        registration_px: from.registration_px,
        registration_deg: from.registration_deg,
    })
}

/// Pictures that are not of the view that their header says: shifted by more than a pixel as it was rendered. Rendering
/// fewer rays blurs a picture and the codec roughens it, but neither moves it.
fn misplaced(run: &HeadsetRun, verified: &Verification) -> Vec<String> {
    let scale_of = |number: u64| {
        let frame = run.frames.iter().find(|frame| frame.frame == number);
        frame.map_or(1.0, |frame| f64::from(frame.resolution_scale))
    };
    let misplaced = verified.frames.iter().filter_map(|frame| {
        let offset_px = frame.offset_px?;
        let most_px = 1.0 / scale_of(frame.frame).clamp(0.1, 1.0);
        (offset_px > most_px).then(|| {
            format!(
                "{}: frame {} is {offset_px:.2} pixels from the exact picture of its own view, expected at most \
                 {most_px:.2}; is the scene that of the server?",
                run.name, frame.frame
            )
        })
    });
    misplaced.collect()
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    fs::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Fails if a headset did not get what it asked for: the exit status tells scripts.
pub(crate) fn judge(
    runs: &[HeadsetRun],
    failed: &[FailedHeadset],
    verified: Option<&Verification>,
) -> anyhow::Result<()> {
    let mut wrong: Vec<String> = failed.iter().map(|f| format!("{}: {}", f.name, f.error)).collect();
    if let (Some(run), Some(verified)) = (runs.first(), verified) {
        wrong.extend(misplaced(run, verified));
        wrong.extend(verified.notes.iter().map(|note| format!("{}: {note}", run.name)));
    }
    for run in runs {
        for (kind, violations) in &run.violations {
            let example = violations.examples.first().map(String::as_str).unwrap_or_default();
            wrong.push(format!(
                "{}: {} frames with wrong {kind}, such as: {example}",
                run.name, violations.count
            ));
        }
        if run.frames.is_empty() {
            wrong.push(format!("{}: no frame was decoded", run.name));
        }
        if run.end.by != "us" {
            wrong.push(format!("{}: ended by {}: {}", run.name, run.end.by, run.end.reason));
        }
        wrong.extend(run.kept.errors.iter().map(|error| format!("{}: {error}", run.name)));
    }
    if !wrong.is_empty() {
        bail!("{}", wrong.join("\n  "));
    }
    Ok(())
}
