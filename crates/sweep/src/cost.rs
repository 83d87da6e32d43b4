//! What a stereo frame costs, and what of it is spent on what is seen.

use crate::sweep::SweepError;
use crate::turns::{Ratio, in_turns, ratio, spread};
use crate::{Setting, Spread};
use render::{
    DepthGridSize, Gpu, Placed, Quality, Sampling, SceneOnDevice, StereoPlan, StereoRequest, StillRenderer,
};
use spatial::EyeView;
use std::sync::Arc;

/// A scene on the device and who looks at it.
#[derive(Clone, Copy, Debug)]
pub struct Watched<'a> {
    /// For people.
    pub name: &'a str,
    /// The scene.
    pub scene: &'a SceneOnDevice,
    /// Where it lies.
    pub placed: Placed,
    /// Left and right.
    pub eyes: [EyeView; 2],
    /// Pixels of an eye, across and down.
    pub size_px: [u32; 2],
}

impl Watched<'_> {
    /// The frame of some of its eyes.
    pub(crate) fn plan(&self, eyes: &[EyeView], setting: &Setting) -> Result<StereoPlan, SweepError> {
        let request = StereoRequest {
            eyes,
            placed: self.placed,
            eye_size_px: self.size_px,
            quality: setting.quality,
            step_mm: None,
            depth_grid: DepthGridSize { columns: 16, rows: 9 },
        };
        Ok(StereoPlan::new(&request, self.scene.grid(), self.scene.numbers())?)
    }
}

/// What a stereo frame of a scene costs at a setting. Ratios are of frames that were drawn in turn.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CostRow {
    /// The scene's name.
    pub scene: String,
    /// The mode as scene files name it, and whether it is lit.
    pub kind: String,
    /// Pixels of an eye, across and down.
    pub size_px: [u32; 2],
    /// Voxels along x, y and z.
    pub dims: [u32; 3],
    /// The setting's name.
    pub setting: String,
    /// Distance of samples, millimetres; without meaning for cells.
    pub step_mm: f64,
    /// Whether cells are solved: then `samples` counts cells, and nothing is held against the bare loop.
    pub solves_cells: bool,
    /// Frames drawn of each.
    pub frames: usize,
    /// Both eyes, submitted, drawn, converted to YUV and read back: milliseconds.
    pub frame_ms: Spread,
    /// Casting the rays of both eyes by the device's clock, milliseconds (of the whole frame where it has none).
    pub raycast_ms: Spread,
    /// Converting both eyes by the device's clock, milliseconds.
    pub convert_ms: Option<Spread>,
    /// Rays cast; a tile that sees nothing casts none.
    pub rays: u64,
    /// Samples taken.
    pub samples: u64,
    /// Samples that changed the pixel.
    pub contributed: u64,
    /// Gradients for light.
    pub gradients: u64,
    /// Samples of all rays from end to end, which the bare loop takes.
    pub bare_samples: u64,
    /// The bare loop, milliseconds of the device's clock.
    pub bare_ms: Spread,
    /// Samples a second, millions, at the median.
    pub msamples_per_sec: f64,
    /// The same of the bare loop.
    pub bare_msamples_per_sec: f64,
    /// The first over the second: how near the device's limit the ray-caster comes.
    pub rate_over_bare: Option<Ratio>,
    /// Samples taken over those that contribute.
    pub taken_over_contributed: Option<f64>,
    /// Samples that no pixel would miss, as a part of all along the rays.
    pub skippable: f64,
    /// Conversion over ray-cast.
    pub convert_over_raycast: Option<f64>,
    /// A frame of both eyes over two frames of one.
    pub stereo_over_monos: Ratio,
    /// The ray-cast over that of a build without all that the scene does not use.
    pub over_cut: Ratio,
}

/// Measures a scene at a setting, `rounds` frames of each kind.
///
/// # Errors
/// If the setting cannot be drawn or the device fails.
pub fn cost(
    gpu: &Arc<Gpu>,
    watched: &Watched<'_>,
    setting: &Setting,
    rounds: usize,
) -> Result<CostRow, SweepError> {
    let Watched { scene, eyes, .. } = watched;
    let both = watched.plan(eyes, setting)?;
    let (left, right) = (watched.plan(&eyes[..1], setting)?, watched.plan(&eyes[1..], setting)?);
    let (bare, cut) = (both.bare(), both.cut());
    let stills = StillRenderer::new(gpu);
    let (counts, all) = (stills.count(scene, &both)?, stills.count(scene, &bare)?);
    // What shows something of the bare loop's own samples: none finer, no cells, no pixel without a ray.
    let quality = Quality {
        refined_parts: 1,
        solves_surfaces: false,
        sampling: Sampling::Hardware,
        interpolated_below: 0.0,
        ..setting.quality
    };
    let plain = stills.count(scene, &watched.plan(eyes, &Setting { quality, ..setting.clone() })?)?;
    let frames = in_turns(gpu, &[&both, &bare, &left, &right, &cut].map(|plan| (*scene, plan)), rounds)?;
    let [stereo, bare, left, right, cut] = frames.as_slice() else {
        unreachable!("as many as there were plans")
    };
    let raycast_ms = spread(stereo, |d| d.raycast);
    let bare_ms = spread(bare, |d| d.raycast);
    let convert_ms = Spread::of(stereo.iter().filter_map(|d| d.convert));
    let rate = |samples: u64, ms: f64| samples as f64 / 1.0e3 / ms.max(1.0e-6);
    let solves_cells = !both.takes_steps();
    // The bare loop's time is below: a rate is samples over time.
    let times = ratio([bare], [stereo], |d| d.raycast);
    let per_time = counts.samples as f64 / all.samples.max(1) as f64;
    let rates = Ratio {
        lower: times.lower * per_time,
        median: times.median * per_time,
        upper: times.upper * per_time,
    };
    let kind = scene.scene();
    let lit = kind.mode == scene::Mode::EmissionAbsorption && kind.light.is_some();
    Ok(CostRow {
        scene: watched.name.to_owned(),
        kind: format!("{}{}", kind.mode.name(), if lit { ", lit" } else { "" }),
        size_px: watched.size_px,
        dims: scene.grid().dims(),
        setting: setting.name.clone(),
        step_mm: both.step_mm(),
        solves_cells,
        frames: stereo.len(),
        frame_ms: spread(stereo, |d| d.frame),
        raycast_ms,
        convert_ms,
        rays: counts.rays,
        samples: counts.samples,
        contributed: counts.contributed,
        gradients: counts.gradients,
        bare_samples: all.samples,
        bare_ms,
        msamples_per_sec: rate(counts.samples, raycast_ms.median),
        bare_msamples_per_sec: rate(all.samples, bare_ms.median),
        rate_over_bare: (!solves_cells).then_some(rates),
        taken_over_contributed: (counts.contributed > 0)
            .then(|| counts.samples as f64 / counts.contributed as f64),
        skippable: 1.0 - (plain.contributed as f64 / all.samples.max(1) as f64).min(1.0),
        convert_over_raycast: convert_ms.map(|c| c.median / raycast_ms.median.max(1.0e-6)),
        stereo_over_monos: ratio([stereo], [left, right], |d| d.frame),
        over_cut: ratio([stereo], [cut], |d| d.raycast),
    })
}
