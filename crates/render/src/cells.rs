//! Cells of 8 voxels: what values they hold, and how far it is to one that can be seen.

use rayon::prelude::*;
use volume::{Channel, Voxels};

/// Voxels along each side of a cell. The shader has the same number; a test compares them.
pub(crate) const CELL: usize = 8;

/// Lowest and highest value of each cell and a border voxel around it.
#[derive(Clone, Debug)]
pub(crate) struct CellRanges {
    /// Cells along x, y, z.
    pub(crate) dims: [usize; 3],
    /// Lowest and highest value (after slope and intercept), x fastest.
    pub(crate) ranges: Vec<[f32; 2]>,
}

impl CellRanges {
    /// Reads every voxel once, on all cores. What the filter gives between voxels may lie `slack` stored units outside
    /// of what they hold: each range is wider by that.
    pub(crate) fn of(channel: &Channel, voxel_dims: [u32; 3], slack: f64) -> Self {
        let scale = |[low, high]: [f64; 2]| {
            let value = |stored: f64| channel.slope * stored + channel.intercept;
            let (a, b) = (value(low - slack), value(high + slack));
            // Rounded outwards: a cell never claims less than it holds.
            [(a.min(b) as f32).next_down(), (a.max(b) as f32).next_up()]
        };
        match &channel.voxels {
            Voxels::U8(v) => ranges(v, voxel_dims, f64::from, scale),
            Voxels::I16(v) => ranges(v, voxel_dims, f64::from, scale),
            Voxels::U16(v) => ranges(v, voxel_dims, f64::from, scale),
            Voxels::F32(v) => ranges(v, voxel_dims, f64::from, scale),
        }
    }

    /// The lowest and the highest value of all.
    pub(crate) fn whole(&self) -> [f32; 2] {
        self.ranges.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |a, r| [a[0].min(r[0]), a[1].max(r[1])])
    }

    /// For each cell the number of cells (Chebyshev) to the nearest one whose range is seen; 0 for such a cell itself.
    pub(crate) fn distance_to_seen(&self, is_seen: impl Fn([f32; 2]) -> bool + Sync) -> Vec<u32> {
        let seen: Vec<bool> = self.ranges.par_iter().map(|&r| is_seen(r)).collect();
        chebyshev(&seen, self.dims)
    }
}

fn ranges<T: Copy + PartialOrd + Send + Sync>(
    voxels: &[T],
    dims: [u32; 3],
    number: impl Fn(T) -> f64 + Sync,
    scale: impl Fn([f64; 2]) -> [f32; 2] + Sync,
) -> CellRanges {
    let dims = dims.map(|d| d as usize);
    let cells = dims.map(|d| d.div_ceil(CELL));
    let [nx, ny, _] = dims;
    let pick =
        |a: [T; 2], b: [T; 2]| [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }];
    // The voxels of a cell with its border, along one axis.
    let span = |cell: usize, n: usize| (cell * CELL).saturating_sub(1)..((cell + 1) * CELL + 1).min(n);
    let ranges = (0..cells[2])
        .into_par_iter()
        .flat_map_iter(|cz| {
            // First over z and y into columns, then over x: each voxel of the slab is read at most 1.25² times.
            let mut slab = Vec::with_capacity(cells[0] * cells[1]);
            for cy in 0..cells[1] {
                let mut columns: Vec<[T; 2]> = Vec::new();
                for z in span(cz, dims[2]) {
                    for y in span(cy, ny) {
                        let row = &voxels[(z * ny + y) * nx..][..nx];
                        if columns.is_empty() {
                            columns.extend(row.iter().map(|&v| [v, v]));
                        } else {
                            for (column, &v) in columns.iter_mut().zip(row) {
                                *column = pick(*column, [v, v]);
                            }
                        }
                    }
                }
                for cx in 0..cells[0] {
                    let inside = &columns[span(cx, nx)];
                    let range = inside[1..].iter().fold(inside[0], |a, &b| pick(a, b));
                    slab.push(scale(range.map(&number)));
                }
            }
            slab
        })
        .collect();
    CellRanges { dims: cells, ranges }
}

