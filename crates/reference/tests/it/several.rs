//! Several volumes in one scene: extinctions add, and so does the light; each on its own grid.

use crate::common::{Noise, near, noisy, oblique, volume, volume_on};
use reference::{Field, Pixel, Ray, Reference, ReferenceError};
use scene::{FurtherFacts, Scene, SceneFile, VolumeFacts, VolumeSource};
use spatial::{DAffine3, DMat3, DVec3};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// A scene whose further volumes are files named `1`, `2`, ….
fn scene(volumes: &[&Volume], json: &str) -> Scene {
    let others: Vec<_> = (1..volumes.len())
        .map(|i| FurtherFacts {
            source: VolumeSource { path: i.to_string().into(), series: None, kind: None },
            facts: VolumeFacts::of(volumes[i]),
        })
        .collect();
    SceneFile::from_json(json)
        .expect("a scene")
        .resolve_among(&VolumeFacts::of(volumes[0]), &others)
        .expect("a scene")
}

fn pixel(volumes: &[&Volume], scene: &Scene, ray: &Ray) -> Pixel {
    Reference::of_several(volumes, scene).expect("a picture").pixel(ray)
}

/// The ray from one point of the patient towards another, as a volume has it.
fn ray_mm(of: &Volume, from: DVec3, towards: DVec3) -> Ray {
    let index_from_mm = of.grid().volume_from_index().inverse();
    let direction = (towards - from).normalize();
    Ray { origin: index_from_mm.transform_point3(from), direction: index_from_mm.matrix3 * direction }
}

fn assert_same(a: &Pixel, b: &Pixel, tolerance: f64) {
    for (a, b) in a.rgba.iter().zip(b.rgba) {
        near(*a, b, tolerance);
    }
    match (a.depth_mm, b.depth_mm) {
        (Some(a), Some(b)) => near(a, b, 1e-6),
        (a, b) => assert_eq!(a, b),
    }
}

const HOT: &str = "[[0.2, 1, 0.4, 0, 0], [0.6, 1, 0.9, 0.2, 0.3], [0.9, 1, 1, 1, 0.1]]";
const GREY: &str = "[[0.1, 0, 0, 0.2, 0.02], [0.5, 0.5, 0.5, 0.5, 0.2], [0.5, 0.9, 0.8, 0.7, 0.05]]";

/// Three grids that meet in the patient, none like another.
fn three() -> [Volume; 3] {
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.3, 0.7, 2.1));
    let grid =
        Grid::new([9, 14, 6], DAffine3::from_mat3_translation(mirrored, DVec3::new(14.0, -22.0, 28.0)));
    [
        noisy(oblique([10, 9, 8], [1.1, 0.9, 1.4]), 5),
        noisy(grid.expect("a grid"), 6),
        noisy(oblique([4, 5, 6], [2.5, 3.0, 2.0]), 7),
    ]
}

/// Random rays through the middle of the first volume.
fn rays(of: &Volume, count: usize, seed: u64) -> Vec<Ray> {
    let mut noise = Noise(seed);
    let centre = of.grid().centre_in_volume();
    (0..count)
        .map(|_| ray_mm(of, centre + noise.point(-40.0, 40.0), centre + noise.point(-2.0, 2.0)))
        .collect()
}

#[test]
fn the_sum_over_small_steps_comes_to_the_same() {
    let volumes = three();
    let [a, b, c] = &volumes;
    let json = format!(
        r#"{{"transfer": {GREY}, "shade": true, "further_volumes": [
            {{"volume": "1", "transfer": {HOT}}}, {{"volume": "2", "transfer": {HOT}, "opacity": 0.5, "shade": true}}]}}"#
    );
    let all = [a, b, c];
    let scene = scene(&all, &json);
    for ray in rays(a, 4, 1) {
        let found = pixel(&all, &scene, &ray);
        assert!(found.rgba[3] > 0.1, "the ray meets them: {found:?}");
        let summed = in_steps(&all, &scene, &ray);
        for (found, summed) in found.rgba.iter().zip(summed) {
            near(*found, summed, 2e-5);
        }
    }
}

