//! The transfer function as the shaders read it: a table of colour and opacity of one step, by value; and, where no step
//! is taken, its linear stretches.

use crate::cells::{Counts, SeenRanges};
use crate::layout::GpuStretch;
use scene::{HIGHEST_OPACITY_PER_MM, Mode, Scene, TransferFunction, TransferPoint};

/// Entries of a table. Linear between them.
pub(crate) const ENTRIES: usize = 4094;
/// Where the entries for a part of a step begin in the texture that holds both tables; the shader has the same number.
const OF_PARTS: usize = ENTRIES + 2;
/// Texels of that texture.
pub(crate) const TABLE_WIDTH: usize = 2 * OF_PARTS;

/// The values a table covers, whatever the step: where the transfer function and the data overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TableDomain {
    low: f64,
    high: f64,
}

impl TableDomain {
    /// Covers the transfer function within the data's range, and an entry more at each side, where it is constant.
    pub(crate) fn of(scene: &Scene, data: [f32; 2]) -> Self {
        let [data_low, data_high] = data.map(f64::from);
        let (low, high) = scene.transfer.value_range().unwrap_or((data_low, data_high));
        let (mut low, mut high) = (low.max(data_low), high.min(data_high));
        if low > high {
            // They do not meet: all data lie on one constant side of the function.
            (low, high) = (data_low, data_high);
        }
        let margin = ((high - low) / ENTRIES as f64).max(low.abs().max(high.abs()) * 1.0e-6).max(1.0e-30);
        (low, high) = (low - margin, high + margin);
        Self { low, high }
    }

    fn value(&self, entry: usize) -> f64 {
        self.low + (self.high - self.low) * entry as f64 / (ENTRIES - 1) as f64
    }

    /// Table position of a value, not clamped.
    pub(crate) fn position(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low) * (ENTRIES - 1) as f64
    }

    /// Factor and offset that take a raw texture number to a table position.
    pub(crate) fn raw_to_position(&self, value_scale: f64, value_offset: f64) -> (f64, f64) {
        let per_value = (ENTRIES - 1) as f64 / (self.high - self.low);
        (value_scale * per_value, (value_offset - self.low) * per_value)
    }
}

/// Colour (RGB, not multiplied) and opacity of a step, by value.
pub(crate) fn optical_table(scene: &Scene, domain: TableDomain, step_mm: f64) -> Vec<[f32; 4]> {
    (0..ENTRIES)
        .map(|entry| {
            let optical = scene.transfer.at(domain.value(entry));
            let opacity = match scene.mode {
                Mode::Maximum => optical.opacity_per_mm,
                // 1 - exp(-σ·step), without losing the digits of a thin step.
                _ => -(-optical.extinction_per_mm() * step_mm).exp_m1(),
            };
            let [r, g, b] = optical.color;
            [r as f32, g as f32, b as f32, opacity as f32]
        })
        .collect()
}

/// The tables of a step and of a part of one, one behind the other. Between them lies a copy of the nearest entry of each,
/// so that a filter that is not quite at an entry's centre mixes nothing in.
pub(crate) fn table_texture(scene: &Scene, domain: TableDomain, step_mm: f64, part: f64) -> Vec<[f32; 4]> {
    let [step, of_part] = [1.0, part].map(|part| optical_table(scene, domain, step_mm * part));
    let mut texels = step;
    texels.extend([texels[ENTRIES - 1], of_part[0]]);
    texels.extend(&of_part);
    texels.resize(TABLE_WIDTH, of_part[ENTRIES - 1]);
    texels
}

/// Extinction a millimetre, by value.
pub(crate) fn extinction_table(scene: &Scene, domain: TableDomain) -> Vec<f32> {
    (0..ENTRIES).map(|e| scene.transfer.at(domain.value(e)).extinction_per_mm() as f32).collect()
}

/// Values at the open ends of the first and the last stretch: beyond what a volume holds, and finite.
const OPEN_END: f32 = 3.0e38;

