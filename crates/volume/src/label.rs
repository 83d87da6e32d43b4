//! Labels: numbers that name structures, and how many voxels have each.

use crate::{Channel, Voxels};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

/// Samples that one task counts.
const CHUNK: usize = 1 << 20;
/// The part of neighbours that have the same label where structures are some voxels wide.
const MOSTLY: f64 = 0.75;

/// What a label is called and how it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The number that voxels of the structure hold.
    pub number: i64,
    /// What people call it; empty where nobody said.
    pub name: String,
    /// RGB, 0 to 1, where the table gives one.
    pub color: Option<[f64; 3]>,
    /// 0 to 1, where the table gives one: of a millimetre, as everywhere.
    pub opacity: Option<f64>,
}

/// Names and colours of labels, in the order of their numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelTable {
    labels: Vec<Label>,
}

impl LabelTable {
    /// Takes labels in any order; of two with one number the later one holds.
    #[must_use]
    pub fn new(labels: impl IntoIterator<Item = Label>) -> Self {
        let sorted: BTreeMap<i64, Label> = labels.into_iter().map(|label| (label.number, label)).collect();
        Self { labels: sorted.into_values().collect() }
    }

    /// All of them.
    #[must_use]
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    /// The label with a number.
    #[must_use]
    pub fn get(&self, number: i64) -> Option<&Label> {
        self.labels.binary_search_by_key(&number, |label| label.number).ok().map(|at| &self.labels[at])
    }

    /// The numbers of the labels of a name: several structures may have one.
    pub fn numbered(&self, name: &str) -> impl Iterator<Item = i64> {
        self.labels.iter().filter(move |label| label.name == name).map(|label| label.number)
    }

    /// Both tables; where both have a number, what `over` says holds, and what it leaves out stays.
    #[must_use]
    pub fn with(&self, over: &Self) -> Self {
        let merged = over.labels.iter().map(|label| match self.get(label.number) {
            None => label.clone(),
            Some(under) => Label {
                number: label.number,
                name: if label.name.is_empty() { under.name.clone() } else { label.name.clone() },
                color: label.color.or(under.color),
                opacity: label.opacity.or(under.opacity),
            },
        });
        Self::new(self.labels.iter().cloned().chain(merged))
    }
}

/// How many voxels have a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabelCount {
    /// The label.
    pub number: i64,
    /// Voxels that have it.
    pub voxels: u64,
}

impl Channel {
    /// The label that a stored number stands for: its value, rounded.
    #[must_use]
    pub fn label_of(&self, stored: f64) -> i64 {
        (self.slope * stored + self.intercept).round() as i64
    }

    /// Whether samples look like labels: whole numbers that are not negative, and where a voxel or its neighbour along x is
    /// not 0, both mostly have the same. A guess for people, not to act upon.
    #[must_use]
    pub fn looks_like_labels(&self, dims: [u32; 3]) -> bool {
        let width = dims[0] as usize;
        let is_label = |v: f64| v >= 0.0 && v.fract() == 0.0;
        if width < 2 || !(0..self.voxels.len()).into_par_iter().all(|at| is_label(self.value(at))) {
            return false;
        }
        let of_row = |row: usize| {
            let values: Vec<f64> = (0..width).map(|x| self.value(row * width + x)).collect();
            let pairs = values.windows(2).filter(|p| p[0] != 0.0 || p[1] != 0.0);
            pairs.fold((0u64, 0u64), |(same, all), p| (same + u64::from(p[0] == p[1]), all + 1))
        };
        let sum = |a: (u64, u64), b: (u64, u64)| (a.0 + b.0, a.1 + b.1);
        let (same, all) = (0..self.voxels.len() / width).into_par_iter().map(of_row).reduce(|| (0, 0), sum);
        all > 0 && same as f64 >= MOSTLY * all as f64
    }

    /// The labels that occur, in the order of their numbers, with their voxels; samples that are not finite are left
    /// out. Reads every sample, on all cores.
    #[must_use]
    pub fn label_counts(&self) -> Vec<LabelCount> {
        let stored: Vec<(f64, u64)> = match &self.voxels {
            Voxels::U8(v) => tally(v, 1 << 8, |&s| usize::from(s), |i| i as f64),
            Voxels::U16(v) => tally(v, 1 << 16, |&s| usize::from(s), |i| i as f64),
            Voxels::I16(v) => tally(v, 1 << 16, |&s| (i32::from(s) + 32768) as usize, |i| i as f64 - 32768.0),
            Voxels::F32(v) => tally_floats(v),
            Voxels::F64(v) => tally_floats(v),
        };
        let mut counts: BTreeMap<i64, u64> = BTreeMap::new();
        for (stored, voxels) in stored {
            *counts.entry(self.label_of(stored)).or_default() += voxels;
        }
        counts.into_iter().map(|(number, voxels)| LabelCount { number, voxels }).collect()
    }
}

