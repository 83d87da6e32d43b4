//! Orders of convergence: how fast the picture of a sampled signal nears that of the signal itself as the grid and the
//! pixels are refined. A silent loss of order fails.

use crate::common::{pixel, scene, volume};
use reference::{Field, Ray, RaySetup, Reference};
use scene::Camera;
use spatial::DVec3;

/// Errors at spacings h, h/2, h/4 must fall by 4 each time, within a tenth of an order at the finest.
#[track_caller]
fn second_order(errors: [f64; 3]) {
    let order = (errors[1] / errors[2]).log2();
    assert!((order - 2.0).abs() < 0.1, "order {order}: {errors:?}");
}

/// A blob `exp(-r²/2s²)`, s = 5 mm, in a cube of 40 mm whose centre is 0.
fn blob(h: f64) -> volume::Volume {
    let n = (40.0 / h) as u32;
    volume([n; 3], [h; 3], |p| (-((p + 0.5) * h - 20.0).length_squared() / 50.0).exp())
}

/// A ray at `impact` mm past the centre of a cube of 40 mm, from 30 mm before it, obliquely.
fn ray_past(h: f64, impact: f64) -> Ray {
    let along = DVec3::new(0.36, 0.48, 0.8);
    let side = DVec3::new(0.8, -0.6, 0.0);
    let origin = side * impact - along * 30.0;
    Ray { origin: (origin + 20.0) / h - 0.5, direction: along / h }
}

fn errors(error: impl Fn(f64) -> f64) -> [f64; 3] {
    [1.0, 0.5, 0.25].map(error)
}

