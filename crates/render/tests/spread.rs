//! Pixels between rays: what is interpolated, what has a ray of its own, and how many rays that takes.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{
    DepthGridSize, FrameRenderer, Gpu, Placed, Quality, SceneOnDevice, StereoPlan, StereoRequest, Still,
    StillRenderer, VolumeOnDevice,
};
use scene::{SceneFile, VolumeFacts};
use spatial::{DVec3, EyeView, Fov, HeadGeometry, Pose};
use std::sync::{Arc, OnceLock};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// Odd, so that a row and a column have no neighbour behind them.
const SIZE: [u32; 2] = [67, 45];
const SIDE: u32 = 48;
const BELOW: f64 = 0.05;

fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

struct Shown {
    scene: SceneOnDevice,
    eyes: [EyeView; 2],
}

impl Shown {
    /// A ball with a smooth and a checked half, in front of a wall of its colour, seen by two eyes.
    fn new(json: &str) -> Self {
        let value = |p: [f64; 3]| {
            let [x, y, z] = p.map(|i| i - f64::from(SIDE) / 2.0);
            let checked = x > 0.0 && (x as i32 + y as i32) % 2 == 0;
            let ball = (20.0 - (x * x + y * y + (z + 10.0).powi(2)).sqrt()).clamp(0.0, 4.0) * 40.0;
            let wall = if z > 15.0 && y < 12.0 { 160.0 } else { 0.0 };
            (ball + wall + if checked && ball > 0.0 { 60.0 } else { 0.0 }).min(255.0) as u8
        };
        Self::of(json, value, DVec3::new(8.0, 5.0, 110.0), Fov::symmetric(0.6, 0.45).unwrap())
    }

    /// A closed room with blocks in it, seen from its middle: every ray meets a surface.
    fn room(fov: Fov) -> Self {
        let value = |p: [f64; 3]| {
            let q = p.map(|i| (i - f64::from(SIDE) / 2.0).abs());
            let is_near = q.iter().all(|&i| i < 8.0);
            let is_wall = q.iter().any(|&i| i > 20.0);
            let block = p.map(|i| i as u32 / 5);
            let is_block = (block[0] * 7 + block[1] * 13 + block[2] * 29) % 5 == 0;
            if is_wall || is_block && !is_near { 240 } else { 0 }
        };
        let json = r#"{"mode": "threshold", "threshold": 120, "surface_color": [0, 0, 0]}"#;
        Self::of(json, value, DVec3::new(0.5, 0.3, 1.0), fov)
    }

    /// Voxels of these values at their indices, seen from `off` millimetres before their middle.
    fn of(json: &str, value: impl Fn([f64; 3]) -> u8, off: DVec3, fov: Fov) -> Self {
        let places = (0..SIDE).flat_map(|z| (0..SIDE).flat_map(move |y| (0..SIDE).map(move |x| [x, y, z])));
        let voxels = Voxels::U8(places.map(|p| value(p.map(f64::from))).collect());
        let channel =
            Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
        let volume = Volume::new(Grid::axis_aligned([SIDE; 3], DVec3::ONE).unwrap(), vec![channel]).unwrap();
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
        let on_device = Arc::new(VolumeOnDevice::upload(gpu(), &volume, |_| {}).unwrap());
        let middle = DVec3::splat(f64::from(SIDE) / 2.0);
        let head = Pose::looking_at(middle - off, middle, DVec3::Y).unwrap();
        let eyes = HeadGeometry::parallel(6.0, fov).view(&head).eyes;
        Self { scene: SceneOnDevice::new(gpu(), &on_device, &scene).unwrap(), eyes }
    }

    fn plan(&self, quality: Quality) -> StereoPlan {
        self.plan_of(&self.eyes, SIZE, quality)
    }

    fn plan_of(&self, eyes: &[EyeView], eye_size_px: [u32; 2], quality: Quality) -> StereoPlan {
        let request = StereoRequest {
            eyes,
            placed: Placed::own_axes(self.scene.grid()),
            eye_size_px,
            quality,
            step_mm: None,
            depth_grid: DepthGridSize { columns: 16, rows: 12 },
        };
        StereoPlan::new(&request, self.scene.grid(), self.scene.numbers()).unwrap()
    }

