//! The sweep itself.

use crate::exact::Exact;
use crate::journal::{Entry, Journal};
use crate::subject::hex;
use crate::timing::timed;
use crate::{Errors, Row, Setting, Subject};
use reference::{Picture, Pixel, ReferenceError};
use render::{
    DepthGridSize, Gpu, PlanError, RenderError, SceneOnDevice, StereoPlan, StereoRequest, StillRenderer,
    VolumeOnDevice,
};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a sweep is told.
#[derive(Clone, Debug)]
pub struct Options {
    /// What is tried; see [`crate::settings`].
    pub settings: Vec<Setting>,
    /// Frames that are timed for each.
    pub frames: usize,
    /// What draws, see [`this_program`]: measurements of another program are made anew.
    pub program: String,
}

/// How far a sweep is with a subject.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress<'a> {
    /// The subject's name.
    pub subject: &'a str,
    /// What is being done: `exact picture`, or a setting's name.
    pub doing: &'a str,
    /// How much of the exact picture, or of the settings, is done: 0 to 1.
    pub part: f64,
}

/// Why there is no measurement.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A file of the sweep's folder.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// An exact picture could not be kept.
    #[error(transparent)]
    Picture(#[from] picture_io::PictureError),
    /// There is no exact picture.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A setting cannot be drawn.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The device failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The renderer gave a colour that is no number.
    #[error("pixel ({x}, {y}) is {rgba:?}: not a number")]
    NotFinite {
        /// Pixel from the left.
        x: u32,
        /// Pixel from the top.
        y: u32,
        /// What it is.
        rgba: [f64; 4],
    },
}

/// A sweep and its folder.
#[derive(Debug)]
pub struct Sweep {
    options: Options,
    exact_folder: PathBuf,
    journal: Journal,
}

impl Sweep {
    /// Opens a sweep's folder, or begins one: `exact/` holds exact pictures (float64 data), `measured.jsonl` what was
    /// measured.
    ///
    /// # Errors
    /// If the folder cannot be made or read.
    pub fn open(folder: &Path, options: Options) -> Result<Self, SweepError> {
        let exact_folder = folder.join("exact");
        fs::create_dir_all(&exact_folder)
            .map_err(|source| SweepError::File { path: exact_folder.clone(), source })?;
        let journal = Journal::open(folder.join("measured.jsonl"))?;
        Ok(Self { options, exact_folder, journal })
    }

    /// Whether the folder has measurements of a subject of this name that was another picture then: of another scene,
    /// volume, eye or size.
    #[must_use]
    pub fn has_changed(&self, subject: &Subject<'_>) -> bool {
        let keys: BTreeSet<&str> = self
            .journal
            .entries
            .iter()
            .filter(|entry| entry.row.scene == subject.name)
            .map(|entry| entry.row.key.as_str())
            .collect();
        !keys.is_empty() && !keys.contains(subject.key().as_str())
    }

