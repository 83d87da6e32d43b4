//! What a volume is, in numbers and for people: what `holocast info` prints.
//!
//! Nothing that names a patient is here, since nothing of the kind is read.

mod draw;

use crate::{Loaded, Sequence};
use serde::Serialize;
use std::fmt;
use volume::{Channel, ChannelKind, Grid, NonFiniteCount, Statistics, VoxelType, Voxels};

/// Axes that meet at an angle farther than this from 90°, in degrees, are called sheared; less is float32 rounding.
const SHEARED_DEG: f64 = 0.05;
/// Axes that lean farther than this from the patient's, in degrees, are called oblique; less is float32 rounding.
const OBLIQUE_DEG: f64 = 0.05;

/// Labels that are listed for a terminal.
const LABELS_LISTED: usize = 200;

/// What a volume is. Its `Display` is a page for a terminal of 80 columns.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VolumeDescription {
    /// The file, as the caller calls it.
    pub file: String,
    /// What the file is, in words.
    pub format: String,
    /// Voxels along x, y and z.
    pub dims: [u32; 3],
    /// Distance between voxel centres along each axis, in millimetres.
    pub spacing_mm: [f64; 3],
    /// Extent along each axis from border to border, in millimetres.
    pub size_mm: [f64; 3],
    /// The middle of the volume in patient space (LPS), in millimetres.
    pub centre_mm: [f64; 3],
    /// Rows of the transform from voxel index to patient millimetres (LPS).
    pub volume_from_index: [[f64; 4]; 3],
    /// Where the stored axes point: `LPS`, `RAS`, …
    pub orientation: String,
    /// Largest angle between a stored axis and the patient's axis it is named after, in degrees.
    pub oblique_deg: f64,
    /// Whether the stored axes form a left-handed system.
    pub left_handed: bool,
    /// Largest angle by which two stored axes miss a right angle, in degrees.
    pub shear_deg: f64,
    /// Whether that is more than rounding.
    pub sheared: bool,
    /// Bytes of all samples in memory.
    pub bytes: usize,
    /// The channels.
    pub channels: Vec<ChannelDescription>,
    /// `CT`, `MR`, `PT`, … where the file says so.
    pub modality: Option<String>,
    /// The series in time that this is one step of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<SequenceDescription>,
    /// The DICOM series that were found, one a line.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub series: Vec<String>,
    /// Who the patient is; empty unless that was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub identity: Vec<(&'static str, String)>,
    /// What a person should know about the loading.
    pub notes: Vec<String>,
}

/// Volumes that follow each other in time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SequenceDescription {
    /// How many there are.
    pub steps: u64,
    /// Which of them this is, counted from 0.
    pub loaded: u64,
    /// Seconds from one to the next, if the file says so.
    pub step_secs: Option<f64>,
}

/// What a channel holds. Values are after slope and intercept.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelDescription {
    /// Its name.
    pub name: String,
    /// `intensity` or `label`.
    pub kind: &'static str,
    /// How samples are held: `uint8`, `int16`, `uint16`, `float32`, `float64`.
    pub r#type: &'static str,
    /// Value a stored unit.
    pub slope: f64,
    /// Value of a stored 0.
    pub intercept: f64,
    /// Lowest value.
    pub minimum: f64,
    /// Highest value.
    pub maximum: f64,
    /// Mean value.
    pub mean: f64,
    /// Values below which a part of the samples lies.
    pub percentiles: Percentiles,
    /// Lowest and highest value of the window to begin with.
    pub window: [f64; 2],
    /// Where that is from: `file`, `percentiles` (1 and 99 %), or the whole `range`.
    pub window_from: &'static str,
    /// Largest difference between a value and what a device with float32 arithmetic makes of it.
    pub float32_rounding: f64,
    /// How often values occur.
    pub histogram: HistogramDescription,
    /// Samples that were no numbers in the file.
    pub non_finite: NonFiniteDescription,
    /// The labels that voxels have, where it holds labels.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<LabelDescription>,
    /// Whether measured values look like labels: whole numbers, of which neighbours have the same.
    pub looks_like_labels: bool,
}

