//! Samples that are lit together, as `draft` has them: as good as each by itself where the gradient turns little.

use crate::setting::{Shown, eye, floats, fov, tell};
use crate::tolerances::BALANCED_DB;
use reference::compare;
use render::Quality;
use spatial::{DVec3, EyeView};

const SIZE: [u32; 2] = [48, 36];
const DIFFUSE: f64 = 0.8;
/// Voxels lit together, as at `draft`.
const SPAN: f64 = 4.0;

/// Thin fog of one colour around a point, whose value is the distance from that point: the gradient points away from it.
fn around(centre: DVec3) -> (Shown, EyeView) {
    let n = 40;
    let v = floats([n; 3], [1.0; 3], |p| (p - centre).length());
    let shown = Shown::new(
        v,
        r#"{"transfer": [[0, 1, 1, 1, 0.06], [500, 1, 1, 1, 0.06]],
            "light": {"ambient": 0.2, "diffuse": 0.8, "specular": 0, "power": 1}}"#,
    );
    (shown, eye(DVec3::new(100.0, 23.0, 21.0), DVec3::new(19.5, 20.0, 19.0), fov(26.0, SIZE)))
}

/// Samples lit together within so many voxels, however much they weigh.
fn with_span(light_span_voxels: f64) -> Quality {
    Quality { light_span_voxels, light_weight: 1.0, step_voxels: 1.0, ..Quality::BALANCED }
}

#[test]
fn a_span_of_a_step_or_less_lights_each_step_by_itself_to_the_bit() {
    let (shown, eye) = around(DVec3::new(19.0, -21.0, 20.0));
    let of = |span| shown.still(&[eye], SIZE, with_span(span), None);
    let each = of(0.0);
    for span in [0.5, 1.0] {
        assert!(of(span).rgba == each.rgba, "{span}");
    }
    assert!(of(SPAN).rgba != each.rgba, "a span of {SPAN} voxels lights none together");
}

#[test]
fn samples_lit_together_are_off_by_no_more_than_the_gradient_turns_on_their_way() {
    // At a distance of R from the point, the gradient turns by at most 1/R a voxel, and a cosine changes by no more than an
    // angle. A span's samples lie within SPAN voxels and are lit as one of their places: each is off by DIFFUSE · SPAN / R
    // at most, times its own opacity; opacities sum to no more than 1.
    let centre = DVec3::new(19.0, -21.0, 20.0);
    let nearest = 20.5;
    let (shown, eye) = around(centre);
    let [each, together] = [0.0, SPAN].map(|span| shown.drawn(eye, SIZE, with_span(span), None));
    let found = compare(&each, &together).unwrap();
    assert!(found.max_abs_error <= DIFFUSE * SPAN / nearest, "{found:?}");
    assert!(found.max_abs_error > 1e-5, "nothing was lit together: {found:?}");
    for i in 0..each.pixels().len() {
        let [a, b] = [&each, &together].map(|p| p.pixels()[i]);
        assert!(a.rgba[3] == b.rgba[3] && a.depth_mm == b.depth_mm, "light changes no matter: {a:?} {b:?}");
    }
}

#[test]
fn each_sample_by_itself_is_nearer_to_the_exact_picture_where_the_gradient_turns_round() {
    // The point lies in the fog: rays that pass near it see the gradient turn round within a span.
    let (shown, eye) = around(DVec3::new(19.3, 20.2, 19.1));
    let exact = shown.exact(eye, SIZE);
    let [each, together] = [0.0, SPAN]
        .map(|span| compare(&exact, &shown.drawn(eye, SIZE, with_span(span), None)).unwrap().psnr_db);
    assert!(each > together + 3.0, "{each} dB each by itself, {together} dB together");
}

#[test]
fn parts_of_a_step_have_light_of_their_own_where_they_weigh() {
    // A body whose rind takes all light within a part of a step, folded more finely than a step is long: what a ray sees is lit
    // as one place of the step, and the gradient there is not the one where the light was taken. Both pictures take the same
    // samples.
    let (n, spacing_mm) = (40, 1.6);
    let folds = |p: DVec3| {
        let fold = (1.9 * p.x).sin() * (1.71 * p.y).cos() + (1.8 * p.z + 0.4 * p.x).sin();
        300.0 - 60.0 * ((p - 19.5).length() - 13.0) + 250.0 * fold
    };
    let shown = Shown::new(
        floats([n; 3], [spacing_mm; 3], folds),
        r#"{"transfer": [[200, 0.9, 0.6, 0.4, 0], [400, 1, 0.95, 0.85, 0.4], [900, 1, 1, 1, 0.95]], "shade": true}"#,
    );
    let at = DVec3::new(90.0, 60.0, 52.0) * spacing_mm;
    let eye = eye(at, DVec3::splat(19.5 * spacing_mm), fov(28.0, SIZE));
    let exact = shown.exact(eye, SIZE);
    let db = |quality| compare(&exact, &shown.drawn(eye, SIZE, quality, None)).unwrap().psnr_db;
    let balanced = db(Quality::BALANCED);
    let in_groups = db(Quality { light_span_voxels: 0.0, light_weight: 1.0, ..Quality::BALANCED });
    tell(&format!("folds: {balanced:.1} dB, a step lit together {in_groups:.1} dB"));
    assert!(balanced >= BALANCED_DB, "{balanced} dB");
    assert!(in_groups < BALANCED_DB, "the scene does not tell them apart: {in_groups} dB");
}
