//! How a connection fares.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// What a connection has counted since it began, and how its path stands now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Estimate of the round trip.
    pub rtt: Duration,
    /// Shortest round trip seen.
    pub min_rtt: Duration,
    /// Bytes that may be under way.
    pub congestion_window_bytes: u64,
    /// Times that the congestion controller backed off.
    pub congestion_events: u64,
    /// Largest UDP payload of the path, as far as it was probed.
    pub mtu_bytes: u16,
    /// UDP datagrams' worth of packets that were sent.
    pub packets_sent: u64,
    /// Packets that were taken for lost.
    pub packets_lost: u64,
    /// UDP payload sent.
    pub bytes_sent: u64,
    /// UDP payload received.
    pub bytes_received: u64,
    /// Datagrams that were given to QUIC.
    pub datagrams_sent: u64,
    /// Datagrams that were not sent because they are larger than the path or the peer takes.
    pub datagrams_too_large: u64,
    /// Datagrams that were given up because newer ones filled the queue: the path was congested.
    pub datagrams_congested: u64,
    /// Streams that are being sent and are not yet wholly acknowledged.
    pub streams_under_way: usize,
    /// Bytes of those streams.
    pub stream_bytes_under_way: usize,
    /// Streams that were refused because too many or too much was under way.
    pub streams_refused: u64,
}

/// What quinn does not count.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) datagrams_sent: Counter,
    pub(crate) datagrams_too_large: Counter,
    pub(crate) datagrams_congested: Counter,
    pub(crate) streams_refused: Counter,
}

#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add_one(&self) {
        // Nothing is read in the light of this number.
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
