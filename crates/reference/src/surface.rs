//! Thresholds, means and maxima along a ray.

use crate::emission::cosine;
use crate::ray::Way;
use crate::{Cubic, Field, Ray};

/// A cell's cubic, and what its corners say about it.
fn cubics<'a>(
    field: &'a Field<'_>,
    ray: &'a Ray,
    way: Way,
) -> impl Iterator<Item = (crate::ray::Passage, [f64; 8])> + 'a {
    ray.cells(field.dims(), way).map(|passage| (passage, field.corners(passage.cell)))
}

/// Distance in millimetres to the first point of a way at or above a threshold: its beginning, or the first root of a
/// cell's cubic.
pub(crate) fn first_at_or_above(field: &Field<'_>, ray: &Ray, way: Way, threshold: f64) -> Option<f64> {
    cubics(field, ray, way).filter(|(_, corners)| corners.iter().any(|&c| c >= threshold)).find_map(
        |(passage, corners)| {
            let value = Cubic::across(&corners, passage.from, passage.to);
            value.first_at_or_above(threshold).map(|u| passage.mm(u))
        },
    )
}

/// The cosine between the gradient at a distance and the ray.
pub(crate) fn cosine_at(field: &Field<'_>, ray: &Ray, distance_mm: f64) -> f64 {
    let per_voxel = field.gradient_per_voxel(ray.at(distance_mm));
    cosine(per_voxel.dot(ray.direction), field.per_mm(per_voxel).length())
}

/// The mean value over a way: each cell's cubic integrated exactly.
pub(crate) fn mean(field: &Field<'_>, ray: &Ray, way: Way) -> f64 {
    let sum: f64 = cubics(field, ray, way)
        .map(|(passage, corners)| {
            Cubic::across(&corners, passage.from, passage.to).mean() * passage.way.length_mm()
        })
        .sum();
    sum / way.length_mm()
}

/// The highest value on a way and the distance at which it is first reached: an end of a cell's stretch, or a root of
/// the derivative.
pub(crate) fn highest(field: &Field<'_>, ray: &Ray, way: Way) -> (f64, f64) {
    let mut best = (way.from_mm, f64::NEG_INFINITY);
    for (passage, corners) in cubics(field, ray, way) {
        if corners.iter().all(|&c| c <= best.1) {
            continue;
        }
        let (u, value) = Cubic::across(&corners, passage.from, passage.to).highest();
        if value > best.1 {
            best = (passage.mm(u), value);
        }
    }
    best
}

/// Where along a way the value is at or above a threshold: stretches in order, neighbours joined.
pub(crate) fn above(field: &Field<'_>, ray: &Ray, way: Way, threshold: f64) -> Vec<Way> {
    let mut found: Vec<Way> = Vec::new();
    let mut cuts = Vec::new();
    for (passage, corners) in cubics(field, ray, way) {
        if corners.iter().all(|&c| c < threshold) {
            continue;
        }
        let value = Cubic::across(&corners, passage.from, passage.to);
        cuts.clear();
        cuts.push(0.0);
        value.crossings(threshold, &mut cuts);
        cuts.push(1.0);
        cuts.sort_by(f64::total_cmp);
        for pair in cuts.windows(2) {
            if value.at(pair[0] + (pair[1] - pair[0]) / 2.0) < threshold {
                continue;
            }
            let stretch = Way { from_mm: passage.mm(pair[0]), to_mm: passage.mm(pair[1]) };
            match found.last_mut() {
                Some(last) if last.to_mm == stretch.from_mm => last.to_mm = stretch.to_mm,
                _ => found.push(stretch),
            }
        }
    }
    found
}
