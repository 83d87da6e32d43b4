//! Rays through a grid and the cells they pass.

use crate::ReferenceError;
use scene::Camera;
use spatial::{DAffine3, DMat3, DVec3, EyeView};
use volume::Grid;

/// Where the eye is and what it sees, as seen from a grid.
#[derive(Clone, Copy, Debug)]
pub struct RaySetup {
    index_from_world: DAffine3,
    mm_from_index: DMat3,
    eye: EyeView,
}

impl RaySetup {
    /// An eye in the room: `volume_from_world` takes metres of the room to patient millimetres, the inverse of
    /// [`scene::Placement::world_from_volume`].
    #[must_use]
    pub fn in_room(grid: &Grid, volume_from_world: DAffine3, eye: EyeView) -> Self {
        Self::new(grid, grid.volume_from_index().inverse() * volume_from_world, eye)
    }

    /// An eye anywhere: `index_from_world` takes the space of its pose to voxel index, lengths being millimetres of the
    /// volume whatever that space measures in.
    #[must_use]
    pub fn new(grid: &Grid, index_from_world: DAffine3, eye: EyeView) -> Self {
        Self { index_from_world, mm_from_index: grid.volume_from_index().matrix3, eye }
    }

    /// A scene file's camera, which is given along the grid's own axes, for a picture of square pixels.
    ///
    /// # Errors
    /// If eye, target and up do not span a picture, or it is wider than 85° off the axis.
    pub fn of_camera(
        grid: &Grid,
        camera: &Camera,
        width_px: u32,
        height_px: u32,
    ) -> Result<Self, ReferenceError> {
        let world_from_eye = camera.pose_mm().ok_or(ReferenceError::Camera)?;
        let fov = camera.fov(width_px, height_px)?;
        Ok(Self::new(grid, grid.own_axes_from_index().inverse(), EyeView { world_from_eye, fov }))
    }

    /// The ray from the eye through a place in the picture; `x` and `y` run from 0 to 1, from the upper left corner.
    #[must_use]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let ahead = self.eye.world_from_eye.orientation * self.eye.fov.ray(x, y);
        let direction = self.index_from_world.matrix3 * ahead;
        let origin = self.index_from_world.transform_point3(self.eye.world_from_eye.position_m);
        Ray { origin, direction: direction / (self.mm_from_index * direction).length() }
    }

    /// The ray through the centre of a pixel, counted from the upper left.
    #[must_use]
    pub fn pixel_ray(&self, x: u32, y: u32, width: u32, height: u32) -> Ray {
        let at = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(n);
        self.ray(at(x, width), at(y, height))
    }
}

/// A ray in index space, whose parameter is the distance from its origin in millimetres of the volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The eye, voxel index.
    pub origin: DVec3,
    /// Voxels a millimetre: a vector one millimetre long, as index.
    pub direction: DVec3,
}

/// A stretch of a ray, millimetres from its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Where it begins.
    pub from_mm: f64,
    /// Where it ends, beyond the beginning.
    pub to_mm: f64,
}

impl Way {
    /// Its length, millimetres.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.to_mm - self.from_mm
    }
}

impl Ray {
    /// The point at a distance, voxel index.
    #[must_use]
    pub fn at(&self, distance_mm: f64) -> DVec3 {
        self.origin + self.direction * distance_mm
    }

    /// Refuses numbers that are no ray.
    pub(crate) fn check(&self) -> Result<(), ReferenceError> {
        if self.origin.is_finite() && self.direction.is_finite() && self.direction != DVec3::ZERO {
            return Ok(());
        }
        let (origin, direction) = (self.origin.to_array(), self.direction.to_array());
        Err(ReferenceError::Ray { origin, direction })
    }