    /// Measures a subject with every setting that it was not measured with before; all rows, in the settings' order.
    /// `progress` is called from any thread.
    ///
    /// # Errors
    /// If a setting cannot be drawn, the device fails, or a file cannot be written. What was measured before is kept.
    pub fn measure(
        &mut self,
        gpu: &Arc<Gpu>,
        subject: &Subject<'_>,
        progress: &(dyn Fn(Progress<'_>) + Sync),
    ) -> Result<Vec<Row>, SweepError> {
        let subject_key = subject.key();
        let keys: Vec<String> =
            self.options.settings.iter().map(|setting| self.key(&subject_key, setting, gpu)).collect();
        if keys.iter().any(|key| self.journal.find(key).is_none()) {
            let mut exact = Exact::of(subject, &self.exact_folder, progress)?;
            let volume = Arc::new(VolumeOnDevice::upload(gpu, subject.volume, |_| {})?);
            let scene = SceneOnDevice::new(gpu, &volume, subject.scene)?;
            for (at, key) in keys.iter().enumerate() {
                if self.journal.find(key).is_some() {
                    continue;
                }
                let setting = &self.options.settings[at];
                let part = at as f64 / keys.len() as f64;
                progress(Progress { subject: subject.name, doing: &setting.name, part });
                let row =
                    measure(gpu, &scene, subject, &subject_key, setting, self.options.frames, &mut exact)?;
                self.journal.add(Entry { key: key.clone(), row })?;
            }
        }
        let row = |(key, setting): (&String, &Setting)| {
            let row = self.journal.find(key)?.clone();
            // What a picture is does not depend on what it is called.
            Some(Row { scene: subject.name.to_owned(), curve: setting.curve, ..row })
        };
        Ok(keys.iter().zip(&self.options.settings).filter_map(row).collect())
    }

    /// What a measurement holds for.
    fn key(&self, subject: &str, setting: &Setting, gpu: &Gpu) -> String {
        let Options { frames, program, .. } = &self.options;
        let Setting { name, quality, .. } = setting;
        let text = format!("{subject}\n{name}\n{quality:?}\n{frames}\n{program}\n{}", gpu.adapter());
        hex(&Sha256::digest(text)[..16])
    }
}

/// The running program, as the first 128 bits of SHA-256 of its file: it holds the renderer and its shaders.
///
/// # Errors
/// If its file cannot be read.
pub fn this_program() -> Result<String, SweepError> {
    let failed = |path: &Path, source| SweepError::File { path: path.to_owned(), source };
    let path = std::env::current_exe().map_err(|source| failed(Path::new("this program"), source))?;
    let bytes = fs::read(&path).map_err(|source| failed(&path, source))?;
    Ok(hex(&Sha256::digest(bytes)[..16]))
}

fn measure(
    gpu: &Arc<Gpu>,
    scene: &SceneOnDevice,
    subject: &Subject<'_>,
    subject_key: &str,
    setting: &Setting,
    frames: usize,
    exact: &mut Exact<'_>,
) -> Result<Row, SweepError> {
    let eyes = [subject.eye];
    let request = StereoRequest {
        eyes: &eyes,
        placed: subject.placed,
        eye_size_px: subject.size_px,
        quality: setting.quality,
        // A scene's own step would make all settings one.
        step_mm: None,
        depth_grid: DepthGridSize::default(),
    };
    let plan = StereoPlan::new(&request, subject.volume.grid(), scene.numbers())?;
    let still = StillRenderer::new(gpu).render(scene, &plan)?;
    let [width, height] = still.eye_size_px;
    let picture = Picture::from_f32(width, height, still.eye(0), still.eye_depth_mm(0))?;
    let errors = Errors::of(exact, &shown(&picture, subject.size_px)?)?;
    let timing = timed(gpu, scene, &plan, frames)?;
    let quality = &setting.quality;
    Ok(Row {
        scene: subject.name.to_owned(),
        kind: subject.kind(),
        key: subject_key.to_owned(),
        size_px: subject.size_px,
        curve: setting.curve,
        setting: setting.name.clone(),
        step_voxels: quality.step_voxels,
        step_mm: plan.step_mm(),
        sampling: format!("{:?}", quality.sampling).to_lowercase(),
        least_transmittance: quality.least_transmittance,
        resolution_scale: quality.resolution_scale,
        skip_empty: quality.skip_empty,
        frames: timing.frames,
        frame_ms: timing.frame_ms,
        raycast_ms: timing.raycast_ms,
        errors,
    })
}

/// A picture of fewer rays than pixels at the size it is shown at, bilinear as `shaders/convert.wgsl` makes it larger;
/// depths are those of the nearest ray, which is what a headset has of them.
fn shown(picture: &Picture, [width, height]: [u32; 2]) -> Result<Picture, ReferenceError> {
    if (picture.width(), picture.height()) == (width, height) {
        return Ok(picture.clone());
    }
    let along = |at: u32, of: u32, rays: u32| {
        let place = (f64::from(at) + 0.5) * f64::from(rays) / f64::from(of);
        let held = place.clamp(0.5, f64::from(rays) - 0.5) - 0.5;
        let first = held.floor();
        let nearest = (place.floor() as u32).min(rays - 1);
        (first as u32, (first as u32 + 1).min(rays - 1), held - first, nearest)
    };
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        let (top, bottom, down, nearest_y) = along(y, height, picture.height());
        for x in 0..width {
            let (left, right, across, nearest_x) = along(x, width, picture.width());
            let sample = |x, y| picture.pixel(x, y).rgba;
            let (a, b) = (sample(left, top), sample(right, top));
            let (c, d) = (sample(left, bottom), sample(right, bottom));
            let rgba = std::array::from_fn(|i| {
                let above = a[i] + (b[i] - a[i]) * across;
                let below = c[i] + (d[i] - c[i]) * across;
                above + (below - above) * down
            });
            pixels.push(Pixel { rgba, depth_mm: picture.pixel(nearest_x, nearest_y).depth_mm });
        }
    }
    Picture::new(width, height, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> Picture {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| {
            let (u, v) = ((f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height));
            Pixel { rgba: [u, v, u + v, 1.0], depth_mm: Some(1.0 + u) }
        });
        Picture::new(width, height, pixels.collect()).unwrap()
    }

    #[test]
    fn a_smooth_picture_of_fewer_rays_is_itself_when_it_is_made_larger() {
        let (small, large) = (shown(&ramp(9, 5), [31, 17]).unwrap(), ramp(31, 17));
        for y in 2..15 {
            for x in 2..29 {
                let (a, b) = (small.pixel(x, y), large.pixel(x, y));
                for i in 0..4 {
                    assert!((a.rgba[i] - b.rgba[i]).abs() < 1e-12, "({x}, {y}): {a:?}, expected {b:?}");
                }
                let off = (a.depth_mm.unwrap() - b.depth_mm.unwrap()).abs();
                assert!(off <= 0.5 / 9.0, "the nearest ray is no more than half a ray away");
            }
        }
        assert_eq!(shown(&large, [31, 17]).unwrap(), large);
        assert_eq!(shown(&ramp(1, 1), [3, 2]).unwrap().pixel(2, 1), ramp(1, 1).pixel(0, 0));
    }
}
