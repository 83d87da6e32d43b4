//! The reference against dumb sums: 100 000 points along each ray, the definition at each.
//!
//! Nothing here knows of cells, cubics or knots. Value and gradient are the definition's (clamped trilinear value,
//! central differences of it), written out again; emission and absorption is a midpoint sum.

use crate::common::{Noise, near, noisy, oblique, pixel, scene};
use reference::Ray;
use scene::{Mode, Scene, TransferFunction};
use spatial::{DMat3, DVec3};
use volume::Volume;

const STEPS: u32 = 100_000;
const RAYS: u64 = 30;

struct Dumb<'a> {
    volume: &'a Volume,
    scene: &'a Scene,
    ray: Ray,
    per_mm: DMat3,
}

#[derive(Clone, Copy)]
struct Sum {
    rgba: [f64; 4],
    depth_mm: Option<f64>,
    step_mm: f64,
}

impl Dumb<'_> {
    fn value(&self, p: DVec3) -> f64 {
        let dims = self.volume.grid().dims();
        let channel = &self.volume.channels()[0];
        let mut sum = 0.0;
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut at = [0usize; 3];
            for axis in 0..3 {
                let last = f64::from(dims[axis] - 1);
                let x = p[axis].clamp(0.0, last);
                let far = corner >> axis & 1 == 1;
                weight *= if far { x.fract() } else { 1.0 - x.fract() };
                at[axis] = (x as usize + usize::from(far)).min(last as usize);
            }
            let [nx, ny, _] = dims.map(|d| d as usize);
            sum += weight * channel.value((at[2] * ny + at[1]) * nx + at[0]);
        }
        sum
    }

    fn cosine(&self, p: DVec3) -> f64 {
        let g = |e: DVec3| (self.value(p + e) - self.value(p - e)) / 2.0;
        let per_voxel = DVec3::new(g(DVec3::X), g(DVec3::Y), g(DVec3::Z));
        let per_mm = self.per_mm * per_voxel;
        let direction = self.volume.grid().volume_from_index().matrix3 * self.ray.direction;
        if per_mm.length() > 0.0 { per_mm.dot(direction).abs() / per_mm.length() } else { 0.0 }
    }

    fn color(&self, p: DVec3, color: [f64; 3], lit: bool) -> [f64; 3] {
        let light = self.scene.light.unwrap_or_default();
        if !lit {
            return color;
        }
        let k = self.cosine(p);
        let shine = if k > 0.0 { light.specular * k.powf(light.power) } else { 0.0 };
        color.map(|c| c * (light.ambient + light.diffuse * k) + shine)
    }

    /// The way by brute force too: half spaces.
    fn way(&self) -> Option<(f64, f64)> {
        let (mut from, mut to) = (0.0f64, 1e9f64);
        for axis in 0..3 {
            let d = self.ray.direction[axis];
            for (plane, inwards) in [(-0.5, 1.0), (f64::from(self.volume.grid().dims()[axis]) - 0.5, -1.0)] {
                let t = (plane - self.ray.origin[axis]) / d;
                if d * inwards > 0.0 { from = from.max(t) } else { to = to.min(t) }
            }
        }
        (from < to).then_some((from, to))
    }

    fn sum(&self) -> Option<Sum> {
        let (from, to) = self.way()?;
        let step_mm = (to - from) / f64::from(STEPS);
        let at = |i: u32| from + (f64::from(i) + 0.5) * step_mm;
        let mut found = Sum { rgba: [0.0; 4], depth_mm: None, step_mm };
        match self.scene.mode {
            Mode::EmissionAbsorption => {
                let mut depth = 0.0f64;
                for i in 0..STEPS {
                    let p = self.ray.at(at(i));
                    let optical = self.scene.transfer.at(self.value(p));
                    let thickness = optical.extinction_per_mm() * step_mm;
                    if thickness > 0.0 {
                        let color = self.color(p, optical.color, self.scene.light.is_some());
                        let seen = (-depth).exp() * -(-thickness).exp_m1();
                        for (sum, c) in found.rgba.iter_mut().zip(color) {
                            *sum += c * seen;
                        }
                    }
                    depth += thickness;
                    if found.depth_mm.is_none() && depth >= std::f64::consts::LN_2 {
                        found.depth_mm = Some(at(i));
                    }
                }
                found.rgba[3] = -(-depth).exp_m1();
            }
            Mode::Threshold => found = self.surface(found, from, &at)?,
            Mode::XRay => found = self.x_ray(found, (from, to), &at),
            Mode::Cumulated => {
                let behind = self.x_ray(found, (from, to), &at);
                let Some(front) = self.surface(found, from, &at) else { return Some(behind) };
                found.depth_mm = front.depth_mm;
                found.rgba = std::array::from_fn(|i| front.rgba[i] + (1.0 - front.rgba[3]) * behind.rgba[i]);
            }
            Mode::Maximum => {
                let values = (0..STEPS).map(|i| (at(i), self.value(self.ray.at(at(i)))));
                let best = values
                    .fold((0.0, f64::NEG_INFINITY), |best, new| if new.1 > best.1 { new } else { best });
                let optical = self.scene.transfer.at(best.1);
                let [r, g, b] = optical.color.map(|c| c * optical.opacity_per_mm);
                found.rgba = [r, g, b, optical.opacity_per_mm];
                found.depth_mm = Some(best.0);
            }
        }
        Some(found)
    }

    fn surface(&self, sum: Sum, from: f64, at: &dyn Fn(u32) -> f64) -> Option<Sum> {
        let above = |mm: &f64| self.value(self.ray.at(*mm)) >= self.scene.threshold;
        let depth_mm = std::iter::once(from).chain((0..STEPS).map(at)).find(above)?;
        let lit = self.color(self.ray.at(depth_mm), self.scene.surface_color, true);
        let alpha = self.scene.surface_opacity;
        let rgba = [lit[0] * alpha, lit[1] * alpha, lit[2] * alpha, alpha];
        Some(Sum { rgba, depth_mm: Some(depth_mm), ..sum })
    }

    fn x_ray(&self, sum: Sum, (from, to): (f64, f64), at: &dyn Fn(u32) -> f64) -> Sum {
        let mean = (0..STEPS).map(|i| self.value(self.ray.at(at(i)))).sum::<f64>() / f64::from(STEPS);
        let w = self.scene.window.fraction(mean);
        Sum { rgba: [w; 4], depth_mm: Some((from + to) / 2.0), ..sum }
    }
}

