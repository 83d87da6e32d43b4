//! Where the voxels lie in the patient.

use spatial::{DAffine3, DMat3, DQuat, DVec3};

/// Smallest and largest distance between voxel centres, in millimetres.
const SPACING_MM: std::ops::RangeInclusive<f64> = 1.0e-6..=1.0e3;
/// Axes nearer to one plane than this (volume of the unit parallelepiped) do not span space.
const FLATTEST: f64 = 1.0e-6;
/// Most voxels along one axis: what fits a signed 16-bit count, beyond any scanner.
const LONGEST_AXIS: u32 = 32_767;

/// Dimensions and placement of a voxel grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    dims: [u32; 3],
    volume_from_index: DAffine3,
}

/// Why numbers from a header are not a grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// An axis without voxels, or with more than any scanner makes.
    #[error("volume of {0:?} voxels: each axis must have 1 to {LONGEST_AXIS}")]
    Dims([u32; 3]),
    /// A number of the transform is NaN or infinite.
    #[error("the transform from voxels to millimetres has a number that is not finite")]
    NotFinite,
    /// Voxels are too near or too far from each other.
    #[error("voxel spacing {spacing_mm} mm: each must be within {} to {} mm", SPACING_MM.start(), SPACING_MM.end())]
    Spacing {
        /// Spacing along x, y and z in millimetres.
        spacing_mm: DVec3,
    },
    /// The axes lie in one plane.
    #[error("the voxel axes lie in one plane: their directions span a volume of {0:.2e}, expected about 1")]
    Flat(f64),
}

impl Grid {
    /// A grid of `dims` voxels; `volume_from_index` takes a voxel's index (centre of the first: 0, 0, 0) to
    /// patient millimetres (LPS).
    ///
    /// # Errors
    /// If an axis is empty or absurd, a number is not finite, a spacing lies outside 1e-6 to 1e3 mm, or the axes are
    /// nearly in one plane.
    pub fn new(dims: [u32; 3], volume_from_index: DAffine3) -> Result<Self, GridError> {
        if dims.iter().any(|d| !(1..=LONGEST_AXIS).contains(d)) {
            return Err(GridError::Dims(dims));
        }
        if !volume_from_index.is_finite() {
            return Err(GridError::NotFinite);
        }
        let grid = Self { dims, volume_from_index };
        let spacing_mm = grid.spacing_mm();
        if spacing_mm.to_array().iter().any(|s| !SPACING_MM.contains(s)) {
            return Err(GridError::Spacing { spacing_mm });
        }
        let spanned = grid.directions().determinant().abs();
        if spanned < FLATTEST {
            return Err(GridError::Flat(spanned));
        }
        Ok(grid)
    }

