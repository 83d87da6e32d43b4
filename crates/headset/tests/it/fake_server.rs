//! A server without a renderer: session, transport and encoder, with pictures made by code.

use codec::{Complexity, Encoder, EncoderSettings, YuvPicture};
use headset::{DecodePool, DeviceModel, HeadsetRun, HeadsetSettings, SimulatedHeadset, SimulatedSettings};
use session::{
    ClientSettings, Device, EncodedFrame, FrameTicket, Reference, RenderTimes, ServerEvent, ServerSession,
    ServerSettings, ServerTime, ServerTransmit, StreamTerms,
};
use spatial::DVec3;
use std::num::NonZero;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::{sleep_until, timeout};
use trace::{Orbit, Trace};
use transport::{Connection, Event, Fingerprint, Identity, ServerEndpoint, TransportSettings};
use wire::{CloseCode, DepthGrid, Quality};

/// After this long a test is taken for stuck.
const STUCK: Duration = Duration::from_secs(120);
/// The patience of both ends: a loaded machine must not look like a broken peer.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// The server's clock is that far ahead of every headset's.
const AHEAD_US: u64 = 5_000_000_000;
const COLUMNS: u16 = 8;
const ROWS: u16 = 4;

/// What is wrong with a server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Lie {
    Nothing,
    /// Pictures of half the height.
    WrongSize,
    /// Black pictures of something.
    Black,
    /// A view from elsewhere.
    WrongView,
    /// Every tenth access unit is none.
    Garbage,
    /// Instead of the welcome, nothing.
    NoWelcome,
    /// A close after so many frames.
    CloseAfter(u64),
}

#[derive(Clone, Debug)]
pub(crate) struct Behaviour {
    pub(crate) lie: Lie,
    pub(crate) session: ServerSettings,
}

pub(crate) struct FakeServer {
    pub(crate) address: String,
    pub(crate) fingerprint: Fingerprint,
    pub(crate) endpoint: Arc<ServerEndpoint>,
}

pub(crate) fn honest() -> Behaviour {
    lying(Lie::Nothing)
}

pub(crate) fn lying(lie: Lie) -> Behaviour {
    let session = ServerSettings {
        server_name: "fake".to_owned(),
        hello_timeout: PATIENCE,
        idle_timeout: PATIENCE,
        stall_timeout: PATIENCE,
        late_margin: PATIENCE,
        statistics_interval: Duration::from_millis(100),
        ..ServerSettings::default()
    };
    Behaviour { lie, session }
}

/// A server that serves everybody alike, in the background of the current runtime.
pub(crate) fn start(behaviour: Behaviour) -> FakeServer {
    let identity = Identity::ephemeral().expect("there is randomness");
    let settings = TransportSettings {
        max_idle_timeout: PATIENCE,
        handshake_timeout: PATIENCE,
        ..TransportSettings::default()
    };
    let endpoint = ServerEndpoint::bind(([127, 0, 0, 1], 0).into(), &identity, &[wire::ALPN], &settings)
        .expect("there is a free port");
    let endpoint = Arc::new(endpoint);
    let address = endpoint.local_addr().expect("it is bound").to_string();
    let accepting = endpoint.clone();
    tokio::spawn(async move {
        while let Some(connection) = accepting.accept().await {
            tokio::spawn(Serving::new(behaviour.clone()).serve(connection));
        }
    });
    FakeServer { address, fingerprint: identity.fingerprint(), endpoint }
}

impl FakeServer {
    /// A small headset that orbits the origin for a second.
    pub(crate) fn simulated(&self) -> SimulatedSettings {
        let device = DeviceModel::Pixels { width: 64, height: 32 }.device(60.0).expect("a small headset");
        let mut headset = HeadsetSettings::new(self.address.clone(), self.fingerprint, device);
        headset.transport.max_idle_timeout = PATIENCE;
        headset.transport.handshake_timeout = PATIENCE;
        headset.session =
            ClientSettings { welcome_timeout: PATIENCE, idle_timeout: PATIENCE, ..headset.session };
        let orbit = Orbit { centre_in_world: DVec3::ZERO, radius_m: 2.0, height_m: 0.3, period_secs: 20.0 };
        let trace = Arc::new(Trace::orbit(&orbit));
        SimulatedSettings { seconds: 1.0, ..SimulatedSettings::new("test", headset, trace) }
    }
}

pub(crate) fn pool() -> DecodePool {
    DecodePool::new(NonZero::<usize>::MIN).expect("there are threads")
}

pub(crate) async fn run(settings: SimulatedSettings) -> HeadsetRun {
    let running =
        async { SimulatedHeadset::connect(settings, &pool()).await.expect("the server answers").run().await };
    timeout(STUCK, running).await.expect("the test is stuck")
}

/// A white bar on black that wanders through both eyes' pictures, and the depth grid to it.
fn picture(width: u32, height: u32, frame: u64) -> (YuvPicture, DepthGrid) {
    let eye_width = width / 2;
    let cell = eye_width / u32::from(COLUMNS);
    let lit_column = frame as u32 / 4 % u32::from(COLUMNS);
    let mut rgb = Vec::with_capacity((3 * width * height) as usize);
    for _ in 0..height {
        for x in 0..width {
            let is_lit = x % eye_width / cell == lit_column;
            rgb.extend([if is_lit { 220 } else { 0 }; 3]);
        }
    }
    let distances_mm = (0..2 * u32::from(ROWS) * u32::from(COLUMNS))
        .map(|i| if i % u32::from(COLUMNS) == lit_column { 2000 } else { 0 })
        .collect();
    let depth = DepthGrid { columns: COLUMNS, rows: ROWS, distances_mm };
    (YuvPicture::from_rgb8(width, height, &rgb).expect("the sides are even"), depth)
}

