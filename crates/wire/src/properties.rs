//! What holds for all values and for all bytes.

use crate::*;
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f32> {
    // Every float but NaN, which equals nothing; that NaN travels too is tested on its own.
    prop::num::f32::ANY.prop_filter("NaN equals nothing", |x| !x.is_nan())
}

fn pose() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(number()), prop::array::uniform4(number()))
        .prop_map(|(position_m, orientation_xyzw)| Pose { position_m, orientation_xyzw })
}

fn fov() -> impl Strategy<Value = Fov> {
    prop::array::uniform4(number()).prop_map(|[left_rad, right_rad, up_rad, down_rad]| Fov {
        left_rad,
        right_rad,
        up_rad,
        down_rad,
    })
}

fn device() -> impl Strategy<Value = DeviceDescription> {
    let eye = (pose(), fov()).prop_map(|(head_from_eye, fov)| EyeGeometry { head_from_eye, fov });
    (".*", any::<(u32, u32, u32)>(), number(), prop::array::uniform2(eye)).prop_map(
        |(name, (eye_width_px, eye_height_px, max_bitrate_bps), refresh_hz, eyes)| DeviceDescription {
            name,
            eye_width_px,
            eye_height_px,
            refresh_hz,
            eyes,
            max_bitrate_bps,
        },
    )
}

fn close() -> impl Strategy<Value = Goodbye> {
    (prop::sample::select(CloseCode::ALL.to_vec()), ".*").prop_map(|(code, reason)| Goodbye { code, reason })
}

fn quality() -> impl Strategy<Value = Quality> {
    (number(), number(), any::<u8>()).prop_map(|(resolution_scale, step_scale, shading)| Quality {
        resolution_scale,
        step_scale,
        shading,
    })
}

fn client_message() -> impl Strategy<Value = ClientMessage> {
    let statistics = (any::<[u64; 5]>(), prop::array::uniform5(number())).prop_map(|(counts, ms)| {
        ClientMessage::Statistics(ClientStatistics {
            frames_received: counts[0],
            frames_decoded: counts[1],
            frames_lost: counts[2],
            frames_stale: counts[3],
            frames_late: counts[4],
            decode_ms_mean: ms[0],
            pose_to_decoded_ms_mean: ms[1],
            pose_to_decoded_ms_max: ms[2],
            motion_to_photon_ms_mean: ms[3],
            round_trip_ms: ms[4],
        })
    });
    prop_oneof![
        (any::<u16>(), ".*", device()).prop_map(|(version, pairing_code, device)| ClientMessage::Hello(
            Hello { version, pairing_code, device }
        )),
        (any::<u32>(), ".*")
            .prop_map(|(request_id, scene_json)| ClientMessage::ChangeScene { request_id, scene_json }),
        statistics,
        close().prop_map(ClientMessage::Goodbye),
    ]
}

fn server_message() -> impl Strategy<Value = ServerMessage> {
    let welcome =
        (any::<(u16, u64, u32, u32, u32, u32)>(), number(), ".*", ".*").prop_map(|(n, hz, codec, name)| {
            ServerMessage::Welcome(Welcome {
                version: n.0,
                session_id: n.1,
                stream: Stream { width_px: n.2, height_px: n.3, refresh_hz: hz, bitrate_bps: n.4, codec },
                server_name: name,
                scene_revision: n.5,
            })
        });
    let statistics = (any::<[u64; 4]>(), quality(), any::<u32>()).prop_map(|(n, quality, bitrate_bps)| {
        ServerMessage::Statistics(ServerStatistics {
            frames_rendered: n[0],
            frames_sent: n[1],
            frames_reset: n[2],
            frames_skipped: n[3],
            quality,
            bitrate_bps,
        })
    });
    prop_oneof![
        welcome,
        (any::<Option<u32>>(), any::<u32>(), prop::option::of(".*")).prop_map(
            |(request_id, revision, scene_json)| ServerMessage::SceneChanged {
                request_id,
                revision,
                scene_json
            }
        ),
        (any::<u32>(), ".*")
            .prop_map(|(request_id, reason)| ServerMessage::SceneRefused { request_id, reason }),
        statistics,
        close().prop_map(ServerMessage::Goodbye),
    ]
}

fn client_datagram() -> impl Strategy<Value = ClientDatagram> {
    prop_oneof![
        (any::<[u64; 3]>(), pose()).prop_map(|(n, world_from_head)| ClientDatagram::Pose(PoseSample {
            sequence: n[0],
            sampled_at_us: n[1],
            display_at_us: n[2],
            world_from_head,
        })),
        any::<(u64, u64, Option<(i64, u32)>)>().prop_map(|(sequence, sent_at_us, clock)| {
            let clock = clock.map(|(server_minus_headset_us, round_trip_us)| ClockReport {
                server_minus_headset_us,
                round_trip_us,
            });
            ClientDatagram::Ping(Ping { sequence, sent_at_us, clock })
        }),
        any::<(u64, Option<u64>, u64, Option<u64>, bool)>().prop_map(|n| ClientDatagram::Feedback(
            Feedback {
                sequence: n.0,
                newest_completed: n.1,
                completed_before: n.2,
                newest_decoded: n.3,
                key_frame_needed: n.4,
            }
        )),
    ]
}

