//! How cost grows.

use crate::phantom::phantom;
use crate::sweep::SweepError;
use crate::turns::{Frames, drawn, in_turns, spread};
use crate::{PhantomError, Setting, Spread, Watched};
use render::{FrameRenderer, Gpu, Placed, SceneOnDevice, SharedVolume, StillRenderer, VolumeOnDevice};
use scene::{Scene, SceneError, SceneFile, VolumeFacts};
use spatial::{DVec3, EyeView, Fov, HeadGeometry, Pose};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Soft matter that lets light through, so that no ray ends early.
const FOG: &str = r#"{"transfer": [[0, 0, 0, 0, 0], [500, 0, 0, 0, 0], [1000, 0.3, 0.5, 0.9, 0.0005], [3000, 1, 0.8, 0.5, 0.003]]}"#;
/// The same with another colour, opacity and first value: every cell has to be looked at anew.
const OTHER_FOG: &str = r#"{"transfer": [[0, 0, 0, 0, 0], [1500, 0, 0, 0, 0], [1600, 0.9, 0.5, 0.3, 0.001], [3000, 1, 1, 1, 0.002]]}"#;
/// How far from the phantom's middle a head is, and how far apart its eyes are, millimetres.
const DISTANCE_MM: f64 = 620.0;
const EYES_MM: f64 = 64.0;
/// Vertical field of view, degrees.
const FOV_Y_DEG: f64 = 30.0;
/// Changes of transfer function of which the median is told.
const CHANGES: usize = 7;
/// Rounds of all sessions.
const SESSION_ROUNDS: usize = 5;

/// What is varied.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleOptions {
    /// What is drawn with.
    pub setting: Setting,
    /// Sizes of an eye's picture.
    pub sizes_px: Vec<[u32; 2]>,
    /// Voxels along a side.
    pub sides: Vec<u32>,
    /// Occupied parts of the volume.
    pub occupied: Vec<f64>,
    /// Headsets that watch one scene.
    pub sessions: Vec<usize>,
    /// Frames of each.
    pub rounds: usize,
    /// What is held while another thing is varied: pixels of an eye, voxels along a side, occupied part.
    pub held: ([u32; 2], u32, f64),
    /// Pixels of an eye where many headsets watch.
    pub session_size_px: [u32; 2],
}

/// Why cost was not measured.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// As for a sweep.
    #[error(transparent)]
    Sweep(#[from] SweepError),
    /// The device failed.
    #[error(transparent)]
    Render(#[from] render::RenderError),
    /// There is no phantom.
    #[error(transparent)]
    Phantom(#[from] PhantomError),
    /// The phantom's scene is none.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A head looks nowhere.
    #[error("no point of view: the size {0:?} spans no field of view")]
    View([u32; 2]),
}

/// A point of a curve.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ScalePoint {
    /// What is varied: pixels of both eyes, voxels, occupied part, sessions.
    pub x: f64,
    /// Whole frames of both eyes, or a frame for each session, milliseconds.
    pub frame_ms: Spread,
    /// Casting the rays of one stereo frame, milliseconds.
    pub raycast_ms: Spread,
    /// Samples taken and samples that contribute, of one stereo frame.
    pub samples: u64,
    /// Those that contribute.
    pub contributed: u64,
}

/// Cost over one thing, and the power law that fits it best.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ScaleCurve {
    /// What is varied, with its unit.
    pub over: String,
    /// In order of `x`.
    pub points: Vec<ScalePoint>,
    /// Milliseconds grow as `x` to this power.
    pub time: Option<PowerLaw>,
    /// Samples grow as `x` to this power.
    pub samples: Option<PowerLaw>,
    /// Milliseconds grow as samples to this power.
    pub time_over_samples: Option<PowerLaw>,
}

/// `y = factor · x^exponent`, by least squares of the logarithms.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PowerLaw {
    /// The power.
    pub exponent: f64,
    /// y at x = 1.
    pub factor: f64,
    /// The part of the logarithms' variance that it explains, 0 to 1.
    pub r_squared: f64,
}