    /// The way inside the border of a grid of `dims` voxels, from the origin onwards. The border itself is inside; a ray
    /// that only touches it in a point has no way.
    #[must_use]
    pub fn inside(&self, dims: [u32; 3]) -> Option<Way> {
        let (mut from_mm, mut to_mm) = (0.0f64, f64::INFINITY);
        for (axis, dim) in dims.into_iter().enumerate() {
            let (origin, direction) = (self.origin[axis], self.direction[axis]);
            let (low, high) = (-0.5, f64::from(dim) - 0.5);
            if direction == 0.0 {
                if !(low..=high).contains(&origin) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin) / direction, (high - origin) / direction);
            from_mm = from_mm.max(a.min(b));
            to_mm = to_mm.min(a.max(b));
        }
        (from_mm < to_mm && to_mm.is_finite()).then_some(Way { from_mm, to_mm })
    }

    /// The cells along a way, in order. Their ends meet; together they are the way.
    pub(crate) fn cells(&self, dims: [u32; 3], way: Way) -> Cells {
        let mut next_plane = [0i32; 3];
        for axis in 0..3 {
            let (d, last) = (self.direction[axis], dims[axis] as i32 - 1);
            let at = self.at(way.from_mm)[axis].clamp(-1.0, f64::from(last) + 1.0);
            // One plane too early, so that rounding cannot skip one; those already behind are passed at once.
            next_plane[axis] = if d > 0.0 {
                (at.ceil() as i32 - 1).max(0)
            } else if d < 0.0 {
                (at.floor() as i32 + 1).min(last)
            } else {
                at.floor() as i32 + 1
            };
        }
        let mut cells = Cells { ray: *self, dims, next_plane, at_mm: way.from_mm, to_mm: way.to_mm };
        for axis in 0..3 {
            while cells.plane_mm(axis) <= way.from_mm {
                cells.pass(axis);
            }
        }
        cells
    }
}

/// A ray's stretch in one cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passage {
    /// The cell lies between the voxel centres `cell` and `cell + 1`.
    pub(crate) cell: [i32; 3],
    /// Where in the cell the stretch begins and ends, 0 to 1 along each axis.
    pub(crate) from: DVec3,
    pub(crate) to: DVec3,
    /// The same as distances from the eye.
    pub(crate) way: Way,
}

impl Passage {
    /// Distance from the eye at a part (0 to 1) of this stretch, millimetres.
    pub(crate) fn mm(&self, part: f64) -> f64 {
        self.way.from_mm + self.way.length_mm() * part
    }
}

/// Walks from plane to plane of voxel centres. A plane's distance is computed from its number, not summed up, so that
/// the walk does not drift (Amanatides and Woo 1987, without their increments).
pub(crate) struct Cells {
    ray: Ray,
    dims: [u32; 3],
    /// The plane of centres that the ray meets next along each axis; one outside the grid is met nowhere.
    next_plane: [i32; 3],
    at_mm: f64,
    to_mm: f64,
}

impl Cells {
    fn plane_mm(&self, axis: usize) -> f64 {
        let (plane, d) = (self.next_plane[axis], self.ray.direction[axis]);
        if d == 0.0 || plane < 0 || plane >= self.dims[axis] as i32 {
            return f64::INFINITY;
        }
        (f64::from(plane) - self.ray.origin[axis]) / d
    }

    fn pass(&mut self, axis: usize) {
        self.next_plane[axis] += if self.ray.direction[axis] > 0.0 { 1 } else { -1 };
    }
}

impl Iterator for Cells {
    type Item = Passage;

