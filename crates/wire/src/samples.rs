//! One value of every message, with numbers that float32 and JSON hold exactly. They are the golden vectors.

use crate::*;
use serde::{Deserialize, Serialize};

/// Something of which `proto/vectors/` holds the bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Sample {
    ClientMessage(ClientMessage),
    ServerMessage(ServerMessage),
    ClientDatagram(ClientDatagram),
    ServerDatagram(ServerDatagram),
    Frame { header: FrameHeader, access_unit: Vec<u8> },
}

impl Sample {
    /// All that goes over the network for this: with the length prefix for a control message.
    pub(crate) fn encode(&self) -> Vec<u8> {
        match self {
            Self::ClientMessage(message) => message.encode().unwrap(),
            Self::ServerMessage(message) => message.encode().unwrap(),
            Self::ClientDatagram(message) => message.encode(),
            Self::ServerDatagram(message) => message.encode(),
            Self::Frame { header, access_unit } => encode_frame(header, access_unit).unwrap(),
        }
    }

    /// What `bytes` say, read as the kind of message that this is.
    pub(crate) fn decode_alike(&self, bytes: &[u8]) -> Self {
        let body = |bytes: &[u8]| {
            let mut reader = ControlReader::new();
            reader.push(bytes);
            let body = reader.next_body().unwrap().unwrap().to_vec();
            assert_eq!(body.len() + 4, bytes.len(), "a vector holds one message");
            body
        };
        match self {
            Self::ClientMessage(_) => Self::ClientMessage(ClientMessage::decode(&body(bytes)).unwrap()),
            Self::ServerMessage(_) => Self::ServerMessage(ServerMessage::decode(&body(bytes)).unwrap()),
            Self::ClientDatagram(_) => Self::ClientDatagram(ClientDatagram::decode(bytes).unwrap()),
            Self::ServerDatagram(_) => Self::ServerDatagram(ServerDatagram::decode(bytes).unwrap()),
            Self::Frame { .. } => {
                let Frame { header, access_unit } = decode_frame(bytes).unwrap();
                Self::Frame { header, access_unit: access_unit.to_vec() }
            }
        }
    }
}

