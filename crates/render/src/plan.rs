//! A frame as data: everything the device is told, worked out in float64 and testable without a device.

use crate::Quality;
use crate::layout::{GpuEye, GpuFrame};
use crate::pipelines::Features;
use crate::scene_on_device::SceneNumbers;
use crate::several::corners;
use spatial::{DAffine3, DMat3, DQuat, DVec3, EyeView, Fov, FovError};
use volume::Grid;

/// How far an orientation's length may be from 1: more is no rounding.
const UNIT_LENGTH_TOLERANCE: f64 = 1.0e-3;
/// A tile has 2 to this power rays along each side.
const LARGEST_TILE_POWER: u32 = 3;
/// The smallest one: rays between others need two along each side.
const LEAST_TILE_POWER: u32 = 1;
/// How wide a tile may be where the volume's middle is, in voxels: what its rays share is where any of them may see something,
/// and a wide one shares little. A narrow one costs more to find out.
const WIDEST_TILE_VOXELS: f64 = 12.0;
/// Longest side of a picture in pixels.
const LONGEST_SIDE: u32 = 16_384;

/// Where the volume lies in the space that the eyes are given in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// From the eyes' space to voxel index.
    pub index_from_world: DAffine3,
    /// Millimetres of room a millimetre of the volume takes.
    pub room_mm_per_volume_mm: f64,
}

impl Placed {
    /// A volume in the room, eyes in metres.
    #[must_use]
    pub fn in_room(placement: &scene::Placement, grid: &Grid) -> Self {
        let world_from_index = placement.world_from_volume(grid) * grid.volume_from_index();
        Self {
            index_from_world: world_from_index.inverse(),
            room_mm_per_volume_mm: 1000.0 / placement.volume_mm_per_world_m(),
        }
    }

    /// Eyes in the volume's own millimetres, as scene files give cameras.
    #[must_use]
    pub fn own_axes(grid: &Grid) -> Self {
        Self { index_from_world: grid.own_axes_from_index().inverse(), room_mm_per_volume_mm: 1.0 }
    }
}

/// Depths sent beside a picture: cells of each eye.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DepthGridSize {
    /// Cells across; 0 for no grid.
    pub columns: u32,
    /// Cells down; 0 for no grid.
    pub rows: u32,
}

/// What is asked of the renderer.
#[derive(Clone, Debug)]
pub struct StereoRequest<'a> {
    /// One eye, or left and right.
    pub eyes: &'a [EyeView],
    /// Where the volume lies.
    pub placed: Placed,
    /// Width and height of one eye's picture in pixels; both even where it is to be encoded.
    pub eye_size_px: [u32; 2],
    /// What the frame may cost.
    pub quality: Quality,
    /// Distance of samples in millimetres, if it is not the quality's to choose.
    pub step_mm: Option<f64>,
    /// Depths wanted beside the picture.
    pub depth_grid: DepthGridSize,
}

/// Why a request cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Neither one eye nor two.
    #[error("a picture has one or two eyes, found {0}")]
    Eyes(usize),
    /// An eye whose position or orientation is not finite, or whose orientation is no rotation.
    #[error(
        "eye {eye} is at {position} with orientation {orientation}: expected finite numbers and a quaternion of length 1"
    )]
    Pose {
        /// Which eye, from 0.
        eye: usize,
        /// Its position, in the space of the eyes.
        position: DVec3,
        /// Its orientation.
        orientation: DQuat,
    },
    /// An eye's field of view is none.
    #[error("eye {eye}: {why}")]
    Fov {
        /// Which eye, from 0.
        eye: usize,
        /// What is wrong with it.
        why: FovError,
    },
    /// The volume is placed nowhere: a number is not finite, or it has no extent.
    #[error("the transform from the eyes' space to voxels, {0}, is not finite or flattens space")]
    Placed(DAffine3),
    /// No pixel, or too many.
    #[error("picture of {0:?} pixels an eye: each side must be 1 to {LONGEST_SIDE}")]
    Size([u32; 2]),
    /// The step is so short that the samples of a ray could not be counted.
    #[error(
        "step of {step_mm} mm: the longest way through the volume, {way_mm:.1} mm, would take {samples:.0} samples, \
         at most {most} are possible on this device"
    )]
    Step {
        /// The step, millimetres.
        step_mm: f64,
        /// The volume's diagonal, millimetres.
        way_mm: f64,
        /// Samples along it.
        samples: f64,
        /// The most that are possible.
        most: u32,
    },
    /// The quality has a number out of its range.
    #[error("quality: {field} is {found}, expected {expected}")]
    Quality {
        /// Which number.
        field: &'static str,
        /// What it is.
        found: f64,
        /// What is allowed.
        expected: &'static str,
    },
}

