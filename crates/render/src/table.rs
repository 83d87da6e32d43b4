//! The transfer function as the shader reads it: colour and opacity of one step, by value.

use scene::{Mode, Scene};

/// Entries of a table. Linear between them.
pub(crate) const ENTRIES: usize = 4096;

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

/// Extinction a millimetre, by value.
pub(crate) fn extinction_table(scene: &Scene, domain: TableDomain) -> Vec<f32> {
    (0..ENTRIES).map(|e| scene.transfer.at(domain.value(e)).extinction_per_mm() as f32).collect()
}

/// Which ranges of values are seen, by a count over the table: one look a cell, whatever the function.
pub(crate) struct SeenValues {
    domain: TableDomain,
    /// Entries with opacity before the i-th.
    before: Vec<u32>,
}

impl SeenValues {
    pub(crate) fn of(table: &[[f32; 4]], domain: TableDomain) -> Self {
        let mut before = Vec::with_capacity(table.len() + 1);
        let mut count = 0;
        before.push(0);
        for entry in table {
            count += u32::from(entry[3] > 0.0);
            before.push(count);
        }
        Self { domain, before }
    }

    /// Whether some value of the range has opacity in the table, linear between its entries; an entry more is looked at
    /// on each side for the rounding of float32.
    pub(crate) fn is_seen(&self, [low, high]: [f32; 2]) -> bool {
        let last = self.before.len() - 2;
        let first_entry =
            (self.domain.position(f64::from(low)).floor() - 1.0).clamp(0.0, last as f64) as usize;
        let last_entry =
            (self.domain.position(f64::from(high)).ceil() + 1.0).clamp(0.0, last as f64) as usize;
        self.before[last_entry + 1] > self.before[first_entry]
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
        };
        SceneFile::from_json(json).unwrap().resolve(&VolumeFacts { channels: vec![channel] }).unwrap()
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
        let seen = SeenValues::of(&optical_table(&scene, domain, 1.0), domain);
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
        assert!(SeenValues::of(&table, domain).is_seen([0.0, 0.0]));
    }
}
