//! A headset that replays a recorded trace of poses.

use crate::check::{Checker, SentPose, Violation};
use crate::client::{DecodedFrame, Headset, HeadsetError, HeadsetEvent, HeadsetSettings, sleep_until};
use crate::clock::HeadsetClock;
use crate::decode::DecodePool;
use crate::display::DisplayTiming;
use crate::keep::{KeepError, KeepSettings, Keeper, Kept, Shown};
use crate::motion::TraceMotion;
use crate::registration::{Aside, registration};
use crate::run::{
    EndFacts, FrameRecord, HeadsetRun, PathFacts, RunCounters, SceneOutcome, SceneRequest,
    ServerStatisticsRecord, SessionFacts,
};
use session::{Disconnection, HeadsetTime, Stage};
use spatial::{DVec3, HeadGeometry};
use std::collections::{BTreeMap, VecDeque};
use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use trace::{Ending, Trace};

/// Time over which the head's speed is told.
const SPEED_OVER: Duration = Duration::from_millis(100);
/// Longest run, in place of an endless one.
const LONGEST: Duration = Duration::from_secs(10 * 366 * 86_400);

/// What a simulated headset does.
#[derive(Clone, Debug)]
pub struct SimulatedSettings {
    /// Its name in reports.
    pub name: String,
    /// Whom it connects to, and as what. `device.refresh_hz` is the rate at which it sends poses.
    pub headset: HeadsetSettings,
    /// How its head moves.
    pub trace: Arc<Trace>,
    /// What follows the trace's end.
    pub ending: Ending,
    /// Where in the trace it begins, in seconds.
    pub trace_offset_secs: f64,
    /// How long after the welcome its first pose is: sets headsets apart that come at once.
    pub phase: Duration,
    /// For how long it sends poses, in seconds.
    pub seconds: f64,
    /// The latency that it reckons with until it has measured it.
    pub first_latency: Duration,
    /// Scenes that it asks for.
    pub scene_changes: Vec<SceneChange>,
    /// What it writes to the disk.
    pub keep: KeepSettings,
    /// Points of the hologram, metres in the room, whose displacement it tells with each frame.
    pub anchors_in_world: Vec<DVec3>,
    /// Decoded pictures that it puts aside in [`HeadsetRun::sampled`], spread over the run; they stay in memory.
    pub sampled_frames: u32,
    /// When the run began: all times count from here.
    pub origin: Instant,
    /// Ends it before its time, with a goodbye, once this is true or its sender is gone; `None` if nobody will.
    pub stop: Option<watch::Receiver<bool>>,
    /// Where it tells how it goes.
    pub progress: Arc<Progress>,
}

/// A scene to ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneChange {
    /// When, in seconds after the first pose.
    pub at_secs: f64,
    /// The whole scene as JSON, not looked at.
    pub scene_json: String,
}

/// How a run goes while it goes.
#[derive(Debug, Default)]
pub struct Progress {
    decoded: AtomicU64,
    late: AtomicU64,
    violations: AtomicU64,
}

impl Progress {
    /// Frames decoded so far.
    #[must_use]
    pub fn decoded(&self) -> u64 {
        self.decoded.load(Ordering::Relaxed)
    }

    /// Frames decoded after their forecast display time so far.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late.load(Ordering::Relaxed)
    }

    /// Violations so far.
    #[must_use]
    pub fn violations(&self) -> u64 {
        self.violations.load(Ordering::Relaxed)
    }
}

impl SimulatedSettings {
    /// A headset that replays `trace` for 10 s, and keeps nothing on the disk.
    #[must_use]
    pub fn new(name: &str, headset: HeadsetSettings, trace: Arc<Trace>) -> Self {
        Self {
            name: name.to_owned(),
            headset,
            trace,
            ending: Ending::Hold,
            trace_offset_secs: 0.0,
            phase: Duration::ZERO,
            seconds: 10.0,
            first_latency: Duration::from_millis(50),
            scene_changes: Vec::new(),
            keep: KeepSettings::default(),
            anchors_in_world: Vec::new(),
            sampled_frames: 0,
            origin: Instant::now(),
            stop: None,
            progress: Arc::default(),
        }
    }
}