fn tally<T: Sync>(
    samples: &[T],
    size: usize,
    index: impl Fn(&T) -> usize + Sync,
    stored: impl Fn(usize) -> f64,
) -> Vec<(f64, u64)> {
    let counts = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut counts = vec![0u64; size];
            for s in chunk {
                counts[index(s)] += 1;
            }
            counts
        })
        .reduce(
            || vec![0; size],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        );
    counts.iter().enumerate().filter(|&(_, &n)| n > 0).map(|(i, &n)| (stored(i), n)).collect()
}

fn tally_floats<T: Copy + Into<f64> + Sync>(samples: &[T]) -> Vec<(f64, u64)> {
    let counts = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut counts: HashMap<u64, u64> = HashMap::new();
            for s in chunk.iter().map(|&s| s.into()).filter(|s| s.is_finite()) {
                *counts.entry(s.to_bits()).or_default() += 1;
            }
            counts
        })
        .reduce(HashMap::new, |mut a, b| {
            for (bits, n) in b {
                *a.entry(bits).or_default() += n;
            }
            a
        });
    counts.into_iter().map(|(bits, n)| (f64::from_bits(bits), n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ChannelKind;

    fn channel(voxels: Voxels, slope: f64, intercept: f64) -> Channel {
        Channel { name: "x".into(), kind: ChannelKind::Label, voxels, slope, intercept }
    }

    fn label(number: i64, name: &str, color: Option<[f64; 3]>) -> Label {
        Label { number, name: name.into(), color, opacity: None }
    }

    #[test]
    fn counts_the_same_whatever_the_type() {
        let expected = [(-2, 1), (0, 2), (7, 1)].map(|(number, voxels)| LabelCount { number, voxels });
        let signed = Voxels::I16(vec![0, 7, -2, 0].into());
        assert_eq!(channel(signed, 1.0, 0.0).label_counts(), expected);
        assert_eq!(
            channel(Voxels::F32(vec![0.0, 7.0, -2.0, -0.0].into()), 1.0, 0.0).label_counts(),
            expected
        );
        assert_eq!(
            channel(Voxels::F64(vec![0.0, 7.0, -2.0, -0.0].into()), 1.0, 0.0).label_counts(),
            expected
        );
        assert_eq!(channel(Voxels::U8(vec![2, 9, 0, 2].into()), 1.0, -2.0).label_counts(), expected);
        assert_eq!(channel(Voxels::U16(vec![2, 9, 0, 2].into()), 1.0, -2.0).label_counts(), expected);
    }

    #[test]
    fn solid_blocks_look_like_labels_and_noise_does_not() {
        let blocks: Vec<u8> = (0..1000u32).map(|i| [0, 7, 7, 3][(i % 40 / 10) as usize]).collect();
        let noise: Vec<u8> = (0..1000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 28) as u8).collect();
        let looks = |voxels: Voxels, slope| channel(voxels, slope, 0.0).looks_like_labels([40, 25, 1]);
        assert!(looks(Voxels::U8(blocks.clone().into()), 1.0));
        assert!(!looks(Voxels::U8(blocks.into()), 0.5), "half numbers");
        assert!(!looks(Voxels::U8(noise.into()), 1.0));
        assert!(!looks(Voxels::U8(vec![0; 1000].into()), 1.0), "nothing at all");
    }

    #[test]
    fn a_table_over_another_keeps_what_it_leaves_out() {
        let under = LabelTable::new([label(5, "liver", Some([1.0, 0.0, 0.0])), label(1, "spleen", None)]);
        let over = LabelTable::new([label(5, "", Some([0.0, 1.0, 0.0])), label(9, "vein", None)]);
        let both = under.with(&over);
        assert_eq!(both.labels().iter().map(|l| l.number).collect::<Vec<_>>(), [1, 5, 9]);
        assert_eq!(both.get(5), Some(&label(5, "liver", Some([0.0, 1.0, 0.0]))));
        assert_eq!(both.numbered("spleen").collect::<Vec<_>>(), [1]);
    }
}
