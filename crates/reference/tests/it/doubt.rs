//! Pixels at a jump of the picture are found, and judged by the answer they chose.

use crate::common::{near, pixel, ray, scene, volume};
use reference::{Answers, Pixel, Ray, RaySetup, Reference, Tolerance, Uncertainty, judge};
use scene::{Camera, Scene};
use spatial::DVec3;
use volume::Volume;

fn answers(volume: &Volume, scene: &Scene, ray: &Ray) -> Answers {
    let reference = Reference::new(volume, scene).expect("a picture");
    reference.answers(ray, &Uncertainty::of_float32(&reference))
}

/// A ridge of height 1 along x, over another of height 2 behind it.
fn ridges() -> Volume {
    volume([9, 9, 20], [1.0; 3], |p| match p.z as u32 {
        5 => 1.0,
        12 => 2.0,
        _ => 0.0,
    })
}

#[test]
fn a_grazed_threshold_has_both_answers() {
    let v = ridges();
    let r = ray(&v, [4.0, 4.2, -9.0], [4.1, 4.0, 20.0]);
    for (threshold, near_first) in [(1.0 + 1e-9, false), (1.0 - 1e-9, true)] {
        let mut s = scene(&v, r#"{"mode": "threshold", "threshold": 1}"#);
        s.threshold = threshold;
        let found = answers(&v, &s, &r);
        let (first, second) = (14.0, 20.5);
        let exact = found.exact().depth_mm.unwrap();
        assert_eq!((exact - first).abs() < 0.1, near_first, "{exact}");
        // The other answer, which a float32 ray may give, is no error; one between them is.
        assert!(found.depth_error_mm(Some(first / r.direction.z)) < 0.01);
        assert!(found.depth_error_mm(Some(second / r.direction.z)) < 0.01);
        assert!(found.depth_error_mm(Some(17.0)) > 2.0);
        assert_eq!(found.depth_error_mm(None), f64::INFINITY);
    }
}

#[test]
fn a_clear_hit_has_one_answer() {
    let v = ridges();
    let s = scene(&v, r#"{"mode": "threshold", "threshold": 0.5}"#);
    let found = answers(&v, &s, &ray(&v, [4.0, 4.2, -9.0], [4.1, 4.0, 20.0]));
    assert!(found.spread() < 1e-4, "{}", found.spread());
    assert_eq!(found.color_error(found.exact().rgba), 0.0);
    assert!(found.color_error([0.0; 4]) > 0.5);
    assert!(found.depth_error_mm(found.exact().depth_mm.map(|d| d + 0.1)) > 0.09);
}

#[test]
fn two_maxima_of_one_value_have_two_depths() {
    let v = volume([9, 9, 20], [1.0; 3], |p| if p.z == 5.0 || p.z == 12.0 { 1.0 } else { 0.0 });
    let s = scene(&v, r#"{"mode": "maximum", "transfer": [[0, 1, 1, 1, 0], [1, 1, 1, 1, 1]]}"#);
    let found = answers(&v, &s, &ray(&v, [4.0, 4.0, -9.0], [4.0, 4.0, 20.0]));
    near(found.exact().depth_mm.unwrap(), 14.0, 1e-9);
    assert!(found.depth_error_mm(Some(21.0)) < 1e-9);
    assert!(found.depth_error_mm(Some(17.0)) > 2.9);
}

#[test]
fn a_ray_beside_the_volume_s_edge_may_miss_it() {
    let v = volume([4, 4, 4], [1.0; 3], |_| 0.75);
    let s = scene(&v, r#"{"mode": "x-ray", "window": [0, 1]}"#);
    let past = |x: f64| answers(&v, &s, &ray(&v, [x, 1.0, -99.0], [x, 1.0, 9.0]));
    for x in [3.5, 3.5 - 1e-6, 3.5 + 1e-6] {
        let found = past(x);
        near(found.spread(), 0.75, 1e-9);
        assert!(found.color_error([0.0; 4]) < 1e-9 && found.color_error([0.75; 4]) < 1e-9, "{x}");
        assert!(found.color_error([0.4; 4]) > 0.3, "{x}");
    }
    // Elsewhere there is only the uncertainty of the value, 2⁻²⁰ of ¾.
    assert!(past(3.4).spread() < 8e-7 && past(3.6).spread() == 0.0);
}

#[test]
fn a_value_on_a_vertical_edge_has_every_answer_between() {
    let v = volume([4, 4, 4], [1.0; 3], |_| 0.75);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0], [0.75, 1, 1, 1, 0], [0.75, 1, 1, 1, 0.5]]}"#);
    let found = answers(&v, &s, &ray(&v, [1.0, 1.0, -9.0], [1.0, 1.0, 9.0]));
    near(found.exact().rgba[3], 1.0 - 0.5f64.powi(4), 1e-10);
    assert!(found.color_error([0.0; 4]) < 1e-9 && found.color_error([0.3; 4]) < 1e-9);
    assert!(found.color_error([1.0; 4]) > 0.05);
}

#[test]
fn half_opacity_may_have_a_depth_or_none() {
    let v = volume([4, 4, 1], [1.0; 3], |_| 0.75);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0.5]]}"#);
    let found = answers(&v, &s, &ray(&v, [1.0, 1.0, -9.0], [1.0, 1.0, 9.0]));
    assert_eq!(found.depth_error_mm(None), 0.0);
    assert!(found.depth_error_mm(Some(9.5)) < 1e-4);
}

#[test]
fn a_picture_is_judged_pixel_by_pixel() {
    let v = ridges();
    let s = scene(&v, r#"{"mode": "threshold", "threshold": 1.000000001}"#);
    let camera =
        Camera { eye: [4.0, 4.0, -30.0], target: [4.0, 4.0, 5.0], up: [0.0, 1.0, 0.0], fov_y_deg: 5.0 };
    let setup = RaySetup::of_camera(v.grid(), &camera, 4, 4).unwrap();
    let reference = Reference::new(&v, &s).unwrap();
    let exact = reference.picture(&setup, 4, 4, &|_| ()).unwrap();
    let lower = Scene { threshold: 0.999_999_999, ..s.clone() };
    let mut pixels =
        Reference::new(&v, &lower).unwrap().picture(&setup, 4, 4, &|_| ()).unwrap().pixels().to_vec();
    pixels[6] = Pixel { depth_mm: Some(38.0), ..pixels[6] };
    let measured = reference::Picture::new(4, 4, pixels).unwrap();
    let tolerance = Tolerance { color: 1e-3, depth_mm: 0.1, depth_from_opacity: 0.5 };
    let uncertainty = Uncertainty::of_float32(&reference);
    let verdict = judge(&reference, &setup, &exact, &measured, &tolerance, &uncertainty).unwrap();
    assert_eq!(verdict.wrong, [(2, 1)]);
    assert_eq!(verdict.jumps.len(), 15);
    let itself = judge(&reference, &setup, &exact, &exact, &tolerance, &uncertainty).unwrap();
    assert_eq!((itself.jumps.len(), itself.wrong.len(), itself.color_error), (0, 0, 0.0));
}

#[test]
fn a_uniform_ray_is_in_no_doubt() {
    let v = volume([4, 4, 4], [1.0; 3], |p| p.x / 4.0);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0], [1, 1, 1, 1, 0.5]]}"#);
    let r = ray(&v, DVec3::new(-9.0, 1.0, 1.2), DVec3::new(9.0, 1.3, 1.0));
    let found = answers(&v, &s, &r);
    assert_eq!(found.exact(), pixel(&v, &s, &r));
    assert!(found.spread() < 1e-5, "{}", found.spread());
}
