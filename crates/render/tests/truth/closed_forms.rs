//! The device against closed forms. Its own copy of the reference's tests, with what float32 costs.

use crate::setting::{
    Noise, Shown, each, eye, f32s, floats, near, oblique, straight, to_the_end, true_picture, u8s, volume_on,
};
use crate::tolerances::{CLOSED_FORM, DISTANCE};
use render::{Quality, Sampling};
use scene::{HIGHEST_OPACITY_PER_MM, Headlight, TransferFunction};
use spatial::{DVec3, Fov};
use std::sync::Arc;

/// Steps, interpolated in float32: the method of the coarser levels without their filter.
fn steps() -> Quality {
    Quality { sampling: Sampling::Float32, least_transmittance: 0.0, ..Quality::PLAIN }
}

#[test]
fn a_homogeneous_slab_absorbs_exponentially_at_every_level_and_step() {
    for opacity in [0.0f64, 1e-6, 0.01, 0.3, 0.99, 1.0] {
        let v = volume_on(straight([10, 12, 9], [2.0, 3.0, 0.5]), u8s(&vec![7.0; 1080]));
        let shown = Shown::new(v, &format!(r#"{{"transfer": [[0, 0.25, 0.5, 1, {opacity}]]}}"#));
        let clear = 1.0 - opacity.min(HIGHEST_OPACITY_PER_MM);
        // Along x, 10 voxels of 2 mm; and at 45° between x and y (in millimetres) through the same faces.
        for (along, length) in [([20.0, 0.0], 20.0), ([60.0, 40.0], 20.0 * 2f64.sqrt())] {
            let (from, to) = ([4.5 - along[0], 5.5 - along[1], 4.0], [4.5, 5.5, 4.0]);
            let alpha = 1.0 - clear.powf(length);
            let mut levels = vec![(to_the_end(Quality::EXACT), None), (to_the_end(Quality::FINE), None)];
            for step in [0.013, 0.3, 1.0, 2.7, 20.0, 1000.0] {
                levels.push((steps(), Some(step)));
                levels.push((to_the_end(Quality::BALANCED), Some(step)));
            }
            for (quality, step) in levels {
                let found = shown.ray(from, to, quality, step);
                near(found.rgba[3], alpha, CLOSED_FORM);
                for (channel, c) in [0.25, 0.5, 1.0].into_iter().enumerate() {
                    near(found.rgba[channel], c * alpha, CLOSED_FORM);
                }
            }
        }
    }
}

#[test]
fn thin_matter_keeps_its_digits() {
    let v = floats([4, 4, 4], [1.0; 3], |_| 7.0);
    let shown = Shown::new(v, r#"{"transfer": [[0, 1, 1, 1, 1e-6]]}"#);
    let levels = [
        (Quality::EXACT, None, 1e-5),
        (Quality::FINE, None, 1e-5),
        (Quality::BALANCED, None, 1e-5),
        (Quality::BALANCED, Some(3e-3), 1e-4),
        // A sum of n equal terms in float32 is off by at most n/2 roundings of 2⁻²⁴: of 20 000, 6e-4.
        (steps(), Some(2e-4), 6e-4),
    ];
    for (quality, step, tolerance) in levels {
        let alpha = shown.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], quality, step).rgba[3];
        near(alpha / 4e-6, 1.0, tolerance);
    }
}

#[test]
fn half_the_light_is_left_at_the_half_value_layer() {
    let v = floats([40, 4, 4], [1.0; 3], |_| 7.0);
    let shown = Shown::new(v, r#"{"transfer": [[0, 1, 1, 1, 0.1]]}"#);
    let expected = 8.5 + 0.5f64.ln() / 0.9f64.ln();
    for quality in [Quality::EXACT, Quality::FINE, Quality::BALANCED] {
        let found = shown.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], quality, None);
        // Straight between nodes a quarter of a piece apart: a sixteenth of its optical depth squared at most, which is 0.1.
        near(found.depth_mm.unwrap(), expected, 1e-3);
    }
}

