//! One connection, either end.

use crate::TransportSettings;
use crate::control::{ControlWriter, SendControlError};
use crate::statistics::{Counters, Statistics};
use crate::streams::{Arrival, OutgoingStreams, SendStreamError, receive};
use bytes::Bytes;
use quinn::{ConnectionError, ReadError, RecvStream, SendDatagramError, SendStream, VarInt};
use std::future::pending;
use std::net::SocketAddr;
use tokio::runtime::Handle;
use tokio::task::{JoinError, JoinSet};

/// Largest piece of the control stream in one event.
const CONTROL_PIECE_BYTES: usize = 64 << 10;
/// Longest reason that is sent with a close; QUIC has to fit it into a packet.
const MAX_REASON_BYTES: usize = 512;

/// What has happened on a connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The next bytes of the control stream, in pieces of any size.
    Control(Bytes),
    /// A datagram.
    Datagram(Bytes),
    /// A stream has arrived to its end.
    Stream {
        /// All that was in it.
        bytes: Vec<u8>,
    },
    /// The peer has reset a stream.
    StreamReset {
        /// The first bytes that had come, at most 64; QUIC may have come by none.
        part: Vec<u8>,
        /// The peer's reason.
        code: u64,
    },
    /// A stream was longer than [`TransportSettings::max_incoming_stream_bytes`] and was stopped.
    StreamTooLarge {
        /// That bound.
        max: usize,
    },
    /// The connection is over. It is the last event: whoever asks again gets it again.
    Closed {
        /// Whether the peer ended it, rather than this end or the network.
        by_peer: bool,
        /// The code that the application at the other end, or at this one, gave.
        code: Option<u64>,
        /// For people.
        reason: String,
    },
}

/// One connection. Its owner calls [`Connection::next_event`] in a loop and sends as it likes; dropping it closes it.
#[derive(Debug)]
pub struct Connection {
    quinn: quinn::Connection,
    /// A client's own socket, which lives as long as its connection.
    endpoint: Option<quinn::Endpoint>,
    settings: TransportSettings,
    runtime: Handle,
    control_in: ControlIn,
    control_out: ControlWriter,
    outgoing: OutgoingStreams,
    arriving: JoinSet<Arrival>,
    counters: Counters,
    ended: Option<Event>,
}

#[derive(Debug)]
enum ControlIn {
    /// The client has not opened it yet.
    Awaited,
    Open(RecvStream),
    /// The peer has finished it, or the connection is over.
    Over,
}

/// What the select of [`Connection::next_event`] came back with.
enum Happened {
    ControlOpened(SendStream, RecvStream),
    ControlRead(Bytes),
    ControlFinished,
    ControlReset(VarInt),
    Arrived(Result<Arrival, JoinError>),
    StreamOpened(RecvStream),
    Datagram(Bytes),
    Ended(ConnectionError),
}

impl Connection {
    /// The end that was called. To be made inside of a tokio runtime.
    pub(crate) fn called(quinn: quinn::Connection, settings: TransportSettings) -> Self {
        Self::new(quinn, settings, ControlIn::Awaited)
    }

    /// The end that has called, with the control stream that it opened.
    pub(crate) fn calling(
        quinn: quinn::Connection,
        endpoint: quinn::Endpoint,
        (send, receive): (SendStream, RecvStream),
        settings: TransportSettings,
    ) -> Self {
        let mut connection = Self::new(quinn, settings, ControlIn::Open(receive));
        connection.control_out.start(&connection.runtime, send);
        connection.endpoint = Some(endpoint);
        connection
    }

    fn new(quinn: quinn::Connection, settings: TransportSettings, control_in: ControlIn) -> Self {
        Self {
            quinn,
            endpoint: None,
            runtime: Handle::current(),
            control_in,
            control_out: ControlWriter::new(settings.max_control_backlog_bytes),
            outgoing: OutgoingStreams::new(settings.max_outgoing_streams, settings.max_outgoing_bytes),
            arriving: JoinSet::new(),
            counters: Counters::default(),
            ended: None,
            settings,
        }
    }

    /// The peer's address; it may change when the peer moves to another network.
    #[must_use]
    pub fn remote_address(&self) -> SocketAddr {
        self.quinn.remote_address()
    }

    /// The application protocol that both ends agreed on.
    #[must_use]
    pub fn protocol(&self) -> Option<Vec<u8>> {
        let data = self.quinn.handshake_data()?.downcast::<quinn::crypto::rustls::HandshakeData>().ok()?;
        data.protocol
    }

