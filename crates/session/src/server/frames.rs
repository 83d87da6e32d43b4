//! From the wish for a frame to its bytes.

use super::flow::Flow;
use super::{QueuedFrame, ServerEvent, ServerSession};
use crate::convert::view_to_wire;
use crate::server::Phase;
use crate::time::{HeadsetTime, ServerTime};
use spatial::StereoView;
use wire::{DepthGrid, EncodeError, Feedback, FrameHeader, Quality, StageTimes, encode_frame};

/// Frames that may be between [`ServerSession::begin_frame`] and their hand-over: one is rendered while another is
/// encoded.
const MAX_IN_PIPELINE: usize = 2;

/// A session's wish for a frame. It stands until [`ServerSession::begin_frame`] fulfils it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRequest {
    /// When the frame should be given to the network to be shown in time. Serve the earliest first.
    pub deadline: ServerTime,
    /// The newest pose. A newer one may come before the frame is begun.
    pub pose_sequence: u64,
}

/// When the pose of a frame was taken, came in, and is to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseTimes {
    /// Names the pose.
    pub sequence: u64,
    /// When the head was there.
    pub sampled_at: HeadsetTime,
    /// When the picture is expected to be shown.
    pub display_at: HeadsetTime,
    /// When the pose came in.
    pub received_at: ServerTime,
}

/// The right and duty to make one frame. Hand it back to [`ServerSession::frame_encoded`] or
/// [`ServerSession::frame_abandoned`]: the session makes at most two frames at a time.
#[derive(Debug, PartialEq)]
#[must_use = "a ticket that is not handed back blocks the session"]
pub struct FrameTicket {
    /// The frame's number; rises, with gaps.
    pub number: u64,
    /// What to render.
    pub view: StereoView,
    /// The pose that the view was predicted from.
    pub pose: PoseTimes,
    /// When the frame should be given to the network to be shown in time.
    pub deadline: ServerTime,
    /// When it was begun.
    pub begun_at: ServerTime,
    /// When it will be shown, on the server's clock.
    display_at: ServerTime,
}

/// What a frame needs to be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// Nothing: a key frame.
    None,
    /// The frame that was encoded before it.
    Previous,
    /// A frame that the encoder kept, such as a long-term reference.
    Frame(u64),
}

/// When a frame passed through the stages that lie outside the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderTimes {
    /// The renderer began.
    pub render_started: ServerTime,
    /// The renderer was done.
    pub rendered: ServerTime,
    /// The picture was converted and read back.
    pub converted: ServerTime,
    /// The encoder began.
    pub encode_started: ServerTime,
    /// The encoder was done.
    pub encoded: ServerTime,
}

/// A frame as it comes from the encoder.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedFrame<'a> {
    /// One H.264 access unit in Annex B form.
    pub access_unit: &'a [u8],
    /// What it needs to be decoded.
    pub reference: Reference,
    /// The scene that it shows.
    pub scene_revision: u32,
    /// Which volume of a series in time it shows, counted from 0.
    pub time_step: u32,
    /// When it passed through which stage.
    pub times: RenderTimes,
    /// What was spent on it.
    pub quality: Quality,
    /// How far away what it shows is.
    pub depth: DepthGrid,
}

/// What became of a frame that was handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameFate {
    /// It goes out with the next [`ServerSession::poll_transmit`].
    Sent,
    /// The headset could not decode it: a frame that it hangs on was given up while it was made. The next one must be
    /// a key frame.
    Undecodable,
    /// The session is over.
    Closed,
}

/// Frames that are being made.
#[derive(Debug, Default)]
pub(super) struct Pipeline {
    numbers: Vec<u64>,
    next_number: u64,
}

impl Pipeline {
    pub(super) fn len(&self) -> usize {
        self.numbers.len()
    }

    fn begin(&mut self) -> u64 {
        let number = self.next_number;
        self.next_number += 1;
        self.numbers.push(number);
        number
    }

    fn end(&mut self, number: u64) {
        self.numbers.retain(|n| *n != number);
    }
}

/// Why no frame can be begun although one is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HeldUpBy {
    Network,
    Renderer,
}

