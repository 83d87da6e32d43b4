//! Frames for the encoder: submitted, in flight, finished.

use crate::StereoPlan;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::layout::GpuFrame;
use crate::scene_on_device::SceneOnDevice;
use crate::targets::{Targets, frame_group, record_raycast};
use std::sync::Arc;
use std::sync::mpsc;
use std::time::Duration;

/// A device that takes longer than this for a frame is taken for dead. The exact quality on a software driver may take
/// half a minute for a large picture.
const LONGEST_FRAME: Duration = Duration::from_secs(120);
/// Timestamps of a frame: begin and end of ray-cast, begin and end of conversion.
const TIMESTAMPS: u32 = 4;
const TIMESTAMP_BYTES: u64 = TIMESTAMPS as u64 * 8;

/// What the device itself measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuTimes {
    /// Casting the rays of both eyes.
    pub raycast: Duration,
    /// Converting to YUV and reducing the depths.
    pub convert: Duration,
}

/// Draws frames one after the other, each into a slot of a read-back ring: while one is read and encoded, the next is
/// cast.
#[derive(Debug)]
pub struct FrameRenderer {
    gpu: Arc<Gpu>,
    targets: Option<Targets>,
    free: mpsc::Receiver<Slot>,
    /// A free slot that was found by looking for one.
    next: Option<Slot>,
    give_back: mpsc::Sender<Slot>,
    slots: usize,
}

/// What a frame in flight holds for itself.
#[derive(Debug)]
struct Slot {
    uniform: wgpu::Buffer,
    frame_group: wgpu::BindGroup,
    queries: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    /// Planes, then the grid of depths, then the timestamps; grows with the frames.
    read_back: Option<wgpu::Buffer>,
}

impl FrameRenderer {
    /// A ring of `slots` frames: what may be in flight or in the encoders' hands at a time.
    ///
    /// # Errors
    /// If the device has no room.
    pub fn new(gpu: &Arc<Gpu>, slots: usize) -> Result<Self, RenderError> {
        let (give_back, free) = mpsc::channel();
        for _ in 0..slots {
            // The receiver lives in this function's result: sending cannot fail here.
            let _ = give_back.send(Slot::new(gpu)?);
        }
        Ok(Self { gpu: gpu.clone(), targets: None, free, next: None, give_back, slots })
    }

    /// Whether a frame can be submitted now.
    pub fn has_room(&mut self) -> bool {
        if self.next.is_none() {
            self.next = self.free.try_recv().ok();
        }
        self.next.is_some()
    }

    /// Submits a frame and returns at once.
    ///
    /// # Errors
    /// [`RenderError::RingFull`] while all slots are in use; an error of the device if it has no room.
    pub fn submit(&mut self, scene: &SceneOnDevice, plan: &StereoPlan) -> Result<FrameInFlight, RenderError> {
        let free = self.next.take().or_else(|| self.free.try_recv().ok());
        let mut slot = free.ok_or(RenderError::RingFull { slots: self.slots })?;
        match self.record(&mut slot, scene, plan) {
            Ok(submission) => Ok(FrameInFlight {
                gpu: self.gpu.clone(),
                plan: plan.clone(),
                submission,
                returns: Returns { slot: Some(slot), give_back: self.give_back.clone() },
            }),
            Err(error) => {
                let _ = self.give_back.send(slot);
                Err(error)
            }
        }
    }

