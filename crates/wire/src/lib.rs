//! The messages of `holocast/1` and their bytes.
//!
//! `proto/wire.md` is the normative text of this protocol and `proto/vectors/` holds golden bytes of every message;
//! this crate is one implementation of them. Everything here is plain data: numbers as they travel, with their units
//! in their names. What the numbers mean, and whether they make sense (a quaternion of length 1, a field of view that
//! an eye can have), is judged by the crate above, `session`.
//!
//! - [`ClientMessage`] and [`ServerMessage`] travel on the control stream, each behind its length; [`ControlReader`]
//!   cuts them out of the stream again.
//! - [`ClientDatagram`] and [`ServerDatagram`] travel as QUIC datagrams.
//! - [`encode_frame`] and [`decode_frame`] make and read the whole content of a frame's stream; [`stamp_sent`] says when it
//!   went out.
//!
//! Decoding never panics, uses all bytes or fails, and never allocates more than the limit of what is decoded.
//! This crate knows no QUIC, no runtime, and no type of the renderer or of `spatial`.

mod bytes;
mod close;
mod control;
mod datagram;
mod frame;
mod geometry;
mod limits;
#[cfg(test)]
mod properties;
#[cfg(test)]
mod samples;
#[cfg(test)]
mod vectors;

pub use bytes::{DecodeError, EncodeError, What};
pub use close::CloseCode;
pub use control::{
    ClientMessage, ClientStatistics, ControlReader, DeviceDescription, Goodbye, Hello, ServerMessage,
    ServerStatistics, Stream, Welcome, hello_version,
};
pub use datagram::{ClientDatagram, ClockReport, Feedback, Ping, Pong, PoseSample, ServerDatagram};
pub use frame::{
    DepthGrid, Frame, FrameHeader, Quality, StageTimes, decode_frame, encode_frame, frame_number_of_part,
    stamp_sent,
};
pub use geometry::{EyeGeometry, EyeView, Fov, Pose};
pub use limits::{
    ALPN, MAX_ACCESS_UNIT_BYTES, MAX_CONTROL_BYTES, MAX_DATAGRAM_BYTES, MAX_FRAME_BYTES,
    MAX_FRAME_HEADER_BYTES, MAX_FRAMES_IN_FLIGHT, PROTOCOL_VERSION,
};