/// Why a simulated headset did not run.
#[derive(Debug, thiserror::Error)]
pub enum SimulatedError {
    /// It did not connect.
    #[error(transparent)]
    Headset(#[from] HeadsetError),
    /// What it is to write cannot be written.
    #[error(transparent)]
    Keep(#[from] KeepError),
}

/// A headset without hardware: its head moves as a trace says, and every frame is decoded and checked.
pub struct SimulatedHeadset {
    settings: SimulatedSettings,
    headset: Headset,
    clock: HeadsetClock,
    checker: Checker,
    timing: DisplayTiming,
    keeper: Option<Keeper>,
    aside: Vec<Aside>,
    /// From the first pose on.
    walk: Option<Walk>,
    /// Requests that wait for an answer, with their place in the run.
    requested: BTreeMap<u32, usize>,
    run: HeadsetRun,
}

/// The way of the head.
struct Walk {
    motion: TraceMotion,
    hz: f64,
    began_at: HeadsetTime,
    ends_at: HeadsetTime,
    next_tick: u64,
    scene_changes: VecDeque<SceneChange>,
    /// No more poses are sent.
    is_over: bool,
}

impl SimulatedHeadset {
    /// Connects.
    ///
    /// # Errors
    /// If the server is not reached, or what is to be kept cannot be written.
    pub async fn connect(settings: SimulatedSettings, pool: &DecodePool) -> Result<Self, SimulatedError> {
        let keeper = Keeper::start(&settings.name, &settings.keep)?;
        let headset = Headset::connect(&settings.headset, pool, settings.origin).await?;
        let device = &settings.headset.device;
        let hz = f64::from(device.refresh_hz);
        Ok(Self {
            clock: headset.clock(),
            checker: Checker::new(device.clone()),
            timing: DisplayTiming::new(Duration::from_secs_f64(1.0 / hz), settings.first_latency),
            keeper,
            aside: Vec::new(),
            walk: None,
            requested: BTreeMap::new(),
            run: HeadsetRun {
                name: settings.name.clone(),
                device: device.name.clone(),
                eye_size_px: [device.eye_width_px, device.eye_height_px],
                trace: settings.trace.name().to_owned(),
                asked_hz: hz,
                started_at_secs: None,
                seconds: 0.0,
                session: None,
                counters: RunCounters::default(),
                violations: BTreeMap::new(),
                clock: None,
                display_lead_us: 0,
                path: PathFacts::default(),
                stage_names: Stage::ALL.map(Stage::name).to_vec(),
                frames: Vec::new(),
                server_statistics: Vec::new(),
                scene_requests: Vec::new(),
                sampled: Vec::new(),
                kept: Kept::default(),
                end: EndFacts { by: "us", code: 0, reason: String::new() },
            },
            headset,
            settings,
        })
    }

    /// Runs to the end: until its time is over, it is stopped, or the connection ends.
    pub async fn run(mut self) -> HeadsetRun {
        let disconnection = loop {
            let walk = self.walk.as_ref().filter(|walk| !walk.is_over);
            let instant = |time| self.clock.instant(time);
            let tick_at = walk.map(|walk| instant(walk.tick_at(walk.next_tick)));
            let ends_at = walk.map(|walk| instant(walk.ends_at));
            let scene_at = walk.and_then(|walk| walk.next_scene_at()).map(instant);
            tokio::select! {
                // Poses before all else: a late pose is a late frame.
                biased;
                () = sleep_until(tick_at) => self.tick(),
                () = sleep_until(ends_at) => self.goodbye(),
                () = stopped(&mut self.settings.stop) => self.goodbye(),
                () = sleep_until(scene_at) => self.change_scene(),
                event = self.headset.next_event() => {
                    if let Some(disconnection) = self.handle(event) {
                        break disconnection;
                    }
                }
            }
        };
        self.finish(&disconnection).await
    }

    /// Sends where the head is now.
    fn tick(&mut self) {
        let Some(walk) = &mut self.walk else {
            return;
        };
        let now = self.clock.now();
        // Ticks that were slept through are not made up for: those poses are old.
        while walk.tick_at(walk.next_tick + 1) <= now {
            walk.next_tick += 1;
            self.run.counters.poses_skipped += 1;
        }
        let interval_began_at = walk.tick_at(walk.next_tick);
        walk.next_tick += 1;
        if now >= walk.ends_at {
            return;
        }
        // A timer is up to a millisecond late; the pose is where the head is then.
        let (pose, display_at) = (walk.motion.at(now), self.timing.display_at(interval_began_at));
        if let Some(sequence) = self.headset.send_pose(now, display_at, &pose) {
            self.checker.pose_sent(SentPose { sequence, sampled_at: now, display_at, pose });
        }
    }

    fn goodbye(&mut self) {
        self.end_walk();
        self.settings.stop = None;
        self.headset.goodbye();
    }

    fn end_walk(&mut self) {
        if let Some(walk) = self.walk.as_mut().filter(|walk| !walk.is_over) {
            // Frames that are still being decoded are checked against it, so it stays.
            walk.is_over = true;
            self.run.seconds = self.clock.now().min(walk.ends_at).since(walk.began_at).as_secs_f64();
        }
    }

    fn change_scene(&mut self) {
        let Some(change) = self.walk.as_mut().and_then(|walk| walk.scene_changes.pop_front()) else {
            return;
        };
        let outcome = match self.headset.change_scene(&change.scene_json) {
            Ok(request_id) => {
                self.requested.insert(request_id, self.run.scene_requests.len());
                SceneOutcome::Unanswered
            }
            Err(error) => SceneOutcome::NotSent { reason: error.to_string() },
        };
        self.run.scene_requests.push(SceneRequest { at_secs: self.now_secs(), outcome });
    }

    /// Returns the end, if this is it.
    fn handle(&mut self, event: HeadsetEvent) -> Option<Disconnection> {
        match event {
            HeadsetEvent::Welcomed(welcome) => {
                self.run.session = Some(SessionFacts {
                    server_address: self.settings.headset.server.clone(),
                    ..SessionFacts::from(&welcome)
                });
                let began_at = self.clock.now() + self.settings.phase;
                self.run.started_at_secs = Some(self.clock.secs_since_origin(began_at));
                self.walk = Some(Walk::new(&self.settings, began_at, self.run.asked_hz));
            }
            HeadsetEvent::Frame(frame) => self.frame(*frame),
            HeadsetEvent::Undecodable { header, error } => {
                self.run.counters.undecodable += 1;
                self.violated(&Violation::Undecodable { frame: header.frame, error });
            }
            HeadsetEvent::SceneChanged { request_id, revision, .. } => {
                let answered_at_secs = self.now_secs();
                let shown = SceneOutcome::Shown { revision, answered_at_secs, first_frame_at_secs: None };
                self.answered(request_id, shown);
            }
            HeadsetEvent::SceneRefused { request_id, reason } => {
                let answered_at_secs = self.now_secs();
                self.answered(Some(request_id), SceneOutcome::Refused { reason, answered_at_secs });
            }
            HeadsetEvent::ServerStatistics(statistics) => {
                let at_secs = self.now_secs();
                self.run.server_statistics.push(ServerStatisticsRecord::new(at_secs, &statistics));
            }
            HeadsetEvent::Disconnected(disconnection) => return Some(disconnection),
        }
        None
    }

    fn answered(&mut self, request_id: Option<u32>, outcome: SceneOutcome) {
        if let Some(index) = request_id.and_then(|request_id| self.requested.remove(&request_id)) {
            self.run.scene_requests[index].outcome = outcome;
        }
    }

    /// Checks a frame and writes it down.
    fn frame(&mut self, frame: DecodedFrame) {
        let DecodedFrame { received, picture, decode_started_at, decoded_at, timeline } = frame;
        let header = &received.header;
        // Frames come only after the welcome, with which the walk begins.
        let Some(walk) = &self.walk else {
            return;
        };
        let findings = self.checker.check(header, &received.view, &picture, &walk.motion);
        self.run.counters.at_jumps += u64::from(findings.crosses_jump);
        self.run.counters.without_depth += u64::from(!findings.has_depth);

        let sampled_at = HeadsetTime::from_micros(header.pose_sampled_at_us);
        let display_at = HeadsetTime::from_micros(header.display_at_us);
        self.timing.learn(decoded_at.since(sampled_at));
        // What comes too late is shown with the next display interval.
        let shown_at = display_at.max(walk.next_interval_after(decoded_at));
        let since_start_secs = decoded_at.since(walk.began_at).as_secs_f64();
        self.headset.frame_shown(sampled_at, shown_at);

        let truth = self.geometry().view(&walk.motion.at(shown_at));
        let can_be_known = !findings.crosses_jump && !walk.motion.jumps_between(sampled_at, shown_at);
        let registration =
            registration(&received.view, &truth, &self.settings.anchors_in_world, self.run.eye_size_px)
                .filter(|_| can_be_known);
        let turned = walk.motion.at(sampled_at).angle_to(&walk.motion.at(sampled_at + SPEED_OVER));
        let speed = turned.to_degrees() / SPEED_OVER.as_secs_f64();
        if self.is_sampled(since_start_secs) {
            self.aside.push(Aside::new(&received, truth, picture.clone()));
        }

        let secs = |time| self.clock.secs_since_origin(time);
        let record = FrameRecord {
            frame: header.frame,
            depends_on: header.depends_on,
            pose_sequence: header.pose_sequence,
            scene_revision: header.scene_revision,
            time_step: header.time_step,
            pose_sampled_at_secs: secs(sampled_at),
            display_at_secs: secs(display_at),
            decoded_at_secs: secs(decoded_at),
            lateness_us: decoded_at.micros_since(display_at),
            pose_to_decoded_us: decoded_at.micros_since(sampled_at),
            decode_us: decoded_at.micros_since(decode_started_at),
            times: timeline.as_ref().map(Into::into),
            bytes: received.access_unit().len() as u64,
            stream_bytes: received.stream_bytes() as u64,
            resolution_scale: header.quality.resolution_scale,
            step_scale: header.quality.step_scale,
            shading: header.quality.shading,
            prediction_error_mm: findings.prediction_error.map(|error| error.position_mm),
            prediction_error_deg: findings.prediction_error.map(|error| error.angle_deg),
            pose_to_shown_us: shown_at.micros_since(sampled_at),
            head_deg_per_sec: Some(speed).filter(|_| can_be_known),
            registration_px: registration.map(|registration| registration.px),
            registration_deg: registration.map(|registration| registration.angle_deg),
            violations: u32::try_from(findings.violations.len()).unwrap_or(u32::MAX),
        };
        for violation in &findings.violations {
            self.violated(violation);
        }
        self.settings.progress.decoded.fetch_add(1, Ordering::Relaxed);
        self.settings.progress.late.fetch_add(u64::from(record.lateness_us > 0), Ordering::Relaxed);
        self.note_first_frame(record.scene_revision, record.decoded_at_secs);
        if let Some(keeper) = &mut self.keeper {
            let shown = Shown {
                received: &received,
                pose_sampled_at_secs: record.pose_sampled_at_secs,
                display_at_secs: record.display_at_secs,
                decoded_at_secs: record.decoded_at_secs,
                since_start_secs,
                violations: findings.violations.iter().map(ToString::to_string).collect(),
            };
            keeper.take(&shown, picture);
        }
        self.run.frames.push(record);
    }

    fn geometry(&self) -> &HeadGeometry {
        &self.settings.headset.device.geometry
    }

    /// The first frame after the middle of each part of the run is put aside.
    #[expect(clippy::cast_precision_loss, reason = "a count of pictures")]
    fn is_sampled(&self, since_start_secs: f64) -> bool {
        let (taken, count) = (self.aside.len(), self.settings.sampled_frames);
        let part_secs = self.settings.seconds / f64::from(count.max(1));
        taken < count as usize && since_start_secs >= (taken as f64 + 0.5) * part_secs
    }

    /// The first frame that shows a scene that was asked for.
    fn note_first_frame(&mut self, shown_revision: u32, decoded_at_secs: f64) {
        for request in &mut self.run.scene_requests {
            if let SceneOutcome::Shown { revision, first_frame_at_secs: first @ None, .. } =
                &mut request.outcome
                && shown_revision >= *revision
            {
                *first = Some(decoded_at_secs);
            }
        }
    }

    fn violated(&mut self, violation: &Violation) {
        tracing::debug!(headset = %self.run.name, %violation, "a frame is not what was asked for");
        self.run.count_violation(violation);
        self.settings.progress.violations.fetch_add(1, Ordering::Relaxed);
    }

    fn now_secs(&self) -> f64 {
        self.clock.secs_since_origin(self.clock.now())
    }

    async fn finish(mut self, disconnection: &Disconnection) -> HeadsetRun {
        self.end_walk();
        let counted = self.headset.counters();
        let mut run = self.run;
        run.counters = RunCounters {
            poses_sent: counted.poses_sent,
            received: counted.frames_received,
            decoded: counted.frames_decoded,
            late: counted.frames_late,
            lost: counted.frames_lost,
            streams_reset: self.headset.streams_reset(),
            stale: counted.frames_stale,
            bytes_received: counted.bytes_received,
            ..run.counters
        };
        run.clock = self.headset.clock_offset().map(Into::into);
        run.path = self.headset.statistics().into();
        run.display_lead_us = u64::try_from(self.timing.lead().as_micros()).unwrap_or(u64::MAX);
        run.end = EndFacts::from(disconnection);
        run.sampled = self.aside.iter().map(Aside::sampled).collect();
        if let Some(keeper) = self.keeper {
            run.kept = keeper.finish().await;
        }
        run
    }
}

impl Walk {
    fn new(settings: &SimulatedSettings, began_at: HeadsetTime, hz: f64) -> Self {
        let mut scene_changes = settings.scene_changes.clone();
        scene_changes.sort_by(|a, b| a.at_secs.total_cmp(&b.at_secs));
        Self {
            motion: TraceMotion::new(
                settings.trace.clone(),
                settings.ending,
                began_at,
                settings.trace_offset_secs,
            ),
            hz,
            began_at,
            ends_at: began_at + duration(settings.seconds),
            next_tick: 0,
            scene_changes: scene_changes.into(),
            is_over: false,
        }
    }

    /// The beginning of a display interval.
    #[expect(clippy::cast_precision_loss, reason = "a count of frames")]
    fn tick_at(&self, tick: u64) -> HeadsetTime {
        self.began_at + duration(tick as f64 / self.hz)
    }

    /// The beginning of the first display interval that does not begin before `time`.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of frames")]
    fn next_interval_after(&self, time: HeadsetTime) -> HeadsetTime {
        self.tick_at((time.since(self.began_at).as_secs_f64() * self.hz).ceil() as u64)
    }

    fn next_scene_at(&self) -> Option<HeadsetTime> {
        self.scene_changes.front().map(|change| self.began_at + duration(change.at_secs))
    }
}

/// Seconds that a person gave: negative ones are none, and endless ones are very many.
fn duration(secs: f64) -> Duration {
    Duration::try_from_secs_f64(secs.max(0.0)).map_or(LONGEST, |duration| duration.min(LONGEST))
}

/// Waits until somebody wants the run to end.
async fn stopped(stop: &mut Option<watch::Receiver<bool>>) {
    match stop {
        // A sender that is gone cannot say anything else.
        Some(stop) => {
            let _ = stop.wait_for(|stop| *stop).await;
        }
        None => pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_seconds_is_a_duration() {
        assert_eq!(duration(1.5), Duration::from_millis(1500));
        assert_eq!(duration(-1.0), Duration::ZERO);
        assert_eq!(duration(f64::NAN), Duration::ZERO);
        assert_eq!(duration(f64::INFINITY), LONGEST);
        assert_eq!(duration(1e300), LONGEST);
    }
}
