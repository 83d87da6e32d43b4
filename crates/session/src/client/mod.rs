//! The headset's end of a session.

mod clock;
mod delivery;
mod frame;
mod statistics;

use crate::close::{ClosedBy, Disconnection, bounded_reason};
use crate::convert::pose_to_wire;
use crate::device::Device;
use crate::pairing::PairingCode;
use crate::time::{ClockOffset, HeadsetTime, ServerTime};
use crate::timeline::{Arrival, FrameTimeline};
use clock::PingFilter;
use delivery::{Delivery, DeliveryOutcome};
use spatial::Pose;
use statistics::Averages;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;
use wire::{
    ClientDatagram, ClientMessage, CloseCode, ControlReader, EncodeError, Feedback, FrameHeader, Goodbye,
    Hello, PoseSample, ServerDatagram, ServerMessage, Welcome,
};

pub use frame::ReceivedFrame;
pub use statistics::ClientCounters;

/// Poses that may wait to be sent; the oldest are dropped.
const MAX_POSES: usize = 4;
/// Frames that were delivered and whose decoding has not been reported.
const MAX_UNREPORTED: usize = 64;

/// What the headset's end wants sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClientTransmit {
    /// Append these bytes to the control stream, which the headset opens first of all.
    Control(Vec<u8>),
    /// Send these bytes as a datagram.
    Datagram(Vec<u8>),
    /// Close the connection once the control stream has had a moment to get through. Nothing comes after this.
    Close {
        /// The application error code.
        code: CloseCode,
        /// Its text.
        reason: String,
    },
}

/// What has happened at the headset's end. Frames come by [`ClientSession::poll_frame`].
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server has accepted the hello. Poses may be sent.
    Welcomed(Welcome),
    /// The room shows another scene.
    SceneChanged {
        /// The request of this headset that this answers; `None` if another asked.
        request_id: Option<u32>,
        /// Frames that show the scene carry this.
        revision: u32,
        /// The scene as JSON, where the server tells it.
        scene_json: Option<String>,
    },
    /// The scene that this headset asked for is not shown.
    SceneRefused {
        /// The request that this answers.
        request_id: u32,
        /// What was expected and what was found.
        reason: String,
    },
    /// How the stream leaves, in the server's words. An older one that was not taken is replaced.
    ServerStatistics(wire::ServerStatistics),
    /// The session is over. The last event.
    Disconnected(Disconnection),
}

/// For how long the headset's end waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientSettings {
    /// For a welcome.
    pub welcome_timeout: Duration,
    /// For anything at all.
    pub idle_timeout: Duration,
    /// Time between two statistics messages.
    pub statistics_interval: Duration,
}

/// How decoding a frame went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decoding {
    /// When the decoder began.
    pub started_at: HeadsetTime,
    /// Whether it gave a picture.
    pub succeeded: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    AwaitingWelcome,
    Streaming,
    Closed,
}

/// A frame that was given to the decoder.
#[derive(Debug)]
struct Unreported {
    header: FrameHeader,
    completed_at: HeadsetTime,
}

/// The headset's end of a session. The crate's documentation tells how to drive it.
#[derive(Debug)]
pub struct ClientSession {
    settings: ClientSettings,
    phase: Phase,
    began_at: HeadsetTime,
    last_heard_at: HeadsetTime,
    control: ControlReader,
    pings: Option<PingFilter>,
    next_pose: u64,
    next_request: u32,
    delivery: Delivery,
    unreported: BTreeMap<u64, Unreported>,
    feedback: Feedback,
    is_feedback_due: bool,
    counters: ClientCounters,
    averages: Averages,
    statistics_at: Option<HeadsetTime>,
    outgoing_control: VecDeque<Vec<u8>>,
    outgoing_pings: VecDeque<Vec<u8>>,
    outgoing_poses: VecDeque<Vec<u8>>,
    close: Option<(CloseCode, String)>,
    events: VecDeque<ClientEvent>,
}