/// A label that voxels have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelDescription {
    /// Its number.
    pub number: i64,
    /// Its name; empty where the file gives none.
    pub name: String,
    /// RGB, 0 to 1, where the file gives one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<[f64; 3]>,
    /// Voxels that have it.
    pub voxels: u64,
    /// Their volume, millilitres.
    pub ml: f64,
}

/// Values below which 1, 50 and 99 % of the samples lie, to within a bin of the histogram.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    /// 1 %.
    pub p1: f64,
    /// 50 %, the median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
}

/// Counts in equal bins.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HistogramDescription {
    /// Value at the lower edge of the first bin.
    pub low: f64,
    /// Value at the upper edge of the last bin.
    pub high: f64,
    /// Samples in each bin.
    pub counts: Vec<u64>,
}

/// Samples that were no numbers and were replaced.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NonFiniteDescription {
    /// NaN.
    pub nan: usize,
    /// +Inf.
    pub positive_infinity: usize,
    /// -Inf.
    pub negative_infinity: usize,
}

impl VolumeDescription {
    /// Describes what was loaded from `file`. Counts every sample.
    #[must_use]
    pub fn of(file: &str, loaded: &Loaded) -> Self {
        let grid = loaded.volume.grid();
        let (orientation, oblique_deg) = grid.orientation();
        let rows = grid.volume_from_index();
        let row = |r: usize| {
            let m = rows.matrix3.row(r);
            [m.x, m.y, m.z, rows.translation[r]]
        };
        let shear_deg = shear_deg(grid);
        Self {
            file: file.to_owned(),
            format: loaded.report.format.to_string(),
            dims: grid.dims(),
            spacing_mm: grid.spacing_mm().to_array(),
            size_mm: grid.size_mm().to_array(),
            centre_mm: grid.centre_in_volume().to_array(),
            volume_from_index: [row(0), row(1), row(2)],
            orientation,
            oblique_deg,
            left_handed: grid.is_left_handed(),
            shear_deg,
            sheared: shear_deg > SHEARED_DEG,
            bytes: loaded.volume.sample_bytes(),
            channels: loaded
                .volume
                .channels()
                .iter()
                .zip(&loaded.report.non_finite)
                .map(|(channel, count)| ChannelDescription::of(channel, *count, loaded))
                .collect(),
            modality: loaded.report.modality.clone(),
            sequence: loaded.report.sequence.map(|Sequence { steps, loaded, step_secs }| {
                SequenceDescription { steps, loaded, step_secs }
            }),
            series: loaded.report.series.iter().map(ToString::to_string).collect(),
            identity: loaded.report.identity.clone(),
            notes: loaded.report.notes.clone(),
        }
    }
}

