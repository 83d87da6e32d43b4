//! A trace and the pose at any time of it.

use crate::{Format, LARGEST_FILE_BYTES, MOST_POSES, Place, TraceError, parse};
use spatial::{Pose, PoseAt};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Longest that a trace may be. Any clock may be the file's, one that counts from 1970 too: times are taken from the
/// first pose on.
pub(crate) const LONGEST_SECS: f64 = 10.0 * 366.0 * 86_400.0;

/// Step in which a stretch of a trace is looked through for a jump.
const STEP_SECS: f64 = 0.01;
/// Fastest that a head moves, in metres a second, and turns, in radians a second (1000°). What is faster is a jump in
/// the recording, such as where it begins anew.
const FASTEST_M_PER_SEC: f64 = 15.0;
const FASTEST_RAD_PER_SEC: f64 = 17.5;

/// What follows the end of a trace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// It begins anew: the head is at its last pose in one moment and at its first in the next. That jump is a
    /// teleport, unless the trace is made for it as [`Trace::orbit`] is.
    Loop,
    /// It stays at the last pose.
    #[default]
    Hold,
    /// It plays backwards to its beginning, then forwards again: no jump, but a sudden reversal.
    PingPong,
}

/// A head's poses over time. There is at least one; the first is at 0 seconds, and each is later than the one before.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    pub(crate) name: String,
    pub(crate) format: Format,
    pub(crate) poses: Vec<PoseAt>,
    pub(crate) duplicates: usize,
}

impl Trace {
    /// Reads a file, in whichever of the formats it is.
    ///
    /// # Errors
    /// If the file cannot be read, is longer than 64 MiB, or is no trace: see [`Trace::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, TraceError> {
        let path = path.as_ref();
        let file_error = |source| TraceError::File { path: path.to_owned(), source };
        let mut bytes = Vec::new();
        // Read no more than one byte too many, whatever the file system says about its length.
        File::open(path)
            .and_then(|file| file.take(LARGEST_FILE_BYTES + 1).read_to_end(&mut bytes))
            .map_err(file_error)?;
        Self::parse(&path.display().to_string(), &bytes)
    }

    /// Reads a trace from memory, in whichever of the formats it is. `name` is for messages.
    ///
    /// Poses at the time of the one before are dropped and counted ([`Trace::duplicates`]).
    ///
    /// # Errors
    /// If it is longer than 64 MiB, no text, of no known format, has no pose or more than a million, a number or
    /// orientation that is none, or a time before the one before. The error names the line.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, TraceError> {
        parse::parse(name, bytes)
    }

    /// What it was called when it was read or made.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it was read from.
    #[must_use]
    pub const fn format(&self) -> Format {
        self.format
    }

    /// The poses, in order of time.
    #[must_use]
    pub fn poses(&self) -> &[PoseAt] {
        &self.poses
    }

    /// How many poses were dropped because they were at the time of the one before.
    #[must_use]
    pub const fn duplicates(&self) -> usize {
        self.duplicates
    }

    /// Seconds from the first pose to the last; 0 where there is one.
    #[must_use]
    pub fn duration_secs(&self) -> f64 {
        self.poses.last().map_or(0.0, |last| last.time_secs)
    }

    /// The pose at a time. Before 0 seconds, or where the time is NaN, it is the first one.
    #[must_use]
    pub fn sample(&self, time_secs: f64, ending: Ending) -> Pose {
        self.at(time_within(time_secs, self.duration_secs(), ending))
    }

    /// Whether the head jumps between two times, as no head does and nobody can foresee.
    #[must_use]
    pub fn jumps_between(&self, from_secs: f64, to_secs: f64, ending: Ending) -> bool {
        let mut pose = self.sample(from_secs, ending);
        let mut time_secs = from_secs;
        while time_secs < to_secs {
            time_secs += STEP_SECS;
            let next = self.sample(time_secs, ending);
            if (next.position_m - pose.position_m).length() > FASTEST_M_PER_SEC * STEP_SECS
                || next.angle_to(&pose) > FASTEST_RAD_PER_SEC * STEP_SECS
            {
                return true;
            }
            pose = next;
        }
        false
    }

    /// The pose at a time from 0 to the duration.
    fn at(&self, time_secs: f64) -> Pose {
        let next = self.poses.partition_point(|pose| pose.time_secs <= time_secs);
        // The first pose is at 0, so `next` is 0 for no time.
        let earlier = &self.poses[next.saturating_sub(1)];
        let Some(later) = self.poses.get(next) else { return earlier.pose };
        let fraction = (time_secs - earlier.time_secs) / (later.time_secs - earlier.time_secs);
        earlier.pose.interpolated(&later.pose, fraction)
    }

    /// The trace in our own format: one JSON object a line. What is written reads back as the same poses.
    #[must_use]
    pub fn to_json_lines(&self) -> String {
        parse::json_lines::write(&self.poses)
    }
}

