//! NIfTI-1, or NIfTI-2 where float32 would lose what the header says.

use super::{Picture, SaveError, SaveOptions, Saved, write_file, write_samples};
use flate2::Compression;
use flate2::write::GzEncoder;
use spatial::DVec3;
use std::io::Write;
use std::path::Path;
use volume::{ChannelKind, Grid, VoxelType};

/// How far float32 may move a voxel, in millimetres, before float64 is needed.
const NEAR_MM: f64 = 1.0e-4;
/// `sform_code` of scanner coordinates.
const CODE: u32 = 1;
/// `xyzt_units` of millimetres.
const UNITS: u8 = 2;
/// `intent_code` of a label map.
const INTENT_LABEL: u32 = 1002;

pub(super) fn save(path: &Path, picture: Picture, options: &SaveOptions) -> Result<Saved, SaveError> {
    let Picture { grid, channel, mut notes } = picture;
    let rows = ras_rows(&grid);
    let fits = |n: f64| f64::from(n as f32) == n;
    let single = fits(channel.slope) && fits(channel.intercept) && moved_mm(&grid, &rows) <= NEAR_MM;
    if !single {
        notes.push("written as NIfTI-2: float32 would move voxels or change values".to_owned());
    }
    let (datatype, bits) = match channel.voxels.voxel_type() {
        VoxelType::U8 => (2, 8),
        VoxelType::I16 => (4, 16),
        VoxelType::U16 => (512, 16),
        VoxelType::F32 => (16, 32),
        VoxelType::F64 => (64, 64),
    };
    let header = Header {
        dims: grid.dims(),
        spacing: grid.spacing_mm().to_array(),
        rows,
        datatype,
        bits,
        scale: [channel.slope, channel.intercept],
        intent: if channel.kind == ChannelKind::Label { INTENT_LABEL } else { 0 },
    };
    let header = if single { header.version_1() } else { header.version_2() };
    let gzip = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let file = write_file(path, options.overwrite, |out| {
        if gzip {
            let mut packed = GzEncoder::new(out, Compression::default());
            packed.write_all(&header)?;
            write_samples(&mut packed, &channel.voxels, options)?;
            packed.finish().map(drop)
        } else {
            out.write_all(&header)?;
            write_samples(out, &channel.voxels, options)
        }
    })?;
    Ok(Saved { dims: grid.dims(), files: vec![file], notes })
}

/// Rows of the transform from voxel index to the right, anterior and superior.
fn ras_rows(grid: &Grid) -> [[f64; 4]; 3] {
    let m = grid.volume_from_index();
    let row = |r: usize, sign: f64| {
        let d = m.matrix3.row(r);
        [sign * d.x, sign * d.y, sign * d.z, sign * m.translation[r]]
    };
    [row(0, -1.0), row(1, -1.0), row(2, 1.0)]
}

/// How far float32 moves the farthest corner.
fn moved_mm(grid: &Grid, rows: &[[f64; 4]; 3]) -> f64 {
    let last = grid.dims().map(|n| f64::from(n - 1));
    let moved = rows.map(|row| {
        let off = row.map(|n| (f64::from(n as f32) - n).abs());
        off[0] * last[0] + off[1] * last[1] + off[2] * last[2] + off[3]
    });
    DVec3::from_array(moved).length()
}

struct Header {
    dims: [u32; 3],
    spacing: [f64; 3],
    rows: [[f64; 4]; 3],
    datatype: u16,
    bits: u16,
    scale: [f64; 2],
    intent: u32,
}

/// A header that is filled at its offsets, little-endian.
struct Bytes(Vec<u8>);

impl Bytes {
    fn put(&mut self, at: usize, bytes: impl AsRef<[u8]>) {
        let bytes = bytes.as_ref();
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
    }
}

impl Header {
    /// `nifti1.h`, and four bytes that say that there are no extensions.
    fn version_1(&self) -> Vec<u8> {
        let mut out = Bytes(vec![0; 352]);
        let single = |n: f64| (n as f32).to_le_bytes();
        out.put(0, 348u32.to_le_bytes());
        for (i, n) in [3, self.dims[0], self.dims[1], self.dims[2], 1, 1, 1, 1].into_iter().enumerate() {
            // At most 32 767.
            out.put(40 + 2 * i, (n as u16).to_le_bytes());
        }
        out.put(68, (self.intent as u16).to_le_bytes());
        out.put(70, self.datatype.to_le_bytes());
        out.put(72, self.bits.to_le_bytes());
        for (i, n) in std::iter::once(1.0).chain(self.spacing).enumerate() {
            out.put(76 + 4 * i, single(n));
        }
        out.put(108, single(352.0));
        out.put(112, single(self.scale[0]));
        out.put(116, single(self.scale[1]));
        out.put(123, [UNITS]);
        out.put(254, (CODE as u16).to_le_bytes());
        for (i, n) in self.rows.iter().flatten().enumerate() {
            out.put(280 + 4 * i, single(*n));
        }
        out.put(344, b"n+1\0");
        out.0
    }

    /// `nifti2.h`, and four bytes that say that there are no extensions.
    fn version_2(&self) -> Vec<u8> {
        let mut out = Bytes(vec![0; 544]);
        out.put(0, 540u32.to_le_bytes());
        out.put(4, b"n+2\0\r\n\x1a\n");
        out.put(12, self.datatype.to_le_bytes());
        out.put(14, self.bits.to_le_bytes());
        for (i, n) in [3, self.dims[0], self.dims[1], self.dims[2], 1, 1, 1, 1].into_iter().enumerate() {
            out.put(16 + 8 * i, u64::from(n).to_le_bytes());
        }
        for (i, n) in std::iter::once(1.0).chain(self.spacing).enumerate() {
            out.put(104 + 8 * i, n.to_le_bytes());
        }
        out.put(168, 544u64.to_le_bytes());
        out.put(176, self.scale[0].to_le_bytes());
        out.put(184, self.scale[1].to_le_bytes());
        out.put(348, CODE.to_le_bytes());
        for (i, n) in self.rows.iter().flatten().enumerate() {
            out.put(400 + 8 * i, n.to_le_bytes());
        }
        out.put(500, u32::from(UNITS).to_le_bytes());
        out.put(504, self.intent.to_le_bytes());
        out.0
    }
}