/// Every sample with the name of its file.
pub(crate) fn all() -> Vec<(&'static str, Sample)> {
    let goodbye = || Goodbye { code: CloseCode::Goodbye, reason: "done".to_owned() };
    let shutting_down =
        || Goodbye { code: CloseCode::ShuttingDown, reason: "maintenance at 18:00".to_owned() };
    vec![
        ("client_hello", Sample::ClientMessage(ClientMessage::Hello(hello()))),
        (
            "client_change_scene",
            Sample::ClientMessage(ClientMessage::ChangeScene {
                request_id: 7,
                scene_json: r#"{"mode":"threshold","note":"Schädel"}"#.to_owned(),
            }),
        ),
        (
            "client_statistics",
            Sample::ClientMessage(ClientMessage::Statistics(ClientStatistics {
                frames_received: 600,
                frames_decoded: 598,
                frames_lost: 2,
                frames_stale: 1,
                frames_late: 17,
                decode_ms_mean: 1.5,
                pose_to_decoded_ms_mean: 42.25,
                pose_to_decoded_ms_max: 71.0,
                motion_to_photon_ms_mean: 50.5,
                round_trip_ms: 3.125,
            })),
        ),
        ("client_goodbye", Sample::ClientMessage(ClientMessage::Goodbye(goodbye()))),
        ("server_welcome", Sample::ServerMessage(ServerMessage::Welcome(welcome()))),
        (
            "server_scene_changed",
            Sample::ServerMessage(ServerMessage::SceneChanged {
                request_id: Some(7),
                revision: 4,
                scene_json: Some(r#"{"mode":"threshold"}"#.to_owned()),
            }),
        ),
        (
            "server_scene_changed_by_another",
            Sample::ServerMessage(ServerMessage::SceneChanged {
                request_id: None,
                revision: 5,
                scene_json: None,
            }),
        ),
        (
            "server_scene_refused",
            Sample::ServerMessage(ServerMessage::SceneRefused {
                request_id: 8,
                reason: "mode: expected one of 5, found \"fog\"".to_owned(),
            }),
        ),
        (
            "server_statistics",
            Sample::ServerMessage(ServerMessage::Statistics(ServerStatistics {
                frames_rendered: 601,
                frames_sent: 600,
                frames_reset: 3,
                frames_skipped: 12,
                quality: Quality { resolution_scale: 0.75, step_scale: 2.0, shading: 1 },
                bitrate_bps: 12_000_000,
            })),
        ),
        ("server_goodbye", Sample::ServerMessage(ServerMessage::Goodbye(shutting_down()))),
        (
            "datagram_pose",
            Sample::ClientDatagram(ClientDatagram::Pose(PoseSample {
                sequence: 1234,
                sampled_at_us: 20_566_667,
                display_at_us: 20_616_667,
                world_from_head: pose(0.0),
            })),
        ),
        (
            "datagram_ping_first",
            Sample::ClientDatagram(ClientDatagram::Ping(Ping {
                sequence: 0,
                sent_at_us: 1_000_000,
                clock: None,
            })),
        ),
        (
            "datagram_ping",
            Sample::ClientDatagram(ClientDatagram::Ping(Ping {
                sequence: 41,
                sent_at_us: 5_100_000,
                clock: Some(ClockReport { server_minus_headset_us: -2_500_000, round_trip_us: 1_800 }),
            })),
        ),
        ("datagram_feedback_first", Sample::ClientDatagram(ClientDatagram::Feedback(Feedback::default()))),
        (
            "datagram_feedback",
            Sample::ClientDatagram(ClientDatagram::Feedback(Feedback {
                sequence: 90,
                newest_completed: Some(66),
                completed_before: 0x0008_0000_0000_0005,
                newest_decoded: Some(63),
                key_frame_needed: true,
            })),
        ),
        (
            "datagram_pong",
            Sample::ServerDatagram(ServerDatagram::Pong(Pong {
                sequence: 41,
                ping_sent_at_us: 5_100_000,
                received_at_us: 2_600_900,
                sent_at_us: 2_600_950,
            })),
        ),
        (
            "frame_key",
            Sample::Frame {
                header: FrameHeader {
                    frame: 0,
                    depends_on: None,
                    depth: DepthGrid::default(),
                    ..frame_header(8)
                },
                access_unit: vec![0, 0, 0, 1, 0x65, 0x88, 0x84, 0x00],
            },
        ),
        ("frame", Sample::Frame { header: frame_header(6), access_unit: vec![0, 0, 0, 1, 0x41, 0x9a] }),
    ]
}

fn hello() -> Hello {
    let eye = |side: f32| EyeGeometry {
        head_from_eye: Pose { position_m: [side / 32.0, 0.0, 0.0], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] },
        fov: Fov { left_rad: -0.25, right_rad: 0.25 + side / 64.0, up_rad: 0.125, down_rad: -0.1875 },
    };
    Hello {
        version: PROTOCOL_VERSION,
        pairing_code: "482 913".to_owned(),
        device: DeviceDescription {
            name: "HoloLens 1 (simulated)".to_owned(),
            eye_width_px: 1268,
            eye_height_px: 720,
            refresh_hz: 60.0,
            eyes: [eye(-1.0), eye(1.0)],
            max_bitrate_bps: 30_000_000,
        },
    }
}

fn welcome() -> Welcome {
    Welcome {
        version: PROTOCOL_VERSION,
        session_id: 17,
        stream: Stream {
            width_px: 2536,
            height_px: 720,
            refresh_hz: 60.0,
            bitrate_bps: 20_000_000,
            codec: "avc1.42C02A".to_owned(),
        },
        server_name: "holocast 0.1.0".to_owned(),
        scene_revision: 3,
    }
}

fn pose(right_m: f32) -> Pose {
    Pose { position_m: [0.5 + right_m, 1.625, -2.0], orientation_xyzw: [0.5, -0.5, 0.5, 0.5] }
}

/// A header of a frame in the middle of a stream, whose access unit has `access_unit_bytes`.
pub(crate) fn frame_header(access_unit_bytes: u32) -> FrameHeader {
    let eye = |side: f32| EyeView {
        world_from_eye: pose(side / 32.0),
        fov: Fov { left_rad: -0.25, right_rad: 0.25 + side / 64.0, up_rad: 0.125, down_rad: -0.1875 },
    };
    FrameHeader {
        frame: 66,
        depends_on: Some(65),
        scene_revision: 4,
        time_step: 9,
        pose_sequence: 1234,
        pose_sampled_at_us: 20_566_667,
        display_at_us: 20_616_667,
        eyes: [eye(-1.0), eye(1.0)],
        stages: StageTimes {
            pose_received_us: 18_067_500,
            render_started_us: 18_070_000,
            rendered_us: 18_078_000,
            converted_us: 18_080_000,
            encode_started_us: 18_080_250,
            encoded_us: 18_086_750,
            sent_us: 18_086_800,
        },
        quality: Quality { resolution_scale: 1.0, step_scale: 1.5, shading: 2 },
        depth: DepthGrid {
            columns: 3,
            rows: 2,
            distances_mm: vec![0, 2000, 0, 1990, 1985, 1995, 0, 0, 2001, 1991, 1986, 65535],
        },
        access_unit_bytes,
    }
}