    fn next(&mut self) -> Option<Passage> {
        while self.at_mm < self.to_mm {
            let planes = [0, 1, 2].map(|axis| self.plane_mm(axis));
            let end = planes.into_iter().fold(self.to_mm, f64::min);
            let cell: [i32; 3] = std::array::from_fn(|axis| {
                let behind = i32::from(self.ray.direction[axis] >= 0.0);
                self.next_plane[axis] - behind
            });
            let way = Way { from_mm: self.at_mm, to_mm: end };
            for (axis, plane_mm) in planes.into_iter().enumerate() {
                if plane_mm <= end {
                    self.pass(axis);
                }
            }
            self.at_mm = end;
            if way.length_mm() > 0.0 {
                let corner = DVec3::from_array(cell.map(f64::from));
                let local = |mm: f64| (self.ray.at(mm) - corner).clamp(DVec3::ZERO, DVec3::ONE);
                return Some(Passage { cell, from: local(way.from_mm), to: local(way.to_mm), way });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: DVec3::from_array(origin), direction: DVec3::from_array(direction) }
    }

    #[test]
    fn the_way_ends_half_a_voxel_outside_the_centres() {
        let way = ray([-10.0, 0.0, 0.0], [1.0, 0.0, 0.0]).inside([4, 1, 1]).unwrap();
        assert_eq!(way, Way { from_mm: 9.5, to_mm: 13.5 });
        let inside = ray([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).inside([4, 1, 1]).unwrap();
        assert_eq!(inside, Way { from_mm: 0.0, to_mm: 2.5 });
    }

    #[test]
    fn a_ray_in_a_face_is_inside_and_one_beside_it_is_not() {
        for (y, hit) in [(-0.5, true), (0.5, true), ((-0.5f64).next_up(), true), (0.5f64.next_up(), false)] {
            assert_eq!(ray([-10.0, y, 0.0], [1.0, 0.0, 0.0]).inside([4, 1, 1]).is_some(), hit, "{y}");
        }
        assert!(ray([9.0, 0.0, 0.0], [1.0, 0.0, 0.0]).inside([4, 1, 1]).is_none(), "behind the eye");
    }

    #[test]
    fn cells_begin_and_end_at_the_centres() {
        let r = ray([-10.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let cells: Vec<_> = r.cells([3, 1, 1], r.inside([3, 1, 1]).unwrap()).collect();
        let along_x: Vec<_> = cells.iter().map(|c| (c.cell[0], c.from.x, c.to.x)).collect();
        assert_eq!(along_x, [(-1, 0.5, 1.0), (0, 0.0, 1.0), (1, 0.0, 1.0), (2, 0.0, 0.5)]);
        let back = ray([10.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        let cells: Vec<_> = back.cells([3, 1, 1], back.inside([3, 1, 1]).unwrap()).collect();
        assert_eq!(cells.iter().map(|c| c.cell[0]).collect::<Vec<_>>(), [2, 1, 0, -1]);
    }

    #[test]
    fn a_diagonal_through_corners_passes_no_empty_cell() {
        let r = ray([-1.0; 3], [1.0; 3]);
        let cells: Vec<_> = r.cells([3; 3], r.inside([3; 3]).unwrap()).collect();
        assert_eq!(cells.iter().map(|c| c.cell).collect::<Vec<_>>(), [[-1; 3], [0; 3], [1; 3], [2; 3]]);
    }

    proptest! {
        #[test]
        fn cells_cover_the_way_without_gaps(
            dims in prop::array::uniform3(1..9u32),
            origin in prop::array::uniform3(-12.0..12.0f64),
            target in prop::array::uniform3(-0.5..8.0f64),
            snap in any::<bool>(),
        ) {
            let (mut origin, mut target) = (DVec3::from_array(origin), DVec3::from_array(target));
            if snap {
                (origin, target) = (origin.round(), target.round());
            }
            let Some(direction) = (target - origin).try_normalize() else { return Ok(()) };
            let r = Ray { origin, direction };
            let Some(way) = r.inside(dims) else { return Ok(()) };
            let mut at = way.from_mm;
            for c in r.cells(dims, way) {
                prop_assert_eq!(c.way.from_mm, at);
                at = c.way.to_mm;
                let corner = DVec3::from_array(c.cell.map(f64::from));
                for (mm, local) in [(c.way.from_mm, c.from), (c.way.to_mm, c.to)] {
                    prop_assert!((r.at(mm) - corner - local).length() < 1e-12, "clamped by more than rounding");
                }
                for (cell, dim) in c.cell.into_iter().zip(dims) {
                    prop_assert!(cell >= -1 && cell < dim as i32);
                }
            }
            prop_assert_eq!(at, way.to_mm);
        }
    }
}