/// A frame as data.
#[derive(Clone, Debug, PartialEq)]
pub struct StereoPlan {
    pub(crate) frame: GpuFrame,
    pub(crate) features: Features,
    pub(crate) step_mm: f64,
    eye_count: u32,
    render_size_px: [u32; 2],
    output_size_px: [u32; 2],
    depth_grid: DepthGridSize,
}

impl StereoPlan {
    /// Works a request out.
    ///
    /// # Errors
    /// If it has no eye, no pixel, an eye or a placement that is none, or a step or quality out of range.
    pub fn new(request: &StereoRequest<'_>, grid: &Grid, numbers: &SceneNumbers) -> Result<Self, PlanError> {
        let StereoRequest { eyes, placed, eye_size_px, quality, depth_grid, .. } = request;
        if !(1..=2).contains(&eyes.len()) {
            return Err(PlanError::Eyes(eyes.len()));
        }
        if eye_size_px.iter().any(|s| !(1..=LONGEST_SIDE).contains(s)) {
            return Err(PlanError::Size(*eye_size_px));
        }
        check_quality(quality)?;
        check_eyes(eyes, placed)?;
        let together = numbers.together.as_ref();
        let finest_mm = together.map_or(grid.spacing_mm().min_element(), |together| together.finest_mm);
        let step_mm = request.step_mm.unwrap_or(quality.step_voxels * finest_mm);
        let way_mm = together.map_or_else(|| grid.size_mm().length(), |together| together.longest_mm);
        let samples = way_mm / step_mm;
        // Without steps, a step has only to be one.
        let most = numbers.most_samples;
        let features = Features::of(numbers, quality);
        let is_counted = !features.cells && !features.labels;
        if !(step_mm > 0.0 && (!is_counted || samples <= f64::from(most))) {
            return Err(PlanError::Step { step_mm, way_mm, samples, most });
        }
        let scaled = |side: u32| ((f64::from(side) * quality.resolution_scale).round() as u32).max(1);
        let render_size_px = eye_size_px.map(scaled);
        let eye_count = eyes.len() as u32;
        let dims = grid.dims();
        // Gradients go to millimetres by the inverse transpose; only their direction matters, so any common factor may
        // go, and the largest entry becomes 1.
        let to_mm = grid.volume_from_index().matrix3.inverse().transpose();
        let largest = to_mm.to_cols_array().into_iter().fold(0.0f64, |a, x| a.max(x.abs()));
        let rows = (to_mm * (1.0 / largest)).transpose();
        let mut frame = GpuFrame {
            render_size: render_size_px,
            output_size: *eye_size_px,
            luma_stride: (eye_size_px[0] * eye_count).next_multiple_of(8),
            eye_count,
            step_mm: step_mm as f32,
            least_transmittance: quality.least_transmittance as f32,
            dims: dims.map(|d| d as f32),
            cells: dims.map(|d| d.div_ceil(crate::cells::CELL as u32)),
            gradient_x: f32s(rows.x_axis),
            gradient_y: f32s(rows.y_axis),
            gradient_z: f32s(rows.z_axis),
            room_mm_per_volume_mm: placed.room_mm_per_volume_mm as f32,
            depth_columns: depth_grid.columns,
            depth_rows: depth_grid.rows,
            light_span: (quality.light_span_voxels * finest_mm / step_mm).floor().max(1.0) as f32,
            light_weight: quality.light_weight as f32,
            skip_empty: u32::from(quality.skip_empty),
            part: (1.0 / f64::from(quality.refined_parts)) as f32,
            interpolated_below: quality.interpolated_below as f32,
            little: if quality.refined_parts > 1 { quality.refined_above as f32 } else { 1.0 },
            ..numbers.frame
        };
        frame.tile_power = LARGEST_TILE_POWER;
        let mm_from_index = grid.volume_from_index().matrix3;
        let centre_in_index = (DVec3::from_array(dims.map(f64::from)) - 1.0) / 2.0;
        for (slot, eye) in frame.eyes.iter_mut().zip(eyes.iter()) {
            *slot = gpu_eye(eye, &placed.index_from_world, &mm_from_index, centre_in_index);
            [slot.near, slot.far] = match together {
                Some(together) => depths(eye, &placed.index_from_world, together.corners_in_index()),
                None => depths(eye, &placed.index_from_world, corners(&grid.index_from_texture())),
            };
        }
        if features.skips_by_tile() {
            let apart =
                frame.eyes[..eyes.len()].iter().map(|e| voxels_apart(e, render_size_px)).fold(0.0, f64::max);
            let narrow = |power: &u32| f64::from(1u32 << power) * apart <= WIDEST_TILE_VOXELS;
            frame.tile_power =
                (LEAST_TILE_POWER..=LARGEST_TILE_POWER).rev().find(narrow).unwrap_or(LEAST_TILE_POWER);
        }
        Ok(Self {
            frame,
            features,
            step_mm,
            eye_count,
            render_size_px,
            output_size_px: *eye_size_px,
            depth_grid: *depth_grid,
        })
    }

