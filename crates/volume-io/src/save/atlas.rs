//! The slice atlas: a grey PNG of tiles, and the JSON that says what they are.

use super::{Picture, SaveError, SaveOptions, Saved, write_file};
use png::{BitDepth, ColorType};
use serde_json::json;
use std::io::Write as _;
use std::path::Path;
use volume::{ChannelKind, Voxels};

pub(super) fn save(path: &Path, picture: Picture, options: &SaveOptions) -> Result<Saved, SaveError> {
    let Picture { grid, mut channel, notes } = picture;
    let beside = path.with_extension("json");
    if beside.exists() && !options.overwrite {
        return Err(SaveError::Exists(beside));
    }
    if let Voxels::I16(samples) = &channel.voxels {
        // A PNG has no signs: numbers are moved up and their meaning down.
        channel.voxels = Voxels::U16(samples.iter().map(|&s| (i32::from(s) + 32_768) as u16).collect());
        channel.intercept -= 32_768.0 * channel.slope;
    }
    let (depth, sample_bytes) = match &channel.voxels {
        Voxels::U8(_) => (BitDepth::Eight, 1),
        Voxels::U16(_) => (BitDepth::Sixteen, 2),
        other => {
            let held = other.voxel_type().name();
            let reason = format!("a PNG has 8 or 16 bits a sample, these are {held}: ask for 8 or 16");
            return Err(SaveError::Samples { channel: channel.name, reason });
        }
    };
    let [width, height, slices] = grid.dims().map(|n| n as usize);
    // As square as tiles allow.
    let columns = ((slices * height) as f64 / width as f64).sqrt().round().clamp(1.0, slices as f64) as usize;
    let rows = slices.div_ceil(columns);
    let image = write_file(path, options.overwrite, |out| {
        let mut encoder = png::Encoder::new(out, (columns * width) as u32, (rows * height) as u32);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().map_err(std::io::Error::other)?;
        let mut stream = writer.stream_writer().map_err(std::io::Error::other)?;
        let mut line = vec![0; columns * width * sample_bytes];
        for y in 0..rows * height {
            line.fill(0);
            for (column, place) in line.chunks_exact_mut(width * sample_bytes).enumerate() {
                let slice = y / height * columns + column;
                if slice < slices {
                    let start = (slice * height + y % height) * width;
                    put(place, &channel.voxels, start..start + width);
                }
            }
            stream.write_all(&line)?;
            options.progressed((y + 1) as f32 / (rows * height) as f32);
        }
        stream.finish().map_err(std::io::Error::other)
    })?;
    let matrix = grid.volume_from_index();
    let row = |r: usize| {
        let d = matrix.matrix3.row(r);
        [d.x, d.y, d.z, matrix.translation[r]]
    };
    let kind = if channel.kind == ChannelKind::Label { "label" } else { "intensity" };
    let header = json!({
        "columns": columns, "rows": rows, "tile_px": [width, height], "slices": slices,
        "volume_from_index": [row(0), row(1), row(2)],
        "channels": [{"component": "R", "name": channel.name, "kind": kind, "slope": channel.slope,
                      "intercept": channel.intercept}],
    });
    let text = write_file(&beside, options.overwrite, |out| writeln!(out, "{header:#}"))?;
    Ok(Saved { dims: grid.dims(), files: vec![image, text], notes })
}

/// Samples as PNG wants them, the high byte first.
fn put(place: &mut [u8], voxels: &Voxels, range: std::ops::Range<usize>) {
    match voxels {
        Voxels::U8(v) => place.copy_from_slice(&v[range]),
        Voxels::U16(v) => {
            for (place, sample) in place.chunks_exact_mut(2).zip(&v[range]) {
                place.copy_from_slice(&sample.to_be_bytes());
            }
        }
        // Refused before.
        Voxels::I16(_) | Voxels::F32(_) | Voxels::F64(_) => {}
    }
}
