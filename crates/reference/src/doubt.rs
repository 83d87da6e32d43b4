//! What else a picture may rightly show where it jumps.
//!
//! Some pixels have no single answer in finite precision: a ray that grazes a surface, that meets a vertical edge of the
//! transfer function, that slips past the volume's own edge, or that meets two maxima of nearly one value. A renderer
//! whose rays and values are off by a stated bound may then fall on the other side. Here the exact picture is computed
//! for rays and values that lie off by that bound, so that such pixels are found, counted and judged by the answer they
//! chose, instead of hiding in a wider tolerance.

use crate::ray::Way;
use crate::surface;
use crate::{Pixel, Ray, Reference};
use scene::Mode;

/// Ways in which a ray is shifted sidewards: every 45°.
const SIDEWAYS: u32 = 8;

/// How far a renderer may be off by its arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of a point on the ray, sidewards: a part of the distance from the eye to where the ray leaves the volume.
    pub distance: f64,
    /// Of a value, in the channel's units; of a further volume's, the same part of its largest value.
    pub value: f64,
    /// Of the transmittance at which emission and absorption takes its depth.
    pub transmittance: f64,
}

impl Uncertainty {
    /// That of a renderer which computes in float32: 2⁻²⁰ of distances, sixteen roundings of 2⁻²⁴, and 2⁻²⁰ of the
    /// channel's largest value.
    #[must_use]
    pub fn of_float32(reference: &Reference<'_>) -> Self {
        let part = 0.5f64.powi(20);
        Self { distance: part, value: part * reference.field().largest_magnitude(), transmittance: part }
    }
}

/// An answer that is right within an uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Colour times opacity (RGB), and opacity.
    pub rgba: [f64; 4],
    /// Nearest and farthest depth, millimetres; one and the same but where the depth itself is open.
    pub depth_mm: Option<(f64, f64)>,
}

impl From<Pixel> for Answer {
    fn from(pixel: Pixel) -> Self {
        Self { rgba: pixel.rgba, depth_mm: pixel.depth_mm.map(|d| (d, d)) }
    }
}

/// All answers for one pixel.
#[derive(Clone, Debug)]
pub struct Answers {
    exact: Pixel,
    others: Vec<Answer>,
    /// Whether every mixture of answers is one too: so it is for an integral, which is steep but has no gap.
    mixes: bool,
}

impl Answers {
    /// The exact one.
    #[must_use]
    pub fn exact(&self) -> Pixel {
        self.exact
    }

    /// What else there may be; near the exact one where the picture does not jump.
    #[must_use]
    pub fn others(&self) -> &[Answer] {
        &self.others
    }

    /// How far the colours of the other answers lie from the exact one: the largest difference of a channel.
    #[must_use]
    pub fn spread(&self) -> f64 {
        let off = |a: &Answer| farthest(a.rgba, self.exact.rgba);
        self.others.iter().map(off).fold(0.0, f64::max)
    }

    /// How far a measured colour is off the nearest answer: the largest difference of a channel.
    #[must_use]
    pub fn color_error(&self, measured: [f64; 4]) -> f64 {
        let exact = farthest(measured, self.exact.rgba);
        if self.mixes {
            let outside = |i: usize| {
                let all = || self.others.iter().map(|a| a.rgba[i]).chain([self.exact.rgba[i]]);
                let (low, high) =
                    (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
                beyond(measured[i], low, high)
            };
            return (0..4).map(outside).fold(0.0, f64::max).min(exact);
        }
        self.others.iter().map(|a| farthest(measured, a.rgba)).fold(exact, f64::min)
    }

    /// How far a measured depth is off the nearest answer, millimetres; infinite if all answers have one and the
    /// measured picture has none, or the other way round.
    #[must_use]
    pub fn depth_error_mm(&self, measured_mm: Option<f64>) -> f64 {
        let all = || self.others.iter().map(|a| a.depth_mm).chain([Answer::from(self.exact).depth_mm]);
        let off = |answer: Option<(f64, f64)>| match (answer, measured_mm) {
            (None, None) => 0.0,
            (Some((near, far)), Some(measured)) => beyond(measured, near, far),
            _ => f64::INFINITY,
        };
        let nearest = all().map(off).fold(f64::INFINITY, f64::min);
        match measured_mm {
            Some(measured) if self.mixes && nearest.is_finite() => {
                let (low, high) =
                    all().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (near, far)| {
                        (l.min(near), h.max(far))
                    });
                // Where an answer has no depth, the others have theirs as far away as the ray goes.
                beyond(measured, low, high).min(nearest)
            }
            _ => nearest,
        }
    }
}

