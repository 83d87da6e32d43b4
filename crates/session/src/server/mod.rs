//! The server's end of one headset's session.

mod flow;
mod frames;
mod handshake;
mod pacing;
mod poses;
mod settings;
mod statistics;

use crate::close::{ClosedBy, Disconnection, bounded_reason};
use crate::device::Device;
use crate::time::ServerTime;
use flow::Flow;
use frames::Pipeline;
use pacing::FrameBudget;
use poses::PoseInbox;
use std::collections::VecDeque;
use wire::{
    ClientDatagram, ClientMessage, CloseCode, ControlReader, Goodbye, PoseSample, ServerDatagram,
    ServerMessage,
};

pub use frames::{EncodedFrame, FrameFate, FrameRequest, FrameTicket, PoseTimes, Reference, RenderTimes};
pub use settings::{Prediction, ServerSettings, StreamTerms};
pub use statistics::ServerCounters;

/// Invalid poses in a row after which a peer is taken for broken.
const BAD_POSES_BEFORE_CLOSE: u32 = 100;
/// Scene requests that may wait for the server to take them; further ones are refused.
const MAX_SCENE_REQUESTS: usize = 8;
/// Pongs that may wait to be sent; the oldest are dropped, as the headset asks again.
const MAX_PONGS: usize = 8;

/// What the server's end wants sent.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerTransmit {
    /// Append these bytes to the control stream.
    Control(Vec<u8>),
    /// Send these bytes as a datagram.
    Datagram(Vec<u8>),
    /// Open a unidirectional stream of this priority, write these bytes and finish it.
    Frame {
        /// Names the stream, for [`ServerTransmit::ResetFrame`].
        number: u64,
        /// The stream's whole content.
        bytes: Vec<u8>,
        /// Higher goes first; rises with the frame's number.
        priority: i32,
    },
    /// Reset the stream of this frame, if it is not done yet.
    ResetFrame {
        /// The frame of an earlier [`ServerTransmit::Frame`].
        number: u64,
    },
    /// Close the connection once the control stream has had a moment to get through. Nothing comes after this.
    Close {
        /// The application error code.
        code: CloseCode,
        /// Its text.
        reason: String,
    },
}

/// What has happened at the server's end.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerEvent {
    /// A headset has said hello and may see. Answer with [`ServerSession::welcome`] or [`ServerSession::close`].
    Connected {
        /// What it is.
        device: Device,
    },
    /// The headset asks for another scene. Answer with [`ServerSession::scene_changed`] or
    /// [`ServerSession::scene_refused`].
    SceneRequested {
        /// Goes into the answer.
        request_id: u32,
        /// The whole scene as JSON, not looked at.
        scene_json: String,
    },
    /// From now on only a key frame can be sent; see [`ServerSession::next_must_be_key_frame`].
    KeyFrameNeeded,
    /// How the stream arrives, in the headset's words. An older one that was not taken is replaced.
    ClientStatistics(wire::ClientStatistics),
    /// The session is over. The last event.
    Disconnected(Disconnection),
}

/// The bytes that a frame's stream is named by when it is cut out of the queue.
#[derive(Debug)]
struct QueuedFrame {
    number: u64,
    bytes: Vec<u8>,
}

