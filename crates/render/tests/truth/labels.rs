//! Labels: none is blended into another, at no level.

use crate::setting::{
    Noise, Shown, each, eye, f32s, finite, fov, i16s, labels_on, oblique, straight, true_picture, u8s, u16s,
};
use crate::tolerances::{self, MOST_JUMPS};
use reference::{Uncertainty, compare, judge};
use render::{
    DepthGridSize, Placed, Quality, RenderError, Sampling, SceneOnDevice, StereoPlan, StereoRequest,
};
use spatial::{DVec3, EyeView};
use std::sync::Arc;
use volume::{Channel, ChannelKind, Grid, Volume};

const SIZE: [u32; 2] = [64, 36];
const DIMS: [u32; 3] = [37, 30, 33];

/// Shells and a bar, as organs in each other.
fn organs(numbers: [f64; 4]) -> Vec<f64> {
    each(DIMS, |p| {
        let q = (p - DVec3::new(18.0, 14.5, 16.0)) / DVec3::new(16.0, 13.0, 14.0);
        let bar = (p.x - 20.0).abs() < 2.5 && (p.z - 12.0).abs() < 2.0;
        match q.length() {
            r if r > 1.0 => 0.0,
            _ if bar => numbers[3],
            r if r > 0.8 => numbers[0],
            r if r > 0.45 => numbers[1],
            _ => numbers[2],
        }
    })
}

fn outside(grid: &Grid) -> EyeView {
    let size_mm = grid.size_mm();
    eye(size_mm * DVec3::new(-0.8, 1.5, 0.9), size_mm * 0.5, fov(40.0, SIZE))
}

fn looks(numbers: [f64; 4], shade: bool) -> String {
    let [a, b, c, d] = numbers;
    format!(
        r#"{{"labels": {{"opacity": {{"{a}": 0.04, "{b}": 0.3, "{c}": 1, "{d}": 0.7}}}}, "shade": {shade}}}"#
    )
}

#[test]
fn every_level_is_the_reference() {
    let far = [3.0, 7.0, 5000.0, 20_000.0];
    let near = [1.0, 2.0, 3.0, 4.0];
    let signed = [-5.0, 1.0, 300.0, 301.0];
    for (name, grid, voxels, numbers) in [
        ("u8", straight(DIMS, [1.0; 3]), u8s(&organs(near)), near),
        ("i16, uneven", straight(DIMS, [0.7, 1.0, 1.6]), i16s(&organs(signed)), signed),
        ("u16, oblique", oblique(DIMS, [1.0, 1.2, 0.9]), u16s(&organs(far)), far),
        ("f32", straight(DIMS, [1.0; 3]), f32s(&organs(far)), far),
    ] {
        let volume = Arc::new(labels_on(grid, voxels));
        for shade in [false, true] {
            let file = scene::SceneFile::from_json(&looks(numbers, shade)).unwrap();
            let scene = file.resolve(&scene::VolumeFacts::of(&volume)).unwrap();
            let shown = Shown::of_scene(volume.clone(), scene);
            let eye = outside(volume.grid());
            let name = format!("labels {name}, shade {shade}");
            true_picture(&name, &shown, eye, SIZE);
            // A step, a table and a filter have no part in it: other levels lose what the end of a ray may cost.
            let exact = shown.exact(eye, SIZE);
            let reference = shown.reference();
            let voxel_mm = volume.grid().spacing_mm().min_element();
            for quality in [Quality::DRAFT, Quality::BALANCED, Quality::FINE] {
                let drawn = shown.drawn(eye, SIZE, quality, None);
                finite(&name, &drawn);
                let mut tolerance = tolerances::exact(voxel_mm);
                tolerance.color += quality.least_transmittance;
                let uncertainty = Uncertainty::of_float32(&reference);
                let verdict =
                    judge(&reference, &shown.rays(eye), &exact, &drawn, &tolerance, &uncertainty).unwrap();
                let most = (MOST_JUMPS * verdict.pixels as f64).ceil() as usize;
                assert!(verdict.wrong.is_empty() && verdict.jumps.len() <= most, "{name}: {verdict:?}");
            }
        }
    }
}

#[test]
fn labels_of_noise_are_the_reference_too() {
    let mut noise = Noise(5);
    let numbers = each([9; 3], |_| (noise.next() * 5.0).floor());
    let shown = Shown::new(
        labels_on(straight([9; 3], [1.0; 3]), u8s(&numbers)),
        r#"{"labels": {"opacity": {"1": 0.02, "2": 0.1, "3": 0.4, "4": 0.05}, "hide": [3]}}"#,
    );
    true_picture("labels of noise", &shown, outside(shown.volume.grid()), SIZE);
}

