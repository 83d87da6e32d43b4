//! A headset, a server and the network between them.

use crate::network::{Arrival, Path};
use netsim::LinkSettings;
use session::*;
use spatial::{DQuat, DVec3, Fov, HeadGeometry, Pose};
use std::time::Duration;
use wire::{CloseCode, Quality};

/// What the server's clock shows when the true time is 0. It has run for a while.
pub(crate) const SERVER_BEGAN_US: u64 = 90_000_000;
/// What the headset's clock shows then. It has run for longer.
pub(crate) const HEADSET_BEGAN_US: u64 = 700_000_000;

/// How the two machines behave. Times are microseconds.
#[derive(Clone)]
pub(crate) struct Setup {
    pub(crate) seed: u64,
    pub(crate) up: LinkSettings,
    pub(crate) down: LinkSettings,
    /// Bytes that the transport has on their way at a time, as its congestion control would find.
    pub(crate) window_bytes: u64,
    pub(crate) settings: ServerSettings,
    pub(crate) pairing_code: &'static str,
    pub(crate) pose_every_us: u64,
    /// How far ahead of a pose its picture is expected to be shown.
    pub(crate) display_ahead_us: u64,
    pub(crate) render_us: u64,
    pub(crate) encode_us: u64,
    pub(crate) decode_us: u64,
    pub(crate) key_frame_bytes: usize,
    pub(crate) frame_bytes: usize,
    /// Where the head is at a true time in seconds.
    pub(crate) motion: fn(f64) -> Pose,
    pub(crate) reads_frames: bool,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            seed: 1,
            up: LinkSettings { delay_us: 2_000, ..LinkSettings::default() },
            down: LinkSettings { delay_us: 2_000, ..LinkSettings::default() },
            window_bytes: 96_000,
            settings: ServerSettings::default(),
            pairing_code: "",
            pose_every_us: 16_667,
            display_ahead_us: 50_000,
            render_us: 6_000,
            encode_us: 5_000,
            decode_us: 2_000,
            key_frame_bytes: 60_000,
            frame_bytes: 15_000,
            motion: walk,
            reads_frames: true,
        }
    }
}

/// Someone who walks about and looks around, smoothly.
pub(crate) fn walk(secs: f64) -> Pose {
    Pose {
        position_m: DVec3::new(0.4 * secs.sin(), 1.6 + 0.02 * (7.0 * secs).sin(), 0.3 * (1.3 * secs).cos()),
        orientation: DQuat::from_rotation_y(0.8 * (0.9 * secs).sin())
            * DQuat::from_rotation_x(0.2 * (1.7 * secs).cos()),
    }
}

pub(crate) fn device() -> Device {
    Device {
        name: "simulated".to_owned(),
        eye_width_px: 320,
        eye_height_px: 180,
        refresh_hz: 60.0,
        geometry: HeadGeometry::parallel(0.064, Fov::symmetric(0.52, 0.3).expect("a field of view")),
        max_bitrate_bps: 20_000_000,
    }
}

/// A frame that the decoder has decoded.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) number: u64,
    pub(crate) is_key_frame: bool,
    /// True time, microseconds.
    pub(crate) decoded_at: u64,
    pub(crate) timeline: Option<FrameTimeline>,
    pub(crate) left_eye: Pose,
    /// True time of the expected display, microseconds.
    pub(crate) display_at: u64,
}

struct Rendering {
    ticket: FrameTicket,
    started: u64,
    done: u64,
}

struct Encoding {
    ticket: FrameTicket,
    render_started: u64,
    rendered: u64,
    started: u64,
    done: u64,
    reference: Reference,
}

/// Both ends and all between, at one true time.
pub(crate) struct World {
    pub(crate) setup: Setup,
    /// True time, microseconds.
    pub(crate) now: u64,
    pub(crate) server: ServerSession,
    pub(crate) client: ClientSession,
    pub(crate) up: Path,
    pub(crate) down: Path,
    /// The headset has lost its power.
    pub(crate) has_vanished: bool,
    pub(crate) sends_poses: bool,
    pub(crate) shown: Vec<Shown>,
    pub(crate) server_events: Vec<ServerEvent>,
    pub(crate) client_events: Vec<ClientEvent>,
    pub(crate) most_in_flight: usize,
    next_pose: u64,
    rendering: Option<Rendering>,
    encoding: Option<Encoding>,
    decoding: Option<(ReceivedFrame, u64)>,
    decodable: Vec<u64>,
}

impl World {
    pub(crate) fn new(setup: Setup) -> Self {
        let server = ServerSession::new(server_time(0), setup.settings.clone());
        let client = ClientSession::new(
            headset_time(0),
            &device(),
            &setup.pairing_code.into(),
            ClientSettings::default(),
        )
        .expect("a short pairing code");
        Self {
            now: 0,
            server,
            client,
            up: Path::new(setup.up.clone(), setup.window_bytes, setup.seed),
            down: Path::new(setup.down.clone(), setup.window_bytes, setup.seed.wrapping_add(0x5eed)),
            has_vanished: false,
            sends_poses: true,
            shown: Vec::new(),
            server_events: Vec::new(),
            client_events: Vec::new(),
            most_in_flight: 0,
            next_pose: 0,
            rendering: None,
            encoding: None,
            decoding: None,
            decodable: Vec::new(),
            setup,
        }
    }

