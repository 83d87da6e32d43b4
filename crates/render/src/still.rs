//! The picture itself, in float32.

use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::layout::GpuFrame;
use crate::scene_on_device::SceneOnDevice;
use crate::targets::{Targets, frame_group, record_raycast};
use crate::{Counts, StereoPlan};
use std::sync::{Arc, mpsc};

/// A picture of one or two eyes, at the size its rays were cast.
#[derive(Clone, Debug, PartialEq)]
pub struct Still {
    /// Pixels across and down, of one eye.
    pub eye_size_px: [u32; 2],
    /// Eyes: one, or left and right.
    pub eye_count: u32,
    /// Colour multiplied by opacity, and opacity; row by row, the left eye first.
    pub rgba: Vec<[f32; 4]>,
    /// Distance from the eye along the ray in millimetres of the volume; 0 where there is none.
    pub depth_mm: Vec<f32>,
}

impl Still {
    /// One eye's part of `rgba`.
    #[must_use]
    pub fn eye(&self, eye: usize) -> &[[f32; 4]] {
        let pixels = self.eye_size_px[0] as usize * self.eye_size_px[1] as usize;
        &self.rgba[eye * pixels..(eye + 1) * pixels]
    }

    /// One eye's part of `depth_mm`.
    #[must_use]
    pub fn eye_depth_mm(&self, eye: usize) -> &[f32] {
        let pixels = self.eye_size_px[0] as usize * self.eye_size_px[1] as usize;
        &self.depth_mm[eye * pixels..(eye + 1) * pixels]
    }
}

/// Draws single pictures.
#[derive(Debug)]
pub struct StillRenderer {
    gpu: Arc<Gpu>,
}

impl StillRenderer {
    /// Draws on this device.
    #[must_use]
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        Self { gpu: gpu.clone() }
    }

    /// Counts what a picture takes, by casting it with pipelines that count.
    ///
    /// # Errors
    /// If the device has no room or was lost.
    pub fn count(&self, scene: &SceneOnDevice, plan: &StereoPlan) -> Result<Counts, RenderError> {
        Ok(Counts::of(&self.render(scene, &plan.counting())?))
    }

    /// Draws a picture and reads it back.
    ///
    /// # Errors
    /// If the device has no room, was lost, or left rays before their ends.
    pub fn render(&self, scene: &SceneOnDevice, plan: &StereoPlan) -> Result<Still, RenderError> {
        use wgpu::BufferUsages as Usage;
        let gpu = &self.gpu;
        let targets = Targets::new(gpu, plan, None)?;
        let uniform =
            gpu.buffer("a frame's numbers", size_of::<GpuFrame>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&plan.frame));
        let frame_group = frame_group(gpu, &uniform);
        let [width, height] = plan.render_size_px();
        let (picture_rows, depth_rows) = (Rows::of(width, PIXEL_BYTES), Rows::of(width, DEPTH_BYTES));
        let lines = u64::from(height * plan.eye_count());
        let picture_bytes = lines * u64::from(picture_rows.padded);
        let depth_bytes = lines * u64::from(depth_rows.padded);
        let read_back = gpu.buffer(
            "the picture's read-back",
            picture_bytes + depth_bytes,
            Usage::MAP_READ | Usage::COPY_DST,
        )?;
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("still") });
        record_raycast(gpu, &mut encoder, scene, plan, &frame_group, &targets, None)?;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: plan.eye_count() };
        let mut copy = |texture: &wgpu::Texture, offset: u64, rows: Rows| {
            encoder.copy_texture_to_buffer(
                texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo {
                    buffer: &read_back,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset,
                        bytes_per_row: Some(rows.padded),
                        rows_per_image: Some(height),
                    },
                },
                size,
            );
        };
        copy(&targets.picture, 0, picture_rows);
        copy(&targets.depth, picture_bytes, depth_rows);
        gpu.queue.submit([encoder.finish()]);

        let failed = |reason: String| RenderError::Device { what: "the picture's read-back", reason };
        let (done, mapped) = mpsc::channel();
        read_back.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            let _ = done.send(result);
        });
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(e.to_string()))?;
        mapped.recv().map_err(|e| failed(e.to_string()))?.map_err(|e| failed(e.to_string()))?;
        let view = read_back.slice(..).get_mapped_range().map_err(|e| failed(format!("{e:?}")))?;
        let (picture, rest) = view.split_at(picture_bytes as usize);
        let rgba: Vec<[f32; 4]> = picture_rows.unpadded(picture);
        let pixels = rgba.iter().filter(|p| p[3] < 0.0).count();
        if pixels > 0 {
            return Err(RenderError::Unfinished { pixels });
        }
        Ok(Still {
            eye_size_px: plan.render_size_px(),
            eye_count: plan.eye_count(),
            rgba,
            depth_mm: depth_rows.unpadded(&rest[..depth_bytes as usize]),
        })
    }
}

/// Bytes of a pixel of the picture.
const PIXEL_BYTES: u32 = 16;
/// Bytes of a pixel's depth.
const DEPTH_BYTES: u32 = 4;

/// Rows of a texture as a copy lays them into a buffer: each padded.
#[derive(Clone, Copy, Debug)]
struct Rows {
    bytes: u32,
    padded: u32,
}

impl Rows {
    fn of(width: u32, pixel_bytes: u32) -> Self {
        let bytes = width * pixel_bytes;
        Self { bytes, padded: bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT) }
    }

    fn unpadded<T: bytemuck::Pod>(self, padded: &[u8]) -> Vec<T> {
        let rows = padded.chunks_exact(self.padded as usize);
        rows.flat_map(|row| bytemuck::pod_collect_to_vec::<u8, T>(&row[..self.bytes as usize])).collect()
    }
}
