//! The threads `encode-N`: frames to access units.

use crate::render_loop::DEPTH_GRID;
use crate::seat::{EncodeJob, Seat, Stream, locked};
use crate::server::Shared;
use codec::{Encoder, YuvFrame};
use session::{EncodedFrame, FrameFate, Reference, RenderTimes};
use std::io;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;

/// A bounded pool. A seat in its queue stands for one frame of that seat; frames of one seat are encoded in their order,
/// one at a time.
pub(crate) struct EncoderPool {
    seats: mpsc::SyncSender<Arc<Seat>>,
    threads: Vec<JoinHandle<()>>,
}

impl EncoderPool {
    /// `queue` bounds the frames that wait: the slots of the read-back ring, so that handing one over never blocks.
    pub(crate) fn start(shared: &Arc<Shared>, threads: usize, queue: usize) -> io::Result<Self> {
        let (seats, receiver) = mpsc::sync_channel::<Arc<Seat>>(queue);
        let receiver = Arc::new(Mutex::new(receiver));
        let threads = (0..threads.max(1))
            .map(|i| {
                let (shared, receiver) = (shared.clone(), receiver.clone());
                std::thread::Builder::new().name(format!("encode-{i}")).spawn(move || {
                    loop {
                        let next = locked(&receiver).recv();
                        let Ok(seat) = next else { return };
                        let ends_with_a_panic = StopOnPanic(&shared);
                        encode_waiting(&shared, &seat);
                        drop(ends_with_a_panic);
                    }
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { seats, threads })
    }

    /// A frame of this seat waits.
    pub(crate) fn encode(&self, seat: &Arc<Seat>) {
        let Some(stream) = seat.stream() else { return };
        // One thread serves a headset at a time: a second one would only wait for its encoder.
        if !stream.is_encoding.swap(true, Ordering::AcqRel) {
            // The queue has room for as many frames as there are; it is gone only after this thread.
            let _ = self.seats.send(seat.clone());
        }
    }

    /// Lets the threads finish what waits, and ends them.
    pub(crate) fn finish(self) {
        drop(self.seats);
        for thread in self.threads {
            let _ = thread.join();
        }
    }
}

/// A thread that is gone would leave its headset's frames waiting for ever.
pub(crate) struct StopOnPanic<'a>(pub(crate) &'a Shared);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            tracing::error!("a thread has panicked; the server stops");
            self.0.stop();
        }
    }
}

/// Encodes what waits for this headset, in order.
fn encode_waiting(shared: &Shared, seat: &Seat) {
    let Some(stream) = seat.stream() else { return };
    let mut encoder = locked(&stream.encoder);
    loop {
        let Some(job) = locked(&stream.waiting).pop_front() else {
            stream.is_encoding.store(false, Ordering::Release);
            // A frame that came between the look and the store has not called a thread.
            if locked(&stream.waiting).is_empty() || stream.is_encoding.swap(true, Ordering::AcqRel) {
                return;
            }
            continue;
        };
        encode(shared, seat, stream, &mut encoder, job);
        seat.wake.notify_one();
        // A slot of the ring and a place in the session are free again.
        shared.wishes.wake();
    }
}

fn encode(shared: &Shared, seat: &Seat, stream: &Stream, encoder: &mut Encoder, job: EncodeJob) {
    let EncodeJob {
        ticket,
        frame,
        scene_revision,
        time_step,
        rung,
        lit,
        render_started,
        rendered,
        converted,
    } = job;
    let (is_closed, must_be_key_frame) = {
        let session = seat.session();
        (session.is_closed(), session.next_must_be_key_frame())
    };
    if is_closed {
        seat.session().frame_abandoned(shared.clock.now(), ticket);
        return;
    }
    let encode_started = shared.clock.now();
    let encoded = YuvFrame::new(stream.layout, frame.planes())
        .map_err(|e| e.to_string())
        .and_then(|picture| encoder.encode(picture, must_be_key_frame).map_err(|e| e.to_string()));
    let depth = wire::DepthGrid {
        columns: DEPTH_GRID.columns as u16,
        rows: DEPTH_GRID.rows as u16,
        distances_mm: frame.depth_grid_mm(),
    };
    // Its slot goes back to the ring before anything else is done.
    drop(frame);
    let now = shared.clock.now();
    let access_unit = match encoded {
        Ok(access_unit) => access_unit,
        Err(error) => {
            tracing::warn!(session = seat.id, frame = ticket.number, "frame not encoded: {error}");
            seat.session().frame_abandoned(now, ticket);
            return;
        }
    };
    let number = ticket.number;
    let sent = seat.session().frame_encoded(
        now,
        ticket,
        EncodedFrame {
            access_unit: &access_unit.bytes,
            reference: if access_unit.key_frame { Reference::None } else { Reference::Previous },
            scene_revision,
            time_step,
            times: RenderTimes { render_started, rendered, converted, encode_started, encoded: now },
            quality: wire::Quality {
                resolution_scale: (shared.settings.quality.resolution_scale * rung.resolution_scale) as f32,
                step_scale: rung.step_scale as f32,
                shading: u8::from(lit),
            },
            depth,
        },
    );
    match sent {
        Ok(FrameFate::Sent | FrameFate::Closed) => {}
        Ok(FrameFate::Undecodable) => {
            tracing::debug!(session = seat.id, frame = number, "a key frame is due");
        }
        Err(error) => tracing::warn!(session = seat.id, frame = number, "frame not sent: {error}"),
    }
}