impl Default for ClientSettings {
    fn default() -> Self {
        Self {
            welcome_timeout: Duration::from_secs(10),
            idle_timeout: Duration::from_secs(5),
            statistics_interval: Duration::from_secs(1),
        }
    }
}

impl ClientSession {
    /// A session over a connection that has just been made. It begins with a hello.
    ///
    /// # Errors
    /// If the pairing code is too long for a message.
    pub fn new(
        now: HeadsetTime,
        device: &Device,
        pairing_code: &PairingCode,
        settings: ClientSettings,
    ) -> Result<Self, EncodeError> {
        let hello = ClientMessage::Hello(Hello {
            version: wire::PROTOCOL_VERSION,
            pairing_code: pairing_code.as_str().to_owned(),
            device: device.to_wire(),
        });
        Ok(Self {
            settings,
            phase: Phase::AwaitingWelcome,
            began_at: now,
            last_heard_at: now,
            control: ControlReader::new(),
            pings: None,
            next_pose: 0,
            next_request: 0,
            delivery: Delivery::default(),
            unreported: BTreeMap::new(),
            feedback: Feedback::default(),
            is_feedback_due: false,
            counters: ClientCounters::default(),
            averages: Averages::default(),
            statistics_at: None,
            outgoing_control: VecDeque::from([hello.encode()?]),
            outgoing_pings: VecDeque::new(),
            outgoing_poses: VecDeque::new(),
            close: None,
            events: VecDeque::new(),
        })
    }

