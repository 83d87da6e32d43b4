//! How long frames take.

use crate::sweep::SweepError;
use render::{FrameRenderer, Gpu, SceneOnDevice, StereoPlan};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Fewest frames of a median.
const FEWEST: usize = 3;
/// A setting is not drawn for longer than this if it has its fewest frames.
const LONGEST: Duration = Duration::from_secs(4);

/// Where the times of some frames lie, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Spread {
    /// The shortest.
    pub min: f64,
    /// The one that half are shorter than.
    pub median: f64,
    /// The longest.
    pub max: f64,
}

impl Spread {
    /// Of some times; none of no time.
    #[must_use]
    pub fn of(times: impl IntoIterator<Item = Duration>) -> Option<Self> {
        let mut ms: Vec<f64> = times.into_iter().map(|t| t.as_secs_f64() * 1000.0).collect();
        ms.sort_by(f64::total_cmp);
        Some(Self { min: *ms.first()?, median: *ms.get(ms.len() / 2)?, max: *ms.last()? })
    }
}

/// What was measured of a setting.
pub(crate) struct Timing {
    /// Frames that were drawn.
    pub(crate) frames: usize,
    /// Submitted, drawn, converted to YUV, read back.
    pub(crate) frame_ms: Spread,
    /// Casting the rays, as the device's own clock says; none if it has none.
    pub(crate) raycast_ms: Option<Spread>,
}

/// Draws a plan up to `frames` times.
pub(crate) fn timed(
    gpu: &Arc<Gpu>,
    scene: &SceneOnDevice,
    plan: &StereoPlan,
    frames: usize,
) -> Result<Timing, SweepError> {
    let mut ring = FrameRenderer::new(gpu, 1)?;
    // The first frame makes buffers; it is not counted.
    drop(ring.submit(scene, plan)?.finish()?);
    let all_begun = Instant::now();
    let (mut whole, mut raycast) = (Vec::new(), Vec::new());
    while whole.len() < frames.max(1) && (whole.len() < FEWEST || all_begun.elapsed() < LONGEST) {
        let begun = Instant::now();
        let frame = ring.submit(scene, plan)?.finish()?;
        whole.push(begun.elapsed());
        raycast.extend(frame.gpu_times().map(|times| times.raycast));
    }
    Ok(Timing {
        frames: whole.len(),
        frame_ms: Spread::of(whole).unwrap_or_default(),
        raycast_ms: Spread::of(raycast),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_odd_number_of_times_is_one_of_them() {
        let spread = Spread::of([9, 1, 4].map(Duration::from_millis)).unwrap();
        assert_eq!(spread, Spread { min: 1.0, median: 4.0, max: 9.0 });
        assert_eq!(Spread::of([]), None);
    }
}