impl ChannelDescription {
    fn of(channel: &Channel, non_finite: NonFiniteCount, loaded: &Loaded) -> Self {
        let of_file = loaded.report.window;
        let is_label = channel.kind == ChannelKind::Label;
        let grid = loaded.volume.grid();
        let voxel_ml = grid.volume_from_index().matrix3.determinant().abs() / 1000.0;
        let label = |count: &volume::LabelCount| {
            let known = loaded.report.labels.get(count.number);
            LabelDescription {
                number: count.number,
                name: known.map(|l| l.name.clone()).unwrap_or_default(),
                color: known.and_then(|l| l.color),
                voxels: count.voxels,
                ml: count.voxels as f64 * voxel_ml,
            }
        };
        let statistics = Statistics::of(channel);
        let (p1, p99) = (statistics.percentile(0.01), statistics.percentile(0.99));
        let (window, window_from) = match of_file {
            Some(window) => (window, "file"),
            // Where most of the volume is air, that alone would be between the percentiles.
            None if p99 > p1 => ([p1, p99], "percentiles"),
            None => ([statistics.minimum, statistics.maximum], "range"),
        };
        Self {
            name: channel.name.clone(),
            kind: match channel.kind {
                ChannelKind::Intensity => "intensity",
                ChannelKind::Label => "label",
            },
            r#type: channel.voxels.voxel_type().name(),
            slope: channel.slope,
            intercept: channel.intercept,
            minimum: statistics.minimum,
            maximum: statistics.maximum,
            mean: statistics.mean,
            percentiles: Percentiles { p1, p50: statistics.percentile(0.5), p99 },
            window,
            window_from,
            float32_rounding: float32_rounding(channel),
            non_finite: NonFiniteDescription {
                nan: non_finite.nan,
                positive_infinity: non_finite.positive_infinity,
                negative_infinity: non_finite.negative_infinity,
            },
            histogram: HistogramDescription {
                low: statistics.histogram.low,
                high: statistics.histogram.high,
                counts: statistics.histogram.counts,
            },
            labels: if is_label { channel.label_counts().iter().map(label).collect() } else { Vec::new() },
            looks_like_labels: !is_label && channel.looks_like_labels(grid.dims()),
        }
    }
}

/// Largest difference between a value, slope and intercept in float64, and the same in float32 of the stored number.
/// Integers are all tried; float32 is looked at sample by sample.
fn float32_rounding(channel: &Channel) -> f64 {
    let Channel { slope, intercept, .. } = channel;
    let lost = |stored: f64| {
        let value = slope * stored + intercept;
        (f64::from((*slope as f32).mul_add(volume::single(stored), *intercept as f32)) - value).abs()
    };
    let worst = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(lost).fold(0.0, f64::max);
    let between = |low: Option<i32>, high: Option<i32>| match (low, high) {
        (Some(low), Some(high)) => worst(&mut (low..=high).map(f64::from)),
        _ => 0.0,
    };
    match &channel.voxels {
        Voxels::U8(_) => between(Some(0), Some(255)),
        Voxels::I16(v) => between(v.iter().min().map(|&s| s.into()), v.iter().max().map(|&s| s.into())),
        Voxels::U16(v) => between(v.iter().min().map(|&s| s.into()), v.iter().max().map(|&s| s.into())),
        Voxels::F32(_) if (*slope, *intercept) == (1.0, 0.0) => 0.0,
        Voxels::F32(v) => worst(&mut v.iter().map(|&s| f64::from(s))),
        Voxels::F64(v) => worst(&mut v.iter().copied()),
    }
}

/// Largest angle by which two axes miss a right angle, in degrees.
fn shear_deg(grid: &Grid) -> f64 {
    let d = grid.directions();
    [(0, 1), (1, 2), (2, 0)]
        .into_iter()
        .map(|(a, b)| d.col(a).dot(d.col(b)).clamp(-1.0, 1.0).asin().to_degrees().abs())
        .fold(0.0, f64::max)
}

