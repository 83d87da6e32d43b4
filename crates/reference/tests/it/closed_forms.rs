//! The reference against closed forms.

use crate::common::{Noise, near, oblique, pixel, ray, scene, volume, volume_on};
use reference::{Field, RaySetup, Reference};
use scene::{HIGHEST_OPACITY_PER_MM, Headlight};
use spatial::{DQuat, DVec3, EyeView, Fov, HeadGeometry, Pose};

/// What the closed forms are met to.
const EXACT: f64 = 1.0e-9;

#[test]
fn a_homogeneous_slab_absorbs_exponentially() {
    let v = volume([10, 12, 9], [2.0, 3.0, 0.5], |_| 7.0);
    let middle = DVec3::new(4.5, 5.5, 4.0);
    for opacity in [0.0f64, 1e-12, 1e-6, 0.01, 0.3, 0.99, 1.0] {
        let s = scene(&v, &format!(r#"{{"transfer": [[0, 0.25, 0.5, 1, {opacity}]]}}"#));
        let clear = 1.0 - opacity.min(HIGHEST_OPACITY_PER_MM);
        // Along x, 10 voxels of 2 mm; and at 45° between x and y (in millimetres) through the same faces.
        for (towards, length) in [(DVec3::X, 20.0), (DVec3::new(3.0, 2.0, 0.0), 20.0 * 2f64.sqrt())] {
            let found = pixel(&v, &s, &ray(&v, middle - 20.0 * towards, middle));
            let alpha = 1.0 - clear.powf(length);
            near(found.rgba[3], alpha, EXACT);
            for (channel, c) in [0.25, 0.5, 1.0].into_iter().enumerate() {
                near(found.rgba[channel], c * alpha, EXACT);
            }
        }
    }
}

#[test]
fn thin_matter_keeps_its_digits() {
    let v = volume([4, 4, 4], [1.0; 3], |_| 7.0);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 1e-12]]}"#);
    let alpha = pixel(&v, &s, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0])).rgba[3];
    near(alpha / 4e-12, 1.0, 1e-11);
}

#[test]
fn half_the_light_is_left_at_the_half_value_layer() {
    let v = volume([40, 4, 4], [1.0; 3], |_| 7.0);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0.1]]}"#);
    let found = pixel(&v, &s, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0]));
    near(found.depth_mm.unwrap(), 8.5 + 0.5f64.ln() / 0.9f64.ln(), EXACT);
    let thin = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0.001]]}"#);
    assert_eq!(pixel(&v, &thin, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0])).depth_mm, None);
}

#[test]
fn a_band_crossed_on_a_ramp_has_the_opacity_of_its_width() {
    // 0.37 wide on a ramp of 10 a voxel: a ray of unit steps would miss it.
    let v = volume([20, 20, 20], [1.5, 1.0, 2.0], |p| 10.0 * p.x);
    let s = scene(
        &v,
        r#"{"transfer": [[0, 0, 0, 0, 0], [61.13, 0, 0, 0, 0], [61.13, 1, 0.5, 0, 0.9],
            [61.5, 1, 0.5, 0, 0.9], [61.5, 0, 0, 0, 0]]}"#,
    );
    let mut noise = Noise(3);
    for _ in 0..50 {
        let r = ray(&v, noise.point(2.0, 5.0), noise.point(8.0, 17.0));
        let per_mm = 10.0 * r.direction.x;
        let alpha = 1.0 - 0.1f64.powf((61.5 - 61.13) / per_mm);
        let found = pixel(&v, &s, &r);
        near(found.rgba[3], alpha, EXACT);
        near(found.rgba[1], alpha / 2.0, EXACT);
    }
}

#[test]
fn opacity_that_grows_linearly_has_a_closed_optical_depth() {
    // o(t) = k·t: ∫ -ln(1 - k·t) dt = ((1 - kL)·ln(1 - kL) + kL) / k, on a ramp with the eye where it is 0.
    let v = volume([30, 5, 5], [1.0; 3], |p| p.x);
    for (k, length) in [(0.02, 20.0), (0.05, 20.0 * HIGHEST_OPACITY_PER_MM), (1e-7, 20.0)] {
        let top = k * length;
        let json = format!(
            r#"{{"transfer": [[0, 1, 1, 1, 0], [{length}, 1, 1, 1, {top}], [{length}, 1, 1, 1, 0]]}}"#
        );
        let s = scene(&v, &json);
        let tau = ((1.0 - top) * (-top).ln_1p() + top) / k;
        let found = pixel(&v, &s, &ray(&v, [0.0, 2.0, 2.0], [9.0, 2.0, 2.0]));
        near(found.rgba[3], -(-tau).exp_m1(), EXACT);
        near(found.rgba[0], -(-tau).exp_m1(), EXACT);
    }
}

