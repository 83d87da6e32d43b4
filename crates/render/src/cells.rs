//! Cells of 4 voxels: what values they hold, and how far it is to one that can be seen.

use rayon::prelude::*;
use std::ops::Range;
use volume::{Channel, Voxels};

/// Voxels along each side of a cell. The shader has the same number; a test compares them.
pub(crate) const CELL: usize = 4;
/// Cells along each side of a larger one that knows its highest value; the shader has the product.
const CELLS_A_MAXIMUM: usize = 2;
/// The farthest distance that is told apart, in cells. A ray that leaps as far looks again there.
const FARTHEST: u8 = 16;
/// How many numbers 8 and 16 bits tell apart.
const NUMBERS_8: usize = 1 << 8;
const NUMBERS_16: usize = 1 << 16;

/// Lowest and highest value of each cell and a border voxel around it.
#[derive(Clone, Debug)]
pub(crate) struct CellRanges {
    /// Cells along x, y, z.
    pub(crate) dims: [usize; 3],
    stored: Stored,
    slope: f64,
    intercept: f64,
    /// How far outside of its voxels, in stored units, the filter's values may lie.
    slack: f64,
    /// The lowest and the highest value of all.
    whole: [f32; 2],
}

/// What can be seen, counted along the values. Two looks a range, whatever is seen.
pub(crate) trait SeenRanges: Sync {
    /// What is counted below a range that begins with this value; never falls with the value. `largest` is how large the
    /// numbers are that are rounded on the way.
    fn before(&self, low: f32, largest: f32) -> Counts;

    /// What is counted up to the end of a range that ends with this value; never falls with the value.
    fn through(&self, high: f32, largest: f32) -> Counts;

    /// Whether something of the range is seen.
    fn is_seen(&self, [low, high]: [f32; 2]) -> bool {
        let largest = low.abs().max(high.abs());
        is_more(self.through(high, largest), self.before(low, largest))
    }
}

/// Two things that are counted apart; a range is seen if either has more.
pub(crate) type Counts = [u32; 2];

fn is_more(through: Counts, before: Counts) -> bool {
    through[0] > before[0] || through[1] > before[1]
}

/// Lowest and highest stored number of each cell, x fastest, as small as the voxels are.
#[derive(Clone, Debug)]
enum Stored {
    U8(Vec<[u8; 2]>),
    I16(Vec<[i16; 2]>),
    U16(Vec<[u16; 2]>),
    F32(Vec<[f32; 2]>),
}

impl CellRanges {
    /// Reads every voxel once, on all cores. What the filter gives between voxels may lie `slack` stored units outside
    /// of what they hold: each range is wider by that.
    pub(crate) fn of(channel: &Channel, voxel_dims: [u32; 3], slack: f64) -> Self {
        let stored = match &channel.voxels {
            Voxels::U8(v) => Stored::U8(ranges(v, voxel_dims)),
            Voxels::I16(v) => Stored::I16(ranges(v, voxel_dims)),
            Voxels::U16(v) => Stored::U16(ranges(v, voxel_dims)),
            Voxels::F32(v) => Stored::F32(ranges(v, voxel_dims)),
            // Rounding keeps the order: these are the ranges of what the device holds.
            Voxels::F64(v) => {
                Stored::F32(ranges(v, voxel_dims).into_iter().map(|r| r.map(volume::single)).collect())
            }
        };
        let dims = voxel_dims.map(|d| (d as usize).div_ceil(CELL));
        let whole = [f32::INFINITY, f32::NEG_INFINITY];
        let mut cells =
            Self { dims, stored, slope: channel.slope, intercept: channel.intercept, slack, whole };
        let widest = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        cells.whole = cells.map(|r| r).into_par_iter().reduce(|| whole, widest);
        cells
    }

    /// The lowest and the highest value of all.
    pub(crate) fn whole(&self) -> [f32; 2] {
        self.whole
    }