    /// Whether what is seen is lit.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        use scene::Mode;
        self.features.lit || matches!(self.features.mode, Mode::Threshold | Mode::Cumulated)
    }

    /// The same rays and steps, on which values are read and summed and nothing else is done: every sample of every ray,
    /// with the device's own filter. What the device gives at best, to measure with; it shows nothing.
    #[must_use]
    pub fn bare(&self) -> Self {
        Self { features: Features::bare(), ..self.clone() }
    }

    /// The same picture, by a ray-caster in whose text nothing is written of what the scene does not use: as if the
    /// features had never been made. To measure what they cost a scene without them.
    #[must_use]
    pub fn cut(&self) -> Self {
        Self { features: Features { cut: true, ..self.features }, ..self.clone() }
    }

    /// The same, with what is looked at stored instead of the picture.
    pub(crate) fn counting(&self) -> Self {
        Self { features: Features { count: true, ..self.features }, ..self.clone() }
    }

    /// Eyes in the picture.
    #[must_use]
    pub fn eye_count(&self) -> u32 {
        self.eye_count
    }

    /// Rays of one eye: across and down.
    #[must_use]
    pub fn render_size_px(&self) -> [u32; 2] {
        self.render_size_px
    }

    /// Pixels of one eye: across and down.
    #[must_use]
    pub fn output_size_px(&self) -> [u32; 2] {
        self.output_size_px
    }

    /// Distance of samples along a ray in millimetres of the volume.
    #[must_use]
    pub fn step_mm(&self) -> f64 {
        self.step_mm
    }

    /// Whether rays are gone along in steps, not from cell to cell.
    #[must_use]
    pub fn takes_steps(&self) -> bool {
        !self.features.cells && !self.features.labels
    }

    /// The part of a step that is gone at a time where there is more than little to see.
    pub(crate) fn step_part(&self) -> f64 {
        f64::from(self.frame.part)
    }

    /// Tiles of one eye: across and down.
    pub(crate) fn tiles(&self) -> [u32; 2] {
        self.render_size_px.map(|side| side.div_ceil(1 << self.frame.tile_power))
    }

    /// Whether the picture is made larger when it is converted.
    pub(crate) fn is_scaled(&self) -> bool {
        self.render_size_px != self.output_size_px
    }

    /// Bytes of a row of luma.
    pub(crate) fn luma_stride(&self) -> usize {
        self.frame.luma_stride as usize
    }

    /// Bytes of the three planes.
    pub(crate) fn planes_bytes(&self) -> usize {
        let rows = self.output_size_px[1].next_multiple_of(2) as usize;
        self.luma_stride() * rows * 3 / 2
    }

    /// Bytes of the grid of depths.
    pub(crate) fn depth_grid_bytes(&self) -> usize {
        ((self.depth_grid.columns * self.depth_grid.rows * self.eye_count) as usize * 2).next_multiple_of(4)
    }

    /// The grid of depths.
    #[must_use]
    pub fn depth_grid(&self) -> DepthGridSize {
        self.depth_grid
    }
}