/// The definition, by the midpoint rule on steps of a 2000th of a millimetre. At a border or an edge of a transfer function
/// it is off by at most half a step of 0.3 a millimetre, 8e-5, and as often up as down.
fn in_steps(volumes: &[&Volume], scene: &Scene, ray: &Ray) -> [f64; 4] {
    let mm_from_index = volumes[0].grid().volume_from_index();
    let (origin, along) = (mm_from_index.transform_point3(ray.origin), mm_from_index.matrix3 * ray.direction);
    let transfers: Vec<_> = [(0, &scene.transfer, scene.light)]
        .into_iter()
        .chain(scene.further.iter().map(|f| (f.volume, &f.transfer, f.light)))
        .collect();
    let step = 1.0 / 2000.0;
    let (mut color, mut depth) = ([0.0; 3], 0.0f64);
    for i in 0..240_000 {
        let at_mm = origin + along * (f64::from(i) + 0.5) * step;
        let (mut extinction, mut emitted) = (0.0, [0.0; 3]);
        for &(number, transfer, light) in &transfers {
            let volume = volumes[number];
            let at = volume.grid().volume_from_index().inverse().transform_point3(at_mm);
            let dims = DVec3::from_array(volume.grid().dims().map(f64::from));
            if (at + 0.5).min_element() < 0.0 || (dims - 0.5 - at).min_element() < 0.0 {
                continue;
            }
            let field = Field::new(&volume.channels()[0], volume.grid());
            let optical = transfer.at(field.value(at));
            let gradient = field.gradient_per_mm(at);
            let cosine = gradient.dot(along).abs() / gradient.length();
            let lit = light.map_or(optical.color, |light| light.lit(optical.color, cosine));
            extinction += optical.extinction_per_mm();
            for (sum, c) in emitted.iter_mut().zip(lit) {
                *sum += c * optical.extinction_per_mm();
            }
        }
        if extinction > 0.0 {
            let seen = (-depth).exp() * -(-extinction * step).exp_m1() / extinction;
            for (sum, e) in color.iter_mut().zip(emitted) {
                *sum += e * seen;
            }
            depth += extinction * step;
        }
    }
    [color[0], color[1], color[2], 1.0 - (-depth).exp()]
}

