//! From the samples of a channel to those that a file gets.

use super::{Picture, SaveError, SaveOptions};
use volume::{Channel, ChannelKind, Statistics, Voxels};

/// Bits of a sample in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// As they are held.
    #[default]
    Kept,
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

/// Converts to the depth that was asked for.
pub(super) fn converted(mut picture: Picture, options: &SaveOptions) -> Result<Picture, SaveError> {
    let levels = match options.depth {
        Depth::Kept => return Ok(picture),
        Depth::Eight => 255.0,
        Depth::Sixteen => 65_535.0,
    };
    let channel = &mut picture.channel;
    let is_there = match &channel.voxels {
        Voxels::U8(_) => options.depth == Depth::Eight || options.window.is_none(),
        Voxels::I16(_) | Voxels::U16(_) => options.depth == Depth::Sixteen,
        Voxels::F32(_) | Voxels::F64(_) => false,
    };
    if is_there && options.window.is_none() {
        return Ok(picture);
    }
    if channel.kind == ChannelKind::Label {
        channel.voxels = labels(channel, levels)?;
        return Ok(picture);
    }
    let [low, high] = match options.window {
        Some(window) => window,
        None => {
            let statistics = Statistics::of(channel);
            [statistics.minimum, statistics.maximum]
        }
    };
    if !(low <= high && low.is_finite() && high.is_finite()) || (options.window.is_some() && low == high) {
        return Err(SaveError::Window([low, high]));
    }
    let slope = if high > low { (high - low) / levels } else { 1.0 };
    let mut clipped = 0usize;
    let mut worst = 0.0f64;
    let numbers = (0..channel.voxels.len()).map(|at| {
        let value = channel.value(at);
        let number = ((value - low) / slope).round();
        let kept = number.clamp(0.0, levels);
        if value < low || value > high {
            clipped += 1;
        } else {
            worst = worst.max((kept * slope + low - value).abs());
        }
        kept
    });
    channel.voxels = if options.depth == Depth::Eight {
        Voxels::U8(numbers.map(|n| n as u8).collect())
    } else {
        Voxels::U16(numbers.map(|n| n as u16).collect())
    };
    (channel.slope, channel.intercept) = (slope, low);
    picture.notes.push(format!(
        "values from {low} to {high} in {} steps: rounded by at most {worst:.3e}, {clipped} outside were clipped",
        levels as u32 + 1
    ));
    Ok(picture)
}

/// Labels in fewer or more bits: names are not rounded.
fn labels(channel: &Channel, levels: f64) -> Result<Voxels, SaveError> {
    let values = || (0..channel.voxels.len()).map(|at| channel.value(at));
    if let Some(wrong) = values().find(|v| !(0.0..=levels).contains(v) || v.fract() != 0.0) {
        return Err(SaveError::Samples {
            channel: channel.name.clone(),
            reason: format!("label {wrong} does not fit whole numbers from 0 to {levels}"),
        });
    }
    Ok(if levels < 256.0 {
        Voxels::U8(values().map(|v| v as u8).collect())
    } else {
        Voxels::U16(values().map(|v| v as u16).collect())
    })
}

/// Samples that are their values, for formats that have no slope.
pub(super) fn unscaled(mut picture: Picture) -> Picture {
    let channel = &mut picture.channel;
    if (channel.slope, channel.intercept) == (1.0, 0.0) {
        return picture;
    }
    let statistics = Statistics::of(channel);
    let whole = channel.slope.fract() == 0.0
        && channel.intercept.fract() == 0.0
        && !matches!(channel.voxels, Voxels::F32(_) | Voxels::F64(_));
    let fits = |low: f64, high: f64| whole && low <= statistics.minimum && statistics.maximum <= high;
    let values = (0..channel.voxels.len()).map(|at| channel.value(at));
    channel.voxels = if fits(0.0, 255.0) {
        Voxels::U8(values.map(|v| v as u8).collect())
    } else if fits(-32_768.0, 32_767.0) {
        Voxels::I16(values.map(|v| v as i16).collect())
    } else if fits(0.0, 65_535.0) {
        Voxels::U16(values.map(|v| v as u16).collect())
    } else if values.clone().all(|v| f64::from(v as f32) == v) {
        Voxels::F32(values.map(|v| v as f32).collect())
    } else {
        Voxels::F64(values.collect())
    };
    let name = channel.voxels.voxel_type().name();
    (channel.slope, channel.intercept) = (1.0, 0.0);
    picture
        .notes
        .push(format!("the format has no slope and intercept: values are written as {name}, without loss"));
    picture
}