#[test]
fn extinction_and_colour_that_grow_linearly_follow_the_closed_form() {
    // C = c0 - (c0 + c1·L)·e^(-τ(L)) + c1·∫e^(-τ), τ = a·t + b·t²/2; the integral by Simpson's rule on 20 000 pieces, which
    // holds for b → 0 too. The volume's value is 1 - e^-σ, so that the opacity a millimetre is the value itself; colour
    // by 256 points. Value and colour are straight between voxels and points: off by h²/8 of their second derivatives, for
    // voxels of 0.05 mm (σ changes by 0.05·b) and points 1/255 of the range of σ apart.
    for (a, b, c0, c1, length) in [
        (0.3, 0.2, 0.2, 0.1, 5.0),
        (0.0, 1.0, 1.0, -0.1, 8.0),
        (1.5, -0.2, 0.0, 0.2, 5.0),
        (0.5, 1e-9, 0.1, 0.0, 3.0),
    ] {
        let h = 0.05;
        let n = (length / h) as u32;
        // The border lies half a voxel outside the first centre.
        let sigma = |x: f64| a + b * (x + 0.5) * h;
        let v = floats([n, 3, 3], [h; 3], |p| -(-sigma(p.x)).exp_m1());
        let mut shown = Shown::new(v, "{}");
        let (first, last) = (sigma(-0.5), sigma(f64::from(n) - 0.5));
        let points = (0..256).map(|i| {
            let s = first + (last - first) * f64::from(i) / 255.0;
            let color = if c1 == 0.0 { c0 } else { c0 + c1 * (s - a) / b };
            let value = -(-s).exp_m1();
            [value, color, color, color, value].into()
        });
        let mut points: Vec<scene::TransferPoint> = points.collect();
        points.sort_by(|p, q| p.value.total_cmp(&q.value));
        shown.scene.transfer = TransferFunction::new(points).unwrap();
        let shown = Shown::of_scene(shown.volume, shown.scene);
        let found = shown.ray([-20.0, 1.0, 1.0], [9.0, 1.0, 1.0], to_the_end(Quality::EXACT), None);

        let tau = |t: f64| a * t + b * t * t / 2.0;
        let pieces = 20_000;
        let step = length / f64::from(2 * pieces);
        let integral: f64 = (0..=2 * pieces)
            .map(|i| {
                let weight = if i == 0 || i == 2 * pieces { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
                weight * (-tau(f64::from(i) * step)).exp()
            })
            .sum::<f64>()
            * step
            / 3.0;
        let expected = c0 - (c0 + c1 * length) * (-tau(length)).exp() + c1 * integral;
        // Half a voxel at each end holds the outermost value: off by (h/2)²/2·b in the optical depth.
        let held = (h / 2.0f64).powi(2) / 2.0 * b.abs() * 2.0;
        let straight = (h * b).powi(2) / 8.0 * length + ((last - first) / 255.0).powi(2) / 8.0;
        near(found.rgba[3], -(-tau(length)).exp_m1(), CLOSED_FORM + held + straight);
        near(found.rgba[1], expected, CLOSED_FORM + held + straight);
    }
}

#[test]
fn opacity_that_grows_linearly_has_a_closed_optical_depth() {
    // o(t) = k·t: ∫ -ln(1 - k·t) dt = ((1 - kL)·ln(1 - kL) + kL) / k, on a ramp with the eye where it is 0.
    for (k, length) in [(0.02, 20.0), (0.05, 20.0 * HIGHEST_OPACITY_PER_MM), (1e-6, 20.0)] {
        let top = k * length;
        let shown = Shown::new(
            floats([30, 5, 5], [1.0; 3], |p| p.x),
            &format!(
                r#"{{"transfer": [[0, 1, 1, 1, 0], [{length}, 1, 1, 1, {top}], [{length}, 1, 1, 1, 0]]}}"#
            ),
        );
        let tau = ((1.0 - top) * (-top).ln_1p() + top) / k;
        let found = shown.ray([0.0, 2.0, 2.0], [9.0, 2.0, 2.0], to_the_end(Quality::EXACT), None);
        near(found.rgba[3], -(-tau).exp_m1(), CLOSED_FORM);
        near(found.rgba[0], -(-tau).exp_m1(), CLOSED_FORM);
    }
}

#[test]
fn a_band_crossed_on_a_ramp_has_the_opacity_of_its_width() {
    // 0.37 wide on a ramp of 10 a voxel: a ray of unit steps would miss it, or be off by 0.17.
    let shown = Shown::new(
        floats([20, 20, 20], [1.5, 1.0, 2.0], |p| 10.0 * p.x),
        r#"{"transfer": [[0, 0, 0, 0, 0], [61.13, 0, 0, 0, 0], [61.13, 1, 0.5, 0, 0.9],
            [61.5, 1, 0.5, 0, 0.9], [61.5, 0, 0, 0, 0]]}"#,
    );
    let mut noise = Noise(3);
    for _ in 0..20 {
        let (from, to) = (noise.point(2.0, 5.0), noise.point(8.0, 17.0));
        let mm = ((to - from) * DVec3::new(1.5, 1.0, 2.0)).length();
        let per_mm = 10.0 * (to.x - from.x) / mm;
        let alpha = 1.0 - 0.1f64.powf((61.5 - 61.13) / per_mm);
        let found = shown.ray(from.into(), to.into(), Quality::EXACT, None);
        // The band's width is a difference of values known to 2⁻²² of 190: 1.2e-4 of it.
        near(found.rgba[3], alpha, CLOSED_FORM + 3e-4 * alpha);
        near(found.rgba[1], alpha / 2.0, CLOSED_FORM + 3e-4 * alpha);
    }
}