    /// Something of the range of each cell (values after slope and intercept), x fastest.
    pub(crate) fn map<T: Send>(&self, of: impl Fn([f32; 2]) -> T + Sync) -> Vec<T> {
        let scale = |[low, high]: [f64; 2]| {
            let (a, b) = (self.value(low - self.slack), self.value(high + self.slack));
            // Rounded outwards: a cell never claims less than it holds.
            of([(a.min(b) as f32).next_down(), (a.max(b) as f32).next_up()])
        };
        match &self.stored {
            Stored::U8(r) => r.par_iter().map(|r| scale(r.map(f64::from))).collect(),
            Stored::I16(r) => r.par_iter().map(|r| scale(r.map(f64::from))).collect(),
            Stored::U16(r) => r.par_iter().map(|r| scale(r.map(f64::from))).collect(),
            Stored::F32(r) => r.par_iter().map(|r| scale(r.map(f64::from))).collect(),
        }
    }

    /// The highest value of each larger cell, and how many of them there are along x, y, z.
    pub(crate) fn maxima(&self) -> (Vec<f32>, [usize; 3]) {
        let highest = self.map(|r| r[1]);
        let [nx, ny, nz] = self.dims;
        let dims = self.dims.map(|d| d.div_ceil(CELLS_A_MAXIMUM));
        let span = |cell: usize, n: usize| cell * CELLS_A_MAXIMUM..((cell + 1) * CELLS_A_MAXIMUM).min(n);
        let mut maxima = Vec::with_capacity(dims.iter().product());
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let mut maximum = f32::NEG_INFINITY;
                    for z in span(z, nz) {
                        for y in span(y, ny) {
                            for &h in &highest[(z * ny + y) * nx..][span(x, nx)] {
                                maximum = maximum.max(h);
                            }
                        }
                    }
                    maxima.push(maximum);
                }
            }
        }
        (maxima, dims)
    }

    /// For each cell the number of cells (Chebyshev) to the nearest one whose range is seen, at most [`FARTHEST`]; 0 for
    /// such a cell itself.
    pub(crate) fn distance_to_seen(&self, seen: &impl SeenRanges) -> Vec<u8> {
        chebyshev(&self.seen(seen), self.dims)
    }

    /// Whether each cell is seen. What is counted before and through each stored number is worked out once, where there are
    /// more cells than numbers.
    fn seen(&self, seen: &impl SeenRanges) -> Vec<bool> {
        match &self.stored {
            Stored::U8(r) if r.len() > NUMBERS_8 => {
                let ends = self.ends(seen, 0..NUMBERS_8);
                r.par_iter().map(|r| ends.is_seen(r.map(usize::from))).collect()
            }
            Stored::U16(r) if r.len() > NUMBERS_16 => {
                let ends = self.ends(seen, 0..NUMBERS_16);
                r.par_iter().map(|r| ends.is_seen(r.map(usize::from))).collect()
            }
            Stored::I16(r) if r.len() > NUMBERS_16 => {
                let ends = self.ends(seen, 0..NUMBERS_16);
                let place = |s: i16| usize::from(s.cast_unsigned() ^ 0x8000);
                r.par_iter().map(|r| ends.is_seen(r.map(place))).collect()
            }
            _ => self.map(|range| seen.is_seen(range)),
        }
    }

    fn value(&self, stored: f64) -> f64 {
        self.slope * stored + self.intercept
    }

    /// The counts at the ends of ranges of stored numbers, by their places from the lowest on.
    fn ends(&self, seen: &impl SeenRanges, places: Range<usize>) -> Ends {
        let lowest = if matches!(self.stored, Stored::I16(_)) { f64::from(i16::MIN) } else { 0.0 };
        let rises = self.slope >= 0.0;
        // As in `map`: the end that is the lowest value is rounded down, the other up.
        let largest = self.whole[0].abs().max(self.whole[1].abs());
        let count = |value: f64, is_low: bool| {
            if is_low {
                seen.before((value as f32).next_down(), largest)
            } else {
                seen.through((value as f32).next_up(), largest)
            }
        };
        let (first, last) = places
            .into_par_iter()
            .map(|place| {
                let stored = place as f64 + lowest;
                let (a, b) = (self.value(stored - self.slack), self.value(stored + self.slack));
                (count(a, rises), count(b, !rises))
            })
            .unzip();
        Ends { first, last, rises }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        match &self.stored {
            Stored::U8(r) => size_of_val(r.as_slice()),
            Stored::I16(r) => size_of_val(r.as_slice()),
            Stored::U16(r) => size_of_val(r.as_slice()),
            Stored::F32(r) => size_of_val(r.as_slice()),
        }
    }
}

/// What is counted at the ends of ranges that begin and end with each stored number.
struct Ends {
    first: Vec<Counts>,
    last: Vec<Counts>,
    /// Whether values rise with stored numbers.
    rises: bool,
}

