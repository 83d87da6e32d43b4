//! Any order of calls with any bytes: nothing panics, and what must hold always holds.

use crate::world::{device, headset_time, server_time};
use proptest::prelude::*;
use session::*;
use wire::{ClientDatagram, ClientMessage, CloseCode, Feedback, Hello, Ping, PoseSample};

#[derive(Clone, Debug)]
enum Operation {
    Hello,
    Welcome,
    Pose { sequence: u64, sampled_at_us: u64, display_at_us: u64, w: f32 },
    Ping { offset: Option<(i64, u32)> },
    Feedback { sequence: u64, newest: Option<u64>, mask: u64, decoded: Option<u64>, key_frame_needed: bool },
    Datagram(Vec<u8>),
    Control(Vec<u8>),
    Wait { micros: u64 },
    Timeout,
    Begin,
    Encode { reference: Reference },
    Abandon,
    Drain,
    Close,
}

fn operation() -> impl Strategy<Value = Operation> {
    let number = prop_oneof![0u64..30, Just(u64::MAX), any::<u64>()];
    let time = prop_oneof![0u64..2_000_000, Just(u64::MAX), any::<u64>()];
    let some = prop::option::of(prop_oneof![0u64..30, any::<u64>()]);
    let reference = prop_oneof![
        3 => Just(Reference::Previous),
        2 => Just(Reference::None),
        1 => number.clone().prop_map(Reference::Frame),
    ];
    prop_oneof![
        2 => Just(Operation::Hello),
        2 => Just(Operation::Welcome),
        20 => (number.clone(), time.clone(), time, prop_oneof![9 => Just(1.0f32), 1 => any::<f32>()]).prop_map(
            |(sequence, sampled_at_us, display_at_us, w)| Operation::Pose { sequence, sampled_at_us, display_at_us, w }
        ),
        3 => any::<Option<(i64, u32)>>().prop_map(|offset| Operation::Ping { offset }),
        10 => (number, some.clone(), any::<u64>(), some, any::<bool>()).prop_map(
            |(sequence, newest, mask, decoded, key_frame_needed)| Operation::Feedback {
                sequence, newest, mask, decoded, key_frame_needed,
            }
        ),
        1 => prop::collection::vec(any::<u8>(), 0..80).prop_map(Operation::Datagram),
        1 => prop::collection::vec(any::<u8>(), 0..80).prop_map(Operation::Control),
        10 => (0u64..200_000).prop_map(|micros| Operation::Wait { micros }),
        10 => Just(Operation::Timeout),
        20 => Just(Operation::Begin),
        15 => reference.prop_map(|reference| Operation::Encode { reference }),
        3 => Just(Operation::Abandon),
        10 => Just(Operation::Drain),
        1 => Just(Operation::Close),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn the_server_keeps_its_promises_whatever_comes(operations in prop::collection::vec(operation(), 0..200)) {
        let mut server = ServerSession::new(server_time(0), ServerSettings::default());
        let mut now_us = 0;
        let mut tickets: Vec<FrameTicket> = Vec::new();
        let mut newest_sent = None;
        let mut is_over = false;
        let terms = StreamTerms {
            width_px: 640, height_px: 180, refresh_hz: 60.0, bitrate_bps: 1, codec: String::new(),
        };
        for operation in operations {
            let now = server_time(now_us);
            match operation {
                Operation::Hello => {
                    let hello = Hello { version: 1, pairing_code: String::new(), device: device().to_wire() };
                    server.handle_control(now, &ClientMessage::Hello(hello).encode().expect("a small hello"));
                }
                Operation::Welcome => server.welcome(now, &terms),
                Operation::Pose { sequence, sampled_at_us, display_at_us, w } => {
                    let world_from_head =
                        wire::Pose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, w] };
                    let sample = PoseSample { sequence, sampled_at_us, display_at_us, world_from_head };
                    server.handle_datagram(now, &ClientDatagram::Pose(sample).encode());
                }
                Operation::Ping { offset } => {
                    let clock = offset.map(|(server_minus_headset_us, round_trip_us)| wire::ClockReport {
                        server_minus_headset_us, round_trip_us,
                    });
                    let ping = Ping { sequence: 0, sent_at_us: 0, clock };
                    server.handle_datagram(now, &ClientDatagram::Ping(ping).encode());
                }
                Operation::Feedback { sequence, newest, mask, decoded, key_frame_needed } => {
                    let feedback = Feedback {
                        sequence, newest_completed: newest, completed_before: mask, newest_decoded: decoded,
                        key_frame_needed,
                    };
                    server.handle_datagram(now, &ClientDatagram::Feedback(feedback).encode());
                }
                Operation::Datagram(bytes) => server.handle_datagram(now, &bytes),
                Operation::Control(bytes) => server.handle_control(now, &bytes),
                Operation::Wait { micros } => now_us += micros,
                Operation::Timeout => {
                    if let Some(at) = server.poll_timeout() {
                        now_us = now_us.max(at.as_micros().saturating_sub(server_time(0).as_micros()));
                        server.handle_timeout(server_time(now_us));
                        let next = server.poll_timeout();
                        prop_assert!(next.is_none_or(|next| next > at), "{next:?} after {at:?}");
                    }
                }
                Operation::Begin => tickets.extend(server.begin_frame(now)),
                Operation::Encode { reference } => {
                    if !tickets.is_empty() {
                        let ticket = tickets.remove(0);
                        let at = ticket.begun_at;
                        let frame = EncodedFrame {
                            access_unit: &[1],
                            reference,
                            scene_revision: 0,
                            time_step: 0,
                            times: RenderTimes {
                                render_started: at, rendered: at, converted: at, encode_started: at, encoded: at,
                            },
                            quality: wire::Quality::default(),
                            depth: wire::DepthGrid::default(),
                        };
                        server.frame_encoded(now, ticket, frame).expect("a small frame");
                    }
                }
                Operation::Abandon => {
                    if let Some(ticket) = tickets.pop() {
                        server.frame_abandoned(now, ticket);
                    }
                }
                Operation::Drain => {
                    while let Some(transmit) = server.poll_transmit(now) {
                        if let ServerTransmit::Frame { number, bytes, .. } = transmit {
                            prop_assert!(newest_sent.is_none_or(|newest| newest < number));
                            newest_sent = Some(number);
                            let header = wire::decode_frame(&bytes).expect("a frame").header;
                            prop_assert_eq!((header.frame, header.stages.sent_us), (number, now.as_micros()));
                        }
                    }
                    while let Some(event) = server.poll_event() {
                        prop_assert!(!is_over, "nothing comes after the end: {event:?}");
                        is_over = matches!(event, ServerEvent::Disconnected(_));
                    }
                }
                Operation::Close => server.close(now, CloseCode::Internal, "test"),
            }
            prop_assert!(tickets.len() <= 2);
            prop_assert!(server.counters().in_flight <= wire::MAX_FRAMES_IN_FLIGHT + 2);
            prop_assert_eq!(server.is_closed(), server.poll_timeout().is_none());
        }
    }

    #[test]
    fn the_headset_survives_whatever_comes(
        pieces in prop::collection::vec((0u8..6, prop::collection::vec(any::<u8>(), 0..300), 0u64..400_000), 0..60),
    ) {
        let mut client = ClientSession::new(headset_time(0), &device(), &"".into(), ClientSettings::default())
            .expect("no pairing code");
        let mut now_us = 0;
        for (kind, bytes, wait_us) in pieces {
            now_us += wait_us;
            let now = headset_time(now_us);
            match kind {
                0 => client.handle_control(now, &bytes),
                1 => client.handle_datagram(now, &bytes),
                2 => client.handle_frame(now, bytes),
                3 => client.frame_stream_reset(now, &bytes),
                4 => client.handle_timeout(now),
                _ => { client.send_pose(now, now, now, &spatial::Pose::IDENTITY); }
            }
            while client.poll_transmit().is_some() {}
            while client.poll_event().is_some() {}
        }
    }
}