fn check_eyes(eyes: &[EyeView], placed: &Placed) -> Result<(), PlanError> {
    let flat = placed.index_from_world.matrix3.determinant() == 0.0;
    if !placed.index_from_world.is_finite() || flat || !placed.room_mm_per_volume_mm.is_finite() {
        return Err(PlanError::Placed(placed.index_from_world));
    }
    for (eye, view) in eyes.iter().enumerate() {
        let (position, orientation) = (view.world_from_eye.position_m, view.world_from_eye.orientation);
        let is_unit = (orientation.length() - 1.0).abs() <= UNIT_LENGTH_TOLERANCE;
        if !position.is_finite() || !is_unit {
            return Err(PlanError::Pose { eye, position, orientation });
        }
        let Fov { left, right, up, down } = view.fov;
        Fov::checked(left, right, up, down).map_err(|why| PlanError::Fov { eye, why })?;
    }
    Ok(())
}

fn check_quality(quality: &Quality) -> Result<(), PlanError> {
    let check = |field, found: f64, ok: bool, expected| {
        if ok { Ok(()) } else { Err(PlanError::Quality { field, found, expected }) }
    };
    let Quality { resolution_scale, step_voxels, refined_parts, refined_above, .. } = *quality;
    let Quality { least_transmittance, light_span_voxels, light_weight, .. } = *quality;
    check(
        "resolution_scale",
        resolution_scale,
        resolution_scale > 0.0 && resolution_scale <= 1.0,
        "above 0, at most 1",
    )?;
    check("step_voxels", step_voxels, step_voxels > 0.0 && step_voxels <= 64.0, "above 0, at most 64")?;
    let parts_are_right = refined_parts.is_power_of_two() && refined_parts <= 16;
    check("refined_parts", f64::from(refined_parts), parts_are_right, "1, 2, 4, 8 or 16")?;
    check("refined_above", refined_above, (0.0..=1.0).contains(&refined_above), "0 to 1")?;
    check(
        "least_transmittance",
        least_transmittance,
        (0.0..=0.5).contains(&least_transmittance),
        "0 to 0.5",
    )?;
    check("light_span_voxels", light_span_voxels, (0.0..=64.0).contains(&light_span_voxels), "0 to 64")?;
    check("light_weight", light_weight, (0.0..=1.0).contains(&light_weight), "0 to 1")?;
    let below = quality.interpolated_below;
    check("interpolated_below", below, (0.0..=1.0).contains(&below), "0 to 1")
}

