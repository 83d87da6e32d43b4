//! The value and its gradient at a point: the trilinear interpolation of the samples.

use spatial::{DMat3, DVec3};
use volume::{Channel, Grid};

/// The clamped trilinear field of one channel, as `docs/picture.md` defines it.
///
/// Clamping each coordinate to the outermost centres is the same as repeating the outermost samples for ever. So every
/// cell, the half ones at the border too, has eight corners (some of them the same sample), and the central difference
/// inside a cell is the trilinear interpolation of the central differences at its corners.
#[derive(Clone, Debug)]
pub struct Field<'a> {
    channel: &'a Channel,
    dims: [u32; 3],
    /// Added to each value: 0, but where an uncertainty of the value is looked into.
    offset: f64,
    mm_from_index: DMat3,
    /// Takes a gradient by index to one by millimetre: the inverse transpose of the voxel axes.
    per_mm_from_per_voxel: DMat3,
}

impl<'a> Field<'a> {
    /// The field of a channel on its grid. The channel must have as many samples as the grid, as a volume's have.
    #[must_use]
    pub fn new(channel: &'a Channel, grid: &Grid) -> Self {
        let mm_from_index = grid.volume_from_index().matrix3;
        Self {
            channel,
            dims: grid.dims(),
            offset: 0.0,
            mm_from_index,
            per_mm_from_per_voxel: mm_from_index.inverse().transpose(),
        }
    }

    /// The same field with every value higher by `offset`.
    #[must_use]
    pub(crate) fn raised(&self, offset: f64) -> Self {
        Self { offset: self.offset + offset, ..self.clone() }
    }

    /// Voxels along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// The corners of the border, voxel index.
    pub(crate) fn border(&self) -> [DVec3; 8] {
        let most = DVec3::from_array(self.dims.map(f64::from)) - 0.5;
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 1 { most[axis] } else { -0.5 };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Takes index vectors to millimetres of the volume.
    #[must_use]
    pub fn mm_from_index(&self) -> DMat3 {
        self.mm_from_index
    }

    /// The value at a point in index space (centre of the first voxel: 0, 0, 0), each coordinate clamped to the
    /// outermost centre.
    #[must_use]
    pub fn value(&self, at_in_index: DVec3) -> f64 {
        let (corners, f, _) = self.clamped_cell(at_in_index);
        let along_x = |i: usize| mix(corners[i], corners[i + 1], f.x);
        mix(mix(along_x(0), along_x(2), f.y), mix(along_x(4), along_x(6), f.y), f.z)
    }

    /// The gradient that lights the picture: the central difference over one voxel each way, in values a voxel.
    #[must_use]
    pub fn gradient_per_voxel(&self, at_in_index: DVec3) -> DVec3 {
        let along = |axis: DVec3| (self.value(at_in_index + axis) - self.value(at_in_index - axis)) / 2.0;
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// The gradient that lights the picture, in values a millimetre, along the patient's axes.
    #[must_use]
    pub fn gradient_per_mm(&self, at_in_index: DVec3) -> DVec3 {
        self.per_mm(self.gradient_per_voxel(at_in_index))
    }

    /// The derivative of the interpolation itself, in values a voxel: 0 along an axis on which the point lies beyond the
    /// outermost centre; on a cell's face, where it jumps, that of the cell above.
    #[must_use]
    pub fn analytic_gradient_per_voxel(&self, at_in_index: DVec3) -> DVec3 {
        let (c, f, inside) = self.clamped_cell(at_in_index);
        let bilinear = |a: [f64; 4], u: f64, v: f64| mix(mix(a[0], a[1], u), mix(a[2], a[3], u), v);
        let x = bilinear([c[1] - c[0], c[3] - c[2], c[5] - c[4], c[7] - c[6]], f.y, f.z);
        let y = bilinear([c[2] - c[0], c[3] - c[1], c[6] - c[4], c[7] - c[5]], f.x, f.z);
        let z = bilinear([c[4] - c[0], c[5] - c[1], c[6] - c[2], c[7] - c[3]], f.x, f.y);
        DVec3::new(x, y, z) * DVec3::from_array(inside.map(|i| f64::from(u8::from(i))))
    }

    /// The derivative of the interpolation itself, in values a millimetre, along the patient's axes.
    #[must_use]
    pub fn analytic_gradient_per_mm(&self, at_in_index: DVec3) -> DVec3 {
        self.per_mm(self.analytic_gradient_per_voxel(at_in_index))
    }

    /// Takes a gradient by index to one by millimetre.
    pub(crate) fn per_mm_from_per_voxel(&self) -> DMat3 {
        self.per_mm_from_per_voxel
    }

    /// A gradient by index as one by millimetre.
    #[must_use]
    pub(crate) fn per_mm(&self, gradient_per_voxel: DVec3) -> DVec3 {
        self.per_mm_from_per_voxel * gradient_per_voxel
    }

    /// The eight samples around a cell, which lies between the centres `cell` and `cell + 1`; -1 and the last centre
    /// make the half cells at the border. Order as [`crate::Cubic::across`] takes them.
    pub(crate) fn corners(&self, cell: [i32; 3]) -> [f64; 8] {
        let [xs, ys, zs] = [0, 1, 2].map(|axis| [0, 1].map(|far| self.held(axis, cell[axis] + far)));
        std::array::from_fn(|i| self.sample(xs[i & 1], ys[i >> 1 & 1], zs[i >> 2]))
    }

    /// The central differences along x, y and z at the eight corners of a cell, in values a voxel.
    pub(crate) fn gradient_corners(&self, cell: [i32; 3]) -> [[f64; 8]; 3] {
        // The samples from one before the cell to one after it along each axis.
        let [xs, ys, zs]: [[usize; 4]; 3] =
            std::array::from_fn(|axis| [-1, 0, 1, 2].map(|offset| self.held(axis, cell[axis] + offset)));
        let at = |x: usize, y: usize, z: usize| self.sample(xs[x], ys[y], zs[z]);
        let corner = |i: usize| (1 + (i & 1), 1 + (i >> 1 & 1), 1 + (i >> 2));
        let difference = |low: f64, high: f64| (high - low) / 2.0;
        [
            std::array::from_fn(|i| {
                let (x, y, z) = corner(i);
                difference(at(x - 1, y, z), at(x + 1, y, z))
            }),
            std::array::from_fn(|i| {
                let (x, y, z) = corner(i);
                difference(at(x, y - 1, z), at(x, y + 1, z))
            }),
            std::array::from_fn(|i| {
                let (x, y, z) = corner(i);
                difference(at(x, y, z - 1), at(x, y, z + 1))
            }),
        ]
    }

    /// The label of a voxel.
    pub(crate) fn label(&self, voxel: [i32; 3]) -> i64 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.held(axis, voxel[axis]));
        let at = (z * self.dims[1] as usize + y) * self.dims[0] as usize + x;
        self.channel.label_of(self.channel.voxels.stored(at))
    }

