//! Labels along a ray: a voxel has one all through.

use crate::beam::Matter;
use crate::emission::{cosine, lit};
use crate::ray::Way;
use crate::{Field, Pixel, Ray};
use scene::{Headlight, LabelLooks};
use spatial::DVec3;

/// More than half a difference of shares can be off by: each is a sum of eight products. Where a label is all around, as
/// at the border of its volume, this is all that is left of them, and has a direction all the same.
const SHARE_ROUNDING: f64 = 1.0e-14;

/// A stretch of a ray in a voxel whose label is seen.
pub(crate) struct Voxel {
    pub(crate) way: Way,
    /// What its label does to light, lit.
    pub(crate) matter: Matter,
}

/// Emission and absorption of labels: what a ray gathers in each voxel has a closed form.
pub(crate) fn pixel(
    field: &Field<'_>,
    looks: &LabelLooks,
    light: Option<&Headlight>,
    depth_at: f64,
    ray: &Ray,
) -> Pixel {
    let sought_depth = -depth_at.ln();
    let (mut color, mut optical_depth, mut depth_mm) = ([0.0; 3], 0.0f64, None);
    for Voxel { way, matter } in voxels(field, looks, light, ray) {
        let passed = matter.extinction_per_mm * way.length_mm();
        let missing = sought_depth - optical_depth;
        if missing > 0.0 && missing <= passed {
            depth_mm = Some(way.from_mm + missing / matter.extinction_per_mm);
        }
        let weight = (-optical_depth).exp() * -(-passed).exp_m1();
        for (sum, c) in color.iter_mut().zip(matter.color) {
            *sum += weight * c;
        }
        optical_depth += passed;
    }
    let [r, g, b] = color;
    Pixel { rgba: [r, g, b, -(-optical_depth).exp_m1()], depth_mm }
}

/// Where labels are seen along a ray, in order: the way is cut at the faces between voxels. A run of one label is lit as
/// where the ray enters it.
pub(crate) fn voxels(
    field: &Field<'_>,
    looks: &LabelLooks,
    light: Option<&Headlight>,
    ray: &Ray,
) -> Vec<Voxel> {
    let mut found = Vec::new();
    let Some(way) = ray.inside(field.dims()) else { return found };
    let mut ends = Vec::new();
    for axis in 0..3 {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        if direction != 0.0 {
            let faces = (1..field.dims()[axis]).map(|voxel| (f64::from(voxel) - 0.5 - origin) / direction);
            ends.extend(faces.filter(|&mm| way.from_mm < mm && mm < way.to_mm));
        }
    }
    ends.push(way.to_mm);
    ends.sort_by(f64::total_cmp);
    let mut run: Option<(i64, [f64; 3])> = None;
    let mut from_mm = way.from_mm;
    for to_mm in ends {
        let length_mm = to_mm - from_mm;
        if length_mm <= 0.0 {
            continue;
        }
        let middle = ray.at(from_mm + length_mm / 2.0);
        // On a face itself the voxel of the higher index holds.
        let label = field.label((middle + 0.5).floor().to_array().map(|x| x as i32));
        let look = looks.at(label);
        let extinction_per_mm = look.extinction_per_mm();
        if extinction_per_mm > 0.0 {
            let color = match run {
                Some((same, color)) if same == label => color,
                _ => light.map_or(look.color, |light| {
                    lit(light, look.color, cosine_at(field, ray, from_mm, label))
                }),
            };
            run = Some((label, color));
            found.push(Voxel { way: Way { from_mm, to_mm }, matter: Matter { color, extinction_per_mm } });
        } else {
            run = None;
        }
        from_mm = to_mm;
    }
    found
}

/// The cosine between the ray and the gradient of a label's share at a distance.
fn cosine_at(field: &Field<'_>, ray: &Ray, distance_mm: f64, label: i64) -> f64 {
    let at = ray.at(distance_mm);
    let along = |axis: DVec3| (share(field, at + axis, label) - share(field, at - axis, label)) / 2.0;
    let per_voxel = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
    if per_voxel.abs().max_element() < SHARE_ROUNDING {
        return 0.0;
    }
    cosine(per_voxel.dot(ray.direction), field.per_mm(per_voxel).length())
}

/// How much of a label is at a point: the clamped trilinear interpolation of 1 where it is and 0 elsewhere.
fn share(field: &Field<'_>, at_in_index: DVec3, label: i64) -> f64 {
    let last = DVec3::from_array(field.dims().map(|d| f64::from(d - 1)));
    let held = at_in_index.clamp(DVec3::ZERO, last);
    let low = held.floor();
    let f = held - low;
    let cell = low.to_array().map(|x| x as i32);
    (0..8)
        .map(|i| {
            let far = [i & 1, i >> 1 & 1, i >> 2];
            let is_label = field.label(std::array::from_fn(|axis| cell[axis] + far[axis])) == label;
            let weight = |axis: usize| if far[axis] == 1 { f[axis] } else { 1.0 - f[axis] };
            if is_label { weight(0) * weight(1) * weight(2) } else { 0.0 }
        })
        .sum()
}
