//! Several sessions that share a device, in virtual time: whatever one headset does, the others do not miss a frame.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use server::{Scheduler, Wish};
use session::{
    Device, EncodedFrame, FrameTicket, Reference, RenderTimes, ServerEvent, ServerSession, ServerSettings,
    ServerTime, ServerTransmit, StreamTerms,
};
use spatial::{Fov, HeadGeometry};
use std::time::Duration;
use wire::{ClientDatagram, ClientMessage, Feedback, Hello, PoseSample};

/// The resolution of virtual time.
const TICK_US: u64 = 100;
const REFRESH_US: u64 = 16_667;
/// What a frame takes on the device: three headsets have all but a sixteenth of it, so that who gets more than its rate
/// takes it from the others.
const FRAME_US: u64 = 5_200;
/// From a frame's end on the device to the headset's feedback that it is decoded.
const FEEDBACK_US: u64 = 9_000;
/// How long all is well, and how long the test goes on after that.
const WELL_US: u64 = 500_000;
const END_US: u64 = 12_000_000;

/// What a headset does from [`WELL_US`] on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Manner {
    /// As before.
    Good,
    /// Nothing at all is heard of it any more.
    Vanishes,
    /// It sends poses and never says that a frame has come.
    NeverReads,
    /// Its datagrams are none.
    Garbage,
    /// Its poses have no direction.
    BadPoses,
    /// Ten poses a tick: 100 000 a second.
    Floods,
    /// It asks for a key frame with every feedback, and for scenes all the time.
    Demands,
}

struct Headset {
    manner: Manner,
    session: ServerSession,
    sequence: u64,
    feedback: u64,
    next_pose_us: u64,
    /// Frames that it will say it has decoded, and when.
    coming: Vec<(u64, u64)>,
    /// When its frames were sent.
    sent_us: Vec<u64>,
}

fn at(us: u64) -> ServerTime {
    ServerTime::from_micros(us)
}

fn device() -> Device {
    Device {
        name: "virtual".into(),
        eye_width_px: 320,
        eye_height_px: 180,
        refresh_hz: 60.0,
        geometry: HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).unwrap()),
        max_bitrate_bps: 10_000_000,
    }
}

impl Headset {
    fn join(manner: Manner, phase_us: u64) -> Self {
        let mut session = ServerSession::new(at(0), ServerSettings::default());
        let hello = Hello {
            version: wire::PROTOCOL_VERSION,
            pairing_code: String::new(),
            device: device().to_wire(),
        };
        session.handle_control(at(0), &ClientMessage::Hello(hello).encode().unwrap());
        assert!(matches!(session.poll_event(), Some(ServerEvent::Connected { .. })));
        let terms = StreamTerms {
            width_px: 640,
            height_px: 180,
            refresh_hz: 60.0,
            bitrate_bps: 5_000_000,
            codec: "avc1.42C01F".into(),
        };
        session.welcome(at(0), &terms);
        Self {
            manner,
            session,
            sequence: 0,
            feedback: 0,
            next_pose_us: phase_us,
            coming: Vec::new(),
            sent_us: Vec::new(),
        }
    }

    fn say(&mut self, now_us: u64, datagram: ClientDatagram) {
        self.session.handle_datagram(at(now_us), &datagram.encode());
    }

    fn send_pose(&mut self, now_us: u64, orientation_xyzw: [f32; 4]) {
        let pose = PoseSample {
            sequence: self.sequence,
            sampled_at_us: now_us,
            display_at_us: now_us + 40_000,
            world_from_head: wire::Pose { position_m: [0.0, 1.6, 0.0], orientation_xyzw },
        };
        self.sequence += 1;
        self.say(now_us, ClientDatagram::Pose(pose));
    }

    /// What it does in this tick.
    fn act(&mut self, now_us: u64) {
        let manner = if now_us < WELL_US { Manner::Good } else { self.manner };
        if manner == Manner::Vanishes {
            return;
        }
        if manner == Manner::Floods {
            (0..10).for_each(|_| self.send_pose(now_us, [0.0, 0.0, 0.0, 1.0]));
        } else if now_us >= self.next_pose_us {
            self.next_pose_us += REFRESH_US;
            match manner {
                Manner::Garbage => self.session.handle_datagram(at(now_us), &[0xee; 30]),
                Manner::BadPoses => self.send_pose(now_us, [0.0; 4]),
                _ => self.send_pose(now_us, [0.0, 0.0, 0.0, 1.0]),
            }
            if manner == Manner::Demands {
                let scene = ClientMessage::ChangeScene { request_id: 1, scene_json: "{}".into() };
                self.session.handle_control(at(now_us), &scene.encode().unwrap());
            }
        }
        while manner != Manner::NeverReads
            && let Some((_, frame)) = self.coming.first().copied().filter(|(when_us, _)| now_us >= *when_us)
        {
            self.coming.remove(0);
            self.feedback += 1;
            let feedback = Feedback {
                sequence: self.feedback,
                newest_completed: Some(frame),
                completed_before: u64::MAX,
                newest_decoded: Some(frame),
                key_frame_needed: manner == Manner::Demands,
            };
            self.say(now_us, ClientDatagram::Feedback(feedback));
        }
    }

