//! From where a scene is seen when nobody wears a headset.

use crate::commands::shown::Shown;
use ::render::Placed;
use anyhow::Context as _;
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
    let placement = shown.scene.placement;
    let fov = Fov::from_vertical(DEFAULT_FOV_Y, f64::from(width) / f64::from(height))?;
    // Far enough that the volume's diagonal fills most of the picture's lower side.
    let size_m = grid.size_mm().length() / placement.volume_mm_per_world_m();
    let narrower = DEFAULT_FOV_Y.min(fov.right - fov.left);
    let centre = DVec3::from_array(placement.position_m);
    let at = centre + DVec3::new(0.25, 0.15, 1.0).normalize() * (size_m * 0.45 / (narrower / 2.0).tan());
    let pose = Pose::looking_at(at, centre, DVec3::Y).context("no point of view before the hologram")?;
    Ok((Placed::in_room(&placement, grid), pose, fov))
}