/// What is to be sent, in the order in which it goes.
#[derive(Debug, Default)]
struct Outbox {
    resets: VecDeque<u64>,
    pongs: VecDeque<Vec<u8>>,
    control: VecDeque<Vec<u8>>,
    frames: VecDeque<QueuedFrame>,
    close: Option<(CloseCode, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing but a hello is listened to.
    AwaitingHello,
    /// The headset may see; the server has not said what it will send.
    AwaitingWelcome,
    /// Frames flow.
    Streaming,
    /// Over; only the outbox and the last event are left.
    Closed,
}

/// The server's end of one headset's session. The crate's documentation tells how to drive it.
#[derive(Debug)]
pub struct ServerSession {
    settings: ServerSettings,
    phase: Phase,
    began_at: ServerTime,
    last_heard_at: ServerTime,
    control: ControlReader,
    device: Option<Device>,
    guessed_wrong: bool,
    scene_revision: u32,
    poses: PoseInbox,
    budget: FrameBudget,
    flow: Flow,
    pipeline: Pipeline,
    counters: ServerCounters,
    statistics_at: Option<ServerTime>,
    quality: wire::Quality,
    bitrate_bps: u32,
    outbox: Outbox,
    events: VecDeque<ServerEvent>,
}

impl ServerSession {
    /// A session with a peer that has just connected and has not said who it is.
    #[must_use]
    pub fn new(now: ServerTime, settings: ServerSettings) -> Self {
        Self {
            scene_revision: settings.scene_revision,
            phase: Phase::AwaitingHello,
            began_at: now,
            last_heard_at: now,
            control: ControlReader::new(),
            device: None,
            guessed_wrong: false,
            poses: PoseInbox::default(),
            budget: FrameBudget::new(now, 60.0),
            flow: Flow::new(&settings),
            pipeline: Pipeline::default(),
            counters: ServerCounters::default(),
            statistics_at: None,
            quality: wire::Quality::default(),
            bitrate_bps: 0,
            outbox: Outbox::default(),
            events: VecDeque::new(),
            settings,
        }
    }

    /// What the headset said it is; `None` before its hello was accepted.
    #[must_use]
    pub fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    /// Whether the session is over. What is left to send and the last event are still to be taken.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// Whether the peer has yet to say who it is.
    #[must_use]
    pub fn awaits_hello(&self) -> bool {
        self.phase == Phase::AwaitingHello
    }

    /// Whether the peer was turned away for a pairing code that is not the server's; none at all is no guess.
    #[must_use]
    pub fn has_guessed_wrong(&self) -> bool {
        self.guessed_wrong
    }

    /// Takes bytes of the control stream, in pieces of any size.
    pub fn handle_control(&mut self, now: ServerTime, bytes: &[u8]) {
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
            if self.phase == Phase::AwaitingHello {
                // The version stands at the same place in every version; the rest need not be readable.
                match wire::hello_version(body) {
                    Some(found) if found != wire::PROTOCOL_VERSION => {
                        let reason =
                            format!("protocol version is {found}, expected {}", wire::PROTOCOL_VERSION);
                        return self.close(now, CloseCode::BadVersion, &reason);
                    }
                    _ => {}
                }
            }
            match ClientMessage::decode(body) {
                Ok(message) => self.handle_message(now, message),
                Err(error) => self.close(now, CloseCode::BadMessage, &error.to_string()),
            }
        }
    }

    fn handle_message(&mut self, now: ServerTime, message: ClientMessage) {
        match (self.phase, message) {
            (_, ClientMessage::Goodbye(Goodbye { code, reason })) => {
                self.end(Disconnection { by: ClosedBy::Peer, code, reason: bounded_reason(&reason) });
                self.outbox.close = Some((CloseCode::Goodbye, "goodbye".to_owned()));
            }
            (Phase::AwaitingHello, ClientMessage::Hello(hello)) => self.handle_hello(now, &hello),
            (Phase::AwaitingHello, _) => {
                self.close(now, CloseCode::BadMessage, "first message is not a hello, expected one");
            }
            (_, ClientMessage::Hello(_)) => {
                self.close(now, CloseCode::BadMessage, "second hello, expected one in a session");
            }
            (_, ClientMessage::ChangeScene { request_id, scene_json }) => {
                let waiting =
                    self.events.iter().filter(|e| matches!(e, ServerEvent::SceneRequested { .. })).count();
                if waiting >= MAX_SCENE_REQUESTS {
                    let reason = format!("{waiting} scene requests wait, expected fewer than that at a time");
                    self.scene_refused(request_id, &reason);
                } else {
                    self.events.push_back(ServerEvent::SceneRequested { request_id, scene_json });
                }
            }
            (_, ClientMessage::Statistics(statistics)) => {
                self.events.retain(|event| !matches!(event, ServerEvent::ClientStatistics(_)));
                self.events.push_back(ServerEvent::ClientStatistics(statistics));
            }
        }
    }