/// Chebyshev distance in cells to the nearest cell that is set, in three separable passes: along an axis the distance is
/// the least over all cells of max(distance so far, steps along the axis). Where nothing is set, the longest axis.
fn chebyshev(seen: &[bool], dims: [usize; 3]) -> Vec<u32> {
    let far = dims.into_iter().max().unwrap_or(1) as u32;
    let mut distance: Vec<u32> = seen.iter().map(|&s| if s { 0 } else { far }).collect();
    // A chamfer of all 26 neighbours, forth and back, is exact for this metric.
    let [nx, ny, nz] = dims;
    let at = |x: usize, y: usize, z: usize| (z * ny + y) * nx + x;
    let relax = |distance: &mut [u32], x: usize, y: usize, z: usize, forth: bool| {
        let here = at(x, y, z);
        let mut least = distance[here];
        if least == 0 {
            return;
        }
        for dz in -1isize..=1 {
            for dy in -1isize..=1 {
                for dx in -1isize..=1 {
                    let before = (dz, dy, dx) < (0, 0, 0);
                    if (dz, dy, dx) == (0, 0, 0) || before != forth {
                        continue;
                    }
                    let (x, y, z) = (x as isize + dx, y as isize + dy, z as isize + dz);
                    if x < 0 || y < 0 || z < 0 || x >= nx as isize || y >= ny as isize || z >= nz as isize {
                        continue;
                    }
                    least = least.min(distance[at(x as usize, y as usize, z as usize)] + 1);
                }
            }
        }
        distance[here] = least;
    };
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                relax(&mut distance, x, y, z, true);
            }
        }
    }
    for z in (0..nz).rev() {
        for y in (0..ny).rev() {
            for x in (0..nx).rev() {
                relax(&mut distance, x, y, z, false);
            }
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use volume::ChannelKind;

    fn channel(voxels: Vec<u8>, slope: f64) -> Channel {
        Channel {
            name: "x".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8(voxels),
            slope,
            intercept: 0.0,
        }
    }

    #[test]
    fn a_cell_knows_its_border_voxel() {
        // 17 voxels along x: three cells. A lone voxel at 7 is the last of cell 0 and borders cell 1.
        let mut v = vec![0u8; 17];
        v[7] = 200;
        let cells = CellRanges::of(&channel(v, 1.0), [17, 1, 1], 0.0);
        assert_eq!(cells.dims, [3, 1, 1]);
        let highest: Vec<bool> = cells.ranges.iter().map(|r| r[1] >= 200.0).collect();
        assert_eq!(highest, [true, true, false]);
    }

    #[test]
    fn a_negative_slope_swaps_low_and_high() {
        let cells = CellRanges::of(&channel(vec![0, 10], -2.0), [2, 1, 1], 0.0);
        assert!(cells.ranges[0][0] <= -20.0 && cells.ranges[0][1] >= 0.0);
    }

    #[test]
    fn slack_widens_a_range_both_ways() {
        let cells = CellRanges::of(&channel(vec![3, 10], 2.0), [2, 1, 1], 1.0);
        assert_eq!(cells.ranges[0], [4f32.next_down(), 22f32.next_up()]);
    }

    #[test]
    fn ranges_equal_those_of_a_plain_loop() {
        let dims = [21usize, 13, 10];
        let mut state = 12345u64;
        let voxels: Vec<u8> = (0..dims.iter().product())
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 56) as u8
            })
            .collect();
        let cells = CellRanges::of(&channel(voxels.clone(), 1.0), dims.map(|d| d as u32), 0.0);
        for (index, range) in cells.ranges.iter().enumerate() {
            let c = [
                index % cells.dims[0],
                index / cells.dims[0] % cells.dims[1],
                index / cells.dims[0] / cells.dims[1],
            ];
            let (mut low, mut high) = (255u8, 0u8);
            for z in 0..dims[2] {
                for y in 0..dims[1] {
                    for x in 0..dims[0] {
                        let inside =
                            [x, y, z].iter().zip(c).all(|(&v, c)| v + 1 >= c * CELL && v <= (c + 1) * CELL);
                        if inside {
                            let v = voxels[(z * dims[1] + y) * dims[0] + x];
                            (low, high) = (low.min(v), high.max(v));
                        }
                    }
                }
            }
            assert_eq!(*range, [f32::from(low).next_down(), f32::from(high).next_up()]);
        }
    }

    #[test]
    fn distances_equal_those_of_a_plain_search() {
        let dims = [7, 5, 6];
        let seen: Vec<bool> = (0..dims.iter().product::<usize>()).map(|i| i % 53 == 5).collect();
        let place = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
        let found = chebyshev(&seen, dims);
        for (i, &d) in found.iter().enumerate() {
            let nearest = (0..seen.len())
                .filter(|&j| seen[j])
                .map(|j| place(i).iter().zip(place(j)).map(|(&a, b)| a.abs_diff(b)).max().unwrap())
                .min()
                .unwrap();
            assert_eq!(d as usize, nearest, "cell {:?}", place(i));
        }
    }

    #[test]
    fn the_shader_has_the_same_cells() {
        assert!(crate::shaders::RAYCAST.contains(&format!("const CELL: f32 = {CELL}.0;")));
    }
}