#[test]
fn the_order_of_volumes_does_not_matter() {
    let [a, b, c] = &three();
    let entry = |file: &str, transfer: &str| format!(r#"{{"volume": "{file}", "transfer": {transfer}}}"#);
    let of = |volumes: &[&Volume], first: &str, second: &str, third: &str| {
        let further = [entry("1", second), entry("2", third)].join(", ");
        scene(volumes, &format!(r#"{{"transfer": {first}, "further_volumes": [{further}]}}"#))
    };
    let (abc, cab) = ([a, b, c], [c, a, b]);
    let (scene_abc, scene_cab) = (of(&abc, GREY, HOT, GREY), of(&cab, GREY, GREY, HOT));
    let from_a = c.grid().volume_from_index().inverse() * a.grid().volume_from_index();
    for ray in rays(a, 40, 2) {
        let as_c_has_it =
            Ray { origin: from_a.transform_point3(ray.origin), direction: from_a.matrix3 * ray.direction };
        assert_same(&pixel(&abc, &scene_abc, &ray), &pixel(&cab, &scene_cab, &as_c_has_it), 1e-9);
    }
}

#[test]
fn a_volume_twice_has_twice_the_extinction() {
    let v = noisy(oblique([7, 6, 5], [1.0, 1.5, 2.0]), 3);
    let of = |opacity: f64| format!("[[0.2, 1, 0, 0, {opacity}], [0.8, 0, 1, 0.5, {opacity}]]");
    let once = scene(&[&v], &format!(r#"{{"transfer": {}}}"#, of(1.0 - 0.9 * 0.9)));
    let json = format!(r#"{{"transfer": {0}, "further_volumes": [{{"transfer": {0}}}]}}"#, of(0.1));
    let twice = scene(&[&v], &json);
    for ray in rays(&v, 40, 3) {
        assert_same(&pixel(&[&v], &twice, &ray), &pixel(&[&v], &once, &ray), 1e-9);
    }
}

#[test]
fn volumes_beside_each_other_hide_each_other() {
    let slab = |from_mm: f64| {
        let grid =
            Grid::new([8, 8, 10], DAffine3::from_translation(DVec3::new(0.0, 0.0, from_mm + 0.5))).unwrap();
        volume_on(grid, |_| 1.0)
    };
    let (near_slab, far_slab) = (slab(0.0), slab(25.0));
    let json = r#"{"transfer": [[0, 1, 0, 0, 0.05]],
        "further_volumes": [{"volume": "1", "transfer": [[0, 0, 1, 0, 0.2]]}]}"#;
    let volumes = [&near_slab, &far_slab];
    let scene = scene(&volumes, json);
    let (through_near, through_far) = (0.95f64.powi(10), 0.8f64.powi(10));
    let begin = DVec3::new(3.0, 3.0, -5.0);
    let front = pixel(&volumes, &scene, &ray_mm(&near_slab, begin, DVec3::new(3.0, 3.0, 50.0)));
    near(front.rgba[0], 1.0 - through_near, 1e-9);
    near(front.rgba[1], through_near * (1.0 - through_far), 1e-9);
    near(front.rgba[3], 1.0 - through_near * through_far, 1e-9);
    // Half of the light goes in the far one, 30 mm and a little from the eye.
    near(front.depth_mm.unwrap(), 30.0 + (0.5 / through_near).ln() / 0.8f64.ln(), 1e-9);
    // Beside the first volume there is only the second.
    let beside = DVec3::new(3.0, 20.0, 30.0);
    let only = pixel(&volumes, &scene, &ray_mm(&near_slab, beside, DVec3::new(3.0, 3.0, 30.0)));
    near(only.rgba[0], 0.0, 0.0);
    near(only.rgba[3], 1.0 - 0.8f64.powi(8), 1e-9);
}

/// Labels along z, in voxels of 2 mm from the plane z = 0 on.
fn labels_along_z(labels: &[u8]) -> Volume {
    let grid = Grid::new(
        [8, 8, labels.len() as u32],
        DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(1.0, 1.0, 2.0)),
            DVec3::new(0.0, 0.0, 1.0),
        ),
    );
    let voxels = Voxels::U8(labels.iter().flat_map(|&label| [label; 64]).collect());
    let name = "labels".into();
    let channel = Channel { name, kind: ChannelKind::Label, voxels, slope: 1.0, intercept: 0.0 };
    Volume::new(grid.expect("a grid"), vec![channel]).expect("a volume")
}

#[test]
fn labels_in_a_fog_are_neither_blended_nor_lost() {
    let fog = {
        let grid = Grid::new([8, 8, 10], DAffine3::from_translation(DVec3::new(0.0, 0.0, 0.5))).unwrap();
        volume_on(grid, |_| 1.0)
    };
    let seg = labels_along_z(&[0, 1, 1, 3, 0, 1]);
    let red = r#""transfer": [[0, 1, 0, 0, 0.05]]"#;
    let looks = r#""labels": {"tint": {"1": [0, 1, 0], "3": [0, 0, 1]}, "opacity": {"1": 0.1, "3": 0.5}}"#;
    let extinction = |opacity: f64| -(1.0 - opacity).ln();
    let (r, g, b) = (extinction(0.05), extinction(0.1), extinction(0.5));
    // Lengths, and what is there: the fog ends at 10 mm, the last label begins there.
    let stretches = [
        (2.0, [r, 0.0, 0.0]),
        (4.0, [r, g, 0.0]),
        (2.0, [r, 0.0, b]),
        (2.0, [r, 0.0, 0.0]),
        (2.0, [0.0, g, 0.0]),
    ];
    let (mut expected, mut light) = ([0.0; 3], 1.0);
    for (length, all) in stretches {
        let sum: f64 = all.iter().sum();
        for (color, one) in expected.iter_mut().zip(all) {
            *color += light * (1.0 - (-sum * length).exp()) * one / sum;
        }
        light *= (-sum * length).exp();
    }
    let through = |of: &Volume| ray_mm(of, DVec3::new(3.0, 3.0, -5.0), DVec3::new(3.0, 3.0, 50.0));
    let fog_first = format!(r#"{{{red}, "further_volumes": [{{"volume": "1", {looks}}}]}}"#);
    let labels_first = format!(r#"{{{looks}, "further_volumes": [{{"volume": "1", {red}}}]}}"#);
    for (volumes, json) in [([&fog, &seg], fog_first), ([&seg, &fog], labels_first)] {
        let seen = pixel(&volumes, &scene(&volumes, &json), &through(volumes[0]));
        for (found, expected) in seen.rgba.iter().zip(expected.into_iter().chain([1.0 - light])) {
            near(*found, expected, 1e-9);
        }
    }
}

#[test]
fn labels_are_not_shown_as_values_nor_values_as_labels() {
    let (values, seg) = (volume([8, 8, 6], [1.0; 3], |_| 1.0), labels_along_z(&[0, 1]));
    let of_labels = scene(&[&values, &seg], r#"{"further_volumes": [{"volume": "1"}]}"#);
    let wrong = Reference::of_several(&[&values, &values], &of_labels).unwrap_err();
    assert!(matches!(wrong, ReferenceError::Kind { .. }), "{wrong:?}");
}

#[test]
fn one_plane_on_several_grids_is_one_plane() {
    // A field that is linear in the patient is the same on every grid: so is the picture, whichever grid has it.
    let plane = |grid: Grid| {
        let to_mm = grid.volume_from_index();
        volume_on(grid, |at| {
            (to_mm.transform_point3(at) - DVec3::new(4.0, 5.0, 6.0)).dot(DVec3::new(0.03, -0.05, 0.02))
        })
    };
    let about = |axes: DMat3, dims: [u32; 3]| {
        let middle = (DVec3::from_array(dims.map(f64::from)) - 1.0) / 2.0;
        Grid::new(dims, DAffine3::from_mat3_translation(axes, DVec3::new(4.0, 5.0, 6.0) - axes * middle))
            .unwrap()
    };
    let first = plane(about(DMat3::IDENTITY, [41, 41, 41]));
    let oblique_axes = oblique([2; 3], [2.0, 1.3, 0.6]).volume_from_index().matrix3;
    let left_handed = DMat3::from_cols(DVec3::NEG_Z * 3.0, DVec3::Y * 0.9, DVec3::NEG_X * 1.7);
    assert!(left_handed.determinant() * oblique_axes.determinant() < 0.0);
    let others = [plane(about(oblique_axes, [41, 61, 121])), plane(about(left_handed, [31, 81, 51]))];
    // A band of 4 mm, which lies within all three near their middle.
    let band = "[[-0.12, 1, 0, 0, 0], [0, 1, 0.5, 0, 0.4], [0.12, 0, 1, 0, 0]]";
    let alone = scene(&[&first], &format!(r#"{{"transfer": {band}}}"#));
    let centre = DVec3::new(4.0, 5.0, 6.0);
    let mut noise = Noise(11);
    for other in &others {
        let volumes = [&first, other];
        let json =
            format!(r#"{{"shown": false, "further_volumes": [{{"volume": "1", "transfer": {band}}}]}}"#);
        let as_other = scene(&volumes, &json);
        let moved = json.replace(
            r#""volume": "1""#,
            r#""volume": "1", "registration": [[1, 0, 0, 2.5], [0, 1, 0, 0], [0, 0, 1, 0]]"#,
        );
        let off = scene(&volumes, &moved);
        for _ in 0..20 {
            // Nearly across the band, so that it is not left through a border.
            let eye = centre + DVec3::new(0.3, -0.5, 0.2) * 20.0 + noise.point(-4.0, 4.0);
            let ray = ray_mm(&first, eye, centre + noise.point(-0.5, 0.5));
            let expected = pixel(&[&first], &alone, &ray);
            // Samples are float32: 2⁻²⁴ of values up to 2 beside a band of 0.24.
            assert_same_plane(&pixel(&volumes, &as_other, &ray), &expected);
            let shifted = Ray { origin: ray.origin + DVec3::new(2.5, 0.0, 0.0), ..ray };
            assert_same_plane(&pixel(&volumes, &off, &shifted), &expected);
        }
    }
}

#[track_caller]
fn assert_same_plane(found: &Pixel, expected: &Pixel) {
    for (a, b) in found.rgba.iter().zip(expected.rgba) {
        near(*a, b, 2e-5);
    }
    if let (Some(a), Some(b)) = (found.depth_mm, expected.depth_mm) {
        near(a, b, 1e-3);
    }
}

#[test]
fn a_hidden_volume_changes_nothing() {
    let [a, b, _] = &three();
    let json = |further: &str| format!(r#"{{"transfer": {GREY}{further}}}"#);
    let alone = scene(&[a], &json(""));
    let hidden = scene(&[a, b], &json(r#", "further_volumes": [{"volume": "1", "shown": false}]"#));
    let transparent = scene(&[a, b], &json(r#", "further_volumes": [{"volume": "1", "opacity": 0}]"#));
    for ray in rays(a, 20, 4) {
        let expected = pixel(&[a], &alone, &ray);
        assert_eq!(pixel(&[a, b], &hidden, &ray), expected);
        assert_same(&pixel(&[a, b], &transparent, &ray), &expected, 1e-9);
    }
}

#[test]
fn what_is_not_there_is_an_error_with_numbers() {
    let v = volume([2, 2, 2], [1.0; 3], |_| 0.0);
    let other = volume([3, 3, 3], [1.0; 3], |_| 0.0);
    let scene = scene(&[&v, &other], r#"{"further_volumes": [{"volume": "1"}]}"#);
    assert_eq!(Reference::new(&v, &scene).unwrap_err(), ReferenceError::NoSuchVolume { wanted: 1, found: 1 });
    assert!(matches!(
        Reference::of_several(&[], &scene),
        Err(ReferenceError::NoSuchVolume { wanted: 0, .. })
    ));
    let stretched =
        r#"{"further_volumes": [{"registration": [[900000, 0, 0, 0], [0, 0.01, 0, 0], [0, 0, 1, 0]]}]}"#;
    let stretched = self::scene(&[&v], stretched);
    assert!(matches!(Reference::new(&v, &stretched), Err(ReferenceError::Grid(_))));
}