/// The linear stretches of the transfer function, in the order of values: one before each point, and one after the last.
pub(crate) fn stretches(scene: &Scene) -> Vec<GpuStretch> {
    let points = match scene.mode {
        Mode::Maximum => scene.transfer.points().to_vec(),
        _ => held_below_one(scene.transfer.points()),
    };
    let mut seen_before = 0;
    (0..=points.len())
        .map(|i| {
            let (before, after) = (i.checked_sub(1).and_then(|i| points.get(i)), points.get(i));
            let nothing = TransferPoint { value: 0.0, color: [0.0; 3], opacity_per_mm: 0.0 };
            let from = before.or(after).unwrap_or(&nothing);
            let to = after.unwrap_or(from);
            let value_from = before.map_or(-OPEN_END, |p| p.value as f32);
            let value_to = after.map_or(OPEN_END, |p| p.value as f32);
            let is_inner = before.is_some() && after.is_some() && value_to > value_from;
            let stretch = GpuStretch {
                value_from,
                value_to,
                opacity_from: from.opacity_per_mm as f32,
                opacity_to: to.opacity_per_mm as f32,
                color_from: from.color.map(|c| c as f32),
                per_value: if is_inner { (1.0 / (value_to - value_from)).min(f32::MAX) } else { 0.0 },
                color_to: to.color.map(|c| c as f32),
                seen_before,
            };
            seen_before += u32::from(stretch.opacity_from > 0.0 || stretch.opacity_to > 0.0);
            stretch
        })
        .collect()
}

/// Points whose opacity is held below 1, with a new one where a stretch passes [`HIGHEST_OPACITY_PER_MM`].
fn held_below_one(points: &[TransferPoint]) -> Vec<TransferPoint> {
    let mut held: Vec<TransferPoint> = Vec::with_capacity(points.len());
    for (i, &p) in points.iter().enumerate() {
        if let Some(before) = i.checked_sub(1).map(|i| points[i]) {
            let above = |p: TransferPoint| p.opacity_per_mm - HIGHEST_OPACITY_PER_MM;
            if above(before) * above(p) < 0.0 && p.value > before.value {
                let part = above(before) / (above(before) - above(p));
                let mix = |a: f64, b: f64| a + (b - a) * part;
                held.push(TransferPoint {
                    value: mix(before.value, p.value),
                    color: std::array::from_fn(|c| mix(before.color[c], p.color[c])),
                    opacity_per_mm: HIGHEST_OPACITY_PER_MM,
                });
            }
        }
        held.push(TransferPoint { opacity_per_mm: p.opacity_per_mm.min(HIGHEST_OPACITY_PER_MM), ..p });
    }
    held
}

/// Which ranges of values are seen, by counts over the table and over the function's own points: two looks a cell,
/// whatever the function.
pub(crate) struct SeenValues {
    domain: TableDomain,
    /// Entries with opacity before the i-th.
    before: Vec<u32>,
    /// The values of the function's points, and how many stretches with opacity lie before the i-th stretch.
    knots: Vec<f64>,
    stretches_before: Vec<u32>,
}

impl SeenValues {
    pub(crate) fn of(transfer: &TransferFunction, table: &[[f32; 4]], domain: TableDomain) -> Self {
        let counted = |seen: &mut dyn Iterator<Item = bool>| {
            let mut count = 0;
            let mut before = vec![0];
            before.extend(seen.map(|s| {
                count += u32::from(s);
                count
            }));
            before
        };
        let points = transfer.points();
        let opaque = |i: Option<usize>| i.and_then(|i| points.get(i)).is_some_and(|p| p.opacity_per_mm > 0.0);
        Self {
            domain,
            before: counted(&mut table.iter().map(|entry| entry[3] > 0.0)),
            knots: points.iter().map(|p| p.value).collect(),
            stretches_before: counted(
                &mut (0..=points.len()).map(|i| opaque(i.checked_sub(1)) || opaque(Some(i))),
            ),
        }
    }