impl Ends {
    fn is_seen(&self, [low, high]: [usize; 2]) -> bool {
        let (first, last) = (self.first[low], self.last[high]);
        if self.rises { is_more(last, first) } else { is_more(first, last) }
    }
}

fn ranges<T: Copy + PartialOrd + Send + Sync>(voxels: &[T], dims: [u32; 3]) -> Vec<[T; 2]> {
    let dims = dims.map(|d| d as usize);
    let cells = dims.map(|d| d.div_ceil(CELL));
    let [nx, ny, _] = dims;
    let pick =
        |a: [T; 2], b: [T; 2]| [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }];
    // The voxels of a cell with its border, along one axis.
    let span = |cell: usize, n: usize| (cell * CELL).saturating_sub(1)..((cell + 1) * CELL + 1).min(n);
    (0..cells[2])
        .into_par_iter()
        .flat_map_iter(|cz| {
            // First over z into a slice, then over y into rows, then over x.
            let mut slice: Vec<[T; 2]> = Vec::new();
            for z in span(cz, dims[2]) {
                let layer = &voxels[z * ny * nx..][..ny * nx];
                if slice.is_empty() {
                    slice.extend(layer.iter().map(|&v| [v, v]));
                } else {
                    for (range, &v) in slice.iter_mut().zip(layer) {
                        *range = pick(*range, [v, v]);
                    }
                }
            }
            let mut slab = Vec::with_capacity(cells[0] * cells[1]);
            let mut columns: Vec<[T; 2]> = Vec::with_capacity(nx);
            for cy in 0..cells[1] {
                columns.clear();
                for y in span(cy, ny) {
                    let row = &slice[y * nx..][..nx];
                    if columns.is_empty() {
                        columns.extend_from_slice(row);
                    } else {
                        for (column, &range) in columns.iter_mut().zip(row) {
                            *column = pick(*column, range);
                        }
                    }
                }
                for cx in 0..cells[0] {
                    let inside = &columns[span(cx, nx)];
                    slab.push(inside[1..].iter().fold(inside[0], |a, &b| pick(a, b)));
                }
            }
            slab
        })
        .collect()
}

/// Cells of a grid as bits, 64 of a row in a word, so that all of a word's neighbours are set in a few operations.
#[derive(Clone, Debug)]
struct Bits {
    words: Vec<u64>,
    words_a_row: usize,
    rows: [usize; 2],
}

impl Bits {
    fn of(set: &[bool], [nx, ny, nz]: [usize; 3]) -> Self {
        let words_a_row = nx.div_ceil(64);
        let word = |bits: &[bool]| bits.iter().rev().fold(0, |word, &bit| word << 1 | u64::from(bit));
        let words = set.par_chunks(nx).flat_map_iter(|row| row.chunks(64).map(word)).collect();
        Self { words, words_a_row, rows: [ny, nz] }
    }

    /// The same with all 26 neighbours of what is set, in one pass an axis. Bits behind a row's end mean nothing.
    fn grown(&self) -> Self {
        let n = self.words_a_row;
        let along_x: Vec<u64> = self
            .words
            .par_chunks(n)
            .flat_map_iter(|row| {
                (0..n).map(move |i| {
                    let before = if i > 0 { row[i - 1] >> 63 } else { 0 };
                    let after = if i + 1 < n { row[i + 1] << 63 } else { 0 };
                    row[i] | row[i] << 1 | row[i] >> 1 | before | after
                })
            })
            .collect();
        let [ny, nz] = self.rows;
        let along_y = neighbours(&along_x, n, ny);
        let words = neighbours(&along_y, n * ny, nz);
        Self { words, ..*self }
    }
}

/// Each block of `length` words with the one before it and the one behind it, within each group of `count` blocks.
fn neighbours(words: &[u64], length: usize, count: usize) -> Vec<u64> {
    let block = |group: &[u64], i: usize, word: usize| group[i * length + word];
    let mut out = vec![0; words.len()];
    out.par_chunks_mut(length).enumerate().for_each(|(at, out)| {
        let (group, i) = (&words[at / count * count * length..][..count * length], at % count);
        for (word, out) in out.iter_mut().enumerate() {
            *out = block(group, i, word);
            if i > 0 {
                *out |= block(group, i - 1, word);
            }
            if i + 1 < count {
                *out |= block(group, i + 1, word);
            }
        }
    });
    out
}