    /// What happens next. Control comes before streams, streams before datagrams, and all that has arrived before the
    /// end. Cancel-safe: an event that was not returned is returned by the next call.
    pub async fn next_event(&mut self) -> Event {
        if let Some(ended) = &self.ended {
            return ended.clone();
        }
        loop {
            // A peer that sends without end must not keep the thread: quinn by itself never yields.
            tokio::task::consume_budget().await;
            match self.happening().await {
                Happened::ControlOpened(send, receive) => {
                    self.control_out.start(&self.runtime, send);
                    self.control_in = ControlIn::Open(receive);
                }
                Happened::ControlRead(bytes) => return Event::Control(bytes),
                Happened::ControlFinished => self.control_in = ControlIn::Over,
                Happened::ControlReset(code) => {
                    // Half a message may be missing: there is nothing to go on with.
                    self.control_in = ControlIn::Over;
                    let reason = format!("the peer has reset the control stream with code {code}");
                    self.quinn.close(VarInt::from_u32(0), reason.as_bytes());
                    return self.end(Event::Closed { by_peer: true, code: None, reason });
                }
                Happened::StreamOpened(stream) => {
                    let receiving = receive(stream, self.settings.max_incoming_stream_bytes);
                    self.arriving.spawn_on(receiving, &self.runtime);
                }
                Happened::Arrived(Ok(Arrival::Whole(bytes))) => return Event::Stream { bytes },
                Happened::Arrived(Ok(Arrival::Reset { part, code })) => {
                    return Event::StreamReset { part, code };
                }
                Happened::Arrived(Ok(Arrival::TooLarge)) => {
                    return Event::StreamTooLarge { max: self.settings.max_incoming_stream_bytes };
                }
                // Told as the connection's end.
                Happened::Arrived(Ok(Arrival::ConnectionLost)) => {}
                Happened::Arrived(Err(error)) => {
                    if let Ok(panic) = error.try_into_panic() {
                        std::panic::resume_unwind(panic);
                    }
                }
                Happened::Datagram(bytes) => return Event::Datagram(bytes),
                Happened::Ended(error) => {
                    let event = closed(&error, &self.settings);
                    return self.end(event);
                }
            }
        }
    }

    async fn happening(&mut self) -> Happened {
        let Self { quinn, control_in, arriving, settings, .. } = self;
        let happened = tokio::select! {
            biased;
            happened = next_control(quinn, control_in) => happened,
            Some(arrived) = arriving.join_next() => Happened::Arrived(arrived),
            stream = quinn.accept_uni(), if arriving.len() < settings.max_incoming_streams as usize => {
                stream.map_or_else(Happened::Ended, Happened::StreamOpened)
            }
            datagram = quinn.read_datagram() => datagram.map_or_else(Happened::Ended, Happened::Datagram),
        };
        if matches!(happened, Happened::Ended(_))
            && let Some(arrived) = arriving.join_next().await
        {
            // What has come to its end before the connection did is still to be told.
            return Happened::Arrived(arrived);
        }
        happened
    }

    fn end(&mut self, event: Event) -> Event {
        self.ended = Some(event.clone());
        event
    }

    /// Appends bytes to the control stream, which goes before all else.
    ///
    /// # Errors
    /// If the peer does not read what was sent before, or the connection is over. The bytes are lost: close.
    pub fn send_control(&self, bytes: impl Into<Bytes>) -> Result<(), SendControlError> {
        let is_over = || self.quinn.close_reason().is_some();
        if is_over() {
            return Err(SendControlError::Closed);
        }
        self.control_out.send(bytes.into()).map_err(|error| match error {
            // The end of the connection ends its streams too.
            SendControlError::Stopped if is_over() => SendControlError::Closed,
            error => error,
        })
    }

    /// Sends a datagram, if it is not too large. Where the queue is full because the path is congested, the oldest
    /// datagrams are dropped for it. [`Statistics`] counts both.
    pub fn send_datagram(&self, bytes: impl Into<Bytes>) {
        let bytes = bytes.into();
        let makes_room = self.quinn.datagram_send_buffer_space() < bytes.len();
        match self.quinn.send_datagram(bytes) {
            Ok(()) => {
                self.counters.datagrams_sent.add_one();
                if makes_room {
                    self.counters.datagrams_congested.add_one();
                }
            }
            Err(SendDatagramError::ConnectionLost(_)) => {}
            Err(
                SendDatagramError::TooLarge
                | SendDatagramError::UnsupportedByPeer
                | SendDatagramError::Disabled,
            ) => self.counters.datagrams_too_large.add_one(),
        }
    }

