//! The sending half of the control stream.

use bytes::Bytes;
use quinn::SendStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// What a queued piece costs beside its bytes, so that a million empty ones are no way around the bound.
const OVERHEAD_BYTES: usize = 64;

/// Why bytes were not taken for the control stream. They are lost, and with them the stream's sense: close, if the
/// connection is not over anyway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendControlError {
    /// The peer does not read.
    #[error("{queued} control bytes wait for the peer to read, at most {max} may")]
    Stalled {
        /// Bytes that wait.
        queued: usize,
        /// Bytes that may wait.
        max: usize,
    },
    /// The connection is over. Its last event says who ended it and why, so that there is nothing to be done here.
    #[error("the connection is closed")]
    Closed,
    /// The peer has stopped the control stream and goes on otherwise.
    #[error("the peer does not want to hear the control stream any more")]
    Stopped,
}

/// A bounded queue in front of the control stream. It drops nothing: a full one is an error.
#[derive(Debug)]
pub(crate) struct ControlWriter {
    sender: mpsc::UnboundedSender<Bytes>,
    /// Bounded by `queued`.
    receiver: Option<mpsc::UnboundedReceiver<Bytes>>,
    queued: Arc<AtomicUsize>,
    max: usize,
    task: Option<JoinHandle<()>>,
}

impl ControlWriter {
    /// A queue whose stream is not there yet.
    pub(crate) fn new(max: usize) -> Self {
        let (sender, receiver) = mpsc::unbounded_channel();
        Self { sender, receiver: Some(receiver), queued: Arc::default(), max, task: None }
    }

    /// The stream is there.
    pub(crate) fn start(&mut self, runtime: &Handle, stream: SendStream) {
        if let Some(receiver) = self.receiver.take() {
            self.task = Some(runtime.spawn(write(stream, receiver, self.queued.clone())));
        }
    }

    pub(crate) fn send(&self, bytes: Bytes) -> Result<(), SendControlError> {
        let cost = bytes.len() + OVERHEAD_BYTES;
        let queued = self.queued.fetch_add(cost, Ordering::Relaxed);
        // What is larger than the bound may go alone.
        let result = if queued > 0 && queued + cost > self.max {
            Err(SendControlError::Stalled { queued, max: self.max })
        } else {
            self.sender.send(bytes).map_err(|_| SendControlError::Stopped)
        };
        if result.is_err() {
            self.queued.fetch_sub(cost, Ordering::Relaxed);
        }
        result
    }

    /// Sends what is queued, ends the stream, and waits until the peer has it all, but no longer than `grace`.
    pub(crate) async fn finish(self, grace: Duration) {
        drop(self.sender);
        if let Some(task) = self.task {
            // Not a peer in the world makes this longer than its grace; the connection's end ends the task.
            let _ = tokio::time::timeout(grace, task).await;
        }
    }
}

async fn write(
    mut stream: SendStream,
    mut receiver: mpsc::UnboundedReceiver<Bytes>,
    queued: Arc<AtomicUsize>,
) {
    // Control is small, and decides what happens to all else. Errors mean that the connection is over or that the peer
    // does not want to hear: the queue closes, and the next `send` says so.
    let _ = stream.set_priority(i32::MAX);
    while let Some(bytes) = receiver.recv().await {
        let cost = bytes.len() + OVERHEAD_BYTES;
        if stream.write_chunk(bytes).await.is_err() {
            return;
        }
        queued.fetch_sub(cost, Ordering::Relaxed);
    }
    if stream.finish().is_ok() {
        let _ = stream.stopped().await;
    }
}