impl ServerSession {
    /// The session's wish for a frame, if it has one now: a pose that no frame was made for, a refresh interval since
    /// the last frame, fewer than two frames being made, and room in the window of frames under way.
    pub fn frame_request(&mut self, now: ServerTime) -> Option<FrameRequest> {
        if self.phase != Phase::Streaming {
            return None;
        }
        self.refill_budget(now);
        let pose = self.poses.fresh()?;
        if !self.budget.has_frame() || self.held_up_by().is_some() {
            return None;
        }
        Some(FrameRequest {
            deadline: self.deadline(self.poses.display_time(&pose)),
            pose_sequence: pose.sequence,
        })
    }

    /// Fulfils the wish: takes the newest pose, carries it on to its display time, and numbers the frame. To be called
    /// at the moment at which the renderer is free. `None` if there is no wish, as [`Self::frame_request`] tells.
    pub fn begin_frame(&mut self, now: ServerTime) -> Option<FrameTicket> {
        self.frame_request(now)?;
        let pose = self.poses.fresh()?;
        let geometry = self.device.as_ref()?.geometry;
        let world_from_head = self.poses.predicted(&pose, self.settings.prediction);
        let display_at = self.poses.display_time(&pose);
        self.poses.mark_rendered();
        self.budget.spend();
        self.counters.frames_begun += 1;
        Some(FrameTicket {
            number: self.pipeline.begin(),
            view: geometry.view(&world_from_head),
            pose: PoseTimes {
                sequence: pose.sequence,
                sampled_at: pose.sampled_at,
                display_at: pose.display_at,
                received_at: pose.received_at,
            },
            deadline: self.deadline(display_at),
            begun_at: now,
            display_at,
        })
    }

    /// Whether only a key frame can be sent. Ask right before encoding.
    #[must_use]
    pub fn next_must_be_key_frame(&self) -> bool {
        self.flow.must_be_key_frame()
    }

    /// The newest frame that the headset has decoded: what an encoder with long-term references may build on instead
    /// of a key frame, unless the headset itself asked for one.
    #[must_use]
    pub fn newest_decoded(&self) -> Option<u64> {
        self.flow.newest_decoded()
    }