impl fmt::Display for VolumeDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.dims;
        let voxels = self.dims.iter().map(|&d| f64::from(d)).product::<f64>();
        let by = |v: [f64; 3]| v.map(draw::number).join(" × ");
        writeln!(f, "{}", self.file)?;
        write!(f, "  format       {}", self.format)?;
        match &self.modality {
            Some(modality) => writeln!(f, ", {modality}")?,
            None => writeln!(f)?,
        }
        for (what, who) in &self.identity {
            writeln!(f, "  {:<12} {who}", format!("patient {what}"))?;
        }
        writeln!(
            f,
            "  voxels       {x} × {y} × {z} = {}, {} in memory",
            draw::count(voxels),
            draw::bytes(self.bytes)
        )?;
        writeln!(f, "  spacing      {} mm", by(self.spacing_mm))?;
        writeln!(f, "  size         {} mm", by(self.size_mm))?;
        write!(f, "  orientation  {}, ", self.orientation)?;
        if self.oblique_deg > OBLIQUE_DEG {
            write!(f, "oblique by {:.1}°", self.oblique_deg)?;
        } else {
            write!(f, "along the patient's axes")?;
        }
        write!(f, ", {}-handed", if self.left_handed { "left" } else { "right" })?;
        if self.sheared {
            write!(f, ", sheared by {:.1}°", self.shear_deg)?;
        }
        writeln!(f)?;
        if let Some(SequenceDescription { steps, loaded, step_secs }) = self.sequence {
            write!(f, "  time         {steps} volumes")?;
            match step_secs {
                Some(secs) => write!(f, ", {} s apart", draw::number(secs))?,
                None => write!(f, ", how far apart is not in the file")?,
            }
            writeln!(f, "; this is number {loaded} of 0 to {}", steps - 1)?;
        }
        for channel in &self.channels {
            write!(f, "\n{channel}")?;
        }
        if self.series.len() > 1 {
            writeln!(f, "\n  series")?;
            for series in &self.series {
                writeln!(f, "  · {series}")?;
            }
        }
        if !self.notes.is_empty() {
            writeln!(f, "\n  notes")?;
        }
        for note in &self.notes {
            for (i, line) in draw::wrapped(note, 74).iter().enumerate() {
                writeln!(f, "  {} {line}", if i == 0 { "·" } else { " " })?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for ChannelDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = draw::number;
        write!(f, "  channel '{}': {}, {}", self.name, self.kind, self.r#type)?;
        if (self.slope, self.intercept) != (1.0, 0.0) {
            write!(f, ", value = {} · stored", number(self.slope))?;
            if self.intercept != 0.0 {
                let sign = if self.intercept < 0.0 { '-' } else { '+' };
                write!(f, " {sign} {}", number(self.intercept.abs()))?;
            }
        }
        writeln!(f)?;
        let Percentiles { p1, p50, p99 } = self.percentiles;
        writeln!(
            f,
            "  values       {} to {}, mean {}",
            number(self.minimum),
            number(self.maximum),
            number(self.mean)
        )?;
        writeln!(f, "  percentiles  1 %: {}, 50 %: {}, 99 %: {}", number(p1), number(p50), number(p99))?;
        let from = match self.window_from {
            "file" => "as the file says",
            "percentiles" => "1 to 99 %",
            _ => "the whole range",
        };
        writeln!(f, "  window       {} to {}, {from}", number(self.window[0]), number(self.window[1]))?;
        if self.float32_rounding > 0.0 {
            let what =
                if self.r#type == VoxelType::F64.name() { "samples and" } else { "samples as they are," };
            let rounding = number(self.float32_rounding);
            writeln!(f, "  on a device  {what} values in float32: off by at most {rounding}")?;
        } else {
            writeln!(f, "  on a device  samples and values as they are")?;
        }
        let NonFiniteDescription { nan, positive_infinity, negative_infinity } = self.non_finite;
        if nan + positive_infinity + negative_infinity > 0 {
            writeln!(
                f,
                "  replaced     {nan} NaN, {positive_infinity} +Inf, {negative_infinity} -Inf in the file"
            )?;
        }
        draw::histogram(f, &self.histogram.counts, self.histogram.low, self.histogram.high)?;
        if self.looks_like_labels {
            writeln!(f, "  its values look like labels: --kind label shows them as such")?;
        }
        if !self.labels.is_empty() {
            writeln!(f, "  labels       number   voxels         ml  name")?;
        }
        for label in self.labels.iter().take(LABELS_LISTED) {
            let LabelDescription { number, name, voxels, ml, .. } = label;
            writeln!(f, "  {number:>18} {voxels:>8} {ml:>10.2}  {name}")?;
        }
        if self.labels.len() > LABELS_LISTED {
            writeln!(f, "  and {} more; --json lists all", self.labels.len() - LABELS_LISTED)?;
        }
        Ok(())
    }
}