    /// The largest absolute value of any sample.
    pub(crate) fn largest_magnitude(&self) -> f64 {
        (0..self.channel.voxels.len()).map(|at| self.channel.value(at).abs()).fold(0.0, f64::max)
    }

    /// The corners of the cell around a point, where in it the clamped point lies (0 to 1), and along which axes the
    /// point was not clamped.
    fn clamped_cell(&self, at_in_index: DVec3) -> ([f64; 8], DVec3, [bool; 3]) {
        let mut cell = [0; 3];
        let mut fraction = DVec3::ZERO;
        let mut inside = [false; 3];
        for axis in 0..3 {
            let last = f64::from(self.dims[axis] - 1);
            let clamped = at_in_index[axis].clamp(0.0, last);
            let floor = clamped.floor().min((last - 1.0).max(0.0));
            cell[axis] = floor as i32;
            fraction[axis] = clamped - floor;
            inside[axis] = (0.0..last).contains(&at_in_index[axis]);
        }
        (self.corners(cell), fraction, inside)
    }

    fn held(&self, axis: usize, at: i32) -> usize {
        at.clamp(0, self.dims[axis] as i32 - 1) as usize
    }

    fn sample(&self, x: usize, y: usize, z: usize) -> f64 {
        let at = (z * self.dims[1] as usize + y) * self.dims[0] as usize + x;
        self.channel.value(at) + self.offset
    }
}

