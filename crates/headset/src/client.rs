//! The client's end of a connection: session, transport and decoder, driven together.

use crate::clock::HeadsetClock;
use crate::decode::{DecodePool, Decoded};
use codec::{DecodeError, Decoder, DecoderError, YuvPicture};
use session::{
    ClientCounters, ClientEvent, ClientSession, ClientSettings, ClientTransmit, ClockOffset, Decoding,
    Device, Disconnection, FrameTimeline, HeadsetTime, PairingCode, ReceivedFrame,
};
use spatial::Pose;
use std::collections::VecDeque;
use std::future::pending;
use std::time::Instant;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use transport::{
    ConnectError, Connection, Event, Fingerprint, SendControlError, Statistics, TransportSettings,
};
use wire::{
    CloseCode, EncodeError, FrameHeader, MAX_FRAME_BYTES, MAX_FRAMES_IN_FLIGHT, ServerStatistics, Welcome,
};

/// Whom to connect to, and as what.
#[derive(Clone, Debug)]
pub struct HeadsetSettings {
    /// Host and port.
    pub server: String,
    /// What the server is known by.
    pub fingerprint: Fingerprint,
    /// What this headset is.
    pub device: Device,
    /// The code that the server shows to those who may see; empty where none is asked for.
    pub pairing_code: PairingCode,
    /// Bounds of the connection.
    pub transport: TransportSettings,
    /// For how long the session waits.
    pub session: ClientSettings,
}