#[test]
fn a_band_far_narrower_than_an_entry_of_the_table_is_seen() {
    // 0.5 of 60 000: a 30 000th. The table of the coarser levels has 4096 entries.
    let shown = Shown::new(
        floats([25, 5, 5], [1.0; 3], |p| 2500.0 * p.x),
        r#"{"transfer": [[0, 0, 0, 0, 0], [30101, 0, 0, 0, 0], [30101, 1, 1, 1, 1], [30101.5, 1, 1, 1, 1],
            [30101.5, 0, 0, 0, 0], [60000, 0, 0, 0, 0]]}"#,
    );
    let found = shown.ray([-9.0, 2.0, 2.0], [9.0, 2.0, 2.0], Quality::EXACT, None);
    // The knots are rounded to 2⁻⁹, a 256th of the band's width each.
    let tau = 20.0 * std::f64::consts::LN_2 * 0.5 / 2500.0;
    near(found.rgba[3] / -(-tau).exp_m1(), 1.0, 2.0 / 256.0);
}

#[test]
fn the_x_ray_of_a_hard_ball_is_its_chord() {
    // 2μ√(R² - b²). The ball's edge is blurred over a voxel: each end of the chord is off by less than a voxel's diagonal.
    let (radius, h) = (12.0, 0.625);
    let n = (40.0 / h) as u32;
    let shown = Shown::new(
        floats([n; 3], [h; 3], |p| f64::from(u8::from(((p + 0.5) * h - 20.0).length() <= radius))),
        r#"{"mode": "x-ray", "window": [0, 1]}"#,
    );
    let (along, side) = (DVec3::new(0.36, 0.48, 0.8), DVec3::new(0.8, -0.6, 0.0));
    for impact in [0.0f64, 3.0, 6.0, 9.0] {
        let index = |mm: DVec3| ((mm + 20.0) / h - 0.5).to_array();
        let (from, to) = (index(side * impact - along * 30.0), index(side * impact));
        let ray = reference::Ray { origin: DVec3::from_array(from), direction: along / h };
        let way = ray.inside(shown.volume.grid().dims()).unwrap().length_mm();
        let chord = shown.ray(from, to, Quality::EXACT, None).rgba[0] * way;
        let half = (radius * radius - impact * impact).sqrt();
        let bound = 2.0 * h * 3f64.sqrt() / (half / radius);
        near(chord, 2.0 * half, bound);
    }
}