/// Where in a trace a time is, once its ending is thought of.
fn time_within(time_secs: f64, duration_secs: f64, ending: Ending) -> f64 {
    if time_secs.is_nan() || time_secs <= 0.0 || duration_secs <= 0.0 {
        return 0.0;
    }
    let within = match ending {
        Ending::Hold => time_secs,
        Ending::Loop => time_secs % duration_secs,
        Ending::PingPong => {
            let there_and_back = time_secs % (2.0 * duration_secs);
            if there_and_back > duration_secs { 2.0 * duration_secs - there_and_back } else { there_and_back }
        }
    };
    // The remainder of an infinite time is no number: it counts as the end.
    if within.is_nan() { duration_secs } else { within.min(duration_secs) }
}

/// Gathers poses in order.
pub(crate) struct Collector<'a> {
    pub(crate) name: &'a str,
    poses: Vec<PoseAt>,
    first_secs: f64,
    duplicates: usize,
}

impl<'a> Collector<'a> {
    pub(crate) fn new(name: &'a str) -> Self {
        Self { name, poses: Vec::new(), first_secs: 0.0, duplicates: 0 }
    }

    /// Adds a pose at a time of the file's own clock.
    pub(crate) fn push(&mut self, place: Place, time_secs: f64, pose: Pose) -> Result<(), TraceError> {
        let name = || self.name.to_owned();
        if self.poses.is_empty() {
            self.first_secs = time_secs;
        }
        let since_first = time_secs - self.first_secs;
        if !since_first.is_finite() || since_first.abs() > LONGEST_SECS {
            return Err(TraceError::Time { name: name(), place, time_secs });
        }
        if let Some(previous) = self.poses.last() {
            if since_first < previous.time_secs {
                let previous_secs = previous.time_secs + self.first_secs;
                return Err(TraceError::Backwards { name: name(), place, time_secs, previous_secs });
            }
            if since_first <= previous.time_secs {
                self.duplicates += 1;
                return Ok(());
            }
        }
        if self.poses.len() == MOST_POSES {
            return Err(TraceError::TooManyPoses { name: name(), place, limit: MOST_POSES });
        }
        self.poses.push(PoseAt { time_secs: since_first, pose });
        Ok(())
    }