/// Compares on random rays through random volumes. Colours must agree within `color`; depths within `steps` of the sum.
fn check(json: &str, color: f64, steps: f64, change: impl Fn(&mut Scene, &mut Noise)) {
    let mut hits = 0;
    for seed in 0..RAYS {
        let mut noise = Noise(seed);
        let dims = std::array::from_fn(|_| 1 + (noise.next() * 5.0) as u32);
        let spacing = std::array::from_fn(|_| noise.within(0.3, 3.0));
        let volume = noisy(oblique(dims, spacing), seed);
        let mut scene = scene(&volume, json);
        change(&mut scene, &mut noise);
        let size = DVec3::from_array(dims.map(f64::from));
        let inside = noise.point(0.0, 1.0) * size - 0.5;
        let from = if seed % 3 == 0 { noise.point(0.0, 1.0) * size - 0.5 } else { noise.point(-9.0, 12.0) };
        let ray = crate::common::ray(&volume, from, inside);
        let per_mm = volume.grid().volume_from_index().matrix3.inverse().transpose();
        let Some(sum) = (Dumb { volume: &volume, scene: &scene, ray, per_mm }).sum() else { continue };
        let found = pixel(&volume, &scene, &ray);
        for (f, s) in found.rgba.iter().zip(sum.rgba) {
            near(*f, s, color);
        }
        match (found.depth_mm, sum.depth_mm) {
            (Some(f), Some(s)) => near(f, s, steps * sum.step_mm),
            (None, None) => {}
            other => panic!("seed {seed}: {other:?}"),
        }
        hits += usize::from(found.rgba[3] > 0.0);
    }
    assert!(hits > 10, "{hits} rays hit something");
}

fn random_transfer(scene: &mut Scene, noise: &mut Noise) {
    let mut value = -0.1;
    let mut points = Vec::new();
    for _ in 0..5 {
        value += noise.within(0.02, 0.3);
        let opacity = if noise.next() < 0.3 { 0.0 } else { noise.within(0.0, 0.6) };
        points.push([value, noise.next(), noise.next(), noise.next(), opacity].into());
    }
    scene.transfer = TransferFunction::new(points).expect("points in order");
}

fn random_edges(scene: &mut Scene, noise: &mut Noise) {
    let (low, high) = (noise.within(0.2, 0.4), noise.within(0.5, 0.8));
    let at = |v: f64, o: f64| [v, 0.9, 0.5, 0.1, o].into();
    scene.transfer = TransferFunction::new(vec![at(low, 0.0), at(low, 0.4), at(high, 0.2), at(high, 0.0)])
        .expect("points in order");
}

// A midpoint sum is off by h²/24 of the second derivative where the field is smooth, and by h²/8 of the jump of the
// first at each of some tens of knots and faces: below 1e-8 with 100 000 steps. The lit colour turns faster near a
// vanishing gradient. At a vertical edge the sum is off by h/2 of the jump in σ·c: 20 mm / 100 000 · 0.5 for each of some
// ten crossings.

#[test]
fn emission_and_absorption_is_the_sum() {
    check("{}", 1e-8, 1.0, random_transfer);
}

#[test]
fn lit_emission_and_absorption_is_the_sum() {
    check(
        r#"{"light": {"ambient": 0.2, "diffuse": 0.5, "specular": 0.3, "power": 12}}"#,
        1e-7,
        1.0,
        random_transfer,
    );
}

#[test]
fn vertical_edges_are_the_sum() {
    check("{}", 2e-4, 10.0, random_edges);
}

// The sum meets a surface up to a step late; the colour turns with the gradient over that step.

#[test]
fn the_surface_is_the_first_point_above() {
    check(
        r#"{"mode": "threshold", "threshold": 0.6, "surface_color": [1, 0.6, 0.3]}"#,
        1e-3,
        1.01,
        |_, _| (),
    );
}

#[test]
fn the_x_ray_is_the_mean() {
    check(r#"{"mode": "x-ray", "window": [0, 1]}"#, 1e-8, 1e-3, |_, _| ());
}

// The highest of the sums points lies within half a step of the maximum: lower by the slope times that where the maximum
// is at a face or an end of the way.

#[test]
fn the_maximum_is_the_highest_point() {
    check(
        r#"{"mode": "maximum", "transfer": [[0, 0, 0, 1, 0], [0.7, 0, 1, 0.5, 0.5], [1, 1, 0, 0, 1]]}"#,
        3e-4,
        1.01,
        |_, _| (),
    );
}

#[test]
fn the_cumulated_picture_is_the_surface_over_the_mean() {
    check(
        r#"{"mode": "cumulated", "threshold": 0.6, "window": [0, 1], "surface_opacity": 0.6}"#,
        1e-3,
        1.01,
        |_, _| (),
    );
}
