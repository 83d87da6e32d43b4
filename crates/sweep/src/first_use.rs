//! What frames in hand feel of a scene that is being made.

use crate::Spread;
use crate::sweep::SweepError;
use crate::turns::{Frames, drawn, spread};
use crate::{Setting, Watched};
use render::{FrameRenderer, Gpu, SceneOnDevice, SharedVolume};
use scene::Scene;
use std::sync::Arc;
use std::thread;
use std::time::Instant;

/// Frames before, and at least as many behind.
const FRAMES: usize = 40;

/// Frames of one scene while another, which needs pipelines that were never used, is made beside them and then shown.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FirstUse {
    /// Frames before, milliseconds.
    pub before_ms: Spread,
    /// Frames while the other scene was made ready.
    pub meanwhile_ms: Spread,
    /// Until it was ready, milliseconds.
    pub ready_ms: f64,
    /// Its first frame.
    pub first_ms: f64,
    /// Its frames after that.
    pub after_ms: Spread,
    /// The first frame over the median of those after it: what is left of the stall.
    pub first_over_after: f64,
    /// The same of a scene that was not made ready: the stall as it would be.
    pub unprepared_first_over_after: f64,
}

/// Shows `watched`, makes another scene of the same volume at another setting beside it, and shows that. `gpu` must not have
/// drawn such a scene yet; nor must it have drawn `unprepared`, which is then shown without being made ready.
///
/// # Errors
/// If the device fails or refused a thread.
pub fn first_use(
    gpu: &Arc<Gpu>,
    watched: &Watched<'_>,
    setting: &Setting,
    volume: &SharedVolume,
    other: &Scene,
    unprepared: &Scene,
) -> Result<FirstUse, SweepError> {
    let plan = watched.plan(&watched.eyes, setting)?;
    let mut ring = FrameRenderer::new(gpu, 1)?;
    drop(ring.submit(watched.scene, &plan)?.finish()?);
    let mut before = Frames::new();
    for _ in 0..FRAMES {
        before.push(drawn(&mut ring, watched.scene, &plan)?);
    }
    let mut meanwhile = Frames::new();
    let made = thread::scope(|scope| -> Result<_, SweepError> {
        let making = scope.spawn(|| -> Result<_, SweepError> {
            let begun = Instant::now();
            let scene = SceneOnDevice::new(gpu, volume, other)?;
            scene.prepare(&setting.quality)?;
            Ok((scene, begun.elapsed()))
        });
        while !making.is_finished() {
            meanwhile.push(drawn(&mut ring, watched.scene, &plan)?);
        }
        // A panic of the other thread is one of ours.
        making.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    });
    let (made, ready) = made?;
    let (first, after) = shown(&mut ring, &Watched { scene: &made, ..*watched }, setting)?;
    let cold = SceneOnDevice::new(gpu, volume, unprepared)?;
    let (cold_first, cold_after) = shown(&mut ring, &Watched { scene: &cold, ..*watched }, setting)?;
    Ok(FirstUse {
        before_ms: spread(&before, |d| d.frame),
        meanwhile_ms: spread(&meanwhile, |d| d.frame),
        ready_ms: ready.as_secs_f64() * 1000.0,
        first_ms: first,
        after_ms: after,
        first_over_after: first / after.median,
        unprepared_first_over_after: cold_first / cold_after.median,
    })
}

/// The first frame of a scene, and those after it.
fn shown(
    ring: &mut FrameRenderer,
    watched: &Watched<'_>,
    setting: &Setting,
) -> Result<(f64, Spread), SweepError> {
    let plan = watched.plan(&watched.eyes, setting)?;
    let first = drawn(ring, watched.scene, &plan)?.frame.as_secs_f64() * 1000.0;
    let mut after = Frames::new();
    for _ in 0..FRAMES {
        after.push(drawn(ring, watched.scene, &plan)?);
    }
    Ok((first, spread(&after, |d| d.frame)))
}
