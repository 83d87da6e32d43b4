//! Pixels between rays: what is interpolated, what has a ray of its own, and how many rays that takes.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{
    DepthGridSize, Gpu, Placed, Quality, SceneOnDevice, StereoPlan, StereoRequest, Still, StillRenderer,
    VolumeOnDevice,
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
        let value = |x: u32, y: u32, z: u32| {
            let [x, y, z] = [x, y, z].map(|i| f64::from(i) - f64::from(SIDE) / 2.0);
            let checked = x > 0.0 && (x as i32 + y as i32) % 2 == 0;
            let ball = (20.0 - (x * x + y * y + (z + 10.0).powi(2)).sqrt()).clamp(0.0, 4.0) * 40.0;
            let wall = if z > 15.0 && y < 12.0 { 160.0 } else { 0.0 };
            (ball + wall + if checked && ball > 0.0 { 60.0 } else { 0.0 }).min(255.0) as u8
        };
        let places = (0..SIDE).flat_map(|z| (0..SIDE).flat_map(move |y| (0..SIDE).map(move |x| (x, y, z))));
        let voxels = Voxels::U8(places.map(|(x, y, z)| value(x, y, z)).collect());
        let channel =
            Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
        let volume = Volume::new(Grid::axis_aligned([SIDE; 3], DVec3::ONE).unwrap(), vec![channel]).unwrap();
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
        let on_device = Arc::new(VolumeOnDevice::upload(gpu(), &volume, |_| {}).unwrap());
        let middle = DVec3::splat(f64::from(SIDE) / 2.0);
        let head = Pose::looking_at(middle - DVec3::new(8.0, 5.0, 110.0), middle, DVec3::Y).unwrap();
        let fov = Fov::symmetric(0.6, 0.45).unwrap();
        let eyes = HeadGeometry::parallel(6.0, fov).view(&head).eyes;
        Self { scene: SceneOnDevice::new(gpu(), &on_device, &scene).unwrap(), eyes }
    }

    fn plan(&self, quality: Quality) -> StereoPlan {
        let request = StereoRequest {
            eyes: &self.eyes,
            placed: Placed::own_axes(self.scene.grid()),
            eye_size_px: SIZE,
            quality,
            step_mm: None,
            depth_grid: DepthGridSize::default(),
        };
        StereoPlan::new(&request, self.scene.grid(), self.scene.numbers()).unwrap()
    }

    fn still(&self, quality: Quality) -> Still {
        StillRenderer::new(gpu()).render(&self.scene, &self.plan(quality)).unwrap()
    }
}

/// What an eye's pixel is, from the picture of which each pixel has its ray; and whether it is interpolated.
fn expected(rgba: &[[f32; 4]], x: u32, y: u32) -> ([f32; 4], bool) {
    let at = |x: u32, y: u32| rgba[(y * SIZE[0] + x) as usize];
    let (left, top) = (x & !1, y & !1);
    let (right, below) = (left + 2, top + 2);
    if (x, y) == (left, top) || right >= SIZE[0] || below >= SIZE[1] {
        return (at(x, y), false);
    }
    let rays = [at(left, top), at(right, top), at(left, below), at(right, below)];
    let of =
        |channel: usize, pick: fn(f32, f32) -> f32| rays.iter().map(|p| p[channel]).reduce(pick).unwrap();
    let apart = (0..4).any(|c| of(c, f32::max) - of(c, f32::min) > BELOW as f32);
    let nothing_beside_something = of(3, f32::max) > 0.0 && of(3, f32::min) <= 0.0;
    if apart || nothing_beside_something {
        return (at(x, y), false);
    }
    let mean = |p: [f32; 4], q: [f32; 4]| std::array::from_fn(|c| 0.5 * (p[c] + q[c]));
    let [a, b, c, d] = rays;
    let between = match (x == left, y == top) {
        (false, true) => mean(a, b),
        (true, false) => mean(a, c),
        _ => mean(mean(a, b), mean(c, d)),
    };
    (between, true)
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
    for json in scenes {
        let shown = Shown::new(json);
        for level in [Quality::DRAFT, Quality::FINE] {
            let each = shown.still(Quality { interpolated_below: 0.0, ..level });
            let quality = Quality { interpolated_below: BELOW, ..level };
            let spread = shown.still(quality);
            let (mut between, mut own) = (0u64, 0u64);
            for eye in 0..2 {
                let (all, drawn) = (each.eye(eye), spread.eye(eye));
                for (i, found) in drawn.iter().enumerate() {
                    let (x, y) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
                    let (color, is_between) = expected(all, x, y);
                    let bits = |p: [f32; 4]| p.map(f32::to_bits);
                    assert_eq!(
                        bits(*found),
                        bits(color),
                        "{json}: eye {eye}, pixel {x}, {y}: {found:?}, {color:?}"
                    );
                    let (depth, own_depth) = (spread.eye_depth_mm(eye)[i], each.eye_depth_mm(eye)[i]);
                    if is_between {
                        between += 1;
                    } else {
                        own += 1;
                        assert_eq!(depth.to_bits(), own_depth.to_bits(), "{json}: eye {eye}, pixel {x}, {y}");
                    }
                }
            }
            assert!(between > 500 && own > 500, "{json}: {between} of {}", between + own);
            // As many rays as pixels that are not interpolated, but those of tiles that see nothing.
            let rays = StillRenderer::new(gpu()).count(&shown.scene, &shown.plan(quality)).unwrap().rays;
            let all = StillRenderer::new(gpu())
                .count(&shown.scene, &shown.plan(Quality { interpolated_below: 0.0, ..level }))
                .unwrap()
                .rays;
            assert!(
                rays <= own && rays < all,
                "{json}: {rays} rays, {own} pixels have their own, {all} without"
            );
        }
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