    /// Opens a stream, writes `bytes` and finishes it, all in the background. Of several streams, the one with the
    /// highest priority goes first. `id` names the stream for [`Self::reset_stream`] while it is under way.
    ///
    /// # Errors
    /// If too many streams or bytes are under way, one of this name is, or the connection is over. Nothing is sent.
    pub fn send_stream(
        &self,
        id: u64,
        bytes: impl Into<Bytes>,
        priority: i32,
    ) -> Result<(), SendStreamError> {
        self.outgoing.send(&self.runtime, &self.quinn, &self.counters, id, bytes.into(), priority)
    }

    /// Gives up a stream, if the peer has not acknowledged all of it. Returns whether it was still under way.
    pub fn reset_stream(&self, id: u64) -> bool {
        self.outgoing.reset(id)
    }

    /// How the connection fares.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        let stats = self.quinn.stats();
        let (streams_under_way, stream_bytes_under_way) = self.outgoing.under_way();
        Statistics {
            rtt: stats.path.rtt,
            min_rtt: stats.path.min_rtt,
            congestion_window_bytes: stats.path.cwnd,
            congestion_events: stats.path.congestion_events,
            mtu_bytes: stats.path.current_mtu,
            packets_sent: stats.path.sent_packets,
            packets_lost: stats.path.lost_packets,
            bytes_sent: stats.udp_tx.bytes,
            bytes_received: stats.udp_rx.bytes,
            datagrams_sent: self.counters.datagrams_sent.get(),
            datagrams_too_large: self.counters.datagrams_too_large.get(),
            datagrams_congested: self.counters.datagrams_congested.get(),
            streams_under_way,
            stream_bytes_under_way,
            streams_refused: self.counters.streams_refused.get(),
        }
    }

    /// Ends the connection in order: what was sent on the control stream gets a moment to be acknowledged, then the
    /// peer is told `code` and `reason`. Streams under way are given up. `code` is at most 2⁶² − 1.
    pub async fn close(mut self, code: u64, reason: &str) {
        let grace = self.settings.close_grace;
        let unused = ControlWriter::new(0);
        std::mem::replace(&mut self.control_out, unused).finish(grace).await;
        self.quinn.close(VarInt::from_u64(code).unwrap_or(VarInt::MAX), shortened(reason).as_bytes());
        if let Some(endpoint) = self.endpoint.take() {
            // Who closes and leaves at once may take the last packet along.
            let _ = tokio::time::timeout(grace, endpoint.wait_idle()).await;
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        // Ends the tasks too: all that they wait for fails. Nothing happens if it was closed before.
        self.quinn.close(VarInt::from_u32(0), b"dropped");
    }
}

async fn next_control(quinn: &quinn::Connection, control: &mut ControlIn) -> Happened {
    match control {
        ControlIn::Awaited => match quinn.accept_bi().await {
            Ok((send, receive)) => Happened::ControlOpened(send, receive),
            Err(_) => pending().await,
        },
        ControlIn::Open(stream) => match stream.read_chunk(CONTROL_PIECE_BYTES, true).await {
            Ok(Some(chunk)) => Happened::ControlRead(chunk.bytes),
            Ok(None) => Happened::ControlFinished,
            Err(ReadError::Reset(code)) => Happened::ControlReset(code),
            // The connection is over, which is told after all else that has arrived.
            Err(_) => pending().await,
        },
        ControlIn::Over => pending().await,
    }
}

fn closed(error: &ConnectionError, settings: &TransportSettings) -> Event {
    let (by_peer, code, reason) = match error {
        ConnectionError::ApplicationClosed(close) => {
            (true, Some(close.error_code.into_inner()), String::from_utf8_lossy(&close.reason).into_owned())
        }
        ConnectionError::ConnectionClosed(close) => (true, None, close.to_string()),
        ConnectionError::Reset => {
            (true, None, "the peer knows nothing of this connection: it was restarted".to_owned())
        }
        ConnectionError::TimedOut => {
            let within = settings.max_idle_timeout.as_millis();
            (false, None, format!("nothing came from the peer within {within} ms"))
        }
        ConnectionError::LocallyClosed => (false, None, "closed by this end".to_owned()),
        ConnectionError::TransportError(error) => (false, None, format!("the peer broke QUIC: {error}")),
        ConnectionError::VersionMismatch | ConnectionError::CidsExhausted => (false, None, error.to_string()),
    };
    Event::Closed { by_peer, code, reason }
}

/// As much of a reason as is sent.
pub(crate) fn shortened(reason: &str) -> &str {
    &reason[..reason.floor_char_boundary(MAX_REASON_BYTES)]
}