impl PowerLaw {
    /// Through at least two points of different x, all above 0; those that are not are passed over.
    #[must_use]
    pub fn fit(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let logs: Vec<(f64, f64)> =
            points.into_iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
        let n = logs.len() as f64;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
        let (mean_x, mean_y) = (mean(&|p| p.0), mean(&|p| p.1));
        let sum =
            |of: &dyn Fn(f64, f64) -> f64| logs.iter().map(|p| of(p.0 - mean_x, p.1 - mean_y)).sum::<f64>();
        let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
        if logs.len() < 2 || xx <= 0.0 {
            return None;
        }
        let exponent = xy / xx;
        let r_squared = if yy > 0.0 { xy * xy / (xx * yy) } else { 1.0 };
        Some(Self { exponent, factor: (mean_y - exponent * mean_x).exp(), r_squared })
    }
}

/// What a volume of one size takes besides its frames.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct VolumeCost {
    /// Voxels along a side, of 16 bits.
    pub side: u32,
    /// The occupied part.
    pub occupied: f64,
    /// Bytes of the voxels on the device.
    pub voxel_bytes: u64,
    /// Bytes of what is there to skip with, over those of the voxels.
    pub acceleration_over_voxels: f64,
    /// To the device, with the cells' ranges: milliseconds.
    pub upload_ms: f64,
    /// After a change of transfer function, until the new scene can be drawn with pipelines that were used before,
    /// milliseconds.
    pub change_ms: Spread,
    /// Its first frame less its later ones, milliseconds: what else was left to do.
    pub first_frame_extra_ms: f64,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Scaling {
    /// Over pixels, volume size, occupied part, sessions.
    pub curves: Vec<ScaleCurve>,
    /// Of the volumes.
    pub volumes: Vec<VolumeCost>,
}

/// Measures how cost grows with each thing while the others are held; `told` hears what is being done.
///
/// # Errors
/// If the device has no room or fails.
pub fn scaling(gpu: &Arc<Gpu>, options: &ScaleOptions, told: &dyn Fn(&str)) -> Result<Scaling, ScaleError> {
    let (size_px, side, occupied) = options.held;
    let mut found = Scaling::default();

    told("pixels");
    let held = Stage::new(gpu, side, occupied)?;
    let mut points = Vec::new();
    for &size in &options.sizes_px {
        points.push(held.point(gpu, size, options, f64::from(size[0]) * f64::from(size[1]) * 2.0)?);
    }
    found.curves.push(curve("pixels of both eyes", points));

    told("sessions");
    let mut points = Vec::new();
    for &sessions in &options.sessions {
        points.push(held.sessions(gpu, sessions, options)?);
    }
    found.curves.push(curve("sessions", points));
    drop(held);

    let mut points = Vec::new();
    for &part in &options.occupied {
        told(&format!("{:.0} % occupied", part * 100.0));
        points.push(Stage::new(gpu, side, part)?.point(gpu, size_px, options, part)?);
    }
    found.curves.push(curve("occupied part of the volume", points));

    for part in [occupied, 1.0] {
        let mut points = Vec::new();
        for &side in &options.sides {
            told(&format!("{side}³ voxels, {:.0} % occupied", part * 100.0));
            let stage = Stage::new(gpu, side, part)?;
            points.push(stage.point(gpu, size_px, options, f64::from(side).powi(3))?);
            found.volumes.push(stage.volume_cost(gpu, size_px, options)?);
        }
        found.curves.push(curve(&format!("voxels, {:.0} % occupied", part * 100.0), points));
    }
    Ok(found)
}