#[test]
fn colour_that_grows_linearly_in_a_homogeneous_extinction_has_a_closed_form() {
    // c = t/L, σ constant: ∫ c σ e^(-σt) dt = (1 - e^(-σL))/(σL) - e^(-σL).
    let v = volume([30, 5, 5], [1.0; 3], |p| p.x);
    let s = scene(&v, r#"{"transfer": [[0, 0, 0, 0, 0.1], [20, 1, 1, 1, 0.1], [20, 0, 0, 0, 0]]}"#);
    let found = pixel(&v, &s, &ray(&v, [0.0, 2.0, 2.0], [9.0, 2.0, 2.0]));
    let depth = -20.0 * 0.9f64.ln();
    near(found.rgba[1], (1.0 - (-depth).exp()) / depth - (-depth).exp(), EXACT);
}

#[test]
fn the_x_ray_of_what_trilinear_reproduces_is_exact() {
    // Linear along x, held in the half voxels at both ends.
    let v = volume([9, 9, 9], [2.0; 3], |p| 1.0 + 2.0 * p.x - p.y + 0.5 * p.x * p.y + p.x * p.y * p.z);
    let s = scene(&v, r#"{"mode": "x-ray", "window": [0, 100]}"#);
    let (y, z) = (2.25, 4.75);
    let at = |x: f64| 1.0 + 2.0 * x - y + 0.5 * x * y + x * y * z;
    let mean = (0.5 * at(0.0) + 8.0 * at(4.0) + 0.5 * at(8.0)) / 9.0;
    let found = pixel(&v, &s, &ray(&v, [-20.0, y, z], [20.0, y, z]));
    for sample in found.rgba {
        near(sample, mean / 100.0, EXACT);
    }
    near(found.depth_mm.unwrap(), 2.0 * 24.0, EXACT);
    // Along a diagonal x = y = z = s, f = s³ from s = 1 to 8, held at 512 for half a voxel.
    let cube = volume([9, 9, 9], [2.0; 3], |p| p.x * p.y * p.z);
    let s = scene(&cube, r#"{"mode": "x-ray", "window": [0, 1000]}"#);
    let found = pixel(&cube, &s, &ray(&cube, [1.0; 3], [5.0; 3]));
    near(found.rgba[3], ((8f64.powi(4) - 1.0) / 4.0 + 0.5 * 512.0) / 7.5 / 1000.0, EXACT);
}

#[test]
fn values_outside_the_window_are_black_or_white() {
    let v = volume([4, 4, 4], [1.0; 3], |_| 5.0);
    for (window, expected) in [("[6, 7]", 0.0), ("[1, 2]", 1.0), ("[4, 6]", 0.5)] {
        let s = scene(&v, &format!(r#"{{"mode": "x-ray", "window": {window}}}"#));
        near(pixel(&v, &s, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0])).rgba[0], expected, EXACT);
    }
}

#[test]
fn the_surface_of_a_plane_is_where_the_plane_is() {
    let grid = oblique([12, 14, 10], [0.1, 0.1, 5.0]);
    // Quarters, which float32 holds.
    let v = volume_on(grid, |p| 0.5 * p.x - 0.25 * p.y + 0.75 * p.z);
    let s = scene(
        &v,
        r#"{"mode": "threshold", "threshold": 5.3, "surface_opacity": 0.75, "surface_color": [1, 0.5, 0]}"#,
    );
    let mut noise = Noise(11);
    for _ in 0..50 {
        let from = DVec3::new(noise.within(0.5, 3.0), noise.within(6.0, 12.0), noise.within(0.5, 3.0));
        let to = DVec3::new(noise.within(8.0, 10.0), noise.within(1.0, 4.0), noise.within(7.0, 8.5));
        let normal = DVec3::new(0.5, -0.25, 0.75);
        let r = ray(&v, from, to);
        let found = pixel(&v, &s, &r);
        let per_mm = normal.dot(r.direction);
        near(found.depth_mm.unwrap(), (5.3 - normal.dot(from)) / per_mm, EXACT);
        // Lit by the default headlight, the cosine taken in millimetres.
        let in_mm = v.grid().volume_from_index().matrix3.inverse().transpose() * normal;
        let direction_mm = v.grid().volume_from_index().matrix3 * r.direction;
        let k = in_mm.normalize().dot(direction_mm).abs();
        let lit = 0.15 + 0.65 * k;
        let inside = r.at(found.depth_mm.unwrap());
        if inside.cmpge(DVec3::ONE).all() && inside.cmple(DVec3::new(10.0, 12.0, 8.0)).all() {
            near(found.rgba[0], 0.75 * (lit + 0.2 * k), EXACT);
            near(found.rgba[1], 0.75 * (0.5 * lit + 0.2 * k), EXACT);
        }
        near(found.rgba[3], 0.75, EXACT);
    }
}

#[test]
fn the_surface_of_a_product_is_a_cubic_s_root() {
    let v = volume([9, 9, 9], [2.0; 3], |p| p.x * p.y * p.z);
    for threshold in [0.1f64, 1.0, 8.0, 77.7, 500.0] {
        let s = scene(&v, &format!(r#"{{"mode": "threshold", "threshold": {threshold}}}"#));
        let found = pixel(&v, &s, &ray(&v, [0.25; 3], [5.0; 3]));
        let mm_per_voxel = 2.0 * 3f64.sqrt();
        near(found.depth_mm.unwrap(), (threshold.cbrt() - 0.25) * mm_per_voxel, EXACT);
    }
    // Off the diagonal: f rises along the ray, so that its value at a point is met first at that point.
    let mut noise = Noise(5);
    for _ in 0..50 {
        let r = ray(&v, noise.point(0.2, 1.0), noise.point(6.0, 7.9));
        let t = noise.within(1.0, 8.0);
        let p = r.at(t);
        let mut s = scene(&v, r#"{"mode": "threshold", "threshold": 1}"#);
        s.threshold = p.x * p.y * p.z;
        near(pixel(&v, &s, &r).depth_mm.unwrap(), t, EXACT);
    }
}

#[test]
fn the_surface_of_a_sphere_is_met_within_the_bound_of_trilinear_interpolation() {
    // f = -r². Its interpolant lies below it by at most ⅛·Σh²|f''| = ¾ h²: the surface lies between the spheres of R² and
    // R² - ¾h². Rays graze it ever more.
    let centre = DVec3::splat(15.5);
    let v = volume([32, 32, 32], [1.0; 3], |p| -(p - centre).length_squared());
    let radius = 10.0f64;
    let inner = radius * radius - 0.75;
    let s = scene(&v, r#"{"mode": "threshold", "threshold": -100}"#);
    let direction = DVec3::new(0.3, 0.8, 0.52).normalize();
    let side = direction.any_orthonormal_vector();
    for impact in [0.0, 3.0, 8.0, 9.5, 9.9, 9.96, 9.9624, 9.97, 9.99, 10.0, 10.01, 10.5] {
        let origin = centre + side * impact - direction * 40.0;
        let found = pixel(&v, &s, &ray(&v, origin, origin + direction)).depth_mm;
        let met = |square: f64| (square >= impact * impact).then(|| 40.0 - (square - impact * impact).sqrt());
        match (met(radius * radius), met(inner), found) {
            (Some(outer), Some(inner), Some(t)) => {
                assert!(t >= outer - EXACT && t <= inner + EXACT, "{impact}: {outer} {t} {inner}");
            }
            (Some(outer), None, t) => {
                assert!(t.is_none_or(|t| t >= outer - EXACT && t <= 80.0 - outer + EXACT), "{impact}");
            }
            (None, None, None) => {}
            other => panic!("{impact}: {other:?}"),
        }
    }
}

#[test]
fn the_maximum_of_a_saddle_is_at_the_root_of_the_slope() {
    // Along x = s, y = 1 - s in one cell, f = x·y has its maximum ¼ in the middle.
    let v = volume([2, 2, 2], [3.0; 3], |p| p.x * p.y);
    let s = scene(&v, r#"{"mode": "maximum", "transfer": [[0, 0, 0.5, 1, 0], [1, 1, 0.5, 0, 1]]}"#);
    let found = pixel(&v, &s, &ray(&v, [-0.25, 1.25, 0.5], [0.5, 0.5, 0.5]));
    near(found.rgba[3], 0.25, EXACT);
    near(found.rgba[0], 0.25 * 0.25, EXACT);
    near(found.rgba[2], 0.75 * 0.25, EXACT);
    near(found.depth_mm.unwrap(), 0.75 * 2f64.sqrt() * 3.0, EXACT);
}

#[test]
fn a_lit_ramp_is_lit_by_its_angle() {
    let grid = oblique([12, 12, 12], [0.4, 1.0, 2.0]);
    let v = volume_on(grid, |p| 2.0 * p.x + p.y - 4.0 * p.z);
    let mut s = scene(&v, r#"{"transfer": [[0, 0.5, 0.25, 1, 0.4]]}"#);
    let light = Headlight { ambient: 0.1, diffuse: 0.6, specular: 0.3, power: 20.0 };
    s.light = Some(light);
    // From inside to an end behind which the field is not looked at: opaque enough to end the ray on its way.
    s.transfer = scene::TransferFunction::new(vec![[0.0, 0.5, 0.25, 1.0, 1.0].into()]).unwrap();
    let r = ray(&v, [2.0, 3.0, 2.0], [9.0, 4.0, 9.0]);
    let m = v.grid().volume_from_index().matrix3;
    let normal = (m.inverse().transpose() * DVec3::new(2.0, 1.0, -4.0)).normalize();
    let k = normal.dot(m * r.direction).abs();
    let alpha = pixel(&v, &s, &r).rgba[3];
    near(alpha, 1.0, 1e-13);
    for (channel, c) in [0.5, 0.25, 1.0].into_iter().enumerate() {
        let lit = c * (0.1 + 0.6 * k) + 0.3 * k.powi(20);
        near(pixel(&v, &s, &r).rgba[channel], lit, EXACT);
    }
}

#[test]
fn early_termination_leaves_no_more_than_it_states() {
    // Behind matter of optical depth 33, white matter of the highest opacity: it adds at most e^-33 of white.
    let length = 33.0 / 0.1;
    let v = volume([400, 2, 2], [1.0; 3], |p| p.x);
    let opacity = -(-0.1f64).exp_m1();
    let json = format!(
        r#"{{"transfer": [[0, 0, 0, 0, {opacity}], [{length}, 0, 0, 0, {opacity}], [{length}, 1, 1, 1, 1]]}}"#
    );
    let found = pixel(&v, &scene(&v, &json), &ray(&v, [0.0, 0.5, 0.5], [9.0, 0.5, 0.5]));
    assert!(found.rgba[0] <= (-32.0f64).exp(), "{}", found.rgba[0]);
}

/// Marschner and Lobb's test signal on -1 to 1, and its gradient.
fn marschner_lobb(p: DVec3) -> (f64, DVec3) {
    const FREQUENCY: f64 = 6.0;
    const ALPHA: f64 = 0.25;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};
    let radius = p.x.hypot(p.y);
    let phase = TAU * FREQUENCY * (FRAC_PI_2 * radius).cos();
    let scale = 1.0 / (2.0 * (1.0 + ALPHA));
    let value = (1.0 - (FRAC_PI_2 * p.z).sin() + ALPHA * (1.0 + phase.cos())) * scale;
    let along_radius = ALPHA * phase.sin() * TAU * FREQUENCY * (FRAC_PI_2 * radius).sin() * FRAC_PI_2 * scale;
    let outwards = if radius > 0.0 { DVec3::new(p.x / radius, p.y / radius, 0.0) } else { DVec3::ZERO };
    (value, outwards * along_radius - DVec3::Z * (FRAC_PI_2 * p.z).cos() * PI / 2.0 * scale)
}

#[test]
fn the_marschner_lobb_signal_of_41_samples_is_met_at_samples() {
    let place = |index: DVec3| index * 0.05 - DVec3::ONE;
    let v = volume([41; 3], [0.05; 3], |p| marschner_lobb(place(p)).0);
    let field = Field::new(&v.channels()[0], v.grid());
    let mut noise = Noise(17);
    let mut square = 0.0;
    for _ in 0..4000 {
        let index = noise.point(0.0, 40.0);
        near(field.value(index.round()), marschner_lobb(place(index.round())).0, 6e-8);
        square += (field.value(index) - marschner_lobb(place(index)).0).powi(2);
    }
    // Between samples the signal is near the sampling limit: its shortest wave has 2.1 samples.
    let rms = (square / 4000.0).sqrt();
    assert!((0.03..0.04).contains(&rms), "{rms}");
}

#[test]
fn the_marschner_lobb_signal_and_its_gradient_are_approached_in_second_order() {
    // The part from 0.2 to 0.6, ever finer. The shortest wave is 2/(6π) long: at 1/80 it has 8.5 samples, at 1/320 34.
    let mut errors = Vec::new();
    for per_unit in [80u32, 160, 320] {
        let h = 1.0 / f64::from(per_unit);
        let n = 2 * per_unit / 5 + 1;
        let place = |index: DVec3| index * h + DVec3::splat(0.2);
        let v = volume([n; 3], [h; 3], |p| marschner_lobb(place(p)).0);
        let field = Field::new(&v.channels()[0], v.grid());
        let mut noise = Noise(17);
        let (mut value_square, mut slope_square) = (0.0, 0.0);
        for _ in 0..4000 {
            let p = noise.point(0.22, 0.58);
            let index = (p - DVec3::splat(0.2)) / h;
            let (value, gradient) = marschner_lobb(p);
            value_square += (field.value(index) - value).powi(2);
            slope_square += (field.gradient_per_mm(index) - gradient).length_squared();
        }
        errors.push([value_square.sqrt(), slope_square.sqrt()]);
    }
    for (kind, finest) in [("value", 0.05), ("gradient", 0.05)].into_iter().enumerate() {
        let order = (errors[1][kind] / errors[2][kind]).log2();
        assert!((order - 2.0).abs() < finest.1, "{}: order {order}, {errors:?}", finest.0);
    }
}

fn eye(position_m: DVec3, fov: Fov) -> EyeView {
    EyeView { world_from_eye: Pose { position_m, orientation: DQuat::IDENTITY }, fov }
}

#[test]
fn eyes_without_distance_see_the_same() {
    let v = crate::common::noisy(oblique([8, 9, 7], [20.0, 15.0, 30.0]), 4);
    let s = scene(&v, r#"{"transfer": [[0.2, 1, 0, 0, 0], [1, 0, 1, 1, 0.1]], "shade": true}"#);
    let reference = Reference::new(&v, &s).unwrap();
    let volume_from_world = s.placement.world_from_volume(v.grid()).inverse();
    let view = HeadGeometry::parallel(0.0, Fov::symmetric(0.3, 0.2).unwrap())
        .view(&Pose { position_m: DVec3::new(0.0, 1.5, 0.0), ..Pose::IDENTITY });
    let [left, right] = view.eyes.map(|eye| {
        let setup = RaySetup::in_room(v.grid(), volume_from_world, eye);
        reference.picture(&setup, 24, 16, &|_| ()).unwrap()
    });
    assert_eq!(left, right);
    assert!(left.pixels().iter().any(|p| p.rgba[3] > 0.1));
}

#[test]
fn disparity_is_focal_length_times_base_over_distance() {
    // A tent around one voxel: the highest value on a ray is highest if the ray goes through the voxel's centre.
    let v = volume([21, 21, 21], [4.0; 3], |p| f64::from(u8::from(p == DVec3::new(12.0, 9.0, 14.0))));
    let s = scene(&v, r#"{"mode": "maximum", "transfer": [[0, 1, 1, 1, 0], [1, 1, 1, 1, 1]]}"#);
    let reference = Reference::new(&v, &s).unwrap();
    let world_from_volume = s.placement.world_from_volume(v.grid());
    let point_mm = v.grid().volume_from_index().transform_point3(DVec3::new(12.0, 9.0, 14.0));
    let point_m = world_from_volume.transform_point3(point_mm);
    let fov = Fov::checked(-0.3, 0.4, 0.25, -0.2).unwrap();
    let base_m = 0.064;
    let [left, right] = [-1.0, 1.0].map(|side| {
        let eye = eye(DVec3::new(side * base_m / 2.0, point_m.y, 0.0), fov);
        let setup = RaySetup::in_room(v.grid(), world_from_volume.inverse(), eye);
        let [_, _, up, down] = fov.tangents();
        let y = up / (up - down);
        let brightness = |x: f64| reference.pixel(&setup.ray(x, y)).rgba[3];
        // Ternary search within a voxel's tent around where it is known to be to a tenth of the picture.
        let (mut low, mut high) = (0.0, 1.0);
        let peak =
            (0..2000).map(|i| f64::from(i) / 2000.0).max_by(|a, b| brightness(*a).total_cmp(&brightness(*b)));
        if let Some(peak) = peak {
            (low, high) = (peak - 1e-3, peak + 1e-3);
        }
        for _ in 0..100 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if brightness(a) < brightness(b) { low = a } else { high = b }
        }
        low
    });
    let [tan_left, tan_right, ..] = fov.tangents();
    let focal_widths = 1.0 / (tan_right - tan_left);
    near(left - right, focal_widths * base_m / -point_m.z, 1e-9);
}
