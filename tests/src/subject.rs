//! What is looked at: a small volume that looks different from every side, and scenes of it.

use scene::Mode;
use spatial::{DAffine3, DMat3, DVec3};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// Voxels along x (to the patient's left), y (posterior) and z (superior).
const DIMS: [u32; 3] = [48, 40, 32];
/// Not cubes: a picture that takes them for such is wrong.
const SPACING_MM: [f64; 3] = [8.0, 8.0, 10.0];
/// Half of what the volume measures in the room, which it stands in upright, facing the viewer.
const HALF_SIZE_M: [f64; 3] = [0.192, 0.16, 0.16];

/// The middle of the volume where no scene says otherwise, metres.
pub const CENTRE_IN_ROOM: DVec3 = DVec3::new(0.0, 1.5, -2.0);
/// Where the beacon lies in the volume: from -1 to 1 along each axis, to the patient's left, forwards, and up.
const BEACON: DVec3 = DVec3::new(0.55, -0.3, 0.5);
/// Where the brightest point lies in the room: left of the patient is right of who stands before it.
pub const BEACON_IN_ROOM: DVec3 = DVec3::new(
    CENTRE_IN_ROOM.x + BEACON.x * HALF_SIZE_M[0],
    CENTRE_IN_ROOM.y + BEACON.z * HALF_SIZE_M[2],
    CENTRE_IN_ROOM.z - BEACON.y * HALF_SIZE_M[1],
);

/// A shell around a core that does not lie in its middle, and a bright beacon at one corner; values 0 to 250.
#[must_use]
pub fn subject() -> Volume {
    volume_of(|p| {
        let bump = |at: DVec3, width: f64| (-((p - at).length() / width).powi(2)).exp();
        let shell = 140.0 * (-((p.length() - 0.62) / 0.14).powi(2)).exp();
        let core = 180.0 * bump(DVec3::new(-0.2, 0.1, -0.15), 0.28);
        let beacon = 250.0 * bump(BEACON, 0.2);
        shell.max(core).max(beacon)
    })
}

/// The beacon of [`subject`] alone.
#[must_use]
pub fn beacon() -> Volume {
    volume_of(|p| 250.0 * (-((p - BEACON).length() / 0.2).powi(2)).exp())
}

/// Steps of a series in time, from small to large values: something grows beside the core of [`subject`].
#[must_use]
pub fn growing(steps: u32) -> Vec<Volume> {
    let one = |step: u32| {
        let size = 0.2 + 0.5 * f64::from(step) / f64::from(steps);
        volume_of(|p| 240.0 * (-((p - DVec3::new(0.3, 0.0, -0.2)).length() / size).powi(2)).exp())
    };
    (0..steps).map(one).collect()
}

/// Labels about the core of [`subject`], on a coarser grid of their own: 1 before 2, nothing else.
#[must_use]
pub fn labels() -> Volume {
    const SIDE: u32 = 12;
    const VOXEL_MM: f64 = 14.0;
    let middle = (DVec3::from_array(DIMS.map(f64::from)) - 1.0) / 2.0 * DVec3::from_array(SPACING_MM);
    let half = DVec3::splat(f64::from(SIDE - 1) / 2.0);
    let mut voxels = Vec::new();
    for i in 0..SIDE.pow(3) {
        let at = DVec3::from_array([i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE].map(f64::from)) - half;
        voxels.push(if at.length() > 4.5 { 0 } else { 1 + u8::from(at.y > 0.0) });
    }
    let channel = Channel {
        name: "labels".into(),
        kind: ChannelKind::Label,
        voxels: Voxels::U8(voxels.into()),
        slope: 1.0,
        intercept: 0.0,
    };
    let volume_from_index = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::splat(VOXEL_MM)),
        middle - half * VOXEL_MM,
    );
    let grid = Grid::new([SIDE; 3], volume_from_index).expect("a grid");
    Volume::new(grid, vec![channel]).expect("as many voxels as the grid has")
}

/// A volume of values 0 to 255 from a function of the place, -1 to 1 along each axis.
fn volume_of(value: impl Fn(DVec3) -> f64) -> Volume {
    let [nx, ny, nz] = DIMS;
    let along = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
    let mut voxels = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let at = DVec3::new(along(x, nx), along(y, ny), along(z, nz));
                voxels.push(value(at).round().clamp(0.0, 255.0) as u8);
            }
        }
    }
    let channel = Channel {
        name: "density".into(),
        kind: ChannelKind::Intensity,
        voxels: Voxels::U8(voxels.into()),
        slope: 1.0,
        intercept: 0.0,
    };
    let grid = Grid::axis_aligned(DIMS, DVec3::from_array(SPACING_MM)).expect("a grid");
    Volume::new(grid, vec![channel]).expect("as many voxels as the grid has")
}

/// Colours that tell the parts of [`subject`] apart; strong ones, so that a wrong colour matrix is seen.
const TRANSFER: &str = "[[15, 0.1, 0.2, 0.7, 0], [130, 0.2, 0.4, 0.9, 0.004], [175, 0.9, 0.3, 0.2, 0.02], \
                        [250, 1, 0.9, 0.2, 0.1]]";

/// A scene of [`subject`] in a mode.
#[must_use]
pub fn scene_of_mode(mode: Mode) -> String {
    // The maximum takes opacities as they stand.
    let transfer = match mode {
        Mode::Maximum => "[[15, 0.1, 0.2, 0.7, 0], [140, 0.2, 0.5, 0.9, 0.6], [250, 1, 0.9, 0.2, 1]]",
        _ => TRANSFER,
    };
    format!(
        r#"{{"mode": "{}", "transfer": {transfer}, "threshold": 90, "window": [0, 120], "shade": true,
            "surface_color": [0.9, 0.6, 0.5]}}"#,
        mode.name()
    )
}

/// The volume-rendered scene of [`subject`], with more fields.
#[must_use]
pub fn scene_with(fields: &str) -> String {
    format!(r#"{{"transfer": {TRANSFER}, "shade": true, {fields}}}"#)
}