#[test]
fn a_picture_of_opaque_labels_has_no_colour_but_theirs() {
    let numbers = [1.0, 2.0, 3.0, 4.0];
    let shown = Shown::new(
        labels_on(straight(DIMS, [1.0; 3]), u8s(&organs(numbers))),
        r#"{"labels": {"hide": [1], "tint": {"2": [1, 0, 0], "3": [0, 1, 0], "4": [0, 0, 1]}}}"#,
    );
    for quality in [Quality::DRAFT, Quality::BALANCED, Quality::EXACT] {
        let drawn = shown.drawn(outside(shown.volume.grid()), SIZE, quality, None);
        let mut seen = 0;
        for (i, p) in drawn.pixels().iter().enumerate() {
            let [r, g, b, a] = p.rgba;
            seen += usize::from(a > 0.99);
            let pure = r.max(g).max(b);
            // A sliver of less than a voxel at the rim lets through what is behind it, never another colour.
            let others = (r + g + b - pure) / a.max(1e-9);
            let thin = 1.0 - pure / a.max(1e-9);
            assert!(a == 0.0 || others <= thin + 1e-6, "pixel {i}: {:?}", p.rgba);
        }
        assert!(seen > 300, "{seen} pixels");
    }
}

#[test]
fn empty_cells_are_skipped_without_a_trace() {
    let numbers = [1.0, 2.0, 3.0, 4.0];
    let volume = labels_on(oblique(DIMS, [1.0, 1.2, 0.9]), u8s(&organs(numbers)));
    let size_mm = volume.grid().size_mm();
    let eyes = [
        outside(volume.grid()),
        eye(size_mm * DVec3::new(0.45, 0.4, 0.3), size_mm * DVec3::new(0.9, 0.8, 0.5), fov(80.0, SIZE)),
    ];
    let shown = Shown::new(volume, r#"{"labels": {"only": [3, 4], "opacity": {"3": 0.2}}, "shade": true}"#);
    for quality in [Quality::DRAFT, Quality::EXACT] {
        let of = |skip_empty| shown.still(&eyes, SIZE, Quality { skip_empty, ..quality }, None);
        let (with, without) = (of(true), of(false));
        assert!(with.rgba.iter().filter(|p| p[3] > 0.5).count() > 100, "something is seen");
        let bits = |p: &[[f32; 4]]| p.iter().map(|p| p.map(f32::to_bits)).collect::<Vec<_>>();
        assert!(bits(&with.rgba) == bits(&without.rgba));
        assert_eq!(with.depth_mm, without.depth_mm);
    }
}

#[test]
fn a_step_and_a_filter_have_no_meaning_for_labels() {
    let numbers = [1.0, 2.0, 3.0, 4.0];
    let shown = Shown::new(
        labels_on(straight(DIMS, [1.0; 3]), u8s(&organs(numbers))),
        r#"{"labels": {"opacity": {"1": 0.1}}}"#,
    );
    let eyes = [outside(shown.volume.grid())];
    let request = |quality, step_mm| StereoRequest {
        eyes: &eyes,
        placed: Placed::own_axes(shown.volume.grid()),
        eye_size_px: SIZE,
        quality,
        step_mm,
        depth_grid: DepthGridSize::default(),
    };
    // More samples than a device could take.
    let short = request(Quality::BALANCED, Some(1e-6));
    StereoPlan::new(&short, shown.volume.grid(), shown.on_device.numbers()).unwrap();
    let drawn = |quality| shown.drawn(eyes[0], SIZE, quality, None);
    let float32 = Quality { sampling: Sampling::Float32, step_voxels: 0.3, ..Quality::BALANCED };
    let apart = compare(&drawn(Quality::BALANCED), &drawn(float32)).unwrap();
    assert_eq!(apart.max_abs_error, 0.0);
}

#[test]
fn a_scene_of_measured_values_is_refused_for_labels() {
    let volume = labels_on(straight(DIMS, [1.0; 3]), u8s(&organs([1.0, 2.0, 3.0, 4.0])));
    let other = Channel { kind: ChannelKind::Intensity, ..volume.channels()[0].clone() };
    let measured = Volume::new(volume.grid().clone(), vec![other]).unwrap();
    let scene = scene::SceneFile::default().resolve(&scene::VolumeFacts::of(&measured)).unwrap();
    let uploaded = Arc::new(render::VolumeOnDevice::upload(crate::setting::gpu(), &volume, |_| {}).unwrap());
    let refused = SceneOnDevice::new(crate::setting::gpu(), &uploaded, &scene);
    assert!(matches!(refused, Err(RenderError::Kind { labels: true, .. })));
}

#[test]
fn where_a_label_is_all_around_there_is_no_highlight() {
    // Seen at the border of its volume, its share is 1 on all sides: what float32 makes of the difference has a direction
    // too, and no meaning.
    let values = each(DIMS, |_| 1.0);
    let json = r#"{"labels": {"tint": {"1": [0.5, 0.5, 0.5]}, "opacity": {"1": 0.3}},
        "light": {"ambient": 0.25, "diffuse": 0.5, "specular": 0.5, "power": 2}}"#;
    let grid = oblique(DIMS, [1.0, 1.2, 0.9]);
    let eye = outside(&grid);
    let shown = Shown::new(labels_on(grid, u8s(&values)), json);
    let drawn = true_picture("labels all around", &shown, eye, SIZE);
    assert!(drawn.pixels().iter().filter(|p| p.rgba[3] > 0.5).count() > 300, "it is seen");
    for pixel in drawn.pixels() {
        let ambient = 0.125 * pixel.rgba[3];
        assert!((pixel.rgba[0] - ambient).abs() < tolerances::CLOSED_FORM, "only ambient light: {pixel:?}");
    }
}
