//! A headset whose head moves as a test says, event by event.

use crate::subject::CENTRE_IN_ROOM;
use crate::{TestServer, within};
use headset::{DecodedFrame, Headset, HeadsetEvent, HeadsetSettings};
use session::HeadsetTime;
use spatial::{DVec3, Pose};
use std::collections::VecDeque;
use std::fmt;
use std::time::{Duration, Instant};

/// From a pose to the display of its picture: more than a frame takes on a loaded machine, so that none is given up
/// for being late.
const LEAD: Duration = Duration::from_millis(400);

/// A head before the volume, a little above and to the right of it, from which it fills the picture.
#[must_use]
pub fn in_front() -> Pose {
    let eye = CENTRE_IN_ROOM + DVec3::new(0.12, 0.08, 0.95);
    Pose::looking_at(eye, CENTRE_IN_ROOM, DVec3::Y).expect("it does not look along up")
}

/// A headset that sends a pose each display interval while it waits.
pub struct Viewer {
    /// The headset itself.
    pub headset: Headset,
    /// The poses that were sent, by sequence.
    pub sent: Vec<(HeadsetTime, Pose)>,
    /// From a pose to the display of its picture.
    pub lead: Duration,
    head_at: Box<dyn Fn(f64) -> Pose + Send>,
    began_at: Instant,
    next_pose_at: Instant,
    period: Duration,
    /// What came while something else was waited for.
    others: VecDeque<HeadsetEvent>,
}

impl Viewer {
    /// Joins a room with a head that does not move.
    pub async fn join(room: &TestServer, name: &str) -> Self {
        Self::join_as(room, &room.headset(name), |_| in_front()).await
    }

    /// Joins a room with a head that moves: its pose so many seconds after the welcome.
    pub async fn join_as(
        room: &TestServer,
        settings: &HeadsetSettings,
        head_at: impl Fn(f64) -> Pose + Send + 'static,
    ) -> Self {
        let headset = Headset::connect(settings, room.pool(), Instant::now());
        let mut headset =
            within("a connection", headset).await.unwrap_or_else(|e| panic!("does not connect: {e}"));
        match within("a welcome", headset.next_event()).await {
            HeadsetEvent::Welcomed(_) => {}
            other => panic!("expected a welcome, found {other:?}"),
        }
        let now = Instant::now();
        Self {
            headset,
            sent: Vec::new(),
            lead: LEAD,
            head_at: Box::new(head_at),
            began_at: now,
            next_pose_at: now,
            period: Duration::from_secs_f32(1.0 / settings.device.refresh_hz),
            others: VecDeque::new(),
        }
    }

    /// What happens next, without an end of waiting. Poses go out meanwhile.
    pub async fn next_event(&mut self) -> HeadsetEvent {
        loop {
            tokio::select! {
                biased;
                () = tokio::time::sleep_until(self.next_pose_at.into()) => self.send_pose(),
                event = self.headset.next_event() => return event,
            }
        }
    }

    fn send_pose(&mut self) {
        let now = Instant::now();
        // What was slept through is not made up for.
        self.next_pose_at = (self.next_pose_at + self.period).max(now);
        let pose = (self.head_at)(now.duration_since(self.began_at).as_secs_f64());
        let sampled_at = self.headset.clock().now();
        if let Some(sequence) = self.headset.send_pose(sampled_at, sampled_at + self.lead, &pose) {
            assert_eq!(sequence, self.sent.len() as u64, "poses are numbered in order");
            self.sent.push((sampled_at, pose));
        }
    }

    /// The next frame of which something holds.
    pub async fn frame_with(
        &mut self,
        what: &str,
        mut wanted: impl FnMut(&DecodedFrame) -> bool,
    ) -> DecodedFrame {
        within(what, async {
            loop {
                match self.next_event().await {
                    HeadsetEvent::Frame(frame) if wanted(&frame) => return *frame,
                    HeadsetEvent::Frame(_) | HeadsetEvent::ServerStatistics(_) => {}
                    HeadsetEvent::Undecodable { header, error } => {
                        panic!("frame {} did not decode: {error}", header.frame)
                    }
                    HeadsetEvent::Disconnected(end) => panic!("waiting for {what}, disconnected: {end:?}"),
                    other => self.others.push_back(other),
                }
            }
        })
        .await
    }

    /// The frame after so many others.
    pub async fn frame_after(&mut self, others: usize) -> DecodedFrame {
        let mut left = others;
        self.frame_with("frames", |_| left.checked_sub(1).map(|less| left = less).is_none()).await
    }

    /// A frame that shows a scene and comes after so many others that do: the encoder has got over the change.
    pub async fn frame_of_scene(&mut self, revision: u32, others: usize) -> DecodedFrame {
        let mut left = others;
        let what = format!("frames of scene {revision}");
        self.frame_with(&what, |frame| {
            frame.received.header.scene_revision == revision
                && left.checked_sub(1).map(|less| left = less).is_none()
        })
        .await
    }

    /// A frame that shows a step of a series and comes after so many others in a row that do.
    pub async fn frame_of_step(&mut self, step: u32, others: usize) -> DecodedFrame {
        let mut in_a_row = 0;
        self.frame_with(&format!("frames of step {step}"), |frame| {
            in_a_row = if frame.received.header.time_step == step { in_a_row + 1 } else { 0 };
            in_a_row > others
        })
        .await
    }

    /// The next event that is no frame and no statistics.
    pub async fn notice(&mut self, what: &str) -> HeadsetEvent {
        if let Some(event) = self.others.pop_front() {
            return event;
        }
        within(what, async {
            loop {
                match self.next_event().await {
                    HeadsetEvent::Frame(_) | HeadsetEvent::ServerStatistics(_) => {}
                    other => return other,
                }
            }
        })
        .await
    }

    /// Says goodbye and waits for the end.
    pub async fn leave(mut self) {
        self.headset.goodbye();
        while !matches!(self.notice("the end").await, HeadsetEvent::Disconnected(_)) {}
    }
}

impl fmt::Debug for Viewer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Viewer").field("headset", &self.headset).finish_non_exhaustive()
    }
}
