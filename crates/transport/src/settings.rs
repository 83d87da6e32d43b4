//! The bounds of a connection.

use quinn::{IdleTimeout, TransportConfig, VarInt};
use std::sync::Arc;
use std::time::Duration;

/// What a connection may hold and how long it waits. [`TransportSettings::default`] takes no streams, as a server does;
/// [`TransportSettings::receiving`] takes them, as a headset does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TransportSettings {
    /// How long a handshake may take, at either end.
    pub handshake_timeout: Duration,
    /// Handshakes that a server does at one time, and finished ones that wait for [`crate::ServerEndpoint::accept`].
    /// Further peers are refused; from half of it on, a peer has to prove its address first.
    pub max_handshakes: usize,
    /// After this long without a packet from the peer, the connection is over. The shorter one of both ends holds.
    pub max_idle_timeout: Duration,
    /// A packet is sent at least this often, so that a quiet connection stays.
    pub keep_alive_interval: Duration,
    /// Streams that the peer may have open at one time; a peer that opens more breaks QUIC's rules and is cut off.
    pub max_incoming_streams: u32,
    /// Longest stream that is taken; what is longer is stopped and told as [`crate::Event::StreamTooLarge`].
    pub max_incoming_stream_bytes: usize,
    /// Bytes of one stream that the peer may send ahead of what is read.
    pub stream_receive_window_bytes: u32,
    /// Bytes of all streams together that the peer may send ahead of what is read.
    pub receive_window_bytes: u32,
    /// Datagrams that wait to be read, in bytes; the oldest are dropped.
    pub datagram_receive_buffer_bytes: usize,
    /// Datagrams that wait to be sent, in bytes; the oldest are dropped.
    pub datagram_send_buffer_bytes: usize,
    /// Streams that are sent and not yet wholly acknowledged; further ones are refused.
    pub max_outgoing_streams: usize,
    /// Bytes of those streams; a stream that does not fit beside others is refused.
    pub max_outgoing_bytes: usize,
    /// Control bytes that wait because the peer does not read them. With more than this the peer has stalled.
    pub max_control_backlog_bytes: usize,
    /// How long [`crate::Connection::close`] waits for what was sent on the control stream to be acknowledged, and
    /// then for the end itself.
    pub close_grace: Duration,
    /// Round trip that is assumed before the first was measured.
    pub initial_rtt: Duration,
    /// Send and receive buffers that are asked of the operating system for a socket. It may grant less.
    pub socket_buffer_bytes: usize,
}

impl Default for TransportSettings {
    fn default() -> Self {
        Self {
            handshake_timeout: Duration::from_secs(5),
            max_handshakes: 64,
            // Longer than a session's own patience, which ends a silence with a reason.
            max_idle_timeout: Duration::from_secs(10),
            keep_alive_interval: Duration::from_secs(1),
            max_incoming_streams: 0,
            max_incoming_stream_bytes: 0,
            // A control stream needs no more than a message or two.
            stream_receive_window_bytes: 512 << 10,
            receive_window_bytes: 1 << 20,
            // Some hundred poses. What is older than that is worthless.
            datagram_receive_buffer_bytes: 32 << 10,
            datagram_send_buffer_bytes: 32 << 10,
            max_outgoing_streams: 32,
            max_outgoing_bytes: 32 << 20,
            max_control_backlog_bytes: 1 << 20,
            close_grace: Duration::from_millis(500),
            // QUIC's own 333 ms are made for any path; here that would be the wait after a lost first packet.
            initial_rtt: Duration::from_millis(100),
            // Two hundred milliseconds of 100 000 small datagrams a second, with the kernel's overhead for each.
            socket_buffer_bytes: 4 << 20,
        }
    }
}

impl TransportSettings {
    /// For the end that takes streams: at most `max_streams` at a time of at most `max_bytes` each.
    #[must_use]
    pub fn receiving(max_streams: u32, max_bytes: usize) -> Self {
        Self {
            max_incoming_streams: max_streams,
            max_incoming_stream_bytes: max_bytes,
            // A key frame fits without a round trip in between.
            stream_receive_window_bytes: 2 << 20,
            receive_window_bytes: 8 << 20,
            ..Self::default()
        }
    }

    /// `incoming_control` is 1 at the end that is called, whose peer opens the control stream.
    pub(crate) fn to_quinn(&self, incoming_control: u32) -> Arc<TransportConfig> {
        let mut config = TransportConfig::default();
        config
            .max_concurrent_bidi_streams(VarInt::from_u32(incoming_control))
            .max_concurrent_uni_streams(VarInt::from_u32(self.max_incoming_streams))
            .max_idle_timeout(Some(IdleTimeout::try_from(self.max_idle_timeout).unwrap_or_else(|_| {
                // Some hundred million years.
                IdleTimeout::from(VarInt::MAX)
            })))
            .keep_alive_interval(Some(self.keep_alive_interval))
            .stream_receive_window(VarInt::from_u32(self.stream_receive_window_bytes))
            .receive_window(VarInt::from_u32(self.receive_window_bytes))
            // All that this crate lets through fits: a fresh stream then never waits behind a stale one for room in
            // quinn's buffer, where alone priorities count.
            .send_window((self.max_outgoing_bytes + 2 * self.max_control_backlog_bytes) as u64)
            .datagram_receive_buffer_size(Some(self.datagram_receive_buffer_bytes))
            .datagram_send_buffer_size(self.datagram_send_buffer_bytes)
            .initial_rtt(self.initial_rtt);
        Arc::new(config)
    }
}