/// Why there is no headset.
#[derive(Debug, thiserror::Error)]
pub enum HeadsetError {
    /// The server was not reached.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The decoder could not be set up.
    #[error(transparent)]
    Decoder(#[from] DecoderError),
    /// The pairing code is too long for a message.
    #[error("cannot say hello: {0}")]
    Hello(#[from] EncodeError),
}

/// What has happened.
#[derive(Debug)]
pub enum HeadsetEvent {
    /// The server has accepted this headset. Poses may be sent.
    Welcomed(Welcome),
    /// A frame was decoded.
    Frame(Box<DecodedFrame>),
    /// A frame did not decode. The next one that does is a key frame, or hangs on an earlier one.
    Undecodable {
        /// What the server says of it.
        header: Box<FrameHeader>,
        /// What the decoder says of it.
        error: DecodeError,
    },
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
    /// How the stream leaves, in the server's words.
    ServerStatistics(ServerStatistics),
    /// It is over. The last event: whoever asks again waits for ever.
    Disconnected(Disconnection),
}

/// A frame with its picture.
#[derive(Debug)]
pub struct DecodedFrame {
    /// Header, view and access unit, as they came.
    pub received: ReceivedFrame,
    /// The picture: both eyes side by side, the left one on the left.
    pub picture: YuvPicture,
    /// When the decoder began.
    pub decode_started_at: HeadsetTime,
    /// When the picture was there.
    pub decoded_at: HeadsetTime,
    /// Where its time went; `None` before the server's clock is known.
    pub timeline: Option<FrameTimeline>,
}

/// A headset that is connected. Its owner calls [`Headset::next_event`] in a loop and sends poses when it likes;
/// dropping it closes the connection without a goodbye.
#[derive(Debug)]
pub struct Headset {
    clock: HeadsetClock,
    session: ClientSession,
    /// `None` once it is being closed or over.
    connection: Option<Connection>,
    /// How the connection fared, once it is over.
    last_statistics: Statistics,
    closing: Option<JoinHandle<()>>,
    decoder: DecoderPlace,
    pool: DecodePool,
    streams_reset: u64,
    events: VecDeque<HeadsetEvent>,
    disconnection: Option<Disconnection>,
}

/// Where the decoder is.
enum DecoderPlace {
    /// Here, with nothing to do.
    Free(Decoder),
    /// On a thread, with a frame.
    Busy(oneshot::Receiver<Decoded>),
    /// On its way from one to the other.
    Moving,
}

/// What the select of [`Headset::next_event`] came back with.
enum Happened {
    Transport(Event),
    Decoded(Box<Decoded>),
    Timeout,
    Closed,
}

impl HeadsetSettings {
    /// With the bounds that fit the protocol.
    #[must_use]
    pub fn new(server: String, fingerprint: Fingerprint, device: Device) -> Self {
        // Twice the frames that may be under way: the credit of one that was reset comes back late.
        let streams = u32::try_from(2 * MAX_FRAMES_IN_FLIGHT).unwrap_or(u32::MAX);
        Self {
            server,
            fingerprint,
            device,
            pairing_code: "".into(),
            transport: TransportSettings::receiving(streams, MAX_FRAME_BYTES),
            session: ClientSettings::default(),
        }
    }
}

impl Headset {
    /// Connects and says hello; [`HeadsetEvent::Welcomed`] or [`HeadsetEvent::Disconnected`] is the first event. The
    /// headset's clock begins at `origin`. To be called inside of a tokio runtime.
    ///
    /// # Errors
    /// If the server is not reached, or the pairing code is too long.
    pub async fn connect(
        settings: &HeadsetSettings,
        pool: &DecodePool,
        origin: Instant,
    ) -> Result<Self, HeadsetError> {
        let decoder = Decoder::new()?;
        let clock = HeadsetClock::new(origin);
        let connection =
            transport::connect(&settings.server, settings.fingerprint, wire::ALPN, &settings.transport)
                .await?;
        let session =
            ClientSession::new(clock.now(), &settings.device, &settings.pairing_code, settings.session)?;
        Ok(Self {
            clock,
            session,
            connection: Some(connection),
            last_statistics: Statistics::default(),
            closing: None,
            decoder: DecoderPlace::Free(decoder),
            pool: pool.clone(),
            streams_reset: 0,
            events: VecDeque::new(),
            disconnection: None,
        })
    }

    /// This headset's clock.
    #[must_use]
    pub fn clock(&self) -> HeadsetClock {
        self.clock
    }

    /// Sends where the head was at `sampled_at`, and when its picture is expected to be shown. Returns the pose's
    /// sequence; `None` before the welcome and after the end.
    pub fn send_pose(
        &mut self,
        sampled_at: HeadsetTime,
        display_at: HeadsetTime,
        world_from_head: &Pose,
    ) -> Option<u64> {
        let sequence = self.session.send_pose(self.clock.now(), sampled_at, display_at, world_from_head);
        self.transmit();
        sequence
    }

    /// Asks for another scene. The answer carries the number that this returns.
    ///
    /// # Errors
    /// If the scene is too large for a message.
    pub fn change_scene(&mut self, scene_json: &str) -> Result<u32, EncodeError> {
        let request_id = self.session.change_scene(scene_json)?;
        self.transmit();
        Ok(request_id)
    }

    /// Reports when a frame was shown that was made for a pose of `pose_sampled_at`; goes into the statistics that the
    /// server gets.
    pub fn frame_shown(&mut self, pose_sampled_at: HeadsetTime, shown_at: HeadsetTime) {
        self.session.frame_shown(pose_sampled_at, shown_at);
    }

    /// Ends the session in order. [`HeadsetEvent::Disconnected`] follows.
    pub fn goodbye(&mut self) {
        self.session.goodbye(self.clock.now());
        self.transmit();
    }

    /// What the session has counted.
    #[must_use]
    pub fn counters(&self) -> ClientCounters {
        self.session.counters()
    }

    /// Streams that the server has reset.
    #[must_use]
    pub fn streams_reset(&self) -> u64 {
        self.streams_reset
    }

    /// How the connection fares, or fared.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.connection.as_ref().map_or(self.last_statistics, Connection::statistics)
    }

    /// How the server's clock stands to this one; `None` before it was measured.
    #[must_use]
    pub fn clock_offset(&self) -> Option<ClockOffset> {
        self.session.clock(self.clock.now())
    }

    /// What happens next. Cancel-safe: an event that was not returned is returned by the next call.
    pub async fn next_event(&mut self) -> HeadsetEvent {
        loop {
            self.transmit();
            if let Some(event) = self.events.pop_front() {
                return event;
            }
            // All that was decoded is told before the end, and the peer has heard of the end before this end tells.
            let is_over = matches!(self.decoder, DecoderPlace::Free(_)) && self.closing.is_none();
            if is_over && let Some(disconnection) = self.disconnection.take() {
                return HeadsetEvent::Disconnected(disconnection);
            }
            match self.happening().await {
                Happened::Transport(event) => self.handle(event),
                Happened::Decoded(decoded) => self.decoded(*decoded),
                Happened::Timeout => self.session.handle_timeout(self.clock.now()),
                Happened::Closed => self.closing = None,
            }
        }
    }

    async fn happening(&mut self) -> Happened {
        let Self { clock, session, connection, closing, decoder, .. } = self;
        let timeout = session.poll_timeout().map(|time| clock.instant(time));
        tokio::select! {
            // A picture that is there is told before more is taken in.
            biased;
            decoded = next_decoded(decoder) => Happened::Decoded(Box::new(decoded)),
            // Before the network, so that a server that sends without end does not stop the clock.
            () = sleep_until(timeout) => Happened::Timeout,
            event = next_transport_event(connection) => Happened::Transport(event),
            () = closed(closing) => Happened::Closed,
        }
    }

    fn handle(&mut self, event: Event) {
        let now = self.clock.now();
        match event {
            Event::Control(bytes) => self.session.handle_control(now, &bytes),
            Event::Datagram(bytes) => self.session.handle_datagram(now, &bytes),
            Event::Stream { bytes } => self.session.handle_frame(now, bytes),
            Event::StreamReset { part, .. } => {
                self.streams_reset += 1;
                self.session.frame_stream_reset(now, &part);
            }
            Event::StreamTooLarge { max } => {
                let reason = format!("frame stream has more than {max} bytes");
                self.session.close(now, CloseCode::BadMessage, &reason);
            }
            Event::Closed { by_peer, code, reason } => {
                // A code that this version does not know still is the peer's word.
                let code = code.filter(|_| by_peer);
                let code = code.map(|code| CloseCode::from_value(code).unwrap_or(CloseCode::Internal));
                self.session.handle_disconnect(now, code, &reason);
                self.drop_connection();
            }
        }
    }

    fn decoded(&mut self, decoded: Decoded) {
        let Decoded { decoder, frame, started_at, finished_at, result } = decoded;
        self.decoder = DecoderPlace::Free(decoder);
        let decoding = Decoding { started_at, succeeded: result.is_ok() };
        let timeline = self.session.frame_decoded(finished_at, frame.header.frame, decoding);
        self.events.push_back(match result {
            Ok(picture) => HeadsetEvent::Frame(Box::new(DecodedFrame {
                received: frame,
                picture,
                decode_started_at: started_at,
                decoded_at: finished_at,
                timeline,
            })),
            Err(error) => HeadsetEvent::Undecodable { header: Box::new(frame.header), error },
        });
    }

    /// Takes all that the session wants done.
    fn transmit(&mut self) {
        if let Some(decoder) = self.decoder.take_if_free() {
            self.decoder = match self.session.poll_frame() {
                Some(frame) => DecoderPlace::Busy(self.pool.decode(decoder, frame, self.clock)),
                None => DecoderPlace::Free(decoder),
            };
        }
        while let Some(transmit) = self.session.poll_transmit() {
            let Some(connection) = &self.connection else {
                continue;
            };
            match transmit {
                ClientTransmit::Control(bytes) => {
                    match connection.send_control(bytes) {
                        // The end that the connection is about to tell says who ended it and why.
                        Ok(()) | Err(SendControlError::Closed) => {}
                        Err(error) => {
                            let reason = error.to_string();
                            self.session.handle_disconnect(self.clock.now(), None, &reason);
                            self.drop_connection();
                        }
                    }
                }
                ClientTransmit::Datagram(bytes) => connection.send_datagram(bytes),
                ClientTransmit::Close { code, reason } => {
                    self.last_statistics = connection.statistics();
                    if let Some(connection) = self.connection.take() {
                        self.closing = Some(tokio::spawn(async move {
                            connection.close(code.value().into(), &reason).await;
                        }));
                    }
                }
            }
        }
        while let Some(event) = self.session.poll_event() {
            match event {
                ClientEvent::Welcomed(welcome) => self.events.push_back(HeadsetEvent::Welcomed(welcome)),
                ClientEvent::SceneChanged { request_id, revision, scene_json } => {
                    self.events.push_back(HeadsetEvent::SceneChanged { request_id, revision, scene_json });
                }
                ClientEvent::SceneRefused { request_id, reason } => {
                    self.events.push_back(HeadsetEvent::SceneRefused { request_id, reason });
                }
                ClientEvent::ServerStatistics(statistics) => {
                    self.events.push_back(HeadsetEvent::ServerStatistics(statistics));
                }
                ClientEvent::Disconnected(disconnection) => self.disconnection = Some(disconnection),
            }
        }
    }

    fn drop_connection(&mut self) {
        if let Some(connection) = self.connection.take() {
            self.last_statistics = connection.statistics();
        }
    }
}

impl DecoderPlace {
    fn take_if_free(&mut self) -> Option<Decoder> {
        match std::mem::replace(self, Self::Moving) {
            Self::Free(decoder) => Some(decoder),
            other => {
                *self = other;
                None
            }
        }
    }
}

impl std::fmt::Debug for DecoderPlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Free(_) => "Free",
            Self::Busy(_) => "Busy",
            Self::Moving => "Moving",
        })
    }
}

async fn next_decoded(decoder: &mut DecoderPlace) -> Decoded {
    match decoder {
        // A thread answers always, unless the decoder has panicked: then so does its headset.
        DecoderPlace::Busy(decoded) => decoded.await.expect("a decoding thread answers"),
        DecoderPlace::Free(_) | DecoderPlace::Moving => pending().await,
    }
}

async fn next_transport_event(connection: &mut Option<Connection>) -> Event {
    match connection {
        Some(connection) => connection.next_event().await,
        None => pending().await,
    }
}

pub(crate) async fn sleep_until(instant: Option<Instant>) {
    match instant {
        Some(instant) => tokio::time::sleep_until(instant.into()).await,
        None => pending().await,
    }
}

async fn closed(closing: &mut Option<JoinHandle<()>>) {
    match closing {
        // It cannot fail but by a panic, and the connection is gone then as well.
        Some(closing) => {
            let _ = closing.await;
        }
        None => pending().await,
    }
}