impl Reference<'_> {
    /// What a ray sees, and what it would see if it, or the values on it, were off by no more than `uncertainty`: shifted
    /// sidewards in eight directions, with values higher and lower, and with depth at a little more and less of the light.
    #[must_use]
    pub fn answers(&self, ray: &Ray, uncertainty: &Uncertainty) -> Answers {
        let exact = self.pixel(ray);
        let mut others: Vec<Answer> = Vec::new();
        for shifted in self.sideways(ray, uncertainty.distance) {
            others.push(self.pixel(&shifted).into());
        }
        for offset in [uncertainty.value, -uncertainty.value] {
            others.push(self.seen_off(offset, ray, 0.5).into());
        }
        let mixes = self.scene().mode == Mode::EmissionAbsorption;
        if mixes {
            for depth_at in [0.5 + uncertainty.transmittance, 0.5 - uncertainty.transmittance] {
                others.push(self.seen_off(0.0, ray, depth_at).into());
            }
        }
        if self.scene().mode == Mode::Maximum {
            others.extend(self.maxima(ray, uncertainty.value, exact));
        }
        Answers { exact, others, mixes }
    }

    /// Where the highest value may be found, if values are off by `value`: every stretch of the ray within twice that of
    /// it, one of two values being too low and the other too high.
    fn maxima(&self, ray: &Ray, value: f64, exact: Pixel) -> Vec<Answer> {
        let field = self.field();
        let Some(way) = ray.inside(field.dims()) else { return Vec::new() };
        let (_, highest) = surface::highest(field, ray, way);
        let answer = |w: Way| Answer { rgba: exact.rgba, depth_mm: Some((w.from_mm, w.to_mm)) };
        surface::above(field, ray, way, highest - 2.0 * value).into_iter().map(answer).collect()
    }

    /// The ray shifted sidewards by a part of the distance at which it leaves the volume, or would if it met it.
    fn sideways(&self, ray: &Ray, part: f64) -> Vec<Ray> {
        let field = self.field();
        let mm_from_index = field.mm_from_index();
        let index_from_mm = mm_from_index.inverse();
        // To the farthest corner: no less than where a ray leaves.
        let reach_mm = self
            .borders()
            .into_iter()
            .map(|corner| (mm_from_index * (corner - ray.origin)).length())
            .fold(0.0, f64::max);
        let (across, up) = (mm_from_index * ray.direction).any_orthonormal_pair();
        // Eight directions miss the steepest one by at most 22.5°: reach a little farther, to cover it.
        let shift_mm = part * reach_mm / (std::f64::consts::PI / f64::from(SIDEWAYS)).cos();
        (0..SIDEWAYS)
            .map(|i| {
                let angle = f64::from(i) * std::f64::consts::TAU / f64::from(SIDEWAYS);
                let shift = (across * angle.cos() + up * angle.sin()) * shift_mm;
                Ray { origin: ray.origin + index_from_mm * shift, ..*ray }
            })
            .collect()
    }
}

fn farthest(a: [f64; 4], b: [f64; 4]) -> f64 {
    // A difference that is no number is not small.
    (0..4)
        .map(|i| (a[i] - b[i]).abs())
        .fold(0.0, |worst, d| if d.is_nan() { f64::INFINITY } else { d.max(worst) })
}

fn beyond(x: f64, low: f64, high: f64) -> f64 {
    if x.is_nan() { f64::INFINITY } else { (low - x).max(x - high).max(0.0) }
}
