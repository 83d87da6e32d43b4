//! The thread `render`: whose frame is next, drawn, read back, handed to the encoders.

use crate::encoding::EncoderPool;
use crate::quality::Rung;
use crate::room::Shown;
use crate::scheduler::{Scheduler, Wish};
use crate::seat::{EncodeJob, Seat, locked};
use crate::server::Shared;
use render::{
    DepthGridSize, FrameInFlight, FrameRenderer, Placed, PlanError, Quality, RenderError, StereoPlan,
    StereoRequest,
};
use session::{FrameTicket, ServerTime};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Depths sent beside a picture, for each eye.
pub(crate) const DEPTH_GRID: DepthGridSize = DepthGridSize { columns: 16, rows: 12 };
/// Longest sleep without a wish: a wish that was missed costs no more.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);
/// Frames in a row that the device fails before it is given up.
const FAILURES_BEFORE_END: u32 = 30;

/// A frame on the device.
struct Drawing {
    seat: Arc<Seat>,
    ticket: FrameTicket,
    frame: FrameInFlight,
    /// What is drawn, kept until it is: the thread `play` counts by it what is on the device.
    shown: Shown,
    rung: Rung,
    lit: bool,
    submitted: ServerTime,
}

/// Why a frame could not be begun.
#[derive(Debug, thiserror::Error)]
enum BeginError {
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// State of the thread.
pub(crate) struct RenderLoop {
    shared: Arc<Shared>,
    ring: FrameRenderer,
    encoders: EncoderPool,
    scheduler: Scheduler,
    on_device: VecDeque<Drawing>,
    /// When the device was last known to be free.
    device_free: ServerTime,
    failures: u32,
}

impl RenderLoop {
    pub(crate) fn new(shared: Arc<Shared>, ring: FrameRenderer, encoders: EncoderPool) -> Self {
        let device_free = shared.clock.now();
        Self {
            shared,
            ring,
            encoders,
            scheduler: Scheduler::default(),
            on_device: VecDeque::new(),
            device_free,
            failures: 0,
        }
    }

    /// Runs until the server stops.
    pub(crate) fn run(mut self) {
        while !self.shared.is_stopping() {
            while self.on_device.len() < self.shared.settings.device_queue && self.ring.has_room() {
                let Some(seat) = self.next() else { break };
                self.begin(seat);
            }
            match self.on_device.pop_front() {
                Some(drawing) => self.finish(drawing),
                None => self.shared.wishes.wait(LONGEST_SLEEP),
            }
            if self.failures >= FAILURES_BEFORE_END {
                tracing::error!("the device has failed {} frames in a row; the server stops", self.failures);
                self.shared.stop();
            }
        }
        self.encoders.finish();
    }

    /// The seat whose frame is next.
    fn next(&mut self) -> Option<Arc<Seat>> {
        let seats = self.shared.seats();
        let now = self.shared.clock.now();
        let wishes: Vec<Wish> = seats
            .iter()
            .filter_map(|seat| {
                let period = seat.stream()?.period;
                let deadline = seat.session().frame_request(now)?.deadline;
                Some(Wish { session: seat.id, deadline, period })
            })
            .collect();
        self.scheduler.retain(|id| seats.iter().any(|s| s.id == id));
        let chosen = self.scheduler.choose(now, &wishes)?;
        seats.iter().find(|s| s.id == chosen).cloned()
    }

    fn begin(&mut self, seat: Arc<Seat>) {
        let Some(ticket) = seat.session().begin_frame(self.shared.clock.now()) else { return };
        match self.submit(&seat, &ticket) {
            Ok((frame, shown, rung, lit)) => {
                let submitted = self.shared.clock.now();
                self.on_device.push_back(Drawing { seat, ticket, frame, shown, rung, lit, submitted });
            }
            Err(error) => {
                self.failures += 1;
                tracing::warn!(session = seat.id, frame = ticket.number, "frame not begun: {error}");
                seat.session().frame_abandoned(self.shared.clock.now(), ticket);
            }
        }
    }

    fn submit(
        &mut self,
        seat: &Seat,
        ticket: &FrameTicket,
    ) -> Result<(FrameInFlight, Shown, Rung, bool), BeginError> {
        let shown = self.shared.room.shown();
        let asked = self.shared.settings.quality;
        // Longer steps are what is given up first: it counts whether those would be taken.
        let takes_steps = shown.scene.numbers().takes_steps(&asked.coarser(2.0));
        let (rung, size) = match seat.stream() {
            Some(stream) => {
                (self.shared.rung(takes_steps), [stream.device.eye_width_px, stream.device.eye_height_px])
            }
            None => return Err(PlanError::Eyes(0).into()),
        };
        let quality = Quality {
            resolution_scale: asked.resolution_scale * rung.resolution_scale,
            ..asked.coarser(rung.step_scale)
        };
        let scene = shown.scene.scene();
        let plan = StereoPlan::new(
            &StereoRequest {
                eyes: &ticket.view.eyes,
                placed: Placed::in_room(&scene.placement, shown.scene.grid()),
                eye_size_px: size,
                quality,
                step_mm: None,
                depth_grid: DEPTH_GRID,
            },
            shown.scene.grid(),
            shown.scene.numbers(),
        )?;
        let lit = plan.is_lit();
        let frame = self.ring.submit(&shown.scene, &plan)?;
        Ok((frame, shown, rung, lit))
    }

