//! Orders of convergence on the device: how fast the picture nears what it samples as step, grid and pixel are refined. A
//! silent loss of order fails.

use crate::setting::{Shown, eye, floats, to_the_end};
use reference::{Picture, RaySetup, compare};
use render::{Quality, Sampling};
use spatial::{DVec3, EyeView, Fov};

/// Errors at h, h/2, h/4, of which each is 2^order of the next, within a part of an order at the finest.
#[track_caller]
fn order(what: &str, errors: [f64; 3], expected: f64, within: f64) {
    crate::setting::tell(&format!("{what}: {errors:?}, order {:.2}", (errors[1] / errors[2]).log2()));
    let found = (errors[1] / errors[2]).log2();
    assert!((found - expected).abs() < within, "{what}: order {found}: {errors:?}");
}

const SIDE_MM: f64 = 32.0;

/// A blob `exp(-r²/2s²)`, s = 4 mm, in a cube of 32 mm.
fn blob(h: f64, json: &str) -> Shown {
    let n = (SIDE_MM / h) as u32;
    Shown::new(
        floats([n; 3], [h; 3], |p| (-((p + 0.5) * h - SIDE_MM / 2.0).length_squared() / 32.0).exp()),
        json,
    )
}

/// An eye that looks at the middle; where it stands does not depend on the grid, whose first centre is at h/2.
fn view(h: f64) -> EyeView {
    let middle = DVec3::splat(SIDE_MM / 2.0 - h / 2.0);
    eye(middle + DVec3::new(21.0, 30.0, 38.0), middle, Fov::symmetric(0.3, 0.3).unwrap())
}

const SIZE: [u32; 2] = [24, 24];

const FOG: &str = r#"{"transfer": [[0, 1, 0, 0, 0], [1, 0, 1, 1, 0.2]]}"#;
const LIT_FOG: &str = r#"{"transfer": [[0, 1, 0, 0, 0], [1, 0, 1, 1, 0.2]], "shade": true}"#;
const X_RAY: &str = r#"{"mode": "x-ray", "window": [0, 1]}"#;

#[test]
fn plain_steps_are_of_second_order() {
    for (what, json) in [("fog", FOG), ("lit fog", LIT_FOG), ("x-ray", X_RAY)] {
        let shown = blob(1.0, json);
        let exact = shown.exact(view(1.0), SIZE);
        let quality = to_the_end(Quality { sampling: Sampling::Float32, ..Quality::PLAIN });
        let error = |step: f64| {
            let drawn = shown.drawn(view(1.0), SIZE, quality, Some(step));
            let c = compare(&exact, &drawn).unwrap();
            c.rmse.hypot(c.opacity_rmse)
        };
        // The cells' faces, where the field's slope jumps, lie anywhere between samples: in the mean over 576 rays their
        // share is of second order too, with noise.
        order(what, [1.0, 0.5, 0.25].map(error), 2.0, 0.35);
    }
}

#[test]
fn refined_steps_are_of_second_order() {
    for (what, json) in [("fog", FOG), ("lit fog", LIT_FOG)] {
        let shown = blob(1.0, json);
        let exact = shown.exact(view(1.0), SIZE);
        // Everywhere, and where there is something to see: in as much of the fog at each step, of whose opacity it is a bound.
        // Light in groups errs by what a group weighs, whatever the step.
        for (where_to, above_a_mm) in [("all", 0.0), ("what is seen", Quality::BALANCED.refined_above)] {
            let error = |step: f64| {
                let quality = to_the_end(Quality {
                    sampling: Sampling::Float32,
                    refined_above: above_a_mm * step,
                    light_weight: 0.0,
                    ..Quality::BALANCED
                });
                let drawn = shown.drawn(view(1.0), SIZE, quality, Some(step));
                let c = compare(&exact, &drawn).unwrap();
                c.rmse.hypot(c.opacity_rmse)
            };
            order(&format!("{what}, refined {where_to}"), [2.0, 1.0, 0.5].map(error), 2.0, 0.35);
        }
    }
}