    fn still(&self, quality: Quality) -> Still {
        StillRenderer::new(gpu()).render(&self.scene, &self.plan(quality)).unwrap()
    }
}

/// A pixel as it should be.
struct Expected {
    color: [f32; 4],
    /// `None` where float32 may decide either way.
    depth_mm: Option<f32>,
    from: From,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum From {
    Ray,
    /// A ray, although the rays around it saw nearly the same: some have a depth and some have none.
    RayForDepth,
    /// The rays around it.
    Between,
    /// The same, with a neighbour's depth.
    BetweenParted,
}

/// What an eye's pixel is, from the picture of which each pixel has its ray.
fn expected(each: (&[[f32; 4]], &[f32]), fov: Fov, below: f64, x: u32, y: u32) -> Expected {
    let index = |x: u32, y: u32| (y * SIZE[0] + x) as usize;
    let own = |from: From| Expected { color: each.0[index(x, y)], depth_mm: Some(each.1[index(x, y)]), from };
    let (left, top) = (x & !1, y & !1);
    let (right, bottom) = (left + 2, top + 2);
    if (x, y) == (left, top) || right >= SIZE[0] || bottom >= SIZE[1] {
        return own(From::Ray);
    }
    let places = [index(left, top), index(right, top), index(left, bottom), index(right, bottom)];
    let (rays, mm) = (places.map(|i| each.0[i]), places.map(|i| each.1[i]));
    let of =
        |channel: usize, pick: fn(f32, f32) -> f32| rays.iter().map(|p| p[channel]).reduce(pick).unwrap();
    let apart = (0..4).any(|c| of(c, f32::max) - of(c, f32::min) > below as f32);
    let nothing_beside_something = of(3, f32::max) > 0.0 && of(3, f32::min) <= 0.0;
    if apart || nothing_beside_something {
        return own(From::Ray);
    }
    if ![0, 4].contains(&mm.iter().filter(|&&d| d > 0.0).count()) {
        return own(From::RayForDepth);
    }
    // How far apart two rays are at the nearest depth: in the plane at distance 1 they are two pixels.
    let [l, r, u, d] = fov.tangents();
    let [width, height] = SIZE.map(f64::from);
    let middle = fov.ray((f64::from(left) + 1.5) / width, (f64::from(top) + 1.5) / height);
    let nearest = f64::from(mm.iter().copied().fold(f32::INFINITY, f32::min));
    let steepest =
        [(r - l) / width, (u - d) / height].map(|pixel| 4.0 * 2.0 * pixel * nearest / middle.length());
    let step = |a: usize, b: usize, most: f64| {
        let step = (f64::from(mm[a]) - f64::from(mm[b])).abs();
        (step <= most, most > 0.0 && (step / most - 1.0).abs() < 1.0e-4)
    };
    let [along_x, along_y] = steepest;
    let steps = [step(0, 1, along_x), step(0, 2, along_y), step(2, 3, along_x), step(1, 3, along_y)];
    let (used, others) = match (x == left, y == top) {
        (false, true) => (&steps[0..1], &[1][..]),
        (true, false) => (&steps[1..2], &[2][..]),
        _ => (&steps[..], &[1, 2, 3][..]),
    };
    let mean = |p: [f32; 4], q: [f32; 4]| std::array::from_fn(|c| 0.5 * (p[c] + q[c]));
    let (color, depth_mm) = match others {
        [one] => (mean(rays[0], rays[*one]), 0.5 * (mm[0] + mm[*one])),
        _ => {
            (mean(mean(rays[0], rays[1]), mean(rays[2], rays[3])), 0.25 * ((mm[0] + mm[1]) + (mm[2] + mm[3])))
        }
    };
    let is_joined = used.iter().all(|step| step.0);
    let depth_mm = if is_joined { depth_mm } else { mm[0] };
    Expected {
        color,
        depth_mm: used.iter().all(|step| !step.1).then_some(depth_mm),
        from: if is_joined { From::Between } else { From::BetweenParted },
    }
}

/// Pixels by where they are from.
#[derive(Default)]
struct Origins {
    ray: u64,
    ray_for_depth: u64,
    between: u64,
    parted: u64,
}

/// Holds a picture to the bit against the one of which each pixel has its ray.
#[track_caller]
fn hold(what: &str, shown: &Shown, level: Quality, below: f64) -> Origins {
    let each = shown.still(Quality { interpolated_below: 0.0, ..level });
    let spread = shown.still(Quality { interpolated_below: below, ..level });
    let mut origins = Origins::default();
    for eye in 0..2 {
        let all = (each.eye(eye), each.eye_depth_mm(eye));
        let depths = spread.eye_depth_mm(eye);
        for (i, found) in spread.eye(eye).iter().enumerate() {
            let (x, y) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
            let expected = expected(all, shown.eyes[eye].fov, below, x, y);
            let bits = |p: [f32; 4]| p.map(f32::to_bits);
            let pixel = format!("{what}: eye {eye}, pixel {x}, {y}");
            assert_eq!(bits(*found), bits(expected.color), "{pixel}: {found:?}, {:?}", expected.color);
            if let Some(depth) = expected.depth_mm {
                assert_eq!(depths[i].to_bits(), depth.to_bits(), "{pixel}: {} mm, {depth} mm", depths[i]);
            }
            match expected.from {
                From::Ray => origins.ray += 1,
                From::RayForDepth => origins.ray_for_depth += 1,
                From::Between => origins.between += 1,
                From::BetweenParted => origins.parted += 1,
            }
        }
    }
    origins
}

#[test]
fn pixels_are_interpolated_where_four_rays_agree_and_have_their_own_ray_elsewhere() {
    let scenes = [
        r#"{"transfer": [[0,0,0,0,0],[100,0.9,0.5,0.3,0],[140,0.9,0.6,0.4,0.4],[255,1,1,1,0.9]]}"#,
        r#"{"transfer": [[0,0,0,0,0],[100,0.9,0.5,0.3,0],[140,0.9,0.6,0.4,0.4],[255,1,1,1,0.9]], "shade": true}"#,
        r#"{"mode": "maximum", "window": [0, 255]}"#,
        r#"{"mode": "x-ray", "window": [0, 255]}"#,
        r#"{"mode": "threshold", "threshold": 120}"#,
        r#"{"mode": "cumulated", "threshold": 200, "window": [0, 255]}"#,
    ];
    let mut for_depth = 0;
    for json in scenes {
        let shown = Shown::new(json);
        for level in [Quality::DRAFT, Quality::FINE] {
            let origins = hold(json, &shown, level, BELOW);
            for_depth += origins.ray_for_depth;
            let (between, own) = (origins.between + origins.parted, origins.ray + origins.ray_for_depth);
            assert!(between > 500 && own > 500, "{json}: {between} of {}", between + own);
            // As many rays as pixels that are not interpolated, but those of tiles that see nothing.
            let count = |interpolated_below: f64| {
                let plan = shown.plan(Quality { interpolated_below, ..level });
                StillRenderer::new(gpu()).count(&shown.scene, &plan).unwrap().rays
            };
            let (rays, all) = (count(BELOW), count(0.0));
            assert!(
                rays <= own && rays < all,
                "{json}: {rays} rays, {own} pixels have their own, {all} without"
            );
        }
    }
    assert!(for_depth > 50, "{for_depth} pixels have a ray for their depth alone");
}

/// `docs/picture.md`: a depth is where half of the light is gone, and there is none where it is not.
#[test]
fn a_pixel_between_rays_has_a_depth_where_half_of_the_light_is_gone() {
    let fog = r#"{"transfer": [[0,0,0,0,0],[100,0.9,0.5,0.3,0],[140,0.9,0.6,0.4,0.02],[255,1,1,1,0.03]]}"#;
    let shown = Shown::new(fog);
    for level in [Quality::DRAFT, Quality::FINE] {
        let origins = hold(fog, &shown, level, BELOW);
        assert!(origins.ray_for_depth > 20, "{} rays for a depth", origins.ray_for_depth);
        let still = shown.still(Quality { interpolated_below: BELOW, ..level });
        for (i, (rgba, depth)) in still.rgba.iter().zip(&still.depth_mm).enumerate() {
            let is_clear = (rgba[3] - 0.5).abs() < 1.0e-4 || (rgba[3] > 0.5) == (*depth > 0.0);
            assert!(is_clear, "pixel {i}: opacity {}, {depth} mm", rgba[3]);
        }
    }
}

/// A wide field's rays at its border are longer than that in its middle, and its pixels are not square.
#[test]
fn depths_are_interpolated_as_far_as_a_surface_explains_them_at_any_field_of_view() {
    for [horizontal, vertical] in [[35.0f64, 25.0], [170.0, 100.0], [60.0, 165.0]] {
        let fov = Fov::symmetric(horizontal.to_radians(), vertical.to_radians()).unwrap();
        let what = format!("{horizontal}° by {vertical}°");
        let origins = hold(&what, &Shown::room(fov), Quality::FINE, 1.0);
        let Origins { ray, ray_for_depth, between, parted } = origins;
        assert!(between > 500 && parted > 100, "{what}: {ray} {ray_for_depth} {between} {parted}");
    }
}

/// A surface before another of the same colour: pixels between them lie on one or the other, not in the air.
#[test]
fn depths_of_surfaces_that_part_are_not_mixed() {
    let shown = Shown::new(r#"{"mode": "threshold", "threshold": 120, "surface_color": [0, 0, 0]}"#);
    let each = shown.still(Quality { interpolated_below: 0.0, ..Quality::FINE });
    let spread = shown.still(Quality { interpolated_below: 1.0, ..Quality::FINE });
    let mut edges = 0;
    for eye in 0..2 {
        let (own, drawn) = (each.eye_depth_mm(eye), spread.eye_depth_mm(eye));
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let around = (y.saturating_sub(2)..(y + 3).min(SIZE[1])).flat_map(|v| {
                    (x.saturating_sub(2)..(x + 3).min(SIZE[0])).map(move |u| own[(v * SIZE[0] + u) as usize])
                });
                let around: Vec<f32> = around.collect();
                let found = drawn[(y * SIZE[0] + x) as usize];
                let nearest = around.iter().map(|d| (d - found).abs()).fold(f32::INFINITY, f32::min);
                let span = around.iter().copied().fold(0.0, f32::max)
                    - around.iter().copied().fold(f32::INFINITY, f32::min);
                edges += usize::from(span > 15.0);
                assert!(nearest < 2.0, "eye {eye}, pixel {x}, {y}: {found}, around it {around:?}");
            }
        }
    }
    assert!(edges > 100, "{edges} pixels beside an edge");
}