    fn record(
        &mut self,
        slot: &mut Slot,
        scene: &SceneOnDevice,
        plan: &StereoPlan,
    ) -> Result<wgpu::SubmissionIndex, RenderError> {
        let gpu = &self.gpu;
        let targets = match self.targets.take() {
            Some(targets) if targets.hold(plan) => targets,
            before => Targets::new(gpu, plan, before.as_ref())?,
        };
        let targets = &*self.targets.insert(targets);
        let layout = ReadBack::of(plan);
        let read_back = slot.read_back(gpu, layout.total)?;
        gpu.queue.write_buffer(&slot.uniform, 0, bytemuck::bytes_of(&plan.frame));

        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        let stamps = |begin| {
            slot.queries.as_ref().map(|(set, _)| wgpu::ComputePassTimestampWrites {
                query_set: set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(begin + 1),
            })
        };
        record_raycast(gpu, &mut encoder, scene, plan, &slot.frame_group, targets, stamps(0))?;
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("convert"),
                timestamp_writes: stamps(2),
            });
            pass.set_bind_group(0, &slot.frame_group, &[]);
            let pipelines = &gpu.pipelines;
            if plan.is_scaled() {
                pass.set_pipeline(&pipelines.tone);
                pass.set_bind_group(1, &targets.tone_group, &[]);
                let [columns, rows] = plan.render_size_px().map(|side| side.div_ceil(8));
                pass.dispatch_workgroups(columns, rows, plan.eye_count());
            }
            pass.set_pipeline(if plan.is_scaled() { &pipelines.convert_scaled } else { &pipelines.convert });
            pass.set_bind_group(1, &targets.convert_group, &[]);
            let [width, height] = plan.output_size_px();
            pass.dispatch_workgroups((width * plan.eye_count()).div_ceil(64), height.div_ceil(16), 1);
            if layout.depth_bytes > 0 {
                pass.set_pipeline(&pipelines.depth);
                pass.set_bind_group(1, &targets.depth_group, &[]);
                pass.dispatch_workgroups((layout.depth_bytes as u32 / 4).div_ceil(64), 1, 1);
            }
        }
        encoder.copy_buffer_to_buffer(&targets.planes, 0, &read_back, 0, Some(layout.planes_bytes));
        if layout.depth_bytes > 0 {
            encoder.copy_buffer_to_buffer(
                &targets.depth_grid,
                0,
                &read_back,
                layout.planes_bytes,
                Some(layout.depth_bytes),
            );
        }
        if let Some((set, resolved)) = &slot.queries {
            encoder.resolve_query_set(set, 0..TIMESTAMPS, resolved, 0);
            encoder.copy_buffer_to_buffer(
                resolved,
                0,
                &read_back,
                layout.timestamps_at,
                Some(TIMESTAMP_BYTES),
            );
        }
        Ok(gpu.queue.submit([encoder.finish()]))
    }
}

impl Slot {
    fn new(gpu: &Gpu) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let uniform =
            gpu.buffer("a frame's numbers", size_of::<GpuFrame>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let frame_group = frame_group(gpu, &uniform);
        let queries = if gpu.has_timestamps {
            let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("frame"),
                ty: wgpu::QueryType::Timestamp,
                count: TIMESTAMPS,
            });
            let usage = Usage::QUERY_RESOLVE | Usage::COPY_SRC;
            Some((set, gpu.buffer("a frame's timestamps", TIMESTAMP_BYTES, usage)?))
        } else {
            None
        };
        Ok(Self { uniform, frame_group, queries, read_back: None })
    }

    fn read_back(&mut self, gpu: &Gpu, bytes: u64) -> Result<wgpu::Buffer, RenderError> {
        use wgpu::BufferUsages as Usage;
        match &self.read_back {
            Some(buffer) if buffer.size() >= bytes => Ok(buffer.clone()),
            _ => {
                let buffer = gpu.buffer("the read-back", bytes, Usage::MAP_READ | Usage::COPY_DST)?;
                Ok(self.read_back.insert(buffer).clone())
            }
        }
    }
}

/// Where things lie in a slot's read-back.
#[derive(Clone, Copy, Debug)]
struct ReadBack {
    planes_bytes: u64,
    depth_bytes: u64,
    timestamps_at: u64,
    total: u64,
}

impl ReadBack {
    fn of(plan: &StereoPlan) -> Self {
        let planes_bytes = (plan.planes_bytes() as u64).next_multiple_of(4);
        let depth_bytes = plan.depth_grid_bytes() as u64;
        let timestamps_at = (planes_bytes + depth_bytes).next_multiple_of(8);
        Self { planes_bytes, depth_bytes, timestamps_at, total: timestamps_at + TIMESTAMP_BYTES }
    }
}

/// Gives its slot back when dropped, unmapped.
#[derive(Debug)]
struct Returns {
    slot: Option<Slot>,
    give_back: mpsc::Sender<Slot>,
}

impl Drop for Returns {
    fn drop(&mut self) {
        if let Some(slot) = self.slot.take() {
            // The renderer may be gone: then the slot goes too.
            let _ = self.give_back.send(slot);
        }
    }
}

/// A frame that the device is drawing.
#[derive(Debug)]
pub struct FrameInFlight {
    gpu: Arc<Gpu>,
    plan: StereoPlan,
    submission: wgpu::SubmissionIndex,
    returns: Returns,
}