fn curve(over: &str, points: Vec<ScalePoint>) -> ScaleCurve {
    let law = |of: &dyn Fn(&ScalePoint) -> (f64, f64)| PowerLaw::fit(points.iter().map(of));
    let is_sessions = over == "sessions";
    let ms = |p: &ScalePoint| if is_sessions { p.frame_ms.median } else { p.raycast_ms.median };
    ScaleCurve {
        over: over.to_owned(),
        time: law(&|p| (p.x, ms(p))),
        samples: law(&|p| (p.x, p.samples as f64)).filter(|_| !is_sessions),
        time_over_samples: law(&|p| (p.samples as f64, ms(p))).filter(|_| !is_sessions),
        points,
    }
}

/// A phantom on the device.
struct Stage {
    side: u32,
    occupied: f64,
    facts: VolumeFacts,
    volume: SharedVolume,
    upload: Duration,
    scene: SceneOnDevice,
}

impl Stage {
    fn new(gpu: &Arc<Gpu>, side: u32, occupied: f64) -> Result<Self, ScaleError> {
        let volume = phantom(side, occupied)?;
        let facts = VolumeFacts::of(&volume);
        let begun = Instant::now();
        let on_device = Arc::new(VolumeOnDevice::upload(gpu, &volume, |_| {})?);
        let upload = begun.elapsed();
        let scene = SceneOnDevice::new(gpu, &on_device, &resolved(FOG, &facts)?)?;
        Ok(Self { side, occupied, facts, volume: on_device, upload, scene })
    }