#[test]
fn the_x_ray_of_what_trilinear_reproduces_is_exact() {
    // Along a diagonal x = y = z = s, f = s³ from s = 1 to 8, held at 512 for half a voxel.
    let cube = floats([9, 9, 9], [2.0; 3], |p| p.x * p.y * p.z);
    let shown = Shown::new(cube, r#"{"mode": "x-ray", "window": [0, 1000]}"#);
    let found = shown.ray([1.0; 3], [5.0; 3], Quality::EXACT, None);
    near(found.rgba[3], ((8f64.powi(4) - 1.0) / 4.0 + 0.5 * 512.0) / 7.5 / 1000.0, CLOSED_FORM);
}

#[test]
fn the_surface_of_a_plane_is_where_the_plane_is_and_lit_by_its_angle() {
    // 0.1 x 0.1 x 5 mm and oblique: the gradient goes to millimetres by the inverse transpose of the axes.
    let grid = oblique([12, 14, 10], [0.1, 0.1, 5.0]);
    let normal = DVec3::new(0.5, -0.25, 0.75);
    let shown = Shown::new(
        volume_on(grid, f32s(&each([12, 14, 10], |p| normal.dot(p)))),
        r#"{"mode": "threshold", "threshold": 5.3, "surface_opacity": 0.75, "surface_color": [1, 0.5, 0]}"#,
    );
    let mut noise = Noise(11);
    let mut lit_ones = 0;
    for _ in 0..30 {
        let from = DVec3::new(noise.within(0.5, 3.0), noise.within(6.0, 12.0), noise.within(0.5, 3.0));
        let to = DVec3::new(noise.within(8.0, 10.0), noise.within(1.0, 4.0), noise.within(7.0, 8.5));
        let m = shown.volume.grid().volume_from_index().matrix3;
        let mm = (m * (to - from)).length();
        let along = (to - from) / mm;
        let depth = (5.3 - normal.dot(from)) / normal.dot(along);
        for quality in [Quality::EXACT, steps()] {
            let found = shown.ray(from.into(), to.into(), quality, None);
            // Values reach 16, known to 2⁻²⁰ of that; the way through the volume is some 50 mm long.
            let tolerance = DISTANCE * (16.0 / normal.dot(along) + 60.0);
            near(found.depth_mm.unwrap(), depth, tolerance);
            let hit = from + along * depth;
            if hit.cmpge(DVec3::ONE).all() && hit.cmple(DVec3::new(10.0, 12.0, 8.0)).all() {
                let k = (m.inverse().transpose() * normal).normalize().dot(m * along).abs();
                let lit = Headlight::default().lit([1.0, 0.5, 0.0], k);
                for (channel, c) in lit.into_iter().enumerate() {
                    near(found.rgba[channel], 0.75 * c, CLOSED_FORM);
                }
                lit_ones += 1;
            }
        }
    }
    assert!(lit_ones > 10, "{lit_ones}");
}

#[test]
fn the_surface_of_a_product_is_a_cubic_s_root() {
    let shown = Shown::new(
        floats([9, 9, 9], [2.0; 3], |p| p.x * p.y * p.z),
        r#"{"mode": "threshold", "threshold": 1}"#,
    );
    for threshold in [0.1f64, 1.0, 8.0, 77.7, 500.0] {
        let mut scene = shown.scene.clone();
        scene.threshold = threshold;
        let shown = Shown::of_scene(shown.volume.clone(), scene);
        let found = shown.ray([0.25; 3], [5.0; 3], Quality::EXACT, None);
        let s = threshold.cbrt();
        // 2⁻²⁰ of the largest value, 512, over the slope 3s² a voxel.
        let off = DISTANCE * (512.0 / (3.0 * s * s) + 40.0) * 2.0 * 3f64.sqrt();
        near(found.depth_mm.unwrap(), (s - 0.25) * 2.0 * 3f64.sqrt(), off);
    }
}

#[test]
fn the_surface_of_a_sphere_is_met_within_the_bound_of_trilinear_interpolation() {
    // f = -r². Its interpolant lies below it by at most ⅛·Σh²|f''| = ¾ h²: the surface lies between the spheres of R² and
    // R² - ¾h². Rays graze it ever more.
    let centre = DVec3::splat(15.5);
    let shown = Shown::new(
        floats([32, 32, 32], [1.0; 3], |p| -(p - centre).length_squared()),
        r#"{"mode": "threshold", "threshold": -100}"#,
    );
    let radius = 10.0f64;
    let inner = radius * radius - 0.75;
    let direction = DVec3::new(0.3, 0.8, 0.52).normalize();
    let side = direction.any_orthonormal_vector();
    for impact in [0.0, 3.0, 8.0, 9.5, 9.9, 9.96, 9.9624, 9.97, 9.99, 10.0, 10.01, 10.5] {
        let origin = centre + side * impact - direction * 40.0;
        let found = shown.ray(origin.into(), (origin + direction).into(), Quality::EXACT, None).depth_mm;
        let met = |square: f64| (square >= impact * impact).then(|| 40.0 - (square - impact * impact).sqrt());
        // 2⁻²⁰ of the largest value, 721, over the slope 2√(R² - b²) that a ray has there, or its root where that is 0.
        let off = DISTANCE * 721.0;
        let hair =
            (off / (2.0 * (radius * radius - impact * impact).max(1e-9).sqrt())).min(off.sqrt()) + 1e-4;
        match (met(radius * radius), met(inner), found) {
            (Some(outer), Some(inner), Some(t)) => {
                assert!(t >= outer - hair && t <= inner + hair, "{impact}: {outer} {t} {inner}");
            }
            (Some(outer), None, t) => {
                assert!(t.is_none_or(|t| t >= outer - hair && t <= 80.0 - outer + hair), "{impact}: {t:?}");
            }
            (None, None, None) => {}
            other => panic!("{impact}: {other:?}"),
        }
    }
}

#[test]
fn a_surface_crossed_twice_within_a_voxel_is_met() {
    // One plane of voxels just above the threshold: above it over a tenth of a voxel to each side.
    let shown = Shown::new(
        floats([9, 9, 20], [1.0; 3], |p| f64::from(u8::from(p.z == 12.0))),
        r#"{"mode": "threshold", "threshold": 0.9}"#,
    );
    for x in 0..40 {
        let from = [4.0 + f64::from(x) * 0.01, 4.2, -9.0 - f64::from(x) * 0.021];
        let found = shown.ray(from, [4.1, 4.0, 12.0], Quality::EXACT, None);
        let t = (11.9 - from[2]) / (12.0 - from[2]);
        let mm = (DVec3::new(4.1, 4.0, 12.0) - DVec3::from_array(from)).length();
        near(found.depth_mm.unwrap(), t * mm, 1e-4);
    }
}

#[test]
fn the_maximum_of_a_saddle_is_at_the_root_of_the_slope() {
    // Along x = s, y = 1 - s in one cell, f = x·y has its maximum ¼ in the middle.
    let shown = Shown::new(
        floats([2, 2, 2], [3.0; 3], |p| p.x * p.y),
        r#"{"mode": "maximum", "transfer": [[0, 0, 0.5, 1, 0], [1, 1, 0.5, 0, 1]]}"#,
    );
    let found = shown.ray([-0.25, 1.25, 0.5], [0.5, 0.5, 0.5], Quality::EXACT, None);
    near(found.rgba[3], 0.25, CLOSED_FORM);
    near(found.rgba[0], 0.25 * 0.25, CLOSED_FORM);
    near(found.rgba[2], 0.75 * 0.25, CLOSED_FORM);
    // Near the top the value is flat: 2⁻²⁴ of it are met within 2⁻¹² of a voxel.
    near(found.depth_mm.unwrap(), 0.75 * 2f64.sqrt() * 3.0, 2e-3);
}

#[test]
fn early_termination_costs_no_more_than_the_transmittance_it_stops_at() {
    let v = floats([20, 20, 40], [1.0; 3], |_| 100.0);
    let shown = Shown::new(v, r#"{"transfer": [[0, 1, 1, 1, 0.3]]}"#);
    for level in [Quality::BALANCED, Quality::FINE] {
        let alpha = |least_transmittance| {
            let quality = Quality { least_transmittance, ..level };
            shown.ray([9.5, 9.5, -50.0], [9.5, 9.5, 0.0], quality, None).rgba[3]
        };
        for least in [0.25, 1.0 / 64.0, 1.0 / 1024.0] {
            let error = alpha(0.0) - alpha(least);
            assert!(error > 0.0 && error <= least, "stopped at {least}: error {error}");
        }
    }
}

/// Marschner and Lobb's test signal on -1 to 1.
fn marschner_lobb(p: DVec3) -> f64 {
    const FREQUENCY: f64 = 6.0;
    const ALPHA: f64 = 0.25;
    use std::f64::consts::{FRAC_PI_2, TAU};
    let phase = TAU * FREQUENCY * (FRAC_PI_2 * p.x.hypot(p.y)).cos();
    (1.0 - (FRAC_PI_2 * p.z).sin() + ALPHA * (1.0 + phase.cos())) / (2.0 * (1.0 + ALPHA))
}

#[test]
fn the_marschner_lobb_signal_of_41_samples_is_drawn_as_the_reference_draws_it() {
    let v = Arc::new(floats([41; 3], [0.05; 3], |p| marschner_lobb(p * 0.05 - 1.0)));
    let size = [48, 48];
    let view = eye(DVec3::new(3.0, 2.5, 4.0), DVec3::splat(1.0), Fov::symmetric(0.5, 0.5).unwrap());
    for json in [
        r#"{"mode": "threshold", "threshold": 0.5, "surface_color": [1, 1, 1]}"#,
        r#"{"mode": "maximum", "window": [0, 1]}"#,
        r#"{"transfer": [[0.45, 0.2, 0.4, 1, 0], [0.55, 1, 0.8, 0.2, 0.99]], "shade": true}"#,
    ] {
        let file = scene::SceneFile::from_json(json).unwrap();
        let scene = file.resolve(&scene::VolumeFacts::of(&v)).unwrap();
        true_picture("Marschner-Lobb", &Shown::of_scene(v.clone(), scene), view, size);
    }
}

#[test]
fn the_marschner_lobb_surface_lies_on_the_signal_where_samples_allow_it() {
    // 161 samples over the middle fifth: the shortest wave has 42 of them, and the value is off by at most
    // h²/8·(2π/wave)²·α/(2(1+α)) a direction across, 5e-4.
    let n = 64u32;
    let h = 0.4 / f64::from(n - 1);
    let place = |index: DVec3| index * h + DVec3::new(0.2, 0.2, -0.1);
    let shown = Shown::new(
        floats([n; 3], [h; 3], |p| marschner_lobb(place(p))),
        r#"{"mode": "threshold", "threshold": 0.5}"#,
    );
    let mut hits = 0;
    for i in 0..100 {
        let from = [3.0 + 0.55 * f64::from(i), 61.0 - 0.57 * f64::from(i), 62.0];
        let to = [5.0 + 0.5 * f64::from(i), 60.0 - 0.5 * f64::from(i), 1.0];
        let Some(depth) = shown.ray(from, to, Quality::EXACT, None).depth_mm else { continue };
        let (from, to) = (DVec3::from_array(from), DVec3::from_array(to));
        let hit = from + (to - from).normalize() * (depth / h);
        if depth > 0.0 && hit.z < 61.0 {
            near(marschner_lobb(place(hit)), 0.5, 1e-3);
            hits += 1;
        }
    }
    assert!(hits > 50, "{hits}");
}