    pub(crate) fn finish(self, format: Format) -> Result<Trace, TraceError> {
        if self.poses.is_empty() {
            return Err(TraceError::Empty { name: self.name.to_owned() });
        }
        Ok(Trace { name: self.name.to_owned(), format, poses: self.poses, duplicates: self.duplicates })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use spatial::{DQuat, DVec3};

    /// Uneven steps: 0, 1, 3 seconds; x is the time, and the head turns left by 0.1 rad a second.
    fn uneven() -> Trace {
        let mut collector = Collector::new("uneven");
        for time_secs in [10.0f64, 11.0, 13.0] {
            let x = time_secs - 10.0;
            let pose =
                Pose { position_m: DVec3::new(x, 1.6, 0.0), orientation: DQuat::from_rotation_y(0.1 * x) };
            collector.push(Place::Line(1), time_secs, pose).unwrap();
        }
        collector.finish(Format::JsonLines).unwrap()
    }

    fn check(ending: Ending, time_secs: f64, expected_x: f64) {
        let pose = uneven().sample(time_secs, ending);
        assert!((pose.position_m.x - expected_x).abs() < 1e-9, "{ending:?} at {time_secs} s: {pose:?}");
        let turned = Pose { orientation: DQuat::from_rotation_y(0.1 * expected_x), ..Pose::IDENTITY };
        assert!(pose.angle_to(&turned) < 1e-9, "{ending:?} at {time_secs} s: {pose:?}");
    }

    #[test]
    fn poses_between_are_interpolated_over_uneven_steps() {
        for ending in [Ending::Hold, Ending::Loop, Ending::PingPong] {
            for x in [0.0, 0.25, 1.0, 1.5, 2.9] {
                check(ending, x, x);
            }
        }
    }

    #[test]
    fn each_ending_does_what_it_says() {
        check(Ending::Hold, 3.0, 3.0);
        check(Ending::Hold, 100.0, 3.0);
        check(Ending::Loop, 3.0, 0.0);
        check(Ending::Loop, 3.5, 0.5);
        check(Ending::Loop, 300.5, 0.5);
        check(Ending::PingPong, 3.0, 3.0);
        check(Ending::PingPong, 3.5, 2.5);
        check(Ending::PingPong, 6.0, 0.0);
        check(Ending::PingPong, 6.5, 0.5);
    }

    #[test]
    fn times_that_are_none_give_an_end() {
        for ending in [Ending::Hold, Ending::Loop, Ending::PingPong] {
            for (time_secs, expected_x) in
                [(-1.0, 0.0), (f64::NAN, 0.0), (f64::NEG_INFINITY, 0.0), (f64::INFINITY, 3.0)]
            {
                check(ending, time_secs, expected_x);
            }
        }
    }

    #[test]
    fn order_is_kept_and_duplicates_are_counted() {
        let mut collector = Collector::new("order");
        let mut push = |line, time_secs| collector.push(Place::Line(line), time_secs, Pose::IDENTITY);
        push(1, 5.0).unwrap();
        push(2, 5.0).unwrap();
        push(3, 6.0).unwrap();
        let error = push(4, 5.5).unwrap_err();
        assert_eq!(error.to_string(), "order, line 4: time 5.5 s after 6 s, expected a later one");
        assert!(matches!(push(5, f64::NAN), Err(TraceError::Time { .. })));
        assert!(matches!(push(6, 1e300), Err(TraceError::Time { .. })));
        let trace = collector.finish(Format::Tum).unwrap();
        assert_eq!((trace.poses().len(), trace.duplicates(), trace.duration_secs()), (2, 1, 1.0));
    }

    #[test]
    fn poses_have_a_limit() {
        let mut collector = Collector::new("long");
        for i in 0..MOST_POSES {
            collector.push(Place::Line(i), i as f64, Pose::IDENTITY).unwrap();
        }
        let error = collector.push(Place::Line(7), 1e6, Pose::IDENTITY).unwrap_err();
        assert_eq!(
            error.to_string(),
            "long, line 7: more than 1000000 poses, which is the limit for a trace"
        );
    }

    proptest! {
        #[test]
        fn ping_pong_never_jumps(time_secs in 0.0..100.0f64) {
            let trace = uneven();
            let step_secs = 1e-4;
            let here = trace.sample(time_secs, Ending::PingPong);
            let there = trace.sample(time_secs + step_secs, Ending::PingPong);
            prop_assert!((here.position_m - there.position_m).length() <= step_secs + 1e-9);
        }
    }
}