#[test]
fn the_x_ray_of_a_blob_nears_its_closed_form_in_second_order() {
    // The signal's own mean over the way, which ends at the border, by 4000 midpoints: exact to 1e-8.
    second_order(errors(|h| {
        let v = blob(h);
        let s = scene(&v, r#"{"mode": "x-ray", "window": [0, 1]}"#);
        let reference = Reference::new(&v, &s).unwrap();
        let mut square = 0.0;
        for i in 0..20 {
            let impact = f64::from(i) * 0.37;
            let r = ray_past(h, impact);
            let way = r.inside(v.grid().dims()).unwrap();
            let steps = 4000;
            let signal = |t: f64| (-((t - 30.0).powi(2) + impact * impact) / 50.0).exp();
            let mean = (0..steps)
                .map(|i| signal(way.from_mm + way.length_mm() * (f64::from(i) + 0.5) / f64::from(steps)))
                .sum::<f64>()
                / f64::from(steps);
            square += (reference.pixel(&r).rgba[0] - mean).powi(2);
        }
        square.sqrt()
    }));
}

#[test]
fn the_surface_of_a_blob_nears_its_closed_form_in_second_order() {
    second_order(errors(|h| {
        let v = blob(h);
        let threshold = 0.4f64;
        let s = scene(&v, &format!(r#"{{"mode": "threshold", "threshold": {threshold}}}"#));
        let reference = Reference::new(&v, &s).unwrap();
        let radius_square = -50.0 * threshold.ln();
        // Many rays: what a surface is off by depends on where in its cell it is met.
        let square: f64 = (0..2000)
            .map(|i| {
                let impact = f64::from(i) * 0.0025;
                let expected = 30.0 - (radius_square - impact * impact).sqrt();
                (reference.pixel(&ray_past(h, impact)).depth_mm.unwrap() - expected).powi(2)
            })
            .sum();
        square.sqrt()
    }));
}

#[test]
fn the_gradient_of_a_blob_nears_its_closed_form_in_second_order() {
    second_order(errors(|h| {
        let v = blob(h);
        let field = Field::new(&v.channels()[0], v.grid());
        let mut noise = crate::common::Noise(9);
        let square: f64 = (0..500)
            .map(|_| {
                let p = noise.point(-8.0, 8.0);
                let expected = p * (-(-p.length_squared() / 50.0f64).exp() / 25.0);
                (field.gradient_per_mm((p + 20.0) / h - 0.5) - expected).length_squared()
            })
            .sum();
        square.sqrt()
    }));
}

#[test]
fn emission_and_absorption_in_a_blob_near_those_of_the_signal_in_second_order() {
    // The opacity a millimetre is the value times 0.2; the sum over the signal itself has 20 000 midpoints.
    second_order(errors(|h| {
        let v = blob(h);
        let s = scene(&v, r#"{"transfer": [[0, 1, 0, 0, 0], [1, 0, 1, 1, 0.2]]}"#);
        let reference = Reference::new(&v, &s).unwrap();
        let square: f64 = (0..20)
            .map(|i| {
                let impact = f64::from(i) * 0.37;
                let r = ray_past(h, impact);
                let way = r.inside(v.grid().dims()).unwrap();
                let dt = way.length_mm() / 20_000.0;
                let (mut red, mut depth) = (0.0, 0.0);
                for i in 0..20_000 {
                    let t = way.from_mm + (f64::from(i) + 0.5) * dt;
                    let value = (-((t - 30.0f64).powi(2) + impact * impact) / 50.0).exp();
                    let thickness = -(-0.2 * value).ln_1p() * dt;
                    red += (1.0 - value) * f64::exp(-(depth + thickness / 2.0)) * thickness;
                    depth += thickness;
                }
                let found = reference.pixel(&r).rgba;
                (found[0] - red).powi(2) + (found[3] + (-depth).exp_m1()).powi(2)
            })
            .sum();
        square.sqrt()
    }));
}

#[test]
fn the_x_ray_of_a_hard_ball_nears_the_chord_in_first_order() {
    // 2μ√(R² - b²). The ball's edge is blurred over a voxel: each end of the chord is off by less than a voxel's diagonal.
    let radius = 12.0;
    for h in [1.0, 0.5, 0.25] {
        let n = (40.0 / h) as u32;
        let v = volume([n; 3], [h; 3], |p| f64::from(u8::from(((p + 0.5) * h - 20.0).length() <= radius)));
        let s = scene(&v, r#"{"mode": "x-ray", "window": [0, 1]}"#);
        for impact in [0.0f64, 3.0, 6.0, 9.0] {
            let r = ray_past(h, impact);
            let way = r.inside(v.grid().dims()).unwrap();
            let chord = pixel(&v, &s, &r).rgba[0] * way.length_mm();
            let half = (radius * radius - impact * impact).sqrt();
            // A voxel's diagonal outwards, along a ray that meets the surface at the cosine half/radius.
            let bound = 2.0 * h * 3f64.sqrt() / (half / radius);
            assert!((chord - 2.0 * half).abs() < bound, "{h} {impact}: {chord} {}", 2.0 * half);
        }
    }
}

#[test]
fn a_pixel_s_centre_nears_its_mean_in_second_order() {
    // A smooth picture: the mean over finer pixels differs from the centre by h²/24 of the second derivatives.
    let v = blob(1.0);
    let s = scene(&v, r#"{"transfer": [[0, 1, 0, 0, 0.05], [1, 0, 1, 1, 0.1]]}"#);
    let reference = Reference::new(&v, &s).unwrap();
    let camera = Camera { eye: [20.0, 20.0, 75.0], target: [20.0; 3], up: [0.0, 1.0, 0.0], fov_y_deg: 14.0 };
    let setup = RaySetup::of_camera(v.grid(), &camera, 1, 1).unwrap();
    let mean = |n: u32| {
        let picture = reference.picture(&setup, n, n, &|_| ()).unwrap();
        picture.pixels().iter().map(|p| p.rgba[1]).sum::<f64>() / f64::from(n * n)
    };
    let finest = mean(64);
    let [a, b, c] = [2, 4, 8].map(|n| (mean(n) - finest).abs());
    let order = (b / c).log2();
    assert!((order - 2.0).abs() < 0.2, "order {order}: {a} {b} {c}");
}
