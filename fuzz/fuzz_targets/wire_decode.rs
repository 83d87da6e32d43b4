//! Bytes from a peer: every decoder of `wire`, and both ends of a `session` that take them in any order.

#![no_main]

use libfuzzer_sys::fuzz_target;
use session::*;
use spatial::{Fov, HeadGeometry, Pose};
use std::sync::LazyLock;

static DEVICE: LazyLock<Device> = LazyLock::new(|| Device {
    name: String::new(),
    eye_width_px: 320,
    eye_height_px: 180,
    refresh_hz: 60.0,
    geometry: HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).expect("a field of view")),
    max_bitrate_bps: 1_000_000,
});

fuzz_target!(|data: &[u8]| {
    decode(data);
    server(data);
    client(data);
});

/// What decodes encodes to the same bytes again.
fn decode(data: &[u8]) {
    if let Ok(message) = wire::ClientMessage::decode(data) {
        assert_eq!(message.encode().expect("as large as before")[4..], *data);
    }
    if let Ok(message) = wire::ServerMessage::decode(data) {
        assert_eq!(message.encode().expect("as large as before")[4..], *data);
    }
    if let Ok(message) = wire::ClientDatagram::decode(data) {
        assert_eq!(message.encode(), data);
    }
    if let Ok(message) = wire::ServerDatagram::decode(data) {
        assert_eq!(message.encode(), data);
    }
    if let Ok(frame) = wire::decode_frame(data) {
        assert_eq!(wire::encode_frame(&frame.header, frame.access_unit).expect("as large as before"), data);
    }
    let mut reader = wire::ControlReader::new();
    reader.push(data);
    while let Ok(Some(body)) = reader.next_body() {
        let _ = wire::ClientMessage::decode(body);
        let _ = wire::ServerMessage::decode(body);
    }
}

/// Cuts `data` into pieces, each behind a byte that says what to do with it and one that says how long it is.
fn pieces(mut data: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    std::iter::from_fn(move || {
        let [what, length, rest @ ..] = data else { return None };
        let (piece, rest) = rest.split_at(usize::from(*length).min(rest.len()));
        data = rest;
        Some((*what, piece))
    })
}

fn server(data: &[u8]) {
    // As the first words of a stranger.
    let mut stranger = ServerSession::new(ServerTime::default(), ServerSettings::default());
    stranger.handle_datagram(ServerTime::default(), data);
    stranger.handle_control(ServerTime::default(), data);

    let mut now = ServerTime::from_micros(1_000_000);
    let mut server = ServerSession::new(now, ServerSettings::default());
    let hello = wire::Hello {
        version: wire::PROTOCOL_VERSION,
        pairing_code: String::new(),
        device: DEVICE.to_wire(),
    };
    server.handle_control(now, &wire::ClientMessage::Hello(hello).encode().expect("a small hello"));
    server.welcome(
        now,
        &StreamTerms {
            width_px: 640,
            height_px: 180,
            refresh_hz: 60.0,
            bitrate_bps: 1,
            codec: String::new(),
        },
    );
    server.handle_datagram(now, data.get(..wire::MAX_DATAGRAM_BYTES).unwrap_or(data));
    for (what, piece) in pieces(data) {
        match what % 6 {
            0 => server.handle_datagram(now, piece),
            1 => server.handle_control(now, piece),
            2 => now = now + std::time::Duration::from_millis(piece.len() as u64),
            3 => server.handle_timeout(now),
            _ => {
                if let Some(ticket) = server.begin_frame(now) {
                    let times = RenderTimes {
                        render_started: now,
                        rendered: now,
                        converted: now,
                        encode_started: now,
                        encoded: now,
                    };
                    let frame = EncodedFrame {
                        access_unit: piece,
                        reference: if what % 6 == 4 { Reference::None } else { Reference::Previous },
                        scene_revision: 0,
                        time_step: 0,
                        times,
                        quality: wire::Quality::default(),
                        depth: wire::DepthGrid::default(),
                    };
                    server.frame_encoded(now, ticket, frame).expect("a small frame");
                }
            }
        }
        while server.poll_transmit(now).is_some() {}
        while server.poll_event().is_some() {}
    }
}

fn client(data: &[u8]) {
    let mut now = HeadsetTime::from_micros(1_000_000);
    let new = || ClientSession::new(now, &DEVICE, &PairingCode::from(""), ClientSettings::default()).expect("no pairing code");
    let mut stranger = new();
    stranger.handle_control(now, data);
    stranger.handle_frame(now, data.to_vec());

    let mut client = new();
    let welcome = wire::Welcome {
        version: wire::PROTOCOL_VERSION,
        session_id: 0,
        stream: wire::Stream {
            width_px: 640,
            height_px: 180,
            refresh_hz: 60.0,
            bitrate_bps: 1,
            codec: String::new(),
        },
        server_name: String::new(),
        scene_revision: 0,
    };
    client.handle_control(now, &wire::ServerMessage::Welcome(welcome).encode().expect("a small welcome"));
    client.handle_frame(now, data.to_vec());
    for (what, piece) in pieces(data) {
        match what % 7 {
            0 => client.handle_datagram(now, piece),
            1 => client.handle_control(now, piece),
            2 => now = now + std::time::Duration::from_millis(piece.len() as u64),
            3 => client.handle_timeout(now),
            4 => client.handle_frame(now, piece.to_vec()),
            5 => client.frame_stream_reset(now, piece),
            _ => drop(client.send_pose(now, now, now, &Pose::IDENTITY)),
        }
        while let Some(frame) = client.poll_frame() {
            let decoding = Decoding { started_at: now, succeeded: piece.len() % 2 == 0 };
            client.frame_decoded(now, frame.header.frame, decoding);
        }
        while client.poll_transmit().is_some() {}
        while client.poll_event().is_some() {}
    }
}