/// Chebyshev distance in cells to the nearest cell that is set, at most [`FARTHEST`]: what is set grows by a cell at a
/// time, and a cell's distance is when it is reached.
fn chebyshev(seen: &[bool], dims: [usize; 3]) -> Vec<u8> {
    let nx = dims[0];
    let mut reached = Bits::of(seen, dims);
    let mut distance: Vec<u8> = seen.par_iter().map(|&s| if s { 0 } else { FARTHEST }).collect();
    for step in 1..FARTHEST {
        let grown = reached.grown();
        let n = reached.words_a_row;
        let rows = reached.words.par_chunks(n).zip(grown.words.par_chunks(n));
        let met: usize = distance
            .par_chunks_mut(nx)
            .zip(rows)
            .map(|(distance, (before, after))| {
                let mut met = 0;
                for (word, (&before, &after)) in before.iter().zip(after).enumerate() {
                    let mut new = after & !before;
                    while new != 0 {
                        let x = word * 64 + new.trailing_zeros() as usize;
                        if x < nx {
                            distance[x] = step;
                            met += 1;
                        }
                        new &= new - 1;
                    }
                }
                met
            })
            .sum();
        if met == 0 {
            break;
        }
        reached = grown;
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{SeenValues, TableDomain, optical_table};
    use scene::{Scene, SceneFile, VolumeFacts};
    use spatial::DVec3;
    use volume::{ChannelKind, Grid, Volume};

    fn channel(voxels: Vec<u8>, slope: f64) -> Channel {
        Channel {
            name: "x".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8(voxels.into()),
            slope,
            intercept: 0.0,
        }
    }

    #[test]
    fn a_cell_knows_its_border_voxel() {
        // Three cells and a voxel. A lone voxel at the end of cell 0 borders cell 1.
        let n = 3 * CELL + 1;
        let mut v = vec![0u8; n];
        v[CELL - 1] = 200;
        let cells = CellRanges::of(&channel(v, 1.0), [n as u32, 1, 1], 0.0);
        assert_eq!(cells.dims, [4, 1, 1]);
        assert_eq!(cells.map(|r| r[1] >= 200.0), [true, true, false, false]);
    }

    #[test]
    fn a_negative_slope_swaps_low_and_high() {
        let cells = CellRanges::of(&channel(vec![0, 10], -2.0), [2, 1, 1], 0.0);
        let range = cells.map(|r| r)[0];
        assert!(range[0] <= -20.0 && range[1] >= 0.0);
    }

    #[test]
    fn slack_widens_a_range_both_ways() {
        let cells = CellRanges::of(&channel(vec![3, 10], 2.0), [2, 1, 1], 1.0);
        assert_eq!(cells.map(|r| r)[0], [4f32.next_down(), 22f32.next_up()]);
    }

    /// Seen between 10 and 12 of the values, and at -40 alone.
    struct Bands;

    impl SeenRanges for Bands {
        fn before(&self, low: f32, _: f32) -> Counts {
            [u32::from(low > 12.0), u32::from(low > -40.0)]
        }

        fn through(&self, high: f32, _: f32) -> Counts {
            [u32::from(high >= 10.0), u32::from(high >= -40.0)]
        }
    }

    /// The same bands, as a scene has them.
    fn bands() -> Scene {
        let grid = Grid::axis_aligned([2, 1, 1], DVec3::ONE).unwrap();
        let volume = Volume::new(grid, vec![channel(vec![0, 255], 1.0)]).unwrap();
        let json = r#"{"transfer": [[-41,0,0,0,0],[-40,1,1,1,0.5],[-39,0,0,0,0],[10,0,0,0,0],[11,1,1,1,0.5],[12,0,0,0,0]]}"#;
        SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap()
    }

    #[test]
    fn counting_by_stored_numbers_sees_what_counting_by_ranges_sees() {
        let scene = bands();
        // More cells than numbers of 16 bits, in ranges of all widths.
        let dims = [168, 164, 164];
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 16
        };
        // Blocks of like numbers, so that some cells see nothing.
        let blocks: Vec<u32> = (0..14 * 14 * 14).map(|_| random() >> (random() % 8)).collect();
        let block = |i: usize| i % 168 / 12 + i / 168 % 164 / 12 * 14 + i / 168 / 164 / 12 * 196;
        let numbers: Vec<u16> =
            (0..168 * 164 * 164).map(|i| (blocks[block(i)] + random() % 64).min(65_535) as u16).collect();
        for slope in [0.01, -0.01, 0.0] {
            for voxels in [
                Voxels::U16(numbers.clone().into()),
                Voxels::I16(numbers.iter().map(|n| n.cast_signed()).collect::<Vec<_>>().into()),
                Voxels::U8(numbers.iter().map(|n| *n as u8).collect::<Vec<_>>().into()),
            ] {
                let bytes = matches!(voxels, Voxels::U8(_));
                let slope = if bytes { 50.0 * slope } else { slope };
                let intercept = if slope < 0.0 { 45.0 } else { -45.0 };
                let channel = Channel { voxels, intercept, ..channel(vec![0], slope) };
                let cells = CellRanges::of(&channel, dims, 0.5);
                let (found, expected) = (cells.seen(&Bands), cells.map(|range| Bands.is_seen(range)));
                assert!(found == expected, "slope {slope}, {:?}", channel.voxels.voxel_type());
                let share = found.iter().filter(|s| **s).count() as f64 / found.len() as f64;
                assert!(slope == 0.0 || (0.001..0.999).contains(&share), "{share} are seen");
                // A function's slack grows with the largest number: of all of them, where numbers are counted, which may
                // see more and never less.
                let domain = TableDomain::of(&scene, cells.whole());
                let values = SeenValues::of(&scene.transfer, &optical_table(&scene, domain, 1.0), domain);
                let (found, expected) = (cells.seen(&values), cells.map(|range| values.is_seen(range)));
                let missed =
                    found.iter().zip(&expected).filter(|(found, expected)| !**found && **expected).count();
                assert_eq!(missed, 0, "slope {slope}, {:?}", channel.voxels.voxel_type());
                let more =
                    found.iter().zip(&expected).filter(|(found, expected)| **found && !**expected).count();
                assert!(more * 100 <= found.len(), "{more} of {} more are seen", found.len());
            }
        }
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
        for (index, range) in cells.map(|r| r).iter().enumerate() {
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
        // Rows of one word and of three, and a cell farther than is told apart.
        for (dims, every) in [([7, 5, 6], 53), ([150, 3, 4], 331), ([2, 40, 3], 1000)] {
            let seen: Vec<bool> = (0..dims.iter().product::<usize>()).map(|i| i % every == 5).collect();
            let place = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
            for (i, &d) in chebyshev(&seen, dims).iter().enumerate() {
                let nearest = (0..seen.len())
                    .filter(|&j| seen[j])
                    .map(|j| place(i).iter().zip(place(j)).map(|(&a, b)| a.abs_diff(b)).max().unwrap())
                    .min()
                    .unwrap();
                assert_eq!(usize::from(d), nearest.min(usize::from(FARTHEST)), "cell {:?}", place(i));
            }
        }
        assert!(chebyshev(&[false; 12], [3, 2, 2]).iter().all(|&d| d == FARTHEST));
    }

    #[test]
    fn a_larger_cell_has_the_highest_of_its_cells() {
        // Three cells and a voxel along x, five voxels along y: the larger cells are two by one.
        let n = 3 * CELL + 1;
        let mut v = vec![1u8; n * 5];
        v[4 * n + 2 * CELL + 1] = 90;
        let cells = CellRanges::of(&channel(v, 2.0), [n as u32, 5, 1], 0.0);
        assert_eq!(cells.maxima(), (vec![2f32.next_up(), 180f32.next_up()], [2, 1, 1]));
    }

    #[test]
    fn ranges_take_a_thirtieth_of_what_the_voxels_do() {
        let voxels = 40usize.pow(3);
        let cells = CellRanges::of(&channel(vec![0; voxels], 1.0), [40; 3], 0.0);
        assert!(cells.bytes() * 30 < voxels);
    }

    #[test]
    fn the_shader_has_the_same_cells() {
        let size = |name: &str, voxels: usize| {
            assert!(crate::shaders::RAYCAST.contains(&format!("const {name}: f32 = {voxels}.0;")), "{name}");
        };
        size("CELL", CELL);
        size("MAXIMUM_CELL", CELL * CELLS_A_MAXIMUM);
    }
}
