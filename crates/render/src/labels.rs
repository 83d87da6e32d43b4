//! Labels on the device: voxels hold a label's place among those of the channel, and a list says what each does to light.

use crate::cells::{Counts, SeenRanges};
use crate::error::RenderError;
use crate::layout::GpuStretch;
use scene::LabelLooks;
use volume::{Channel, Voxels};

/// Most labels that a channel may hold: what 16 bits tell apart.
const MOST_LABELS: usize = 1 << 16;

/// The labels of a channel, in the order of their numbers; a voxel's place among them stands for it.
pub(crate) fn places(channel: &Channel) -> Result<(Vec<i64>, Channel), RenderError> {
    let numbers: Vec<i64> = channel.label_counts().iter().map(|count| count.number).collect();
    if numbers.len() > MOST_LABELS {
        let (channel, found) = (channel.name.clone(), numbers.len());
        return Err(RenderError::TooManyLabels { channel, found, max: MOST_LABELS });
    }
    let place = |stored: f64| numbers.binary_search(&channel.label_of(stored)).unwrap_or_default();
    // Of each stored number once, where there are few of them.
    let voxels = match &channel.voxels {
        Voxels::U8(v) => {
            let of: Vec<u8> = (0..=255u8).map(|s| place(f64::from(s)) as u8).collect();
            Voxels::U8(v.iter().map(|&s| of[usize::from(s)]).collect())
        }
        Voxels::U16(v) => {
            let of: Vec<u16> = (0..=u16::MAX).map(|s| place(f64::from(s)) as u16).collect();
            Voxels::U16(v.iter().map(|&s| of[usize::from(s)]).collect())
        }
        Voxels::I16(v) => {
            let of: Vec<u16> = (0..=u16::MAX).map(|s| place(f64::from(s as i16)) as u16).collect();
            Voxels::U16(v.iter().map(|&s| of[usize::from(s as u16)]).collect())
        }
        Voxels::F32(v) => Voxels::U16(v.iter().map(|&s| place(f64::from(s)) as u16).collect()),
        Voxels::F64(v) => Voxels::U16(v.iter().map(|&s| place(s) as u16).collect()),
    };
    let places = Channel { name: channel.name.clone(), voxels, slope: 1.0, intercept: 0.0, ..*channel };
    Ok((numbers, places))
}

/// What each label does to light, as `shaders/labels.wgsl` reads it.
pub(crate) fn looks_on_device(numbers: &[i64], looks: &LabelLooks) -> Vec<GpuStretch> {
    let look = |&number: &i64| {
        let optical = looks.at(number);
        GpuStretch {
            color_from: optical.color.map(|c| c as f32),
            opacity_from: optical.opacity_per_mm.min(scene::HIGHEST_OPACITY_PER_MM) as f32,
            opacity_to: optical.extinction_per_mm() as f32,
            ..GpuStretch::default()
        }
    };
    numbers.iter().map(look).collect()
}

/// Which ranges of places hold a label that is seen: two looks a cell.
pub(crate) struct SeenLabels {
    /// Labels with opacity before the i-th.
    before: Vec<u32>,
}

impl SeenLabels {
    pub(crate) fn of(looks: &[GpuStretch]) -> Self {
        let mut count = 0;
        let after = looks.iter().map(|look| {
            count += u32::from(look.opacity_from > 0.0);
            count
        });
        Self { before: std::iter::once(0).chain(after).collect() }
    }

    fn counted(&self, place: f32) -> Counts {
        [self.before[(place.max(0.0) as usize).min(self.before.len() - 1)], 0]
    }
}

/// Whether a label from one place to another has opacity. Ranges are a little wider than what cells hold.
impl SeenRanges for SeenLabels {
    fn before(&self, low: f32, _: f32) -> Counts {
        self.counted(low.floor())
    }

    fn through(&self, high: f32, _: f32) -> Counts {
        self.counted(high.ceil() + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::Optical;
    use volume::ChannelKind;

    fn channel(voxels: Voxels) -> Channel {
        Channel { name: "l".into(), kind: ChannelKind::Label, voxels, slope: 1.0, intercept: 0.0 }
    }

    #[test]
    fn places_are_the_same_whatever_the_type() {
        let numbers = vec![-3, 0, 500];
        let (found, held) = places(&channel(Voxels::I16(vec![500, 0, -3, 0].into()))).unwrap();
        assert_eq!((&found, held.voxels), (&numbers, Voxels::U16(vec![2, 1, 0, 1].into())));
        let (found, held) = places(&channel(Voxels::F32(vec![500.0, 0.0, -3.0, 0.0].into()))).unwrap();
        assert_eq!((found, held.voxels), (numbers, Voxels::U16(vec![2, 1, 0, 1].into())));
        let (found, held) = places(&channel(Voxels::U8(vec![200, 7].into()))).unwrap();
        assert_eq!((found, held.voxels), (vec![7, 200], Voxels::U8(vec![1, 0].into())));
    }

    #[test]
    fn a_range_is_seen_if_a_label_in_it_is() {
        let shown = Optical { color: [1.0; 3], opacity_per_mm: 0.5 };
        let looks = looks_on_device(&[0, 3, 9, 12], &LabelLooks::new([(9, shown)]));
        let seen = SeenLabels::of(&looks);
        assert!(seen.is_seen([0.0, 3.0]) && seen.is_seen([2.0, 2.0]));
        assert!(!seen.is_seen([0.0, 0.5]) && !seen.is_seen([3.2, 3.5]));
    }
}