    /// Takes a frame from the encoder and sends it, unless the headset could not decode it. Frames are to be encoded
    /// and handed over in the order of their numbers.
    ///
    /// # Errors
    /// If the frame is larger than the protocol allows. The next one must be a key frame then.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "a ticket is used up, so that no frame is handed over twice"
    )]
    pub fn frame_encoded(
        &mut self,
        now: ServerTime,
        ticket: FrameTicket,
        frame: EncodedFrame<'_>,
    ) -> Result<FrameFate, EncodeError> {
        self.refill_budget(now);
        self.pipeline.end(ticket.number);
        if self.is_closed() {
            return Ok(FrameFate::Closed);
        }
        self.counters.frames_rendered += 1;
        self.quality = frame.quality;
        let previous = self.flow.newest_encoded();
        let (depends_on, is_in_order) = match frame.reference {
            Reference::None => (None, true),
            Reference::Previous => (previous, previous.is_some()),
            Reference::Frame(number) => (Some(number), number < ticket.number),
        };
        let is_in_order = is_in_order && previous.is_none_or(|previous| previous < ticket.number);
        if !is_in_order || !self.flow.is_decodable(depends_on) {
            self.counters.frames_dropped += 1;
            self.watching_for_key_frame(|flow| flow.dropped(now, ticket.number, depends_on));
            return Ok(FrameFate::Undecodable);
        }
        let header = header(&ticket, &frame, depends_on);
        let bytes = match encode_frame(&header, frame.access_unit) {
            Ok(bytes) => bytes,
            Err(error) => {
                self.counters.frames_dropped += 1;
                self.watching_for_key_frame(|flow| flow.dropped(now, ticket.number, depends_on));
                return Err(error);
            }
        };
        self.counters.frames_sent += 1;
        self.counters.key_frames_sent += u64::from(depends_on.is_none());
        self.counters.bytes_sent += bytes.len() as u64;
        self.flow.sent(now, ticket.number, depends_on, ticket.display_at);
        self.outbox.frames.push_back(QueuedFrame { number: ticket.number, bytes });
        Ok(FrameFate::Sent)
    }

    /// Takes back the ticket of a frame that was given up before it reached the encoder. Nothing hangs on it.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "a ticket is used up, so that no frame is handed over twice"
    )]
    pub fn frame_abandoned(&mut self, now: ServerTime, ticket: FrameTicket) {
        self.refill_budget(now);
        self.pipeline.end(ticket.number);
        self.counters.frames_abandoned += 1;
    }

    pub(super) fn handle_feedback(&mut self, now: ServerTime, feedback: &Feedback) {
        self.refill_budget(now);
        let outcome = self.watching_for_key_frame(|flow| flow.take_feedback(now, feedback));
        self.counters.feedback_ignored += u64::from(outcome.ignored);
        self.counters.frames_completed += outcome.completed;
    }

    pub(super) fn reset_late_frames(&mut self, now: ServerTime) {
        for number in self.watching_for_key_frame(|flow| flow.reset_late(now)) {
            self.counters.frames_reset += 1;
            let queued = self.outbox.frames.len();
            self.outbox.frames.retain(|frame| frame.number != number);
            if self.outbox.frames.len() == queued {
                self.outbox.resets.push_back(number);
            }
        }
    }

    /// When the next frame is late or the peer has stalled, if nothing is heard before.
    pub(super) fn next_flow_timeout(&self) -> Option<ServerTime> {
        let stalled = self.flow.stalled_since().map(|since| since + self.settings.stall_timeout);
        [self.flow.next_late(), stalled].into_iter().flatten().min()
    }

    /// Does something to the flow and tells if only a key frame will do since then.
    fn watching_for_key_frame<T>(&mut self, act: impl FnOnce(&mut Flow) -> T) -> T {
        let before = self.flow.must_be_key_frame();
        let result = act(&mut self.flow);
        if self.flow.must_be_key_frame() && !before && !self.events.contains(&ServerEvent::KeyFrameNeeded) {
            self.events.push_back(ServerEvent::KeyFrameNeeded);
        }
        result
    }

    pub(super) fn refill_budget(&mut self, now: ServerTime) {
        let held_up_by = self.held_up_by();
        let wanted = self.phase == Phase::Streaming && held_up_by.is_some() && self.poses.fresh().is_some();
        let missed = self.budget.refill(now, wanted);
        match held_up_by {
            Some(HeldUpBy::Network) => self.counters.frames_skipped_for_network += missed,
            Some(HeldUpBy::Renderer) => self.counters.frames_skipped_for_renderer += missed,
            None => {}
        }
    }

    fn held_up_by(&self) -> Option<HeldUpBy> {
        if self.pipeline.len() >= MAX_IN_PIPELINE {
            Some(HeldUpBy::Renderer)
        } else if self.flow.in_window() + self.pipeline.len() >= self.flow.window() {
            Some(HeldUpBy::Network)
        } else {
            None
        }
    }

    /// When the next frame will be wanted, if no more pose comes.
    pub(super) fn next_frame_due(&self) -> Option<ServerTime> {
        let is_waiting =
            !self.budget.has_frame() && self.held_up_by().is_none() && self.poses.fresh().is_some();
        is_waiting.then(|| self.budget.next_frame_at())
    }

    fn deadline(&self, display_at: ServerTime) -> ServerTime {
        display_at - self.flow.round_trip().unwrap_or_default() / 2
    }
}

fn header(ticket: &FrameTicket, frame: &EncodedFrame<'_>, depends_on: Option<u64>) -> FrameHeader {
    let times = &frame.times;
    FrameHeader {
        frame: ticket.number,
        depends_on,
        scene_revision: frame.scene_revision,
        time_step: frame.time_step,
        pose_sequence: ticket.pose.sequence,
        pose_sampled_at_us: ticket.pose.sampled_at.as_micros(),
        display_at_us: ticket.pose.display_at.as_micros(),
        eyes: view_to_wire(&ticket.view),
        stages: StageTimes {
            pose_received_us: ticket.pose.received_at.as_micros(),
            render_started_us: times.render_started.as_micros(),
            rendered_us: times.rendered.as_micros(),
            converted_us: times.converted.as_micros(),
            encode_started_us: times.encode_started.as_micros(),
            encoded_us: times.encoded.as_micros(),
            // Stamped when it goes out.
            sent_us: times.encoded.as_micros(),
        },
        quality: frame.quality,
        depth: frame.depth.clone(),
        access_unit_bytes: u32::try_from(frame.access_unit.len()).unwrap_or(u32::MAX),
    }
}