    /// Runs until the true time is `secs`.
    pub(crate) fn run_until(&mut self, secs: f64) {
        let end = (secs * 1e6) as u64;
        let mut steps_at_once = 0;
        loop {
            self.drain();
            let Some(next) = self.next_event().filter(|next| *next <= end) else {
                self.now = end;
                return;
            };
            assert!(next >= self.now, "nothing happens in the past");
            steps_at_once = if next == self.now { steps_at_once + 1 } else { 0 };
            assert!(steps_at_once < 10_000, "time stands still at {next} µs");
            self.now = next;
            self.step();
        }
    }

    pub(crate) fn server_now(&self) -> ServerTime {
        server_time(self.now)
    }

    pub(crate) fn headset_now(&self) -> HeadsetTime {
        headset_time(self.now)
    }

    pub(crate) fn shown_between(&self, from_secs: f64, to_secs: f64) -> usize {
        let (from, to) = ((from_secs * 1e6) as u64, (to_secs * 1e6) as u64);
        self.shown.iter().filter(|shown| (from..to).contains(&shown.decoded_at)).count()
    }

    /// Why the server's end is over, if it is.
    pub(crate) fn server_end(&self) -> Option<&Disconnection> {
        self.server_events.iter().find_map(|event| match event {
            ServerEvent::Disconnected(end) => Some(end),
            _ => None,
        })
    }

    /// Why the headset's end is over, if it is.
    pub(crate) fn client_end(&self) -> Option<&Disconnection> {
        self.client_events.iter().find_map(|event| match event {
            ClientEvent::Disconnected(end) => Some(end),
            _ => None,
        })
    }

