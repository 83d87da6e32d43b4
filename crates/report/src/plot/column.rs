//! The frames of a headset as columns along the time: one a frame, or one for many.

use super::axis::step;
use crate::distribution::nearest_rank;
use crate::{FrameRecord, HeadsetRun};

/// A stretch of time and what was decoded in it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    /// Where it begins and ends, in seconds since the run began.
    pub(super) from_secs: f64,
    pub(super) to_secs: f64,
    /// For each stage the time from the pose to its end, in milliseconds; never less than the one before.
    pub(super) ends_ms: Vec<f64>,
    /// From pose to decoded picture, in milliseconds: the median and the p95 of the column's frames.
    pub(super) p50_ms: f64,
    pub(super) p95_ms: f64,
    /// Share of frames, 0 to 1, that were late.
    pub(super) late: f64,
    /// Whether there is a key frame among them.
    pub(super) key_frame: bool,
    /// Mean rendered width over the stream's width.
    pub(super) resolution_scale: f64,
    /// Mean of the full-quality step over the step, at most 1.
    pub(super) fineness: f64,
}

/// All columns of a headset, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Columns {
    pub(super) columns: Vec<Column>,
    /// How long each is, in seconds; `None` if each is a frame.
    pub(super) bin_secs: Option<f64>,
}

/// A frame's column reaches back to the frame before it, so that one that kept the eye waiting is wide. It does not reach
/// back further than this many median intervals; then a gap shows the freeze.
const LONGEST_WAIT: f64 = 3.0;

impl Columns {
    /// One column a frame if there are at most `most` frames, else at most `most` columns of equal length.
    pub(super) fn of(headset: &HeadsetRun, most: usize) -> Self {
        let mut frames: Vec<&FrameRecord> =
            headset.frames.iter().filter(|frame| frame.decoded_at_secs.is_finite()).collect();
        frames.sort_by(|a, b| a.decoded_at_secs.total_cmp(&b.decoded_at_secs));
        let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Self::default() };
        if frames.len() <= most {
            return Self { columns: one_each(headset, &frames), bin_secs: None };
        }
        let bin_secs = step((last.decoded_at_secs - first.decoded_at_secs).max(1e-3), most.max(2) - 1);
        let bin = |frame: &FrameRecord| (frame.decoded_at_secs / bin_secs).floor();
        let columns = frames.chunk_by(|a, b| bin(a) == bin(b)).map(|frames| {
            let from_secs = bin(frames[0]) * bin_secs;
            column(headset, frames, from_secs, from_secs + bin_secs)
        });
        Self { columns: columns.collect(), bin_secs: Some(bin_secs) }
    }

    /// Columns that follow each other without a gap.
    pub(super) fn stretches(&self) -> impl Iterator<Item = &[Column]> {
        self.columns.chunk_by(|a, b| (b.from_secs - a.to_secs).abs() < 1e-9 * (1.0 + b.from_secs.abs()))
    }
}

fn one_each(headset: &HeadsetRun, frames: &[&FrameRecord]) -> Vec<Column> {
    let mut intervals: Vec<f64> =
        frames.windows(2).map(|pair| pair[1].decoded_at_secs - pair[0].decoded_at_secs).collect();
    intervals.sort_unstable_by(f64::total_cmp);
    let usual =
        if intervals.is_empty() { 1.0 / headset.asked_hz.max(1.0) } else { nearest_rank(&intervals, 50) };
    let columns = frames.iter().enumerate().map(|(index, frame)| {
        let to_secs = frame.decoded_at_secs;
        let from_secs = match index.checked_sub(1) {
            Some(before) => frames[before].decoded_at_secs.max(to_secs - usual * LONGEST_WAIT),
            None => to_secs - usual,
        };
        column(headset, &[frame], from_secs, to_secs)
    });
    columns.collect()
}

/// The column of `frames`, which is not empty. Its stages are those of its median frame, so that they sum to its total.
fn column(headset: &HeadsetRun, frames: &[&FrameRecord], from_secs: f64, to_secs: f64) -> Column {
    let mut by_total = frames.to_vec();
    by_total.sort_by_key(|frame| frame.pose_to_decoded_us);
    let rank = |percent: usize| by_total[(percent * by_total.len()).div_ceil(100).max(1) - 1];
    let (median, slow) = (rank(50), rank(95));
    let mean = |value: &dyn Fn(&FrameRecord) -> f64| {
        frames.iter().map(|frame| value(frame)).sum::<f64>() / frames.len() as f64
    };
    let (mut end_us, mut highest_us) = (0i64, 0i64);
    let ends_ms = median.stages_us.iter().map(|stage_us| {
        // A stage between two clocks can be negative; it is drawn as nothing, and what follows keeps its place.
        end_us = end_us.saturating_add(*stage_us);
        highest_us = highest_us.max(end_us).min(median.pose_to_decoded_us.max(0));
        highest_us as f64 * 1e-3
    });
    Column {
        from_secs,
        to_secs,
        ends_ms: ends_ms.collect(),
        p50_ms: median.pose_to_decoded_us as f64 * 1e-3,
        p95_ms: slow.pose_to_decoded_us as f64 * 1e-3,
        late: mean(&|frame| f64::from(u8::from(frame.is_late()))),
        key_frame: frames.iter().any(|frame| frame.key_frame),
        resolution_scale: mean(&|frame| frame.resolution_scale),
        fineness: mean(&|frame| {
            if frame.step_scale > 0.0 { (headset.full_step_scale / frame.step_scale).min(1.0) } else { 1.0 }
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headset(times: impl IntoIterator<Item = f64>) -> HeadsetRun {
        let frame = |(index, decoded_at_secs): (usize, f64)| FrameRecord {
            frame: index as u64,
            decoded_at_secs,
            stages_us: vec![1_000 + index as i64, -200, 500],
            pose_to_decoded_us: 1_300 + index as i64,
            lateness_us: if index % 4 == 0 { 1 } else { 0 },
            resolution_scale: 1.0,
            step_scale: 1.0,
            ..FrameRecord::default()
        };
        let frames = times.into_iter().enumerate().map(frame).collect();
        HeadsetRun { asked_hz: 10.0, full_step_scale: 0.5, frames, ..HeadsetRun::default() }
    }

    #[test]
    fn a_freeze_leaves_a_gap() {
        let columns = Columns::of(&headset([0.0, 0.1, 0.2, 1.2, 1.3]), 100);
        let stretches: Vec<usize> = columns.stretches().map(<[_]>::len).collect();
        assert_eq!((stretches, columns.bin_secs), (vec![3, 2], None));
        assert!((columns.columns[3].from_secs - 0.9).abs() < 1e-9, "{:?}", columns.columns[3]);
    }

    #[test]
    fn many_frames_become_few_columns_of_their_median_frame() {
        let columns = Columns::of(&headset((0..6_000).map(|frame| f64::from(frame) * 0.1)), 320);
        assert_eq!((columns.columns.len(), columns.bin_secs), (300, Some(2.0)));
        let column = &columns.columns[1];
        assert_eq!((column.from_secs, column.to_secs), (2.0, 4.0));
        // Frames 20 to 39: the tenth is the median, the nineteenth the p95.
        assert_eq!((column.p50_ms, column.p95_ms), (1.329, 1.338));
        assert_eq!((column.late, column.fineness), (0.25, 0.5));
    }

    #[test]
    fn a_negative_stage_is_drawn_as_nothing() {
        let columns = Columns::of(&headset([0.0]), 100);
        assert_eq!(columns.columns[0].ends_ms, [1.0, 1.0, 1.3]);
    }
}