/// The closed form of every pixel, from where its ray runs past the middle: the nearest point's distance along the ray, and
/// how far that is from the middle, millimetres; and where the ray is inside.
fn rays(h: f64) -> Vec<(f64, f64, f64, f64)> {
    let shown = blob(h, X_RAY);
    let setup: RaySetup = shown.rays(view(h));
    let middle = DVec3::splat(SIDE_MM / h / 2.0 - 0.5);
    let mut all = Vec::new();
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let ray = setup.pixel_ray(x, y, SIZE[0], SIZE[1]);
            let way = ray.inside(shown.volume.grid().dims()).unwrap();
            let to_middle = (middle - ray.origin) * h;
            let nearest = to_middle.dot(ray.direction * h);
            let past = (to_middle.length_squared() - nearest * nearest).max(0.0);
            all.push((nearest, past, way.from_mm, way.to_mm));
        }
    }
    all
}

fn signal(nearest: f64, past_squared: f64, t: f64) -> f64 {
    (-((t - nearest).powi(2) + past_squared) / 32.0).exp()
}

fn root_mean_square(picture: &Picture, error: impl Fn(usize) -> f64) -> f64 {
    let n = picture.pixels().len();
    ((0..n).map(|i| error(i).powi(2)).sum::<f64>() / n as f64).sqrt()
}

#[test]
fn the_exact_picture_nears_the_sampled_signal_in_second_order_of_the_grid() {
    let grids = [2.0, 1.0, 0.5];
    let x_ray = grids.map(|h| {
        let picture = blob(h, X_RAY).drawn(view(h), SIZE, Quality::EXACT, None);
        let rays = rays(h);
        root_mean_square(&picture, |i| {
            let (nearest, past, from, to) = rays[i];
            let steps = 2000;
            let at = |k: u32| from + (to - from) * (f64::from(k) + 0.5) / f64::from(steps);
            let mean = (0..steps).map(|k| signal(nearest, past, at(k))).sum::<f64>() / f64::from(steps);
            picture.pixels()[i].rgba[0] - mean
        })
    });
    order("x-ray of a blob", x_ray, 2.0, 0.2);

    let fog = grids.map(|h| {
        let picture = blob(h, FOG).drawn(view(h), SIZE, to_the_end(Quality::EXACT), None);
        let rays = rays(h);
        root_mean_square(&picture, |i| {
            let (nearest, past, from, to) = rays[i];
            let steps = 4000;
            let dt = (to - from) / f64::from(steps);
            let (mut red, mut depth) = (0.0, 0.0);
            for k in 0..steps {
                let value = signal(nearest, past, from + (f64::from(k) + 0.5) * dt);
                let thickness = -(-0.2 * value).ln_1p() * dt;
                red += (1.0 - value) * f64::exp(-(depth + thickness / 2.0)) * thickness;
                depth += thickness;
            }
            let found = picture.pixels()[i].rgba;
            (found[0] - red).hypot(found[3] + (-depth).exp_m1())
        })
    });
    order("fog of a blob", fog, 2.0, 0.2);

    let threshold = 0.4f64;
    let radius_square = -32.0 * threshold.ln();
    let surface = grids.map(|h| {
        let json = format!(r#"{{"mode": "threshold", "threshold": {threshold}}}"#);
        let picture = blob(h, &json).drawn(view(h), SIZE, Quality::EXACT, None);
        let rays = rays(h);
        root_mean_square(&picture, |i| {
            let (nearest, past, ..) = rays[i];
            // Where rays graze, the depth turns without bound.
            if past > 0.6 * radius_square {
                return 0.0;
            }
            picture.pixels()[i].depth_mm.unwrap() - (nearest - (radius_square - past).sqrt())
        })
    });
    order("surface of a blob", surface, 2.0, 0.3);
}

#[test]
fn a_pixel_s_centre_nears_its_mean_in_second_order() {
    // A smooth picture: the mean over finer pixels differs from the centre by h²/24 of the second derivatives.
    let shown = blob(1.0, FOG);
    let mean = |n: u32| {
        let picture = shown.drawn(view(1.0), [n, n], to_the_end(Quality::EXACT), None);
        picture.pixels().iter().map(|p| p.rgba[1]).sum::<f64>() / f64::from(n * n)
    };
    let finest = mean(128);
    order("mean of pixels", [4, 8, 16].map(|n| (mean(n) - finest).abs()), 2.0, 0.2);
}