    fn finish(&mut self, drawing: Drawing) {
        let Drawing { seat, ticket, frame, shown, rung, lit, submitted } = drawing;
        let finished = frame.finish();
        let Shown { scene, revision: scene_revision, time_step } = shown;
        drop(scene);
        let converted = self.shared.clock.now();
        // The device draws one frame after the other: this one waited until the one before it was done.
        let render_started = submitted.max(self.device_free).min(converted);
        self.device_free = converted;
        let frame = match finished {
            Ok(frame) => frame,
            Err(error) => {
                self.failures += 1;
                tracing::warn!(session = seat.id, frame = ticket.number, "frame lost: {error}");
                seat.session().frame_abandoned(converted, ticket);
                if let Some(stream) = seat.stream() {
                    stream.took(converted, converted.since(render_started));
                }
                self.shared.judge(converted);
                return;
            }
        };
        self.failures = 0;
        let rendered = match frame.gpu_times() {
            Some(times) => (render_started + times.raycast).min(converted),
            None => converted,
        };
        if let Some(stream) = seat.stream() {
            stream.took(converted, converted.since(render_started));
            self.shared.judge(converted);
            locked(&stream.waiting).push_back(EncodeJob {
                ticket,
                frame,
                scene_revision,
                time_step,
                rung,
                lit,
                render_started,
                rendered,
                converted,
            });
            self.encoders.encode(&seat);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::room::{Room, Volumes};
    use crate::settings::Settings;
    use render::{Gpu, VolumeOnDevice};
    use scene::{SceneFile, VolumeFacts};
    use session::{Device, ServerEvent};
    use spatial::{DVec3, Fov, HeadGeometry};
    use std::net::{Ipv4Addr, SocketAddr};
    use std::time::Instant;
    use volume::{Channel, ChannelKind, Grid, Volume, Voxels};
    use wire::{ClientDatagram, ClientMessage, Hello, PoseSample};

    /// Far longer than anything takes on a loaded machine.
    const PATIENCE: Duration = Duration::from_secs(60);

    fn shared() -> (Arc<Shared>, Arc<Gpu>) {
        let gpu = Arc::new(Gpu::open(None).unwrap());
        let channel = Channel {
            name: "ct".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8((0..64).collect()),
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(Grid::axis_aligned([4; 3], DVec3::ONE).unwrap(), vec![channel]).unwrap();
        let on_device = Arc::new(VolumeOnDevice::upload(&gpu, &volume, |_| {}).unwrap());
        let volumes = Volumes::one(on_device, VolumeFacts::of(&volume));
        let room = Room::new(&gpu, volumes, Quality::BALANCED, &SceneFile::default()).unwrap();
        let nowhere = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let settings = Settings { encoder_threads: 2, ..Settings::new(nowhere) };
        (Shared::new(settings, Clock::start(), room), gpu)
    }

    /// A headset that has been welcomed, without a network.
    fn join(shared: &Shared, name: &str) -> Arc<Seat> {
        let device = Device {
            name: name.into(),
            eye_width_px: 96,
            eye_height_px: 64,
            refresh_hz: 200.0,
            geometry: HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).unwrap()),
            max_bitrate_bps: 10_000_000,
        };
        let hello =
            Hello { version: wire::PROTOCOL_VERSION, pairing_code: String::new(), device: device.to_wire() };
        let seat = shared.take_seat((Ipv4Addr::LOCALHOST, 1).into());
        let now = shared.clock.now();
        seat.session().handle_control(now, &ClientMessage::Hello(hello).encode().unwrap());
        let event = seat.session().poll_event();
        assert!(matches!(event, Some(ServerEvent::Connected { .. })), "{event:?}");
        let terms = seat.open_stream(&device, 1.0).unwrap();
        seat.session().welcome(now, &terms);
        seat
    }

    /// Sends poses of all `seats` until something holds.
    fn poses_until(shared: &Shared, seats: &[&Arc<Seat>], what: &str, holds: impl Fn() -> bool) {
        let begun = Instant::now();
        while !holds() {
            assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}");
            let now = shared.clock.now();
            let pose = PoseSample {
                sequence: now.as_micros(),
                sampled_at_us: now.as_micros(),
                display_at_us: now.as_micros() + 50_000,
                world_from_head: wire::Pose {
                    position_m: [0.0, 1.5, -1.5],
                    orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
                },
            };
            for seat in seats {
                seat.session().handle_datagram(now, &ClientDatagram::Pose(pose).encode());
            }
            shared.wishes.wake();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    fn a_slow_encoder_holds_up_neither_the_next_ray_cast_nor_another_headset() {
        let (shared, gpu) = shared();
        let (slow, other) = (join(&shared, "slow"), join(&shared, "other"));
        let ring = FrameRenderer::new(&gpu, shared.slots()).unwrap();
        let encoders = EncoderPool::start(&shared, 2, shared.slots()).unwrap();
        let running = RenderLoop::new(shared.clone(), ring, encoders);
        // As long as this is held, a frame of the slow one is in its encoder.
        let encoding = locked(&slow.stream().unwrap().encoder);
        let running = std::thread::spawn(move || running.run());
        let both = [&slow, &other];
        poses_until(&shared, &both, "two frames of the slow one were cast", || {
            let counters = slow.session().counters();
            counters.frames_begun == 2 && locked(&slow.stream().unwrap().waiting).len() == 2
        });
        assert_eq!(slow.session().counters().frames_rendered, 0, "none was encoded");
        // Two under way are all that its window takes without a word from the headset.
        poses_until(&shared, &both, "the other one has its frames", || {
            other.session().counters().frames_sent == 2
        });
        assert_eq!(slow.session().counters().frames_begun, 2, "at most two of a headset are made at a time");
        drop(encoding);
        poses_until(&shared, &both, "the slow one is encoded", || slow.session().counters().frames_sent == 2);
        shared.stop();
        running.join().unwrap();
    }
}