    /// The table's entry at a position, held to those that there are.
    fn entry(&self, position: f64) -> usize {
        position.clamp(0.0, (self.before.len() - 2) as f64) as usize
    }

    /// Some units of float32's last place.
    fn slack(largest: f32) -> f64 {
        f64::from(largest) * 1.0e-6
    }
}

/// Whether some value of the range has opacity: in the table, linear between its entries, or in the function itself. The
/// rounding of float32 is allowed for: an entry on each side, and some units of the last place.
impl SeenRanges for SeenValues {
    fn before(&self, low: f32, largest: f32) -> Counts {
        let low = f64::from(low);
        let entry = self.entry(self.domain.position(low).floor() - 1.0);
        let knot = self.knots.partition_point(|&k| k < low - Self::slack(largest));
        [self.before[entry], self.stretches_before[knot]]
    }

    fn through(&self, high: f32, largest: f32) -> Counts {
        let high = f64::from(high);
        let entry = self.entry(self.domain.position(high).ceil() + 1.0);
        let knot = self.knots.partition_point(|&k| k <= high + Self::slack(largest));
        [self.before[entry + 1], self.stretches_before[knot + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{ChannelFacts, SceneFile, VolumeFacts};

    fn scene(json: &str) -> Scene {
        let channel = ChannelFacts {
            name: "ct".into(),
            minimum: 0.0,
            maximum: 255.0,
            percentile_2: 0.0,
            percentile_99_8: 255.0,
            labels: None,
        };
        SceneFile::from_json(json)
            .unwrap()
            .resolve(&VolumeFacts { channels: vec![channel], modality: None })
            .unwrap()
    }

    #[test]
    fn opacity_of_a_step_follows_its_length() {
        let scene = scene(r#"{"transfer": [[0, 1, 1, 1, 0.5]]}"#);
        let domain = TableDomain::of(&scene, [0.0, 255.0]);
        for (step_mm, expected) in [(1.0, 0.5), (2.0, 0.75), (0.5, 1.0 - 0.5f64.sqrt())] {
            let table = optical_table(&scene, domain, step_mm);
            assert!(table.iter().all(|e| (f64::from(e[3]) - expected).abs() < 1e-7));
        }
    }

    #[test]
    fn a_thin_fog_keeps_its_digits() {
        let scene = scene(r#"{"transfer": [[0, 1, 1, 1, 1e-6]]}"#);
        let table = optical_table(&scene, TableDomain::of(&scene, [0.0, 255.0]), 0.01);
        assert!((f64::from(table[7][3]) / 1e-8 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_narrow_band_is_seen_only_by_ranges_that_meet_it() {
        let scene =
            scene(r#"{"transfer": [[0,0,0,0,0],[100,1,1,1,0],[101,1,1,1,0.5],[102,1,1,1,0],[255,0,0,0,0]]}"#);
        let domain = TableDomain::of(&scene, [0.0, 255.0]);
        let seen = SeenValues::of(&scene.transfer, &optical_table(&scene, domain, 1.0), domain);
        assert!(seen.is_seen([0.0, 255.0]));
        assert!(seen.is_seen([100.9, 101.0]));
        assert!(!seen.is_seen([0.0, 99.0]));
        assert!(!seen.is_seen([103.0, 255.0]));
    }

    #[test]
    fn values_beyond_the_function_are_as_its_ends() {
        let scene = scene(r#"{"transfer": [[300, 1, 1, 1, 0.5], [400, 1, 1, 1, 1.0]]}"#);
        let domain = TableDomain::of(&scene, [0.0, 255.0]);
        let table = optical_table(&scene, domain, 1.0);
        assert!(table.iter().all(|e| (e[3] - 0.5).abs() < 1e-6));
        assert!(SeenValues::of(&scene.transfer, &table, domain).is_seen([0.0, 0.0]));
    }
}
