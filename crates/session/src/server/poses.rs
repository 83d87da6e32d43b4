//! The newest pose, the motion behind it, and when its picture will be seen.

use super::{Prediction, ServerCounters};
use crate::convert::pose_from_wire;
use crate::time::{ClockOffset, HeadsetTime, ServerTime};
use spatial::{Pose, PoseAt, PoseError, Predictor};
use std::time::Duration;
use wire::{ClockReport, PoseSample};

/// A display time farther than this after the pose's arrival is taken for this.
const FARTHEST_DISPLAY: Duration = Duration::from_secs(1);
/// Time after which the least delay of a pose is forgotten.
const DELAY_WINDOW: Duration = Duration::from_secs(5);

/// The newest pose of a headset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReceivedPose {
    pub(super) sequence: u64,
    pub(super) sampled_at: HeadsetTime,
    pub(super) display_at: HeadsetTime,
    pub(super) received_at: ServerTime,
    pub(super) world_from_head: Pose,
}

/// Takes poses in any order and keeps the newest.
#[derive(Debug, Default)]
pub(super) struct PoseInbox {
    newest: Option<ReceivedPose>,
    /// Has taken the same poses.
    predictor: Predictor,
    rendered_sequence: Option<u64>,
    bad_in_a_row: u32,
    last_error: Option<PoseError>,
    clock: HeadsetClock,
}

impl PoseInbox {
    /// Takes a pose, or counts why not.
    pub(super) fn take(&mut self, now: ServerTime, sample: &PoseSample, counters: &mut ServerCounters) {
        let world_from_head = match pose_from_wire(&sample.world_from_head) {
            Ok(pose) => pose,
            Err(error) => {
                counters.poses_invalid += 1;
                self.bad_in_a_row = self.bad_in_a_row.saturating_add(1);
                self.last_error = Some(error);
                return;
            }
        };
        self.bad_in_a_row = 0;
        if self.newest.is_some_and(|newest| sample.sequence <= newest.sequence) {
            counters.poses_stale += 1;
            return;
        }
        counters.poses_taken += 1;
        let sampled_at = HeadsetTime::from_micros(sample.sampled_at_us);
        self.clock.see_pose(now, sampled_at);
        self.predictor.take(PoseAt { time_secs: sampled_at.as_secs(), pose: world_from_head });
        self.newest = Some(ReceivedPose {
            sequence: sample.sequence,
            sampled_at,
            display_at: HeadsetTime::from_micros(sample.display_at_us),
            received_at: now,
            world_from_head,
        });
    }

    pub(super) fn bad_in_a_row(&self) -> u32 {
        self.bad_in_a_row
    }

    pub(super) fn last_error(&self) -> Option<PoseError> {
        self.last_error
    }

    pub(super) fn learn_clock(&mut self, report: ClockReport) {
        self.clock.reported = Some(ClockOffset {
            server_minus_headset_us: report.server_minus_headset_us,
            error_us: u64::from(report.round_trip_us / 2),
        });
    }

    /// The newest pose, if no frame has been made for it.
    pub(super) fn fresh(&self) -> Option<ReceivedPose> {
        self.newest.filter(|newest| self.rendered_sequence.is_none_or(|rendered| newest.sequence > rendered))
    }

    /// A frame is made for the newest pose.
    pub(super) fn mark_rendered(&mut self) {
        self.rendered_sequence = self.newest.map(|newest| newest.sequence);
    }

    /// When the picture for `pose` will be shown, on the server's clock.
    pub(super) fn display_time(&self, pose: &ReceivedPose) -> ServerTime {
        self.clock.to_server(pose.display_at).clamp(pose.received_at, pose.received_at + FARTHEST_DISPLAY)
    }

