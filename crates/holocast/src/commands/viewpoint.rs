//! From where a scene is seen when nobody wears a headset.

use crate::commands::shown::Shown;
use ::render::Placed;
use anyhow::Context as _;
use scene::Scene;
use spatial::{DVec3, EyeView, Fov, HeadGeometry, Pose};
use volume::Grid;

/// Size of a still that neither the scene nor the command line gives.
const DEFAULT_SIZE_PX: [u32; 2] = [1280, 720];
/// Vertical field of view of a still without a camera, radians.
const DEFAULT_FOV_Y: f64 = std::f64::consts::FRAC_PI_6;

/// One eye or two before a scene.
pub(crate) struct Viewpoint {
    pub(crate) placed: Placed,
    /// One, or left and right.
    pub(crate) eyes: Vec<EyeView>,
    pub(crate) eye_size_px: [u32; 2],
}

impl Viewpoint {
    /// The scene's camera, or a place before the hologram. `size_px` goes before the scene's own; two eyes if they have
    /// a distance, in millimetres.
    pub(crate) fn of(
        shown: &Shown,
        grid: &Grid,
        size_px: Option<[u32; 2]>,
        eye_distance_mm: Option<f64>,
    ) -> anyhow::Result<Self> {
        let eye_size_px = size_px.or(shown.file.size).unwrap_or(DEFAULT_SIZE_PX);
        let (placed, head, fov) = point_of_view(shown, grid, eye_size_px)?;
        let eyes = match eye_distance_mm {
            Some(distance_mm) => {
                // Eyes are given in the unit of the space they look at: metres in the room, millimetres of the volume for
                // a scene's own camera.
                let unit_per_mm = if shown.file.camera.is_some() { 1.0 } else { 1.0e-3 };
                HeadGeometry::parallel(distance_mm * unit_per_mm, fov).view(&head).eyes.to_vec()
            }
            None => vec![EyeView { world_from_eye: head, fov }],
        };
        Ok(Self { placed, eyes, eye_size_px })
    }
}

impl Viewpoint {
    /// An eye before the hologram in the room, from where all of the volume is in the picture.
    pub(crate) fn before(grid: &Grid, scene: &Scene, size_px: [u32; 2]) -> anyhow::Result<(Placed, EyeView)> {
        Self::looking(grid, scene, DVec3::new(-0.25, -0.15, -1.0), DVec3::Y, size_px)
    }

    /// An eye that looks straight along an axis of the volume onto its slices, as a reader of films does: from the feet,
    /// the front or the left, with the patient's right, or else the front, on the left of the picture.
    pub(crate) fn onto_slices(
        grid: &Grid,
        scene: &Scene,
        axis: usize,
        size_px: [u32; 2],
    ) -> anyhow::Result<(Placed, EyeView)> {
        let normal = grid.directions().col(axis);
        let largest = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(2);
        // Patient axes run to left, posterior and superior.
        let [seen_along, up] =
            [[DVec3::NEG_X, DVec3::Z], [DVec3::Y, DVec3::Z], [DVec3::Z, DVec3::NEG_Y]][largest];
        let ahead = normal * normal.dot(seen_along).signum();
        let world_from_volume = scene.placement.world_from_volume(grid).matrix3;
        Self::looking(grid, scene, world_from_volume * ahead, world_from_volume * up, size_px)
    }

    /// An eye that looks at the volume's middle from so far that all of it is in the picture.
    fn looking(
        grid: &Grid,
        scene: &Scene,
        ahead: DVec3,
        up: DVec3,
        [width, height]: [u32; 2],
    ) -> anyhow::Result<(Placed, EyeView)> {
        let placement = scene.placement;
        let fov = Fov::from_vertical(DEFAULT_FOV_Y, f64::from(width) / f64::from(height))?;
        // Far enough that the volume's diagonal fills most of the picture's lower side.
        let size_m = grid.size_mm().length() / placement.volume_mm_per_world_m();
        let narrower = DEFAULT_FOV_Y.min(fov.right - fov.left);
        let centre = DVec3::from_array(placement.position_m);
        let at = centre - ahead.normalize() * (size_m * 0.45 / (narrower / 2.0).tan());
        let pose =
            Pose::looking_at(at, centre, up.normalize()).context("no point of view before the hologram")?;
        Ok((Placed::in_room(&placement, grid), EyeView { world_from_eye: pose, fov }))
    }
}

/// Where the head is: the scene's camera in the volume's own millimetres, or before the hologram in the room.
fn point_of_view(
    shown: &Shown,
    grid: &Grid,
    [width, height]: [u32; 2],
) -> anyhow::Result<(Placed, Pose, Fov)> {
    if let Some(camera) = &shown.file.camera {
        let pose = camera.pose_mm().context("the scene's camera does not span a picture")?;
        return Ok((Placed::own_axes(grid), pose, camera.fov(width, height)?));
    }
    let (placed, eye) = Viewpoint::before(grid, &shown.scene, [width, height])?;
    Ok((placed, eye.world_from_eye, eye.fov))
}
