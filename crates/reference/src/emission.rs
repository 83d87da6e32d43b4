//! Emission and absorption along a ray.

use crate::beam::{Beam, Matter, PICTURE_ERROR};
use crate::ray::Passage;
use crate::transfer::Stretches;
use crate::{Cubic, Field, Pixel, Ray};
use scene::Headlight;

/// What emission and absorption needs of a scene.
pub(crate) struct Emission<'a> {
    pub(crate) transfer: &'a Stretches,
    pub(crate) light: Option<&'a Headlight>,
    /// The transmittance whose place is the pixel's depth: ½, but where its uncertainty is looked into.
    pub(crate) depth_at: f64,
}

impl Emission<'_> {
    /// Integrates along a ray: cell by cell, each cut where the value passes a knot of the transfer function and where
    /// the gradient turns from facing the ray to facing away, so that every piece is smooth.
    pub(crate) fn pixel(&self, field: &Field<'_>, ray: &Ray) -> Pixel {
        let Some(way) = ray.inside(field.dims()) else { return Pixel::NOTHING };
        let error_per_mm = PICTURE_ERROR / way.length_mm();
        let mut beam = Beam::seeking(self.depth_at);
        let mut depth_mm = None;
        let mut cuts = Vec::new();
        for passage in ray.cells(field.dims(), way) {
            let corners = field.corners(passage.cell);
            let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
            let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            // Trilinear values lie between those of the corners, so nothing is lost by leaving this cell out.
            if !self.transfer.is_visible_within(low, high) {
                continue;
            }
            let value = Cubic::across(&corners, passage.from, passage.to);
            let shine = self.light.map(|light| Shine::new(light, field, ray, &passage));
            cuts.clear();
            self.transfer.crossings(&value, low, high, &mut cuts);
            if let Some(shine) = &shine {
                shine.cosine_kinks(&mut cuts);
            }
            cuts.sort_by(f64::total_cmp);
            cuts.push(1.0);
            let length_mm = passage.way.length_mm();
            let mut from = 0.0;
            for &to in cuts.iter().filter(|&&to| to > 0.0) {
                let stretch = self.transfer.at(value.at(from + (to - from) / 2.0));
                if to > from && stretch.is_visible() {
                    let matter = |u: f64| {
                        let optical = stretch.optical(value.at(u));
                        let color = match &shine {
                            Some(shine) => shine.lit(optical.color, u),
                            None => optical.color,
                        };
                        Matter { color, extinction_per_mm: optical.extinction_per_mm() }
                    };
                    let error = error_per_mm * length_mm * (to - from);
                    let reached = beam.pass(from, to, length_mm, error, &matter);
                    depth_mm = depth_mm.or(reached.map(|u| passage.mm(u)));
                }
                from = to;
            }
            if beam.is_spent() {
                break;
            }
        }
        let [r, g, b] = beam.color();
        Pixel { rgba: [r, g, b, beam.alpha()], depth_mm }
    }
}

/// The light on the matter of one passage.
#[derive(Clone)]
pub(crate) struct Shine<'a> {
    light: &'a Headlight,
    /// The gradient's parts, values a millimetre.
    gradient: [Cubic; 3],
    /// The gradient along the ray, values a millimetre.
    along: Cubic,
}

impl<'a> Shine<'a> {
    pub(crate) fn new(light: &'a Headlight, field: &Field<'_>, ray: &Ray, passage: &Passage) -> Self {
        let per_voxel =
            field.gradient_corners(passage.cell).map(|c| Cubic::across(&c, passage.from, passage.to));
        let combined = |weights: [f64; 3]| Cubic {
            coefficients: std::array::from_fn(|power| {
                (0..3).map(|axis| weights[axis] * per_voxel[axis].coefficients[power]).sum()
            }),
        };
        let per_mm = field.per_mm_from_per_voxel();
        Self {
            light,
            gradient: std::array::from_fn(|row| combined(per_mm.row(row).to_array())),
            along: combined(ray.direction.to_array()),
        }
    }

    /// Where the cosine reaches 0 and grows again: it is an absolute value.
    pub(crate) fn cosine_kinks(&self, found: &mut Vec<f64>) {
        self.along.crossings(0.0, found);
    }

    pub(crate) fn lit(&self, color: [f64; 3], u: f64) -> [f64; 3] {
        let [x, y, z] = self.gradient.map(|g| g.at(u));
        lit(self.light, color, cosine(self.along.at(u), (x * x + y * y + z * z).sqrt()))
    }
}

/// A colour lit at a cosine k: `c · (ambient + diffuse · k) + specular · kᵖ`.
pub(crate) fn lit(light: &Headlight, color: [f64; 3], cosine: f64) -> [f64; 3] {
    let mirrored = match light.power {
        _ if cosine == 0.0 || light.specular == 0.0 => 0.0,
        // A whole power by multiplication: a third of all the time is spent here otherwise.
        p if p.fract() == 0.0 && p.abs() <= 1024.0 => cosine.powi(p as i32),
        p => cosine.powf(p),
    };
    color.map(|c| c * (light.ambient + light.diffuse * cosine) + light.specular * mirrored)
}

/// The cosine between a gradient and the ray: 0 where there is no gradient.
pub(crate) fn cosine(along_ray: f64, length: f64) -> f64 {
    if length > 0.0 { (along_ray.abs() / length).min(1.0) } else { 0.0 }
}