    /// Where the head of the newest pose will be when its picture is shown.
    pub(super) fn predicted(&self, pose: &ReceivedPose, prediction: Prediction) -> Pose {
        let ahead = pose.display_at.since(pose.sampled_at).min(prediction.horizon);
        if !prediction.enabled || ahead.is_zero() {
            return pose.world_from_head;
        }
        self.predictor.predicted(ahead.as_secs_f64()).unwrap_or(pose.world_from_head)
    }
}

/// How a headset's clock stands, as well as the server can know: what the headset has learnt from pongs, and until
/// then the least difference between a pose's arrival and its time, which is too large by the shortest way up.
#[derive(Debug, Default)]
struct HeadsetClock {
    reported: Option<ClockOffset>,
    least_delay_us: Option<i64>,
    least_delay_before_us: Option<i64>,
    window_began_at: ServerTime,
}

impl HeadsetClock {
    fn see_pose(&mut self, now: ServerTime, sampled_at: HeadsetTime) {
        let delay = now.micros_since_headset(sampled_at);
        if now.since(self.window_began_at) > DELAY_WINDOW {
            self.window_began_at = now;
            self.least_delay_before_us = self.least_delay_us.take();
        }
        self.least_delay_us = Some(self.least_delay_us.map_or(delay, |least| least.min(delay)));
    }

    fn to_server(&self, time: HeadsetTime) -> ServerTime {
        let least = [self.least_delay_us, self.least_delay_before_us].into_iter().flatten().min();
        self.reported
            .or(least.map(|delay| ClockOffset { server_minus_headset_us: delay, error_us: u64::MAX }))
            .map_or(ServerTime::default(), |clock| clock.to_server(time))
    }
}

impl ServerTime {
    /// The two clocks' readings subtracted: their offset plus the time between the two moments.
    fn micros_since_headset(self, time: HeadsetTime) -> i64 {
        self.micros_since(ServerTime::from_micros(time.as_micros()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::{DQuat, DVec3};

    fn sample(sequence: u64, sampled_at_us: u64, x: f32) -> PoseSample {
        PoseSample {
            sequence,
            sampled_at_us,
            display_at_us: sampled_at_us.saturating_add(50_000),
            world_from_head: wire::Pose { position_m: [x, 0.0, 0.0], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] },
        }
    }

    fn taken(samples: &[PoseSample]) -> (PoseInbox, ServerCounters) {
        let (mut inbox, mut counters) = (PoseInbox::default(), ServerCounters::default());
        for sample in samples {
            inbox.take(ServerTime::from_micros(sample.sampled_at_us), sample, &mut counters);
        }
        (inbox, counters)
    }

    fn predicted_x(samples: &[PoseSample]) -> f64 {
        let (inbox, _) = taken(samples);
        inbox.predicted(&inbox.newest.unwrap(), Prediction::default()).position_m.x
    }

    #[test]
    fn the_newest_sequence_wins_whatever_the_order() {
        let (inbox, counters) = taken(&[
            sample(5, 50_000, 5.0),
            sample(4, 40_000, 4.0),
            sample(5, 50_000, 5.0),
            sample(7, 70_000, 7.0),
            sample(6, 60_000, 6.0),
        ]);
        assert_eq!(inbox.fresh().unwrap().sequence, 7);
        assert_eq!((counters.poses_taken, counters.poses_stale), (2, 3));
    }

    #[test]
    fn a_pose_is_fresh_until_a_frame_is_made_for_it() {
        let (mut inbox, mut counters) = taken(&[sample(1, 0, 0.0)]);
        inbox.mark_rendered();
        assert_eq!(inbox.fresh(), None);
        inbox.take(ServerTime::default(), &sample(2, 16_000, 0.0), &mut counters);
        assert!(inbox.fresh().is_some());
    }

    #[test]
    fn invalid_poses_are_counted_and_change_nothing() {
        let (mut inbox, mut counters) = taken(&[sample(1, 0, 1.0)]);
        let mut bad = sample(2, 16_000, f32::NAN);
        inbox.take(ServerTime::default(), &bad, &mut counters);
        bad.world_from_head = wire::Pose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 2.0] };
        inbox.take(ServerTime::default(), &bad, &mut counters);
        assert_eq!((inbox.bad_in_a_row(), counters.poses_invalid), (2, 2));
        assert_eq!(inbox.fresh().unwrap().sequence, 1);
        inbox.take(ServerTime::default(), &sample(2, 16_000, 1.0), &mut counters);
        assert_eq!(inbox.bad_in_a_row(), 0);
    }