/// What a frame leaves on the device is not seen in the next.
#[test]
fn frames_that_follow_each_other_are_as_frames_by_themselves() {
    let shown = Shown::new(
        r#"{"transfer": [[0,0,0,0,0],[100,0.9,0.5,0.3,0],[140,0.9,0.6,0.4,0.4],[255,1,1,1,0.9]], "shade": true}"#,
    );
    let middle = DVec3::splat(f64::from(SIDE) / 2.0);
    let head = Pose::looking_at(middle + DVec3::new(70.0, 20.0, -60.0), middle, DVec3::Y).unwrap();
    let others = HeadGeometry::parallel(6.0, Fov::symmetric(0.5, 0.4).unwrap()).view(&head).eyes;
    // Even, as what is encoded has to be; half as many rays are odd.
    let (large, small) = ([66, 46], [34, 22]);
    let half = Quality { resolution_scale: 0.5, ..Quality::DRAFT };
    let plans = [
        shown.plan_of(&shown.eyes, large, Quality::BALANCED),
        shown.plan_of(&shown.eyes, large, Quality::DRAFT),
        shown.plan_of(&others, small, Quality::DRAFT),
        shown.plan_of(&shown.eyes, large, Quality::DRAFT),
        shown.plan_of(&others, large, half),
        shown.plan_of(&shown.eyes, large, Quality::BALANCED),
    ];
    let mut renderer = FrameRenderer::new(gpu(), 1).unwrap();
    for (i, plan) in plans.iter().enumerate() {
        let mut alone = FrameRenderer::new(gpu(), 1).unwrap();
        let [found, expected] = [&mut renderer, &mut alone].map(|renderer| {
            let frame = renderer.submit(&shown.scene, plan).unwrap().finish().unwrap();
            (frame.planes().to_vec(), frame.depth_grid_mm())
        });
        assert!(expected.1.iter().filter(|&&mm| mm > 0).count() > 50, "frame {i}: {:?}", expected.1);
        assert!(found == expected, "frame {i}");
    }
}