    /// Seen from somewhere on a circle around it, `turn` from 0 to 1.
    fn watched(&self, size_px: [u32; 2], turn: f64) -> Result<Watched<'_>, ScaleError> {
        let grid = self.volume.grid();
        // A phantom's millimetres begin at the first voxel's centre.
        let middle = (grid.size_mm() - grid.spacing_mm()) / 2.0;
        let angle = 0.4 + turn * std::f64::consts::TAU;
        let at = middle + DISTANCE_MM * DVec3::new(angle.cos() * 0.94, angle.sin() * 0.94, 0.34);
        let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
        let head = Pose::looking_at(at, middle, DVec3::Z).ok_or(ScaleError::View(size_px))?;
        let fov =
            Fov::from_vertical(FOV_Y_DEG.to_radians(), aspect).map_err(|_| ScaleError::View(size_px))?;
        let eyes: [EyeView; 2] = HeadGeometry::parallel(EYES_MM, fov).view(&head).eyes;
        Ok(Watched { name: "phantom", scene: &self.scene, placed: Placed::own_axes(grid), eyes, size_px })
    }

    fn point(
        &self,
        gpu: &Arc<Gpu>,
        size_px: [u32; 2],
        options: &ScaleOptions,
        x: f64,
    ) -> Result<ScalePoint, ScaleError> {
        let watched = self.watched(size_px, 0.0)?;
        let plan = watched.plan(&watched.eyes, &options.setting)?;
        let counts = StillRenderer::new(gpu).count(&self.scene, &plan)?;
        let frames = in_turns(gpu, &[(&self.scene, &plan)], options.rounds)?.remove(0);
        Ok(ScalePoint {
            x,
            frame_ms: spread(&frames, |d| d.frame),
            raycast_ms: spread(&frames, |d| d.raycast),
            samples: counts.samples,
            contributed: counts.contributed,
        })
    }

    /// A frame for each of many heads, two on the device at a time.
    fn sessions(
        &self,
        gpu: &Arc<Gpu>,
        sessions: usize,
        options: &ScaleOptions,
    ) -> Result<ScalePoint, ScaleError> {
        let plans: Vec<_> = (0..sessions)
            .map(|i| {
                let watched = self.watched(options.session_size_px, i as f64 / sessions as f64)?;
                Ok(watched.plan(&watched.eyes, &options.setting)?)
            })
            .collect::<Result<_, ScaleError>>()?;
        let mut counts = render::Counts::default();
        for plan in &plans {
            let one = StillRenderer::new(gpu).count(&self.scene, plan)?;
            counts.samples += one.samples;
            counts.contributed += one.contributed;
        }
        let mut ring = FrameRenderer::new(gpu, 2)?;
        let (mut rounds, mut raycasts) = (Vec::new(), Vec::new());
        // The first round makes buffers; it is not counted.
        for round in 0..=SESSION_ROUNDS.max(options.rounds) {
            let begun = Instant::now();
            let mut flying = VecDeque::new();
            for plan in &plans {
                if flying.len() == 2 {
                    finish(&mut flying, &mut raycasts)?;
                }
                flying.push_back(ring.submit(&self.scene, plan)?);
            }
            while !flying.is_empty() {
                finish(&mut flying, &mut raycasts)?;
            }
            if round == 0 {
                raycasts.clear();
            } else {
                rounds.push(begun.elapsed());
            }
        }
        Ok(ScalePoint {
            x: sessions as f64,
            frame_ms: Spread::of(rounds).unwrap_or_default(),
            raycast_ms: Spread::of(raycasts).unwrap_or_default(),
            samples: counts.samples / sessions.max(1) as u64,
            contributed: counts.contributed / sessions.max(1) as u64,
        })
    }

    fn volume_cost(
        &self,
        gpu: &Arc<Gpu>,
        size_px: [u32; 2],
        options: &ScaleOptions,
    ) -> Result<VolumeCost, ScaleError> {
        let scenes = [resolved(OTHER_FOG, &self.facts)?, resolved(FOG, &self.facts)?];
        let (mut changes, mut extras) = (Vec::new(), Vec::new());
        let mut ring = FrameRenderer::new(gpu, 1)?;
        for change in 0..CHANGES {
            let begun = Instant::now();
            let scene = SceneOnDevice::new(gpu, &self.volume, &scenes[change % 2])?;
            changes.push(begun.elapsed());
            let watched = Watched { scene: &scene, ..self.watched(size_px, 0.0)? };
            let plan = watched.plan(&watched.eyes, &options.setting)?;
            let first = drawn(&mut ring, &scene, &plan)?.frame;
            let later: Frames = (0..3).map(|_| drawn(&mut ring, &scene, &plan)).collect::<Result<_, _>>()?;
            extras.push(first.as_secs_f64() * 1000.0 - spread(&later, |d| d.frame).median);
        }
        extras.sort_by(f64::total_cmp);
        let voxel_bytes = self.volume.voxel_bytes();
        Ok(VolumeCost {
            side: self.side,
            occupied: self.occupied,
            voxel_bytes,
            acceleration_over_voxels: self.scene.acceleration_bytes() as f64 / voxel_bytes as f64,
            upload_ms: self.upload.as_secs_f64() * 1000.0,
            change_ms: Spread::of(changes).unwrap_or_default(),
            first_frame_extra_ms: extras[CHANGES / 2],
        })
    }
}

fn finish(
    flying: &mut VecDeque<render::FrameInFlight>,
    raycasts: &mut Vec<Duration>,
) -> Result<(), ScaleError> {
    if let Some(frame) = flying.pop_front() {
        raycasts.extend(frame.finish()?.gpu_times().map(|times| times.raycast));
    }
    Ok(())
}

fn resolved(json: &str, facts: &VolumeFacts) -> Result<Scene, ScaleError> {
    Ok(SceneFile::from_json(json)?.resolve(facts)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_found_again() {
        let law = PowerLaw::fit((1..6).map(|x| (f64::from(x), 3.0 * f64::from(x).powf(0.7)))).unwrap();
        assert!((law.exponent - 0.7).abs() < 1e-12 && (law.factor - 3.0).abs() < 1e-12, "{law:?}");
        assert!((law.r_squared - 1.0).abs() < 1e-12);
        assert_eq!(PowerLaw::fit([(2.0, 1.0)]), None);
        assert_eq!(PowerLaw::fit([(2.0, 1.0), (2.0, 3.0), (0.0, 1.0)]), None);
    }
}