struct Serving {
    behaviour: Behaviour,
    began: Instant,
    session: ServerSession,
    device: Option<Device>,
    encoder: Option<Encoder>,
    frames: u64,
    scene_revision: u32,
}

impl Serving {
    fn new(behaviour: Behaviour) -> Self {
        let session = ServerSession::new(ServerTime::from_micros(AHEAD_US), behaviour.session.clone());
        let (device, encoder) = (None, None);
        Self { began: Instant::now(), session, device, encoder, frames: 0, scene_revision: 0, behaviour }
    }

    fn now(&self) -> ServerTime {
        ServerTime::from_micros(AHEAD_US) + self.began.elapsed()
    }

    async fn serve(mut self, mut connection: Connection) {
        loop {
            self.act();
            if let Some((code, reason)) = self.transmit(&connection) {
                return connection.close(code.value().into(), &reason).await;
            }
            if let Some(ticket) = self.session.begin_frame(self.now()) {
                self.make_frame(ticket);
                continue;
            }
            let Some(due) = self.session.poll_timeout() else {
                return; // over without a word
            };
            let due = self.began + Duration::from_micros(due.as_micros() - AHEAD_US);
            tokio::select! {
                event = connection.next_event() => self.handle(event),
                () = sleep_until(due.into()) => self.session.handle_timeout(self.now()),
            }
        }
    }

    fn handle(&mut self, event: Event) {
        let now = self.now();
        match event {
            Event::Control(bytes) => self.session.handle_control(now, &bytes),
            Event::Datagram(bytes) => self.session.handle_datagram(now, &bytes),
            Event::Closed { by_peer, code, reason } => {
                let code = code.filter(|_| by_peer).and_then(CloseCode::from_value);
                self.session.handle_disconnect(now, code, &reason);
            }
            other => panic!("a headset sends no {other:?}"),
        }
    }

    fn act(&mut self) {
        while let Some(event) = self.session.poll_event() {
            match event {
                ServerEvent::Connected { device } if self.behaviour.lie != Lie::NoWelcome => {
                    let terms = StreamTerms {
                        width_px: 2 * device.eye_width_px,
                        height_px: device.eye_height_px,
                        refresh_hz: device.refresh_hz,
                        bitrate_bps: 1_000_000,
                        codec: "avc1.42C01F".to_owned(),
                    };
                    self.session.welcome(self.now(), &terms);
                    self.device = Some(device);
                }
                ServerEvent::SceneRequested { request_id, scene_json } => {
                    if scene_json.contains("bad") {
                        self.session.scene_refused(request_id, "a bad scene");
                    } else {
                        self.scene_revision += 1;
                        self.session.scene_changed(Some(request_id), self.scene_revision, None);
                    }
                }
                _ => {}
            }
        }
    }

    fn transmit(&mut self, connection: &Connection) -> Option<(CloseCode, String)> {
        while let Some(transmit) = self.session.poll_transmit(self.now()) {
            match transmit {
                ServerTransmit::Control(bytes) => connection.send_control(bytes).expect("the headset reads"),
                ServerTransmit::Datagram(bytes) => connection.send_datagram(bytes),
                ServerTransmit::Frame { number, bytes, priority } => {
                    // At the end nobody listens any more.
                    let _ = connection.send_stream(number, bytes, priority);
                }
                ServerTransmit::ResetFrame { number } => {
                    connection.reset_stream(number);
                }
                ServerTransmit::Close { code, reason } => return Some((code, reason)),
            }
        }
        None
    }

    fn make_frame(&mut self, mut ticket: FrameTicket) {
        let render_started = self.now();
        let lie = self.behaviour.lie;
        let device = self.device.as_ref().expect("there are no tickets before the hello");
        let (width, mut height) = (2 * device.eye_width_px, device.eye_height_px);
        if lie == Lie::WrongSize {
            height /= 2;
        }
        if lie == Lie::WrongView {
            for eye in &mut ticket.view.eyes {
                eye.world_from_eye.position_m.y += 1.0;
            }
        }
        let (mut picture, depth) = picture(width, height, self.frames);
        if lie == Lie::Black {
            picture = YuvPicture::black(picture.layout());
        }
        self.frames += 1;
        let rendered = self.now();
        let encoder = self.encoder.get_or_insert_with(|| {
            Encoder::new(EncoderSettings {
                width_px: width,
                height_px: height,
                frames_per_second: 60.0,
                bitrate_bps: 1_000_000,
                complexity: Complexity::Low,
            })
            .expect("the settings are in range")
        });
        let must_be_key_frame = self.session.next_must_be_key_frame();
        let mut unit = encoder.encode(picture.as_frame(), must_be_key_frame).expect("it encodes");
        if lie == Lie::Garbage && self.frames.is_multiple_of(10) {
            unit.bytes = vec![0, 0, 0, 1, 0x74, 1, 2];
        }
        let encoded = self.now();
        let frame = EncodedFrame {
            access_unit: &unit.bytes,
            reference: if unit.key_frame { Reference::None } else { Reference::Previous },
            scene_revision: self.scene_revision,
            time_step: 0,
            times: RenderTimes {
                render_started,
                rendered,
                converted: rendered,
                encode_started: rendered,
                encoded,
            },
            quality: Quality { resolution_scale: 0.5, step_scale: 2.0, shading: 1 },
            depth,
        };
        self.session.frame_encoded(encoded, ticket, frame).expect("a frame of lawful size");
        if lie == Lie::CloseAfter(self.frames) {
            self.session.close(encoded, CloseCode::ShuttingDown, "the power is going");
        }
    }
}
