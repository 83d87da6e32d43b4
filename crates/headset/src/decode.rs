//! Threads that decode.

use crate::clock::HeadsetClock;
use codec::{DecodeError, Decoder, YuvPicture};
use session::{HeadsetTime, ReceivedFrame};
use std::io;
use std::num::NonZero;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use tokio::sync::oneshot;

/// Named threads that decode frames of any number of headsets. A headset has at most one frame here at a time, so its
/// frames are decoded in order and the queue is never longer than the headsets are many; what comes meanwhile waits
/// in the session, where a key frame can still pass it over.
///
/// The threads end when the pool and every headset that uses it are gone.
#[derive(Clone, Debug)]
pub struct DecodePool {
    queue: Sender<Job>,
}

/// A frame with the decoder of its stream, which comes back with the picture.
struct Job {
    decoder: Decoder,
    frame: ReceivedFrame,
    clock: HeadsetClock,
    done: oneshot::Sender<Decoded>,
}

/// A frame that a thread is done with.
pub(crate) struct Decoded {
    pub(crate) decoder: Decoder,
    pub(crate) frame: ReceivedFrame,
    pub(crate) started_at: HeadsetTime,
    pub(crate) finished_at: HeadsetTime,
    pub(crate) result: Result<YuvPicture, DecodeError>,
}

impl DecodePool {
    /// Starts `threads` threads named `decode-0` and on.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(threads: NonZero<usize>) -> io::Result<Self> {
        let (queue, jobs) = channel();
        let jobs = Arc::new(Mutex::new(jobs));
        for i in 0..threads.get() {
            let jobs = jobs.clone();
            thread::Builder::new().name(format!("decode-{i}")).spawn(move || work(&jobs))?;
        }
        Ok(Self { queue })
    }

    /// Gives a frame to the next free thread.
    pub(crate) fn decode(
        &self,
        decoder: Decoder,
        frame: ReceivedFrame,
        clock: HeadsetClock,
    ) -> oneshot::Receiver<Decoded> {
        let (done, decoded) = oneshot::channel();
        // The threads live as long as the queue. If one had panicked in the decoder, `decoded` tells.
        let _ = self.queue.send(Job { decoder, frame, clock, done });
        decoded
    }
}

fn work(jobs: &Mutex<Receiver<Job>>) {
    loop {
        // Only the wait holds the lock.
        let job = jobs.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Job { mut decoder, frame, clock, done }) = job else {
            return;
        };
        let started_at = clock.now();
        let result = decoder.decode(frame.access_unit());
        // A headset that is gone wants no picture.
        let _ = done.send(Decoded { decoder, frame, started_at, finished_at: clock.now(), result });
    }
}