impl FrameInFlight {
    /// Waits for the device and maps what it wrote.
    ///
    /// # Errors
    /// If the device was lost or did not answer within two minutes.
    pub fn finish(self) -> Result<FinishedFrame, RenderError> {
        let failed = |reason: String| RenderError::Device { what: "a frame's read-back", reason };
        let layout = ReadBack::of(&self.plan);
        let buffer = self.returns.slot.as_ref().and_then(|s| s.read_back.clone());
        let buffer = buffer.ok_or_else(|| failed("the frame has no read-back".into()))?;
        let (done, mapped) = mpsc::channel();
        buffer.slice(..layout.total).map_async(wgpu::MapMode::Read, move |result| {
            let _ = done.send(result);
        });
        let wait =
            wgpu::PollType::Wait { submission_index: Some(self.submission), timeout: Some(LONGEST_FRAME) };
        let waited = self.gpu.device.poll(wait).map_err(|e| failed(e.to_string())).and_then(|_| {
            let result = mapped.recv_timeout(LONGEST_FRAME).map_err(|e| failed(e.to_string()))?;
            result.map_err(|e| failed(e.to_string()))
        });
        if let Err(error) = waited {
            // The slot goes back to the ring, where a buffer that may yet be mapped would be an error.
            buffer.unmap();
            return Err(error);
        }
        let view = buffer.slice(..layout.total).get_mapped_range().map_err(|e| failed(format!("{e:?}")))?;
        let times = self.gpu.has_timestamps.then(|| {
            let at = layout.timestamps_at as usize;
            let period = f64::from(self.gpu.queue.get_timestamp_period());
            let stamp = |i: usize| {
                let bytes = &view[at + i * 8..at + i * 8 + 8];
                u64::from_le_bytes(bytes.try_into().unwrap_or_default())
            };
            let between = |a: usize, b: usize| {
                Duration::from_nanos((stamp(b).saturating_sub(stamp(a)) as f64 * period) as u64)
            };
            GpuTimes { raycast: between(0, 1), convert: between(2, 3) }
        });
        Ok(FinishedFrame { view: Some(view), buffer, layout, plan: self.plan, times, _returns: self.returns })
    }
}

/// A frame in the host's memory. Its slot goes back to the ring when it is dropped.
#[derive(Debug)]
pub struct FinishedFrame {
    view: Option<wgpu::BufferView>,
    buffer: wgpu::Buffer,
    layout: ReadBack,
    plan: StereoPlan,
    times: Option<GpuTimes>,
    // Dropped after this struct's own drop has unmapped the buffer.
    _returns: Returns,
}

impl FinishedFrame {
    /// The three planes behind each other: luma with [`Self::luma_stride`] bytes a row, then U, then V with half of it.
    #[must_use]
    pub fn planes(&self) -> &[u8] {
        &self.bytes()[..self.plan.planes_bytes()]
    }

    /// Bytes of a row of luma: the width of both eyes, rounded up to 8.
    #[must_use]
    pub fn luma_stride(&self) -> usize {
        self.plan.luma_stride()
    }

    /// Width of both eyes and height, in pixels.
    #[must_use]
    pub fn size_px(&self) -> [u32; 2] {
        let [width, height] = self.plan.output_size_px();
        [width * self.plan.eye_count(), height]
    }

    /// Depths of the grid: millimetres of room, 0 where nothing is seen; row by row, the left eye's cells first.
    #[must_use]
    pub fn depth_grid_mm(&self) -> Vec<u16> {
        let at = self.layout.planes_bytes as usize;
        let grid = self.plan.depth_grid();
        let cells = (grid.columns * grid.rows * self.plan.eye_count()) as usize;
        self.bytes()[at..].chunks_exact(2).take(cells).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
    }

    /// What was planned.
    #[must_use]
    pub fn plan(&self) -> &StereoPlan {
        &self.plan
    }

    /// What the device measured; `None` where it cannot.
    #[must_use]
    pub fn gpu_times(&self) -> Option<GpuTimes> {
        self.times
    }

    fn bytes(&self) -> &[u8] {
        // The view is there until this is dropped.
        self.view.as_deref().unwrap_or(&[])
    }
}

impl Drop for FinishedFrame {
    fn drop(&mut self) {
        self.view = None;
        self.buffer.unmap();
    }
}