    /// Takes a datagram.
    pub fn handle_datagram(&mut self, now: ServerTime, bytes: &[u8]) {
        if self.is_closed() {
            return;
        }
        if self.phase == Phase::AwaitingHello {
            // A datagram may overtake the hello. It proves nothing and is worth nothing yet.
            self.counters.datagrams_early += 1;
            return;
        }
        self.last_heard_at = now;
        match ClientDatagram::decode(bytes) {
            Ok(ClientDatagram::Pose(sample)) => self.handle_pose(now, &sample),
            Ok(ClientDatagram::Ping(ping)) => {
                if let Some(clock) = ping.clock {
                    self.poses.learn_clock(clock);
                    self.flow.learn_round_trip(now, clock.round_trip_us);
                }
                let pong = wire::Pong {
                    sequence: ping.sequence,
                    ping_sent_at_us: ping.sent_at_us,
                    received_at_us: now.as_micros(),
                    sent_at_us: now.as_micros(),
                };
                if self.outbox.pongs.len() == MAX_PONGS {
                    self.outbox.pongs.pop_front();
                }
                self.outbox.pongs.push_back(ServerDatagram::Pong(pong).encode());
            }
            Ok(ClientDatagram::Feedback(feedback)) => self.handle_feedback(now, &feedback),
            Err(error) => self.close(now, CloseCode::BadMessage, &error.to_string()),
        }
    }

    fn handle_pose(&mut self, now: ServerTime, sample: &PoseSample) {
        self.refill_budget(now);
        self.poses.take(now, sample, &mut self.counters);
        let bad = self.poses.bad_in_a_row();
        if bad >= BAD_POSES_BEFORE_CLOSE {
            let reason = match self.poses.last_error() {
                Some(error) => format!("{bad} invalid poses in a row, the last: {error}"),
                None => format!("{bad} invalid poses in a row"),
            };
            self.close(now, CloseCode::BadMessage, &reason);
        }
    }

    /// What to send next; `None` if nothing is left to send now. A frame says that it was sent `now`: send it at once.
    pub fn poll_transmit(&mut self, now: ServerTime) -> Option<ServerTransmit> {
        let outbox = &mut self.outbox;
        if let Some(number) = outbox.resets.pop_front() {
            return Some(ServerTransmit::ResetFrame { number });
        }
        if let Some(bytes) = outbox.pongs.pop_front() {
            return Some(ServerTransmit::Datagram(bytes));
        }
        if let Some(bytes) = outbox.control.pop_front() {
            return Some(ServerTransmit::Control(bytes));
        }
        if let Some(QueuedFrame { number, mut bytes }) = outbox.frames.pop_front() {
            wire::stamp_sent(&mut bytes, now.as_micros());
            let priority = i32::try_from(number).unwrap_or(i32::MAX - 1);
            return Some(ServerTransmit::Frame { number, bytes, priority });
        }
        outbox.close.take().map(|(code, reason)| ServerTransmit::Close { code, reason })
    }

    /// What has happened; `None` if nothing has since the last call.
    pub fn poll_event(&mut self) -> Option<ServerEvent> {
        self.events.pop_front()
    }