    /// Whether the session is over. What is left to send and the last event are still to be taken.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// Whether the server has accepted this headset and the session is not over.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        self.phase == Phase::Streaming
    }

    /// Takes bytes of the control stream, in pieces of any size.
    pub fn handle_control(&mut self, now: HeadsetTime, bytes: &[u8]) {
        if self.is_closed() {
            return;
        }
        self.last_heard_at = now;
        self.control.push(bytes);
        while !self.is_closed() {
            let body = match self.control.next_body() {
                Ok(Some(body)) => body,
                Ok(None) => return,
                Err(error) => return self.close(now, CloseCode::BadMessage, &error.to_string()),
            };
            match ServerMessage::decode(body) {
                Ok(message) => self.handle_message(now, message),
                Err(error) => self.close(now, CloseCode::BadMessage, &error.to_string()),
            }
        }
    }

    fn handle_message(&mut self, now: HeadsetTime, message: ServerMessage) {
        match (self.phase, message) {
            (_, ServerMessage::Goodbye(Goodbye { code, reason })) => {
                self.end(Disconnection { by: ClosedBy::Peer, code, reason: bounded_reason(&reason) });
                self.close = Some((CloseCode::Goodbye, "goodbye".to_owned()));
            }
            (Phase::AwaitingWelcome, ServerMessage::Welcome(welcome)) => {
                if welcome.version != wire::PROTOCOL_VERSION {
                    let reason = format!(
                        "protocol version is {}, expected {}",
                        welcome.version,
                        wire::PROTOCOL_VERSION
                    );
                    return self.close(now, CloseCode::BadVersion, &reason);
                }
                self.phase = Phase::Streaming;
                self.pings = Some(PingFilter::new(now));
                self.send_due_ping(now);
                self.statistics_at = Some(now + self.settings.statistics_interval);
                self.events.push_back(ClientEvent::Welcomed(welcome));
            }
            (Phase::AwaitingWelcome, _) => {
                self.close(now, CloseCode::BadMessage, "first message is not a welcome, expected one");
            }
            (_, ServerMessage::Welcome(_)) => {
                self.close(now, CloseCode::BadMessage, "second welcome, expected one in a session");
            }
            (_, ServerMessage::SceneChanged { request_id, revision, scene_json }) => {
                // What was not taken of another headset's doing is overtaken by this.
                self.events
                    .retain(|event| !matches!(event, ClientEvent::SceneChanged { request_id: None, .. }));
                self.events.push_back(ClientEvent::SceneChanged { request_id, revision, scene_json });
            }
            (_, ServerMessage::SceneRefused { request_id, reason }) => {
                self.events.push_back(ClientEvent::SceneRefused { request_id, reason });
            }
            (_, ServerMessage::Statistics(statistics)) => {
                self.events.retain(|event| !matches!(event, ClientEvent::ServerStatistics(_)));
                self.events.push_back(ClientEvent::ServerStatistics(statistics));
            }
        }
    }

    /// Takes a datagram.
    pub fn handle_datagram(&mut self, now: HeadsetTime, bytes: &[u8]) {
        // A datagram may overtake the welcome; no ping was sent then, and so it answers none.
        let Some(pings) = self.pings.as_mut().filter(|_| self.phase == Phase::Streaming) else {
            return;
        };
        self.last_heard_at = now;
        match ServerDatagram::decode(bytes) {
            Ok(ServerDatagram::Pong(pong)) => {
                if !pings.take(now, &pong) {
                    self.counters.pongs_ignored += 1;
                }
            }
            Err(error) => self.close(now, CloseCode::BadMessage, &error.to_string()),
        }
    }

    /// Takes the whole content of a frame's stream.
    pub fn handle_frame(&mut self, now: HeadsetTime, stream: Vec<u8>) {
        // A frame may overtake the welcome: it is as good as any, and kept.
        if self.is_closed() {
            return;
        }
        self.last_heard_at = now;
        let frame = match ReceivedFrame::from_stream(now, stream) {
            Ok(frame) => frame,
            Err(error) => return self.close(now, CloseCode::BadMessage, &error.to_string()),
        };
        self.counters.frames_received += 1;
        self.counters.bytes_received += frame.stream_bytes() as u64;
        self.feedback.set_completed(frame.header.frame);
        let outcome = self.delivery.take(frame);
        self.count(outcome);
        self.is_feedback_due = true;
    }

    /// A frame's stream was reset by the server, after `part` of it had come. If `part` holds the frame's number, what
    /// hangs on it is given up at once; else that takes until it has waited too long.
    pub fn frame_stream_reset(&mut self, now: HeadsetTime, part: &[u8]) {
        if self.is_closed() {
            return;
        }
        self.last_heard_at = now;
        match wire::frame_number_of_part(part) {
            Some(number) => {
                let outcome = self.delivery.lose(number);
                self.count(outcome);
            }
            None => self.counters.frames_lost += 1,
        }
        self.is_feedback_due = true;
    }

    /// The next frame to decode. To be called when the decoder is free: frames that wait here can still be passed over
    /// by a newer key frame.
    pub fn poll_frame(&mut self) -> Option<ReceivedFrame> {
        if self.phase != Phase::Streaming {
            return None;
        }
        let frame = self.delivery.next_ready()?;
        if self.unreported.len() == MAX_UNREPORTED {
            self.unreported.pop_first();
        }
        let unreported = Unreported { header: frame.header.clone(), completed_at: frame.completed_at };
        self.unreported.insert(frame.header.frame, unreported);
        Some(frame)
    }

    /// Reports that the decoder is done with a frame at `now`. Returns where its time went, once the server's clock is
    /// known and if it gave a picture.
    pub fn frame_decoded(
        &mut self,
        now: HeadsetTime,
        number: u64,
        decoding: Decoding,
    ) -> Option<FrameTimeline> {
        let Unreported { header, completed_at } = self.unreported.remove(&number)?;
        self.is_feedback_due = true;
        if !decoding.succeeded {
            let outcome = self.delivery.fail(number);
            self.count(outcome);
            return None;
        }
        self.feedback.newest_decoded = self.feedback.newest_decoded.max(Some(number));
        self.counters.frames_decoded += 1;
        self.counters.frames_late += u64::from(now.as_micros() > header.display_at_us);
        self.averages.add_decode(now.since(decoding.started_at));
        let pose_to_decoded = now.micros_since(HeadsetTime::from_micros(header.pose_sampled_at_us));
        self.averages.add_pose_to_decoded(pose_to_decoded);
        let arrival = Arrival { completed_at, decode_started_at: decoding.started_at, decoded_at: now };
        Some(FrameTimeline::new(&header, &arrival, self.clock(now)?))
    }

    /// Reports that a frame made for a pose of `pose_sampled_at` was shown at `shown_at`; goes into the statistics.
    pub fn frame_shown(&mut self, pose_sampled_at: HeadsetTime, shown_at: HeadsetTime) {
        self.averages.add_motion_to_photon(shown_at.micros_since(pose_sampled_at));
    }

    /// Sends where the head was at `sampled_at` and when a picture for it is expected to be shown. Returns the pose's
    /// sequence; `None` before the welcome and after the end.
    pub fn send_pose(
        &mut self,
        _now: HeadsetTime,
        sampled_at: HeadsetTime,
        display_at: HeadsetTime,
        world_from_head: &Pose,
    ) -> Option<u64> {
        if self.phase != Phase::Streaming {
            return None;
        }
        let sequence = self.next_pose;
        self.next_pose += 1;
        self.counters.poses_sent += 1;
        if self.outgoing_poses.len() == MAX_POSES {
            self.outgoing_poses.pop_front();
        }
        self.outgoing_poses.push_back(
            ClientDatagram::Pose(PoseSample {
                sequence,
                sampled_at_us: sampled_at.as_micros(),
                display_at_us: display_at.as_micros(),
                world_from_head: pose_to_wire(world_from_head),
            })
            .encode(),
        );
        // Feedback may get lost: it goes again with every pose.
        self.is_feedback_due = true;
        Some(sequence)
    }

    /// Asks for another scene. The answer carries the number that this returns.
    ///
    /// # Errors
    /// If the scene is too large for a message.
    pub fn change_scene(&mut self, scene_json: &str) -> Result<u32, EncodeError> {
        let request_id = self.next_request;
        let bytes = ClientMessage::ChangeScene { request_id, scene_json: scene_json.to_owned() }.encode()?;
        self.next_request = self.next_request.wrapping_add(1);
        if !self.is_closed() {
            self.outgoing_control.push_back(bytes);
        }
        Ok(request_id)
    }

    /// How the server's clock stands; `None` before the first pong.
    #[must_use]
    pub fn clock(&self, now: HeadsetTime) -> Option<ClockOffset> {
        self.pings.as_ref()?.offset(now)
    }

    /// A moment of the server's clock on the headset's, as well as it is known at `now`; `None` before the first pong.
    #[must_use]
    pub fn server_time_to_headset(&self, now: HeadsetTime, time: ServerTime) -> Option<HeadsetTime> {
        Some(self.clock(now)?.to_headset(time))
    }

    /// What to send next; `None` if nothing is left to send now.
    pub fn poll_transmit(&mut self) -> Option<ClientTransmit> {
        if let Some(bytes) = self.outgoing_control.pop_front() {
            return Some(ClientTransmit::Control(bytes));
        }
        let datagram = self.outgoing_pings.pop_front().or_else(|| self.outgoing_poses.pop_front());
        if let Some(bytes) = datagram {
            return Some(ClientTransmit::Datagram(bytes));
        }
        if self.is_feedback_due && self.phase == Phase::Streaming {
            self.is_feedback_due = false;
            self.feedback.sequence += 1;
            self.feedback.key_frame_needed = self.delivery.is_key_frame_needed();
            return Some(ClientTransmit::Datagram(ClientDatagram::Feedback(self.feedback).encode()));
        }
        self.close.take().map(|(code, reason)| ClientTransmit::Close { code, reason })
    }

    /// What has happened; `None` if nothing has since the last call.
    pub fn poll_event(&mut self) -> Option<ClientEvent> {
        self.events.pop_front()
    }

    /// When to call [`Self::handle_timeout`] next, if nothing else happens; `None` once the session is over.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<HeadsetTime> {
        match self.phase {
            Phase::Closed => None,
            Phase::AwaitingWelcome => Some(self.began_at + self.settings.welcome_timeout),
            Phase::Streaming => [
                Some(self.last_heard_at + self.settings.idle_timeout),
                self.pings.as_ref().map(PingFilter::next_at),
                self.delivery.next_expiry(),
                self.statistics_at,
            ]
            .into_iter()
            .flatten()
            .min(),
        }
    }

    /// Does what the passing of time asks for: pings, statistics, giving up frames, and closing a server that is gone.
    pub fn handle_timeout(&mut self, now: HeadsetTime) {
        match self.phase {
            Phase::Closed => {}
            Phase::AwaitingWelcome => {
                if now >= self.began_at + self.settings.welcome_timeout {
                    let reason =
                        format!("no welcome within {} ms", self.settings.welcome_timeout.as_millis());
                    self.close(now, CloseCode::Idle, &reason);
                }
            }
            Phase::Streaming => {
                self.send_due_ping(now);
                let outcome = self.delivery.expire(now);
                if outcome != DeliveryOutcome::default() {
                    self.count(outcome);
                    self.is_feedback_due = true;
                }
                if self.statistics_at.is_some_and(|at| now >= at) {
                    self.statistics_at = Some(now + self.settings.statistics_interval);
                    self.send_statistics(now);
                }
                if now >= self.last_heard_at + self.settings.idle_timeout {
                    let reason = format!("nothing heard for {} ms", self.settings.idle_timeout.as_millis());
                    self.close(now, CloseCode::Idle, &reason);
                }
            }
        }
    }

    /// Ends the session in order.
    pub fn goodbye(&mut self, now: HeadsetTime) {
        self.close(now, CloseCode::Goodbye, "goodbye");
    }

    /// Ends the session with a goodbye of any code. Does nothing if it is over already.
    pub fn close(&mut self, _now: HeadsetTime, code: CloseCode, reason: &str) {
        if self.is_closed() {
            return;
        }
        let reason = bounded_reason(reason);
        self.send(&ClientMessage::Goodbye(Goodbye { code, reason: reason.clone() }));
        self.end(Disconnection { by: ClosedBy::Us, code, reason: reason.clone() });
        self.close = Some((code, reason));
    }

    /// The connection has ended by itself: the server closed it with `code`, or it broke without one. A close with a
    /// code that this version does not know is [`CloseCode::Internal`].
    pub fn handle_disconnect(&mut self, _now: HeadsetTime, code: Option<CloseCode>, reason: &str) {
        if self.is_closed() {
            return;
        }
        let by = if code.is_some() { ClosedBy::Peer } else { ClosedBy::Network };
        self.end(Disconnection { by, code: code.unwrap_or(CloseCode::Idle), reason: bounded_reason(reason) });
        self.outgoing_control.clear();
    }

    fn end(&mut self, disconnection: Disconnection) {
        self.phase = Phase::Closed;
        self.outgoing_pings.clear();
        self.outgoing_poses.clear();
        self.events.push_back(ClientEvent::Disconnected(disconnection));
    }

    fn send_due_ping(&mut self, now: HeadsetTime) {
        if let Some(ping) = self.pings.as_mut().and_then(|pings| pings.poll(now)) {
            // One that has not even left yet would only tell a wrong time.
            self.outgoing_pings.clear();
            self.outgoing_pings.push_back(ClientDatagram::Ping(ping).encode());
        }
    }

    fn send(&mut self, message: &ClientMessage) {
        let bytes = message.encode().expect("statistics and a goodbye with a bounded reason are small");
        self.outgoing_control.push_back(bytes);
    }

    fn count(&mut self, outcome: DeliveryOutcome) {
        self.counters.frames_stale += outcome.stale;
        self.counters.frames_lost += outcome.lost;
    }
}