fn mix(a: f64, b: f64, fraction: f64) -> f64 {
    a + (b - a) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use spatial::{DAffine3, DQuat};
    use volume::{ChannelKind, Voxels};

    fn channel(samples: Vec<f32>) -> Channel {
        Channel {
            name: "test".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::F32(samples.into()),
            slope: 2.0,
            intercept: -3.0,
        }
    }

    fn noise(dims: [u32; 3]) -> (Channel, Grid) {
        let grid = Grid::axis_aligned(dims, DVec3::ONE).unwrap();
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / 1e6
        };
        (channel((0..grid.voxel_count()).map(|_| next()).collect()), grid)
    }

    #[test]
    fn samples_are_met_and_the_border_holds_the_nearest() {
        let grid = Grid::axis_aligned([2, 1, 2], DVec3::ONE).unwrap();
        let c = channel(vec![0.0, 1.0, 2.0, 3.0]);
        let field = Field::new(&c, &grid);
        assert_eq!(field.value(DVec3::ZERO), -3.0);
        assert_eq!(field.value(DVec3::new(1.0, 0.0, 1.0)), 3.0);
        assert_eq!(field.value(DVec3::new(1.5, 0.5, 1.5)), 3.0);
        assert_eq!(field.value(DVec3::new(-0.5, -0.5, -0.5)), -3.0);
        assert_eq!(field.value(DVec3::new(0.5, 0.3, 0.5)), 0.0);
        assert_eq!(field.gradient_per_voxel(DVec3::new(0.5, 0.3, 0.5)), DVec3::new(1.0, 0.0, 2.0));
        assert_eq!(field.analytic_gradient_per_voxel(DVec3::new(0.5, 0.3, 0.5)), DVec3::new(2.0, 0.0, 4.0));
    }

    #[test]
    fn one_voxel_is_constant_and_has_no_gradient() {
        let grid = Grid::axis_aligned([1, 1, 1], DVec3::ONE).unwrap();
        let c = channel(vec![5.0]);
        let field = Field::new(&c, &grid);
        for p in [DVec3::ZERO, DVec3::splat(0.5), DVec3::new(-0.5, 0.2, 0.1)] {
            assert_eq!(field.value(p), 7.0);
            assert_eq!(field.gradient_per_mm(p), DVec3::ZERO);
            assert_eq!(field.analytic_gradient_per_mm(p), DVec3::ZERO);
        }
    }

    #[test]
    fn a_plane_has_its_own_gradient_under_anisotropic_oblique_axes() {
        // The field is n·x in millimetres, on voxels of 0.1 × 0.1 × 5 mm that stand oblique: M^(-T)·∇index is n.
        let n = DVec3::new(0.3, -1.2, 0.7);
        let axes = DMat3::from_quat(DQuat::from_euler(Default::default(), 0.4, -0.7, 1.1))
            * DMat3::from_diagonal(DVec3::new(0.1, 0.1, 5.0));
        let grid = Grid::new([5, 6, 4], DAffine3::from_mat3(axes)).unwrap();
        let mut samples = Vec::new();
        for z in 0..4 {
            for y in 0..6 {
                for x in 0..5 {
                    samples.push(n.dot(axes * DVec3::new(f64::from(x), f64::from(y), f64::from(z))) as f32);
                }
            }
        }
        // Values are rounded to float32, by at most 2⁻²⁴ of 15; over a voxel of 0.1 mm that is 1.8e-5 a millimetre.
        let c = Channel { slope: 1.0, intercept: 0.0, ..channel(samples) };
        let field = Field::new(&c, &grid);
        let p = DVec3::new(2.3, 3.1, 1.6);
        assert!((field.gradient_per_mm(p) - n).length() < 3e-5, "{}", field.gradient_per_mm(p));
        assert!((field.analytic_gradient_per_mm(p) - n).length() < 6e-5);
    }

    proptest! {
        #[test]
        fn a_cell_s_corners_give_the_clamped_central_difference(
            dims in prop::array::uniform3(1..5u32),
            place in prop::array::uniform3(0.0..1.0f64),
        ) {
            let (c, grid) = noise(dims);
            let field = Field::new(&c, &grid);
            let p = DVec3::from_array(std::array::from_fn(|i| place[i] * f64::from(dims[i]) - 0.5));
            let cell = p.floor();
            let f = p - cell;
            let cell = cell.to_array().map(|i| i as i32);
            let at = |corners: &[f64; 8]| crate::Cubic::across(corners, f, f).at(0.0);
            prop_assert!((at(&field.corners(cell)) - field.value(p)).abs() < 1e-11);
            let gradient = field.gradient_per_voxel(p);
            for (axis, corners) in field.gradient_corners(cell).iter().enumerate() {
                prop_assert!((at(corners) - gradient[axis]).abs() < 1e-11);
            }
        }

        #[test]
        fn the_analytic_gradient_is_the_slope_of_the_value(place in prop::array::uniform3(0.01..0.99f64)) {
            let (c, grid) = noise([4, 3, 5]);
            let field = Field::new(&c, &grid);
            let p = DVec3::from_array(place) + DVec3::new(1.0, 0.0, 2.0);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                // Linear along an axis inside a cell: any step gives the slope.
                let slope = (field.value(p + axis * 0.005) - field.value(p - axis * 0.005)) / 0.01;
                prop_assert!((slope - field.analytic_gradient_per_voxel(p).dot(axis)).abs() < 1e-9);
            }
        }
    }
}