    /// When to call [`Self::handle_timeout`] next, if nothing else happens; `None` once the session is over.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<ServerTime> {
        match self.phase {
            Phase::Closed => None,
            Phase::AwaitingHello => Some(self.began_at + self.settings.hello_timeout),
            Phase::AwaitingWelcome => Some(self.last_heard_at + self.settings.idle_timeout),
            Phase::Streaming => [
                Some(self.last_heard_at + self.settings.idle_timeout),
                self.statistics_at,
                self.next_flow_timeout(),
                self.next_frame_due(),
            ]
            .into_iter()
            .flatten()
            .min(),
        }
    }

    /// Does what the passing of time asks for: resets of late frames, statistics, and closing a peer that is gone.
    pub fn handle_timeout(&mut self, now: ServerTime) {
        match self.phase {
            Phase::Closed => {}
            Phase::AwaitingHello => {
                if now >= self.began_at + self.settings.hello_timeout {
                    let reason = format!("no hello within {} ms", self.settings.hello_timeout.as_millis());
                    self.close(now, CloseCode::Idle, &reason);
                }
            }
            Phase::AwaitingWelcome => self.close_if_idle(now),
            Phase::Streaming => {
                self.refill_budget(now);
                self.reset_late_frames(now);
                if self.statistics_at.is_some_and(|at| now >= at) {
                    self.statistics_at = Some(now + self.settings.statistics_interval);
                    self.send(&ServerMessage::Statistics(self.statistics_message()));
                }
                self.close_if_idle(now);
                if let Some(since) = self.flow.stalled_since()
                    && now >= since + self.settings.stall_timeout
                {
                    let reason = format!(
                        "{} frames are under way and none was completed for {} ms",
                        self.flow.in_flight(),
                        self.settings.stall_timeout.as_millis()
                    );
                    self.close(now, CloseCode::Stalled, &reason);
                }
            }
        }
    }

    fn close_if_idle(&mut self, now: ServerTime) {
        if now >= self.last_heard_at + self.settings.idle_timeout {
            let reason = format!("nothing heard for {} ms", self.settings.idle_timeout.as_millis());
            self.close(now, CloseCode::Idle, &reason);
        }
    }

    /// The room shows another scene: this headset's request if `request_id` is given, else another's.
    pub fn scene_changed(&mut self, request_id: Option<u32>, revision: u32, scene_json: Option<&str>) {
        self.scene_revision = revision;
        if self.phase == Phase::Streaming {
            self.send(&ServerMessage::SceneChanged {
                request_id,
                revision,
                scene_json: scene_json.map(str::to_owned),
            });
        }
    }

    /// The scene that this headset asked for is not shown.
    pub fn scene_refused(&mut self, request_id: u32, reason: &str) {
        if !self.is_closed() {
            self.send(&ServerMessage::SceneRefused { request_id, reason: bounded_reason(reason) });
        }
    }

    /// Ends the session with a goodbye. Does nothing if it is over already.
    pub fn close(&mut self, _now: ServerTime, code: CloseCode, reason: &str) {
        if self.is_closed() {
            return;
        }
        let reason = bounded_reason(reason);
        self.send(&ServerMessage::Goodbye(Goodbye { code, reason: reason.clone() }));
        self.end(Disconnection { by: ClosedBy::Us, code, reason: reason.clone() });
        self.outbox.close = Some((code, reason));
    }

    /// The connection has ended by itself: the peer closed it with `code`, or it broke without one. A close with a code
    /// that this version does not know is [`CloseCode::Internal`].
    pub fn handle_disconnect(&mut self, _now: ServerTime, code: Option<CloseCode>, reason: &str) {
        if self.is_closed() {
            return;
        }
        let by = if code.is_some() { ClosedBy::Peer } else { ClosedBy::Network };
        let code = code.unwrap_or(CloseCode::Idle);
        self.end(Disconnection { by, code, reason: bounded_reason(reason) });
        self.outbox = Outbox::default();
    }

    fn end(&mut self, disconnection: Disconnection) {
        self.phase = Phase::Closed;
        self.outbox.frames.clear();
        self.outbox.resets.clear();
        self.outbox.pongs.clear();
        self.flow.forget_all();
        self.events.push_back(ServerEvent::Disconnected(disconnection));
    }

    fn send(&mut self, message: &ServerMessage) {
        // Only a scene can be too large: one that came in through the same limit may be a few bytes over it on the way
        // out. It goes without its text then.
        let bytes = match (message.encode(), message) {
            (Ok(bytes), _) => bytes,
            (Err(_), ServerMessage::SceneChanged { request_id, revision, .. }) => {
                let (request_id, revision) = (*request_id, *revision);
                ServerMessage::SceneChanged { request_id, revision, scene_json: None }
                    .encode()
                    .expect("a few numbers are small")
            }
            (Err(error), _) => panic!("the server's own name or codec is beyond all bounds: {error}"),
        };
        self.outbox.control.push_back(bytes);
    }
}
