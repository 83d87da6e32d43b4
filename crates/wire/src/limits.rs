//! The numbers that both ends agree on before they meet.

/// The application protocol that TLS negotiates.
pub const ALPN: &[u8] = b"holocast/1";

/// The version that a [`crate::Hello`] and a [`crate::Welcome`] carry.
pub const PROTOCOL_VERSION: u16 = 1;

/// Largest body of a control message in bytes, without its length prefix. A scene with its tables fits many times.
pub const MAX_CONTROL_BYTES: usize = 256 * 1024;

/// Largest datagram in bytes: what QUIC carries over any path that carries QUIC at all.
pub const MAX_DATAGRAM_BYTES: usize = 1200;

/// Largest encoded [`crate::FrameHeader`] in bytes, without its length prefix.
pub const MAX_FRAME_HEADER_BYTES: usize = 64 * 1024;

/// Largest access unit in bytes.
pub const MAX_ACCESS_UNIT_BYTES: usize = 16 * 1024 * 1024;

/// Largest content of a frame's stream in bytes: length prefix, header and access unit.
pub const MAX_FRAME_BYTES: usize = 4 + MAX_FRAME_HEADER_BYTES + MAX_ACCESS_UNIT_BYTES;

/// Most frames that are ever under way to one headset, and so the most streams it must be ready to take.
pub const MAX_FRAMES_IN_FLIGHT: usize = 32;