    /// The encoder and the network, which take no time here.
    fn hand_over(&mut self, now_us: u64, ticket: FrameTicket) {
        let now = at(now_us);
        let key = self.session.next_must_be_key_frame();
        let frame = EncodedFrame {
            access_unit: &[1, 2, 3],
            reference: if key { Reference::None } else { Reference::Previous },
            scene_revision: 0,
            time_step: 0,
            times: RenderTimes {
                render_started: ticket.begun_at,
                rendered: now,
                converted: now,
                encode_started: now,
                encoded: now,
            },
            quality: wire::Quality::default(),
            depth: wire::DepthGrid::default(),
        };
        self.session.frame_encoded(now, ticket, frame).unwrap();
    }

    fn drain(&mut self, now_us: u64) {
        if self.session.poll_timeout().is_some_and(|due| due <= at(now_us)) {
            self.session.handle_timeout(at(now_us));
        }
        while let Some(transmit) = self.session.poll_transmit(at(now_us)) {
            if let ServerTransmit::Frame { number, .. } = transmit {
                self.sent_us.push(now_us);
                self.coming.push((now_us + FEEDBACK_US, number));
            }
        }
        while self.session.poll_event().is_some() {}
    }
}

/// Two good headsets and one of that manner; what became of them.
fn run(manner: Manner) -> [Headset; 3] {
    let mut headsets =
        [(Manner::Good, 300), (manner, 2_000), (Manner::Good, 9_000)].map(|(m, at)| Headset::join(m, at));
    let mut scheduler = Scheduler::default();
    let mut on_device: Option<(usize, FrameTicket, u64)> = None;
    for now_us in (0..END_US).step_by(TICK_US as usize) {
        for headset in &mut headsets {
            headset.act(now_us);
        }
        if let Some((whose, ticket, _)) = on_device.take_if(|(_, _, done_us)| *done_us <= now_us) {
            headsets[whose].hand_over(now_us, ticket);
        }
        for headset in &mut headsets {
            headset.drain(now_us);
        }
        if on_device.is_none() {
            let wish = |(i, headset): (usize, &mut Headset)| {
                let deadline = headset.session.frame_request(at(now_us))?.deadline;
                Some(Wish { session: i as u64, deadline, period: Duration::from_micros(REFRESH_US) })
            };
            let wishes: Vec<Wish> = headsets.iter_mut().enumerate().filter_map(wish).collect();
            on_device = scheduler.choose(at(now_us), &wishes).and_then(|chosen| {
                let whose = chosen as usize;
                Some((whose, headsets[whose].session.begin_frame(at(now_us))?, now_us + FRAME_US))
            });
        }
    }
    headsets
}

#[test]
fn whatever_one_headset_does_the_others_do_not_miss_a_frame() {
    for manner in [
        Manner::Good,
        Manner::Vanishes,
        Manner::NeverReads,
        Manner::Garbage,
        Manner::BadPoses,
        Manner::Floods,
        Manner::Demands,
    ] {
        let headsets = run(manner);
        for good in [&headsets[0], &headsets[2]] {
            let frames = good.sent_us.len() as u64;
            // A frame for each refresh, and none long after the one before it: three frames of the device is all that it
            // may have to wait.
            assert!(frames >= END_US / REFRESH_US - 1, "{manner:?}: {frames} frames");
            let gap_us = good.sent_us.windows(2).map(|w| w[1] - w[0]).max().unwrap();
            assert!(gap_us <= REFRESH_US + 3 * FRAME_US, "{manner:?}: no frame for {gap_us} µs");
            assert!(!good.session.is_closed(), "{manner:?}");
            let counters = good.session.counters();
            assert_eq!((counters.frames_reset, counters.frames_dropped), (0, 0), "{manner:?}");
        }
        // And who is of no use is gone in the end.
        let [_, odd, _] = &headsets;
        let is_gone =
            matches!(manner, Manner::Vanishes | Manner::NeverReads | Manner::Garbage | Manner::BadPoses);
        assert_eq!(odd.session.is_closed(), is_gone, "{manner:?}");
        if manner == Manner::Floods {
            let frames = odd.sent_us.len() as u64;
            assert!(frames <= END_US * 102 / 100 / REFRESH_US + 2, "{frames} frames for a flood");
        }
    }
}
