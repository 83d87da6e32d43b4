//! One headset's session as two state machines: [`ServerSession`] and [`ClientSession`].
//!
//! Neither has a socket, a thread or a clock. Whoever owns those feeds inputs with the time at which they came, and
//! then drains what is to be sent, what has happened, and when to call again. The drive loop is the same for both
//! ends:
//!
//! ```text
//! loop {
//!     // 1. Drain: all of it, before waiting.
//!     while let Some(transmit) = session.poll_transmit() {                  (the server's takes `now`)
//!         Control(bytes)  => append to the control stream (the highest priority of all streams)
//!         Datagram(bytes) => send as a datagram; a full queue may drop it
//!         Frame { .. }    => open a unidirectional stream, set its priority, write, finish      (server)
//!         ResetFrame(n)   => reset the stream of frame n                                        (server)
//!         Close { .. }    => finish the control stream, give it a moment, close the connection; the end
//!     }
//!     while let Some(event) = session.poll_event() { act on it }
//!
//!     // 2. Wait for the first of these, and tell the session with the time at which it came.
//!     bytes of the control stream, in pieces of any size => session.handle_control(now, bytes)
//!     a datagram                                         => session.handle_datagram(now, bytes)
//!     a frame's stream, to its end or its reset          => session.handle_frame / frame_stream_reset   (client)
//!     the connection has ended by itself                 => session.handle_disconnect(now, code, reason)
//!     the time that session.poll_timeout() names         => session.handle_timeout(now)
//! }
//! ```
//!
//! **The server** answers [`ServerEvent::Connected`] with [`ServerSession::welcome`] or [`ServerSession::close`]. From
//! then on its scheduler asks every session for a [`FrameRequest`], picks the earliest deadline, and calls
//! [`ServerSession::begin_frame`] at the moment at which the renderer is free: that is when the newest pose is taken
//! and extrapolated to its display time. The [`FrameTicket`] comes back through [`ServerSession::frame_encoded`] or
//! [`ServerSession::frame_abandoned`], always.
//!
//! **The headset** calls [`ClientSession::send_pose`] for every pose, takes frames with [`ClientSession::poll_frame`]
//! whenever its decoder is free, and reports with [`ClientSession::frame_decoded`], which returns the frame's
//! [`FrameTimeline`]: where every microsecond between pose and picture went.
//!
//! Two clocks meet here and cannot be mixed up: [`ServerTime`] and [`HeadsetTime`]. Both count microseconds and never
//! go back; [`ClockOffset`] leads from one to the other.
//!
//! This crate knows no socket, thread, clock, GPU or codec.

mod client;
mod close;
mod convert;
mod device;
mod pairing;
mod server;
mod time;
mod timeline;

pub use client::{
    ClientCounters, ClientEvent, ClientSession, ClientSettings, ClientTransmit, Decoding, ReceivedFrame,
};
pub use close::{ClosedBy, Disconnection};
pub use device::{Device, DeviceError, MAX_NAME_BYTES};
pub use pairing::PairingCode;
pub use server::{
    EncodedFrame, FrameFate, FrameRequest, FrameTicket, PoseTimes, Prediction, Reference, RenderTimes,
    ServerCounters, ServerEvent, ServerSession, ServerSettings, ServerTransmit, StreamTerms,
};
pub use time::{ClockOffset, HeadsetTime, ServerTime};
pub use timeline::{FrameTimeline, Stage};