fn frame() -> impl Strategy<Value = (FrameHeader, Vec<u8>)> {
    let eye = (pose(), fov()).prop_map(|(world_from_eye, fov)| EyeView { world_from_eye, fov });
    let depth = (0u16..20, 0u16..20).prop_flat_map(|(columns, rows)| {
        prop::collection::vec(any::<u16>(), 2 * usize::from(columns) * usize::from(rows))
            .prop_map(move |distances_mm| DepthGrid { columns, rows, distances_mm })
    });
    let numbers = any::<([u64; 4], Option<u64>, [u32; 2], [u64; 7])>();
    let access_unit = prop::collection::vec(any::<u8>(), 0..200);
    (numbers, prop::array::uniform2(eye), quality(), depth, access_unit).prop_map(
        |((n, depends_on, [scene_revision, time_step], t), eyes, quality, depth, access_unit)| {
            let header = FrameHeader {
                frame: n[0],
                depends_on,
                scene_revision,
                time_step,
                pose_sequence: n[1],
                pose_sampled_at_us: n[2],
                display_at_us: n[3],
                eyes,
                stages: StageTimes {
                    pose_received_us: t[0],
                    render_started_us: t[1],
                    rendered_us: t[2],
                    converted_us: t[3],
                    encode_started_us: t[4],
                    encoded_us: t[5],
                    sent_us: t[6],
                },
                quality,
                depth,
                access_unit_bytes: access_unit.len() as u32,
            };
            (header, access_unit)
        },
    )
}

/// Decodes `bytes` as everything there is. What decodes must encode to the same bytes: there is one form of a value.
fn decode_as_everything(bytes: &[u8]) {
    if let Ok(message) = ClientMessage::decode(bytes) {
        assert_eq!(message.encode().unwrap()[4..], *bytes);
    }
    if let Ok(message) = ServerMessage::decode(bytes) {
        assert_eq!(message.encode().unwrap()[4..], *bytes);
    }
    if let Ok(message) = ClientDatagram::decode(bytes) {
        assert_eq!(message.encode(), bytes);
    }
    if let Ok(message) = ServerDatagram::decode(bytes) {
        assert_eq!(message.encode(), bytes);
    }
    if let Ok(Frame { header, access_unit }) = decode_frame(bytes) {
        assert_eq!(encode_frame(&header, access_unit).unwrap(), bytes);
    }
    let _ = hello_version(bytes);
    let _ = frame_number_of_part(bytes);
    let mut reader = ControlReader::new();
    reader.push(bytes);
    while let Ok(Some(body)) = reader.next_body() {
        let _ = ClientMessage::decode(body);
    }
}

proptest! {
    #[test]
    fn client_messages_come_back(message in client_message()) {
        let bytes = message.encode().unwrap();
        prop_assert_eq!(ClientMessage::decode(&bytes[4..]).unwrap(), message);
    }

    #[test]
    fn server_messages_come_back(message in server_message()) {
        let bytes = message.encode().unwrap();
        prop_assert_eq!(ServerMessage::decode(&bytes[4..]).unwrap(), message);
    }

    #[test]
    fn client_datagrams_come_back_and_fit(message in client_datagram()) {
        let bytes = message.encode();
        prop_assert!(bytes.len() <= 64);
        prop_assert_eq!(ClientDatagram::decode(&bytes).unwrap(), message);
    }

    #[test]
    fn server_datagrams_come_back(n in any::<[u64; 4]>()) {
        let message = ServerDatagram::Pong(Pong {
            sequence: n[0], ping_sent_at_us: n[1], received_at_us: n[2], sent_at_us: n[3],
        });
        prop_assert_eq!(ServerDatagram::decode(&message.encode()).unwrap(), message);
    }

    #[test]
    fn frames_come_back((header, access_unit) in frame()) {
        let bytes = encode_frame(&header, &access_unit).unwrap();
        let frame = decode_frame(&bytes).unwrap();
        prop_assert_eq!(frame.header, header);
        prop_assert_eq!(frame.access_unit, access_unit);
    }

    #[test]
    fn a_frame_is_stamped_with_when_it_was_sent_and_is_otherwise_the_same(
        (mut header, access_unit) in frame(), sent_us in any::<u64>(),
    ) {
        let mut stamped = encode_frame(&header, &access_unit).unwrap();
        stamp_sent(&mut stamped, sent_us);
        header.stages.sent_us = sent_us;
        prop_assert_eq!(stamped, encode_frame(&header, &access_unit).unwrap());
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        decode_as_everything(&bytes);
    }

    #[test]
    fn damaged_vectors_never_panic(
        which in 0usize..100,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
    ) {
        let samples = samples::all();
        let mut bytes = samples[which % samples.len()].1.encode();
        for (at, value) in damage {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        bytes.truncate(cut.index(bytes.len() + 1));
        decode_as_everything(&bytes);
        decode_as_everything(bytes.get(4..).unwrap_or_default());
    }
}

#[test]
fn numbers_that_are_none_travel_unchanged() {
    let message = ClientDatagram::Pose(PoseSample {
        sequence: 1,
        sampled_at_us: 2,
        display_at_us: 3,
        world_from_head: Pose { position_m: [f32::NAN; 3], orientation_xyzw: [f32::INFINITY; 4] },
    });
    let bytes = message.encode();
    assert_eq!(ClientDatagram::decode(&bytes).unwrap().encode(), bytes);
}