    fn next_event(&self) -> Option<u64> {
        let pose = (self.client.is_streaming() && self.sends_poses && !self.has_vanished)
            .then_some(self.next_pose.max(self.now));
        let client = self.client.poll_timeout().filter(|_| !self.has_vanished);
        [
            pose,
            self.server.poll_timeout().map(|time| (time.as_micros() - SERVER_BEGAN_US).max(self.now)),
            client.map(|time| (time.as_micros() - HEADSET_BEGAN_US).max(self.now)),
            self.up.next_event(),
            self.down.next_event(),
            self.rendering.as_ref().filter(|_| self.encoding.is_none()).map(|r| r.done.max(self.now)),
            self.encoding.as_ref().map(|encoding| encoding.done),
            self.decoding.as_ref().map(|(_, started)| started + self.setup.decode_us),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    fn step(&mut self) {
        let now = self.now;
        self.up.advance(now);
        self.down.advance(now);
        for arrival in self.up.receive(now) {
            match arrival {
                Arrival::Datagram(bytes) => self.server.handle_datagram(server_time(now), &bytes),
                Arrival::Control(bytes) => self.server.handle_control(server_time(now), &bytes),
                other => panic!("a headset sends no {other:?}"),
            }
        }
        for arrival in self.down.receive(now) {
            if self.has_vanished {
                continue;
            }
            match arrival {
                Arrival::Datagram(bytes) => self.client.handle_datagram(headset_time(now), &bytes),
                Arrival::Control(bytes) => self.client.handle_control(headset_time(now), &bytes),
                _ if !self.setup.reads_frames => {}
                Arrival::Frame(bytes) => self.client.handle_frame(headset_time(now), bytes),
                Arrival::FrameReset { part } => self.client.frame_stream_reset(headset_time(now), &part),
            }
        }
        if self.server.poll_timeout().is_some_and(|time| time <= server_time(now)) {
            self.server.handle_timeout(server_time(now));
        }
        if !self.has_vanished {
            if self.client.poll_timeout().is_some_and(|time| time <= headset_time(now)) {
                self.client.handle_timeout(headset_time(now));
            }
            self.move_head();
            self.decode();
        }
        self.render();
    }

    fn move_head(&mut self) {
        if !self.client.is_streaming() || !self.sends_poses {
            self.next_pose = self.now;
        } else if self.now >= self.next_pose {
            self.next_pose = self.now + self.setup.pose_every_us;
            let pose = (self.setup.motion)(self.now as f64 * 1e-6);
            let now = self.headset_now();
            let display_at = now + Duration::from_micros(self.setup.display_ahead_us);
            self.client.send_pose(now, now, display_at, &pose);
        }
    }

    fn decode(&mut self) {
        if let Some((frame, started)) = self.decoding.take_if(|(_, s)| *s + self.setup.decode_us <= self.now)
        {
            self.finish_decoding(&frame, started);
        }
        if self.decoding.is_none()
            && let Some(frame) = self.client.poll_frame()
        {
            self.decoding = Some((frame, self.now));
        }
    }

    fn finish_decoding(&mut self, frame: &ReceivedFrame, started: u64) {
        let header = &frame.header;
        assert!(
            self.shown.last().is_none_or(|last| last.number < header.frame),
            "nothing stale after a fresh frame"
        );
        assert_eq!(frame.access_unit()[..8], header.frame.to_le_bytes(), "the picture is the header's");
        match header.depends_on {
            None => self.decodable.clear(),
            Some(other) => {
                assert!(self.decodable.contains(&other), "frame {} hangs on {other}", header.frame);
            }
        }
        self.decodable.push(header.frame);
        let decoding = Decoding { started_at: headset_time(started), succeeded: true };
        let timeline = self.client.frame_decoded(headset_time(self.now), header.frame, decoding);
        self.shown.push(Shown {
            number: header.frame,
            is_key_frame: header.depends_on.is_none(),
            decoded_at: self.now,
            timeline,
            left_eye: frame.view.eyes[0].world_from_eye,
            display_at: header.display_at_us - HEADSET_BEGAN_US,
        });
    }

    fn render(&mut self) {
        let now = self.now;
        if let Some(encoding) = self.encoding.take_if(|encoding| encoding.done <= now) {
            self.hand_over(encoding);
        }
        if self.encoding.is_none()
            && let Some(Rendering { ticket, started, done }) = self.rendering.take_if(|r| r.done <= now)
        {
            let is_key = self.server.next_must_be_key_frame();
            self.encoding = Some(Encoding {
                ticket,
                render_started: started,
                rendered: done,
                started: now,
                done: now + self.setup.encode_us,
                reference: if is_key { Reference::None } else { Reference::Previous },
            });
        }
        if self.rendering.is_none()
            && let Some(ticket) = self.server.begin_frame(server_time(now))
        {
            self.rendering = Some(Rendering { ticket, started: now, done: now + self.setup.render_us });
        }
        self.most_in_flight = self.most_in_flight.max(self.server.counters().in_flight);
    }

    fn hand_over(&mut self, encoding: Encoding) {
        let Encoding { ticket, render_started, rendered, started, done, reference } = encoding;
        let size =
            if reference == Reference::None { self.setup.key_frame_bytes } else { self.setup.frame_bytes };
        let mut access_unit = ticket.number.to_le_bytes().to_vec();
        access_unit.resize(size, 0xab);
        let frame = EncodedFrame {
            access_unit: &access_unit,
            reference,
            scene_revision: 0,
            time_step: 0,
            times: RenderTimes {
                render_started: server_time(render_started),
                rendered: server_time(rendered),
                converted: server_time(rendered),
                encode_started: server_time(started),
                encoded: server_time(done),
            },
            quality: Quality::default(),
            depth: wire::DepthGrid::default(),
        };
        self.server.frame_encoded(server_time(self.now), ticket, frame).expect("a frame of lawful size");
    }

    /// Takes all that both ends want done.
    fn drain(&mut self) {
        let now = self.now;
        // Events first: their answers go out in the same instant.
        while let Some(event) = self.server.poll_event() {
            if let ServerEvent::Connected { device } = &event {
                let terms = StreamTerms {
                    width_px: 2 * device.eye_width_px,
                    height_px: device.eye_height_px,
                    refresh_hz: device.refresh_hz,
                    bitrate_bps: device.max_bitrate_bps,
                    codec: "avc1.42C01F".to_owned(),
                };
                self.server.welcome(server_time(now), &terms);
            }
            self.server_events.push(event);
        }
        while let Some(transmit) = self.server.poll_transmit(server_time(now)) {
            match transmit {
                ServerTransmit::Control(bytes) => self.down.send_control(now, &bytes),
                ServerTransmit::Datagram(bytes) => self.down.send_datagram(now, bytes),
                ServerTransmit::Frame { number, bytes, priority } => {
                    self.down.send_frame(now, number, &bytes, priority);
                }
                ServerTransmit::ResetFrame { number } => self.down.reset_frame(now, number),
                ServerTransmit::Close { .. } => {}
            }
        }
        if self.has_vanished {
            return;
        }
        while let Some(transmit) = self.client.poll_transmit() {
            match transmit {
                ClientTransmit::Control(bytes) => self.up.send_control(now, &bytes),
                ClientTransmit::Datagram(bytes) => self.up.send_datagram(now, bytes),
                ClientTransmit::Close { .. } => {}
            }
        }
        self.client_events.extend(std::iter::from_fn(|| self.client.poll_event()));
    }
}

pub(crate) fn server_time(true_us: u64) -> ServerTime {
    ServerTime::from_micros(SERVER_BEGAN_US + true_us)
}

pub(crate) fn headset_time(true_us: u64) -> HeadsetTime {
    HeadsetTime::from_micros(HEADSET_BEGAN_US + true_us)
}

/// Checks that a session ended as expected: by whom, with which code, and with a reason that holds `needle`.
#[track_caller]
pub(crate) fn check_end(end: Option<&Disconnection>, by: ClosedBy, code: CloseCode, needle: &str) {
    let end = end.expect("the session is over");
    assert_eq!((end.by, end.code), (by, code), "{end:?}");
    assert!(end.reason.contains(needle), "{:?} tells of {needle:?}", end.reason);
}