fn f32s(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

fn gpu_eye(
    eye: &EyeView,
    index_from_world: &DAffine3,
    mm_from_index: &DMat3,
    centre_in_index: DVec3,
) -> GpuEye {
    let pose = &eye.world_from_eye;
    let [left, right, up, down] = eye.fov.tangents();
    let to_index = |v_in_eye: DVec3| index_from_world.matrix3 * (pose.orientation * v_in_eye);
    let ray = to_index(DVec3::new((left + right) / 2.0, (up + down) / 2.0, -1.0));
    let ray_dx = to_index(DVec3::new(right - left, 0.0, 0.0));
    let ray_dy = to_index(DVec3::new(0.0, down - up, 0.0));
    // The anchor lies on the plane at the depth of the volume's middle, or at the eye if that is behind it.
    let centre_in_world = index_from_world.inverse().transform_point3(centre_in_index);
    let centre_in_eye = pose.orientation.conjugate() * (centre_in_world - pose.position_m);
    let anchor_depth = (-centre_in_eye.z).max(0.0);
    let anchor = index_from_world.transform_point3(pose.position_m) + ray * anchor_depth;
    GpuEye {
        anchor: f32s(anchor),
        anchor_depth: anchor_depth as f32,
        ray: f32s(ray),
        ray_dx: f32s(ray_dx),
        ray_dy: f32s(ray_dy),
        ray_mm: f32s(*mm_from_index * ray),
        ray_dx_mm: f32s(*mm_from_index * ray_dx),
        ray_dy_mm: f32s(*mm_from_index * ray_dy),
        ..GpuEye::default()
    }
}

/// How far neighbouring rays of an eye are apart where the volume's middle is, in voxels along the axis where that is most.
fn voxels_apart(eye: &GpuEye, render_size_px: [u32; 2]) -> f64 {
    let apart = |across: [f32; 3], pixels: u32| {
        let most = across.into_iter().fold(0.0f32, |most, x| most.max(x.abs()));
        f64::from(eye.anchor_depth * most) / f64::from(pixels)
    };
    apart(eye.ray_dx, render_size_px[0]).max(apart(eye.ray_dy, render_size_px[1]))
}

/// Nearest and farthest depth of volumes before an eye, from the corners of their borders: along the eye's axis, in the
/// world's unit, none behind it.
fn depths(
    eye: &EyeView,
    index_from_world: &DAffine3,
    corners_in_index: impl IntoIterator<Item = DVec3>,
) -> [f32; 2] {
    let world_from_index = index_from_world.inverse();
    let pose = &eye.world_from_eye;
    let (mut near, mut far) = (f64::INFINITY, 0.0f64);
    for corner in corners_in_index {
        let corner_in_world = world_from_index.transform_point3(corner);
        let depth = -(pose.orientation.conjugate() * (corner_in_world - pose.position_m)).z;
        (near, far) = (near.min(depth), far.max(depth));
    }
    // Rounded outwards.
    let (near, far) = (near.max(0.0), far.max(0.0));
    [(near as f32).next_down().max(0.0), (far as f32).next_up()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::Mode;
    use spatial::{Fov, HeadGeometry, Pose};

    fn numbers() -> SceneNumbers {
        SceneNumbers {
            mode: Mode::EmissionAbsorption,
            lit: false,
            labels: false,
            has_empty_cells: true,
            most_samples: 60_000,
            frame: GpuFrame::default(),
            together: None,
        }
    }

    fn request(eyes: &[EyeView], grid: &Grid) -> StereoPlan {
        StereoPlan::new(
            &StereoRequest {
                eyes,
                placed: Placed::in_room(&scene::Placement::default(), grid),
                eye_size_px: [320, 180],
                quality: Quality::BALANCED,
                step_mm: None,
                depth_grid: DepthGridSize::default(),
            },
            grid,
            &numbers(),
        )
        .unwrap()
    }

    fn grid() -> Grid {
        Grid::axis_aligned([64, 80, 96], DVec3::new(1.0, 2.0, 0.5)).unwrap()
    }

    #[test]
    fn the_middle_ray_of_an_eye_at_the_hologram_meets_the_volumes_middle() {
        let grid = grid();
        let eye = EyeView {
            world_from_eye: Pose { position_m: DVec3::new(0.0, 1.5, 0.0), ..Pose::IDENTITY },
            fov: Fov::symmetric(0.5, 0.3).unwrap(),
        };
        let plan = request(&[eye], &grid);
        let e = plan.frame.eyes[0];
        let centre = [31.5, 39.5, 47.5];
        assert!(
            e.anchor.iter().zip(centre).all(|(a, c): (&f32, f32)| (a - c).abs() < 1e-4),
            "{:?}",
            e.anchor
        );
        assert!((e.anchor_depth - 2.0).abs() < 1e-6);
        // Looking along -Z, at the patient's face: towards posterior, +y.
        assert!(e.ray[0].abs() < 1e-3 && e.ray[1] > 0.0 && e.ray[2].abs() < 1e-3, "{:?}", e.ray);
        // A metre of room is 1000 mm of patient.
        assert!((e.ray_mm[1] - 1000.0).abs() < 1e-3);
    }

    #[test]
    fn tiles_are_as_large_as_their_rays_stand_close() {
        let grid = Grid::axis_aligned([64; 3], DVec3::ONE).unwrap();
        let power = |distance_m: f64, width: u32, mode: Mode| {
            let position_m = DVec3::new(0.0, 1.5, distance_m - 2.0);
            let eye = EyeView {
                world_from_eye: Pose { position_m, ..Pose::IDENTITY },
                fov: Fov::symmetric(0.5, 0.5).unwrap(),
            };
            let request = StereoRequest {
                eyes: &[eye],
                placed: Placed::in_room(&scene::Placement::default(), &grid),
                eye_size_px: [width, width],
                quality: Quality::BALANCED,
                step_mm: None,
                depth_grid: DepthGridSize::default(),
            };
            let numbers = SceneNumbers { mode, ..numbers() };
            let plan = StereoPlan::new(&request, &grid, &numbers).unwrap();
            assert_eq!(plan.tiles(), [width.div_ceil(1 << plan.frame.tile_power); 2]);
            plan.frame.tile_power
        };
        let [left, right, ..] = Fov::symmetric(0.5, 0.5).unwrap().tangents();
        // At a metre's distance.
        let across_mm = (right - left) * 1000.0;
        for (apart_mm, expected) in [(0.1, 3), (1.49, 3), (1.51, 2), (2.99, 2), (3.01, 1), (50.0, 1)] {
            assert_eq!(power(apart_mm * 400.0 / across_mm, 400, Mode::Threshold), expected, "{apart_mm} mm");
        }
        // The maximum skips by what each ray has found: its rays share nothing.
        assert_eq!(power(3.0, 100, Mode::Maximum), 3);
    }

    #[test]
    fn no_eye_distance_plans_equal_eyes() {
        let head = Pose { position_m: DVec3::new(0.1, 1.4, 0.3), ..Pose::IDENTITY };
        let view = HeadGeometry::parallel(0.0, Fov::symmetric(0.5, 0.3).unwrap()).view(&head);
        let plan = request(&view.eyes, &grid());
        assert_eq!(plan.frame.eyes[0], plan.frame.eyes[1]);
    }

    #[test]
    fn what_cannot_be_drawn_is_refused_with_numbers() {
        let grid = grid();
        let eye = EyeView { world_from_eye: Pose::IDENTITY, fov: Fov::symmetric(0.5, 0.3).unwrap() };
        let plan = |eyes: &[EyeView], size, quality, step_mm| {
            StereoPlan::new(
                &StereoRequest {
                    eyes,
                    placed: Placed::own_axes(&grid),
                    eye_size_px: size,
                    quality,
                    step_mm,
                    depth_grid: DepthGridSize::default(),
                },
                &grid,
                &numbers(),
            )
        };
        assert!(matches!(plan(&[], [8, 8], Quality::FINE, None), Err(PlanError::Eyes(0))));
        assert!(matches!(plan(&[eye], [0, 8], Quality::FINE, None), Err(PlanError::Size(_))));
        let steps = Quality::BALANCED;
        assert!(matches!(plan(&[eye], [8, 8], steps, Some(1e-7)), Err(PlanError::Step { .. })));
        assert!(matches!(plan(&[eye], [8, 8], steps, Some(f64::NAN)), Err(PlanError::Step { .. })));
        let quality = Quality { resolution_scale: 0.0, ..Quality::FINE };
        assert!(matches!(plan(&[eye], [8, 8], quality, None), Err(PlanError::Quality { .. })));
        let turned =
            |orientation| EyeView { world_from_eye: Pose { orientation, ..eye.world_from_eye }, ..eye };
        for orientation in [DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DQuat::NAN, DQuat::IDENTITY * 1.1] {
            let refused = plan(&[eye, turned(orientation)], [8, 8], Quality::FINE, None);
            assert!(matches!(refused, Err(PlanError::Pose { eye: 1, .. })), "{orientation}");
        }
        let inside_out = EyeView { fov: Fov { left: 0.3, right: -0.3, up: 0.3, down: -0.3 }, ..eye };
        assert!(matches!(
            plan(&[inside_out], [8, 8], Quality::FINE, None),
            Err(PlanError::Fov { eye: 0, .. })
        ));
    }

    #[test]
    fn a_scene_without_light_asks_for_no_gradient() {
        let eye = EyeView { world_from_eye: Pose::IDENTITY, fov: Fov::symmetric(0.5, 0.3).unwrap() };
        assert!(!request(&[eye], &grid()).features.lit);
    }
}
