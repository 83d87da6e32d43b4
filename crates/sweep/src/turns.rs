//! Frames of several plans in turn, so that a busy moment of the machine meets all of them alike.

use crate::Spread;
use crate::sweep::SweepError;
use render::{FrameRenderer, Gpu, SceneOnDevice, StereoPlan};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Fewest rounds of a median.
const FEWEST: usize = 3;
/// Rounds are not begun after this if there were the fewest.
const LONGEST: Duration = Duration::from_secs(12);

/// What a frame took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    /// Submitted, drawn, converted to YUV, read back.
    pub(crate) frame: Duration,
    /// Casting the rays by the device's clock; the whole frame if it has none.
    pub(crate) raycast: Duration,
    /// Converting to YUV by the device's clock.
    pub(crate) convert: Option<Duration>,
}

/// The frames of one plan, a round each.
pub(crate) type Frames = Vec<Drawn>;

/// Draws each plan once a round, after a frame of each that is not counted.
pub(crate) fn in_turns(
    gpu: &Arc<Gpu>,
    plans: &[(&SceneOnDevice, &StereoPlan)],
    rounds: usize,
) -> Result<Vec<Frames>, SweepError> {
    let mut rings = Vec::new();
    for (scene, plan) in plans {
        let mut ring = FrameRenderer::new(gpu, 1)?;
        drop(ring.submit(scene, plan)?.finish()?);
        rings.push(ring);
    }
    let mut all = vec![Frames::new(); plans.len()];
    let begun = Instant::now();
    for round in 0..rounds.max(1) {
        if round >= FEWEST && begun.elapsed() > LONGEST {
            break;
        }
        for ((ring, (scene, plan)), frames) in rings.iter_mut().zip(plans).zip(&mut all) {
            frames.push(drawn(ring, scene, plan)?);
        }
    }
    Ok(all)
}

/// Draws a frame and waits for it.
pub(crate) fn drawn(
    ring: &mut FrameRenderer,
    scene: &SceneOnDevice,
    plan: &StereoPlan,
) -> Result<Drawn, SweepError> {
    let begun = Instant::now();
    let finished = ring.submit(scene, plan)?.finish()?;
    let frame = begun.elapsed();
    let times = finished.gpu_times();
    Ok(Drawn { frame, raycast: times.map_or(frame, |t| t.raycast), convert: times.map(|t| t.convert) })
}

/// Where the times of some frames lie, milliseconds.
pub(crate) fn spread(frames: &Frames, of: impl Fn(&Drawn) -> Duration) -> Spread {
    Spread::of(frames.iter().map(of)).unwrap_or_default()
}

/// The median of the ratios of each round.
pub(crate) fn ratio<const A: usize, const B: usize>(
    above: [&Frames; A],
    below: [&Frames; B],
    of: impl Fn(&Drawn) -> Duration,
) -> Ratio {
    let sum = |frames: &[&Frames], round: usize| -> f64 {
        frames.iter().filter_map(|f| f.get(round)).map(|d| of(d).as_secs_f64()).sum()
    };
    let rounds = above.first().map_or(0, |f| f.len());
    Ratio::of((0..rounds).map(|round| sum(&above, round) / sum(&below, round).max(1.0e-9)))
}

/// Where ratios of frames of one round lie: what was busy meets both sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Ratio {
    /// A quarter are below.
    pub lower: f64,
    /// Half are below.
    pub median: f64,
    /// A quarter are above.
    pub upper: f64,
}

impl Ratio {
    /// Of some ratios; all 0 of none.
    #[must_use]
    pub fn of(ratios: impl IntoIterator<Item = f64>) -> Self {
        let mut all: Vec<f64> = ratios.into_iter().collect();
        all.sort_by(f64::total_cmp);
        let at = |part: f64| all.get((all.len() as f64 * part) as usize).copied().unwrap_or_default();
        Self { lower: at(0.25), median: at(0.5), upper: at(0.75) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(ms: &[u64]) -> Frames {
        let drawn = |&ms| {
            let frame = Duration::from_millis(ms);
            Drawn { frame, raycast: frame / 2, convert: None }
        };
        ms.iter().map(drawn).collect()
    }

    #[test]
    fn a_ratio_is_of_rounds_and_not_of_medians() {
        // A busy second round meets both.
        let (a, b) = (frames(&[10, 100, 12]), frames(&[5, 50, 6]));
        assert_eq!(ratio([&a], [&b], |d| d.frame), Ratio { lower: 2.0, median: 2.0, upper: 2.0 });
        assert!((ratio([&a], [&b, &b], |d| d.raycast).median - 1.0).abs() < 1e-9);
        assert_eq!(ratio([&frames(&[])], [&b], |d| d.frame), Ratio::default());
    }
}
