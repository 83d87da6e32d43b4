//! Labels against closed forms: none is ever blended into another.

use crate::common::{Noise, oblique, pixel, ray, scene};
use spatial::DVec3;
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// A row of voxels of 2 mm.
fn row(labels: &[i16]) -> Volume {
    let grid = Grid::axis_aligned([labels.len() as u32, 1, 1], DVec3::splat(2.0)).expect("a grid");
    let voxels = Voxels::I16(labels.to_vec().into());
    let channel =
        Channel { name: "labels".into(), kind: ChannelKind::Label, voxels, slope: 1.0, intercept: 0.0 };
    Volume::new(grid, vec![channel]).expect("a volume")
}

const TABLE: &str = r#"[{"number": 1, "color": [1, 0, 0], "opacity": 0.1},
    {"number": 2, "color": [0, 1, 0], "opacity": 0.9}, {"number": 3, "color": [0, 0, 1], "opacity": 0.2}]"#;

#[test]
fn between_labels_1_and_3_there_is_no_2() {
    let volume = row(&[0, 1, 3, 3, 0]);
    let scene = scene(&volume, &format!(r#"{{"labels": {{"table": {TABLE}}}}}"#));
    let seen = pixel(&volume, &scene, &ray(&volume, [-5.0, 0.0, 0.0], [0.0, 0.0, 0.0]));
    // 2 mm of label 1, then 4 mm of label 3.
    let red = 1.0 - 0.9f64.powi(2);
    let blue = 0.9f64.powi(2) * (1.0 - 0.8f64.powi(4));
    for (found, expected) in seen.rgba.into_iter().zip([red, 0.0, blue, red + blue]) {
        assert!((found - expected).abs() < 1e-14, "{:?}", seen.rgba);
    }
    // Half is gone in label 3, whose first face lies 11 + 2 mm behind the eye.
    let depth_mm = 13.0 + (0.5 / 0.81f64).ln() / 0.8f64.ln();
    assert!((seen.depth_mm.expect("a depth") - depth_mm).abs() < 1e-12, "{:?}", seen.depth_mm);
}

#[test]
fn a_hidden_label_is_as_if_it_were_air() {
    let volume = row(&[2, 1, 2, 2, 3]);
    let scene = scene(&volume, &format!(r#"{{"labels": {{"table": {TABLE}, "hide": [2]}}}}"#));
    let seen = pixel(&volume, &scene, &ray(&volume, [20.0, 0.0, 0.0], [0.0, 0.0, 0.0]));
    let blue = 1.0 - 0.8f64.powi(2);
    let red = (1.0 - blue) * (1.0 - 0.9f64.powi(2));
    for (found, expected) in seen.rgba.into_iter().zip([red, 0.0, blue, red + blue]) {
        assert!((found - expected).abs() < 1e-14, "{:?}", seen.rgba);
    }
}

#[test]
fn a_run_is_lit_as_where_the_ray_enters_it_whatever_the_number() {
    for number in [1, 700] {
        let volume = row(&[0, number, number, 0, number]);
        let table = format!(r#"[{{"number": {number}, "color": [0.5, 0.5, 0.5], "opacity": 0.1}}]"#);
        let scene = scene(
            &volume,
            &format!(
                r#"{{"labels": {{"table": {table}}},
                "light": {{"ambient": 0.25, "diffuse": 0.5, "specular": 0.125, "power": 2}}}}"#
            ),
        );
        let seen = pixel(&volume, &scene, &ray(&volume, [-5.0, 0.0, 0.0], [0.0, 0.0, 0.0]));
        // At each entry the label's share rises along the ray: the cosine is 1.
        let lit = 0.5 * 0.75 + 0.125;
        let expected = lit * (1.0 - 0.9f64.powi(6));
        assert!((seen.rgba[0] - expected).abs() < 1e-14, "{number}: {:?}", seen.rgba);
        // From inside, where the label's share does not change, only the ambient part is left.
        let inside = pixel(&volume, &scene, &ray(&volume, [1.5, 0.0, 0.0], [1.5, 1.0, 0.0]));
        let ambient = 0.5 * 0.25 * (1.0 - 0.9f64);
        assert!((inside.rgba[0] - ambient).abs() < 1e-14, "{number}: {:?}", inside.rgba);
    }
}

#[test]
fn a_scene_for_measured_values_is_refused_for_labels() {
    let volume = row(&[0, 1]);
    let other = Channel { kind: ChannelKind::Intensity, ..volume.channels()[0].clone() };
    let measured = Volume::new(volume.grid().clone(), vec![other]).expect("a volume");
    let scene = scene(&measured, "{}");
    let message = reference::Reference::new(&volume, &scene).expect_err("another kind").to_string();
    assert!(message.contains("channel 'labels'"), "{message}");
}

#[test]
fn where_a_label_is_all_around_there_is_no_highlight() {
    let grid = oblique([6, 5, 7], [1.3, 0.7, 1.9]);
    let voxels = Voxels::U8(vec![1; 6 * 5 * 7].into());
    let name = "labels".into();
    let channel = Channel { name, kind: ChannelKind::Label, voxels, slope: 1.0, intercept: 0.0 };
    let volume = Volume::new(grid, vec![channel]).expect("a volume");
    let json = r#"{"labels": {"tint": {"1": [0.5, 0.5, 0.5]}, "opacity": {"1": 0.2}},
        "light": {"ambient": 0.25, "diffuse": 0.5, "specular": 0.5, "power": 2}}"#;
    let scene = scene(&volume, json);
    let mut noise = Noise(3);
    for _ in 0..50 {
        let (from, to) = (noise.point(-9.0, -6.0), noise.point(1.0, 3.0));
        let seen = pixel(&volume, &scene, &ray(&volume, from.to_array(), to.to_array()));
        assert!(seen.rgba[3] > 0.1, "{seen:?}");
        assert!((seen.rgba[0] - 0.125 * seen.rgba[3]).abs() < 1e-12, "only ambient light: {seen:?}");
    }
}
