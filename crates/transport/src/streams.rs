//! Unidirectional streams: whole ones out, whole ones in.

use crate::statistics::Counters;
use bytes::Bytes;
use quinn::{ReadError, RecvStream, SendStream, VarInt};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::runtime::Handle;
use tokio::sync::oneshot;

/// Bytes of a reset stream that are kept.
const PART_BYTES: usize = 64;
/// Pieces that are taken from a stream at once.
const PIECES: usize = 32;

/// Why a stream was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendStreamError {
    /// As many streams are under way as may be.
    #[error("{max} streams are under way, and no more may be")]
    TooMany {
        /// [`crate::TransportSettings::max_outgoing_streams`].
        max: usize,
    },
    /// The streams under way leave no room for this one.
    #[error("{under_way} bytes of streams are under way, {bytes} more would exceed {max}")]
    TooMuch {
        /// Bytes under way.
        under_way: usize,
        /// Bytes of this stream.
        bytes: usize,
        /// [`crate::TransportSettings::max_outgoing_bytes`].
        max: usize,
    },
    /// A stream of this name is under way.
    #[error("stream {id} is under way already")]
    NameTaken {
        /// The name.
        id: u64,
    },
    /// The connection is over.
    #[error("the connection is closed")]
    Closed,
}

/// The streams that are sent and not yet wholly acknowledged.
#[derive(Clone, Debug)]
pub(crate) struct OutgoingStreams {
    under_way: Arc<Mutex<UnderWay>>,
    max_streams: usize,
    max_bytes: usize,
}

#[derive(Debug, Default)]
struct UnderWay {
    resets: HashMap<u64, oneshot::Sender<()>>,
    bytes: usize,
}

impl OutgoingStreams {
    pub(crate) fn new(max_streams: usize, max_bytes: usize) -> Self {
        Self { under_way: Arc::default(), max_streams, max_bytes }
    }

    /// Streams and bytes under way.
    pub(crate) fn under_way(&self) -> (usize, usize) {
        let under_way = self.lock();
        (under_way.resets.len(), under_way.bytes)
    }

    pub(crate) fn send(
        &self,
        runtime: &Handle,
        quinn: &quinn::Connection,
        counters: &Counters,
        id: u64,
        bytes: Bytes,
        priority: i32,
    ) -> Result<(), SendStreamError> {
        if quinn.close_reason().is_some() {
            return Err(SendStreamError::Closed);
        }
        let place = self.reserve(id, bytes.len()).inspect_err(|_| counters.streams_refused.add_one())?;
        let quinn = quinn.clone();
        runtime.spawn(async move {
            let Place { reset, place: _place } = place;
            tokio::select! {
                biased;
                _ = reset => {}
                () = send_whole(&quinn, bytes, priority) => {}
            }
        });
        Ok(())
    }

    /// Returns whether the stream was still under way.
    pub(crate) fn reset(&self, id: u64) -> bool {
        // The place itself is given back by the stream's task.
        match self.lock().resets.get_mut(&id) {
            Some(reset) => std::mem::replace(reset, oneshot::channel().0).send(()).is_ok(),
            None => false,
        }
    }

    fn reserve(&self, id: u64, bytes: usize) -> Result<Place, SendStreamError> {
        let mut under_way = self.lock();
        if under_way.resets.len() >= self.max_streams {
            return Err(SendStreamError::TooMany { max: self.max_streams });
        }
        if under_way.bytes > 0 && under_way.bytes + bytes > self.max_bytes {
            let max = self.max_bytes;
            return Err(SendStreamError::TooMuch { under_way: under_way.bytes, bytes, max });
        }
        if under_way.resets.contains_key(&id) {
            return Err(SendStreamError::NameTaken { id });
        }
        let (sender, reset) = oneshot::channel();
        under_way.resets.insert(id, sender);
        under_way.bytes += bytes;
        let place = GiveBack { under_way: self.under_way.clone(), id, bytes };
        Ok(Place { reset, place })
    }

    fn lock(&self) -> MutexGuard<'_, UnderWay> {
        lock(&self.under_way)
    }
}

/// Nothing can panic while the lock is held, and a count would be right even then.
fn lock(under_way: &Mutex<UnderWay>) -> MutexGuard<'_, UnderWay> {
    under_way.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Place {
    reset: oneshot::Receiver<()>,
    place: GiveBack,
}

struct GiveBack {
    under_way: Arc<Mutex<UnderWay>>,
    id: u64,
    bytes: usize,
}

impl Drop for GiveBack {
    fn drop(&mut self) {
        let mut under_way = lock(&self.under_way);
        under_way.resets.remove(&self.id);
        under_way.bytes -= self.bytes;
    }
}

/// Resets the stream when it is dropped. One that was received whole takes no notice; quinn by itself would finish a
/// stream that was given up in the middle, and the peer would take the part for the whole.
struct ResetOnDrop(SendStream);

impl Drop for ResetOnDrop {
    fn drop(&mut self) {
        let _ = self.0.reset(VarInt::from_u32(0));
    }
}

/// Returns once the peer has the whole stream, does not want it, or is gone.
async fn send_whole(quinn: &quinn::Connection, bytes: Bytes, priority: i32) {
    let Ok(stream) = quinn.open_uni().await else {
        return;
    };
    let mut stream = ResetOnDrop(stream);
    let _ = stream.0.set_priority(priority);
    if stream.0.write_chunk(bytes).await.is_ok() && stream.0.finish().is_ok() {
        let _ = stream.0.stopped().await;
    }
}

/// How an incoming stream ended.
#[derive(Debug)]
pub(crate) enum Arrival {
    Whole(Vec<u8>),
    Reset {
        part: Vec<u8>,
        code: u64,
    },
    TooLarge,
    /// The connection ended before the stream did.
    ConnectionLost,
}

/// Reads a stream to its end, its reset, or `max_bytes`.
pub(crate) async fn receive(mut stream: RecvStream, max_bytes: usize) -> Arrival {
    let mut content = Vec::new();
    let mut pieces: [Bytes; PIECES] = std::array::from_fn(|_| Bytes::new());
    loop {
        match stream.read_chunks(&mut pieces).await {
            Ok(Some(count)) => {
                for piece in &mut pieces[..count] {
                    if content.len() + piece.len() > max_bytes {
                        let _ = stream.stop(VarInt::from_u32(0));
                        return Arrival::TooLarge;
                    }
                    content.extend_from_slice(&std::mem::take(piece));
                }
            }
            Ok(None) => return Arrival::Whole(content),
            Err(ReadError::Reset(code)) => {
                content.truncate(PART_BYTES);
                return Arrival::Reset { part: content, code: code.into_inner() };
            }
            Err(_) => return Arrival::ConnectionLost,
        }
    }
}