    #[test]
    fn a_steady_walk_is_carried_on_to_the_display_time() {
        let walk: Vec<_> = (0..10).map(|i| sample(i, i * 16_667, i as f32 * 0.016_667)).collect();
        assert!((predicted_x(&walk) - (9.0 * 0.016_667 + 0.05)).abs() < 1e-4);
    }

    #[test]
    fn a_flood_of_poses_keeps_the_span_of_its_velocity() {
        let flood: Vec<_> = (0..20_000).map(|i| sample(i, i * 10, i as f32 * 1e-5)).collect();
        assert!((predicted_x(&flood) - (0.199_99 + 0.05)).abs() < 1e-3);
    }

    #[test]
    fn a_jump_of_the_tracking_is_not_carried_on() {
        let mut walk: Vec<_> = (0..10).map(|i| sample(i, i * 16_667, 0.0)).collect();
        walk.push(sample(10, 10 * 16_667, 3.0));
        assert_eq!(predicted_x(&walk), 3.0);
    }

    #[test]
    fn poses_after_a_gap_are_not_carried_on() {
        assert_eq!(predicted_x(&[sample(0, 0, 0.0), sample(1, 500_000, 0.5)]), 0.5);
    }

    #[test]
    fn a_turn_is_carried_on_but_not_beyond_the_horizon() {
        let mut inbox = PoseInbox::default();
        let mut counters = ServerCounters::default();
        for i in 0..5u64 {
            let turned = DQuat::from_rotation_y(i as f64 * 0.02);
            let mut sample = sample(i, i * 20_000, 0.0);
            sample.display_at_us = sample.sampled_at_us + 2_000_000;
            sample.world_from_head.orientation_xyzw = turned.to_array().map(|x| x as f32);
            inbox.take(ServerTime::default(), &sample, &mut counters);
        }
        let predicted = inbox.predicted(&inbox.newest.unwrap(), Prediction::default());
        let expected = Pose { position_m: DVec3::ZERO, orientation: DQuat::from_rotation_y(0.08 + 0.1) };
        assert!(predicted.angle_to(&expected) < 1e-6);
    }

    #[test]
    fn absurd_times_are_survived() {
        let mut absurd = sample(1, u64::MAX, 0.0);
        absurd.display_at_us = 0;
        let (inbox, _) = taken(&[sample(0, 0, 0.0), absurd, sample(2, 5, 0.0), sample(3, u64::MAX - 9, 1.0)]);
        let pose = inbox.newest.unwrap();
        inbox.predicted(&pose, Prediction::default());
        inbox.display_time(&pose);
    }

    #[test]
    fn a_display_time_is_known_before_and_after_the_clock_is() {
        let mut inbox = PoseInbox::default();
        let mut counters = ServerCounters::default();
        // The server's clock is 1 s ahead and the pose took 2 ms.
        inbox.take(ServerTime::from_micros(1_002_000), &sample(1, 0, 0.0), &mut counters);
        let pose = inbox.newest.unwrap();
        assert_eq!(inbox.display_time(&pose).as_micros(), 1_052_000);
        inbox.learn_clock(ClockReport { server_minus_headset_us: 1_000_000, round_trip_us: 4_000 });
        assert_eq!(inbox.display_time(&pose).as_micros(), 1_050_000);
        inbox.learn_clock(ClockReport { server_minus_headset_us: i64::MIN, round_trip_us: 0 });
        assert_eq!(inbox.display_time(&pose), pose.received_at);
    }
}