    /// A grid along the patient's axes with its first voxel's centre at the origin; spacing in millimetres.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn axis_aligned(dims: [u32; 3], spacing_mm: DVec3) -> Result<Self, GridError> {
        Self::new(dims, DAffine3::from_scale(spacing_mm))
    }

    /// Voxels along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// The product of the dimensions.
    #[must_use]
    pub fn voxel_count(&self) -> usize {
        self.dims.iter().map(|&d| d as usize).product()
    }

    /// From voxel index to patient millimetres.
    #[must_use]
    pub fn volume_from_index(&self) -> DAffine3 {
        self.volume_from_index
    }

    /// From texture coordinates ([0, 1] over the whole volume, border to border) to voxel index.
    #[must_use]
    pub fn index_from_texture(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.dims_f64(), DQuat::IDENTITY, DVec3::splat(-0.5))
    }

    /// Distance between neighbouring centres along each axis, in millimetres.
    #[must_use]
    pub fn spacing_mm(&self) -> DVec3 {
        let m = self.volume_from_index.matrix3;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }

    /// Unit directions of the voxel axes in the patient, as columns.
    #[must_use]
    pub fn directions(&self) -> DMat3 {
        let (m, s) = (self.volume_from_index.matrix3, self.spacing_mm());
        DMat3::from_cols(m.x_axis / s.x, m.y_axis / s.y, m.z_axis / s.z)
    }

    /// Extent of the volume along its own axes, border to border, in millimetres.
    #[must_use]
    pub fn size_mm(&self) -> DVec3 {
        self.dims_f64() * self.spacing_mm()
    }

    /// The middle of the volume in patient millimetres.
    #[must_use]
    pub fn centre_in_volume(&self) -> DVec3 {
        self.volume_from_index.transform_point3((self.dims_f64() - 1.0) / 2.0)
    }

    /// The same voxels along their own axes: spacing kept, orientation and origin dropped. This is the space in which
    /// scenes that give a camera in "the volume's own millimetres" are meant.
    #[must_use]
    pub fn own_axes_from_index(&self) -> DAffine3 {
        DAffine3::from_scale(self.spacing_mm())
    }

    /// Where the stored axes point, as three letters (`LPS`, `RAS`, …), and the largest angle in degrees between an
    /// axis and the patient axis it is named after.
    #[must_use]
    pub fn orientation(&self) -> (String, f64) {
        let directions = self.directions();
        let mut worst = 0.0f64;
        let mut taken = [false; 3];
        let letters = (0..3)
            .map(|i| {
                let d = directions.col(i);
                let free = |axis: &usize| !taken[*axis];
                let axis = (0..3)
                    .filter(free)
                    .max_by(|&a, &b| d[a].abs().total_cmp(&d[b].abs()))
                    .unwrap_or_default();
                taken[axis] = true;
                worst = worst.max(d[axis].abs().clamp(0.0, 1.0).acos().to_degrees());
                [['R', 'L'], ['A', 'P'], ['I', 'S']][axis][usize::from(d[axis] > 0.0)]
            })
            .collect();
        (letters, worst)
    }

    /// Whether the stored axes form a left-handed system.
    #[must_use]
    pub fn is_left_handed(&self) -> bool {
        self.volume_from_index.matrix3.determinant() < 0.0
    }

    fn dims_f64(&self) -> DVec3 {
        DVec3::from_array(self.dims.map(f64::from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_no_grid() {
        let one = DVec3::ONE;
        assert!(matches!(Grid::axis_aligned([0, 1, 1], one), Err(GridError::Dims(_))));
        assert!(matches!(Grid::axis_aligned([1, 1, 1 << 31], one), Err(GridError::Dims(_))));
        assert!(matches!(
            Grid::axis_aligned([1, 1, 1], DVec3::new(1.0, 0.0, 1.0)),
            Err(GridError::Spacing { .. })
        ));
        assert!(matches!(Grid::axis_aligned([1, 1, 1], DVec3::NAN), Err(GridError::NotFinite)));
        let flat = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z));
        assert!(matches!(Grid::new([2, 2, 2], flat), Err(GridError::Flat(_))));
    }

    #[test]
    fn accepts_spacing_from_a_nanometre_to_a_metre() {
        for s in [1e-6, 0.1, 1e3] {
            Grid::axis_aligned([4, 4, 4], DVec3::new(s, s, 5.0)).unwrap();
        }
    }

    #[test]
    fn names_the_axes() {
        let with = |m: DMat3| Grid::new([2, 2, 2], DAffine3::from_mat3(m)).unwrap();
        assert_eq!(with(DMat3::IDENTITY).orientation().0, "LPS");
        let ras = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        assert_eq!(with(ras).orientation().0, "RAS");
        assert!(!with(ras).is_left_handed());
        assert!(with(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))).is_left_handed());
        let oblique = DMat3::from_quat(DQuat::from_rotation_z(12f64.to_radians()));
        let (letters, angle_deg) = with(oblique).orientation();
        assert_eq!(letters, "LPS");
        assert!((angle_deg - 12.0).abs() < 1e-9);
    }

    #[test]
    fn texture_corners_lie_half_a_voxel_outside() {
        let grid = Grid::axis_aligned([4, 1, 10], DVec3::new(2.0, 3.0, 0.5)).unwrap();
        let corner =
            |t| grid.volume_from_index().transform_point3(grid.index_from_texture().transform_point3(t));
        assert_eq!(corner(DVec3::ZERO), DVec3::new(-1.0, -1.5, -0.25));
        assert_eq!(corner(DVec3::ONE), DVec3::new(7.0, 1.5, 4.75));
        assert_eq!(corner(DVec3::splat(0.5)), grid.centre_in_volume());
        assert_eq!(grid.size_mm(), DVec3::new(8.0, 3.0, 5.0));
    }
}
