//! Where the volume lies in the room.

use crate::error::{SceneError, within};
use spatial::{DAffine3, DMat3, DQuat, DVec3};
use volume::Grid;

/// Metres of room a millimetre of patient takes at scale 1.
const M_PER_MM: f64 = 1.0e-3;

/// Where the middle of the volume lies in the room, and how it is turned and enlarged.
///
/// Not turned, the patient stands upright and faces the viewer: superior is +Y, the patient's left is +X, anterior +Z.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Placement {
    /// The middle of the volume, metres in the room. Default: eye height, at the headset's focal plane 2 m ahead.
    pub position_m: [f64; 3],
    /// Turn about the vertical, degrees.
    pub yaw_deg: f64,
    /// Then about the volume's left-right axis, degrees.
    pub pitch_deg: f64,
    /// Then about its front-back axis, degrees.
    pub roll_deg: f64,
    /// 1 shows the patient at life size.
    pub scale: f64,
}

impl Default for Placement {
    fn default() -> Self {
        Self { position_m: [0.0, 1.5, -2.0], yaw_deg: 0.0, pitch_deg: 0.0, roll_deg: 0.0, scale: 1.0 }
    }
}

impl Placement {
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        for x in self.position_m {
            within("placement.position_m", x, -1.0e4..=1.0e4, "within 10 000 m")?;
        }
        for (field, x) in [
            ("placement.yaw_deg", self.yaw_deg),
            ("placement.pitch_deg", self.pitch_deg),
            ("placement.roll_deg", self.roll_deg),
        ] {
            within(field, x, -360.0..=360.0, "-360 to 360 degrees")?;
        }
        within("placement.scale", self.scale, 1.0e-4..=1.0e4, "0.0001 to 10 000")?;
        Ok(())
    }

    /// From patient millimetres (LPS) to the room, in metres.
    #[must_use]
    pub fn world_from_volume(&self, grid: &Grid) -> DAffine3 {
        // Columns: where the patient's left, posterior and superior point in the room.
        let upright = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let turn = DQuat::from_rotation_y(self.yaw_deg.to_radians())
            * DQuat::from_rotation_x(self.pitch_deg.to_radians())
            * DQuat::from_rotation_z(self.roll_deg.to_radians());
        let linear = DMat3::from_quat(turn) * upright * (M_PER_MM * self.scale);
        let centre = linear * grid.centre_in_volume();
        DAffine3::from_mat3_translation(linear, DVec3::from_array(self.position_m) - centre)
    }

    /// Millimetres of patient that a metre of room is.
    #[must_use]
    pub fn volume_mm_per_world_m(&self) -> f64 {
        1.0 / (M_PER_MM * self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_patient_stands_and_faces_the_viewer() {
        let grid = Grid::axis_aligned([11, 21, 31], DVec3::new(2.0, 2.0, 2.0)).unwrap();
        let world = Placement::default().world_from_volume(&grid);
        let centre = grid.centre_in_volume();
        let at = |v: DVec3| world.transform_point3(centre + v) - DVec3::new(0.0, 1.5, -2.0);
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
        near(at(DVec3::ZERO), DVec3::ZERO);
        near(at(DVec3::new(1000.0, 0.0, 0.0)), DVec3::X);
        near(at(DVec3::new(0.0, -1000.0, 0.0)), DVec3::Z);
        near(at(DVec3::new(0.0, 0.0, 1000.0)), DVec3::Y);
        assert!(world.matrix3.determinant() > 0.0, "left stays left");
    }
}
