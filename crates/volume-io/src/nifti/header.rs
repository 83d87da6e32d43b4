//! The fields of a NIfTI header, of both versions and both byte orders.

use crate::LoadError;
use crate::load::{checked_axis, checked_scaling, read_promised};
use crate::samples::{ByteOrder, StoredType};
use std::io::Read;

/// Bytes of the NIfTI-1 header, which is also its first field.
const LENGTH_1: usize = 348;
/// Bytes of the NIfTI-2 header, which is also its first field.
const LENGTH_2: usize = 540;
/// Bytes that say whether extensions follow.
const EXTENDER: u64 = 4;
/// `magic` of a NIfTI-1 file with its voxels.
const MAGIC_1: &[u8] = b"n+1\0";
/// `magic` of a NIfTI-1 header whose voxels are in another file.
const MAGIC_1_PAIR: &[u8] = b"ni1\0";
/// `magic` of a NIfTI-2 file with its voxels.
const MAGIC_2: &[u8] = b"n+2\0\r\n\x1a\n";
/// `magic` of a NIfTI-2 header whose voxels are in another file.
const MAGIC_2_PAIR: &[u8] = b"ni2\0\r\n\x1a\n";

/// Version of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Version {
    /// NIfTI-1, 2004.
    One,
    /// NIfTI-2, 2011: the same fields, wider.
    Two,
}

/// The fields that matter for a volume, as the file gives them. Text fields are not read: they may name the patient.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub(crate) version: Version,
    pub(crate) order: ByteOrder,
    pub(crate) dim: [i64; 8],
    pub(crate) datatype: i64,
    pub(crate) bitpix: i64,
    pub(crate) pixdim: [f64; 8],
    pub(crate) vox_offset: f64,
    pub(crate) scl_slope: f64,
    pub(crate) scl_inter: f64,
    pub(crate) xyzt_units: i64,
    pub(crate) intent_code: i64,
    pub(crate) qform_code: i64,
    pub(crate) sform_code: i64,
    /// Components b, c, d of the quaternion.
    pub(crate) quatern: [f64; 3],
    /// Where the quaternion's transform puts the first voxel.
    pub(crate) qoffset: [f64; 3],
    /// Rows of the affine transform.
    pub(crate) srow: [[f64; 4]; 3],
}

/// Version and byte order, by the first field: the header's length.
fn recognise(start: &[u8]) -> Option<(Version, ByteOrder)> {
    let first: [u8; 4] = start.get(..4)?.try_into().ok()?;
    [(ByteOrder::Little, u32::from_le_bytes(first)), (ByteOrder::Big, u32::from_be_bytes(first))]
        .into_iter()
        .find_map(|(order, length)| match length as usize {
            LENGTH_1 => Some((Version::One, order)),
            LENGTH_2 => Some((Version::Two, order)),
            _ => None,
        })
}

/// Whether a file that starts like this is a NIfTI file, or an ANALYZE one that should be told from it.
pub(crate) fn is_header(start: &[u8]) -> bool {
    recognise(start).is_some()
}

impl Header {
    /// Reads the header, and nothing after it.
    pub(crate) fn read(
        file: &str,
        input: &mut impl Read,
        packed: Option<&'static str>,
    ) -> Result<Self, LoadError> {
        let mut bytes = [0; LENGTH_2];
        read_promised(file, input, &mut bytes[..4], "header", packed)?;
        let Some((version, order)) = recognise(&bytes) else {
            return Err(LoadError::field(file, "sizeof_hdr", "348 or 540", &format!("{:02x?}", &bytes[..4])));
        };
        let length = if version == Version::One { LENGTH_1 } else { LENGTH_2 };
        read_promised(file, input, &mut bytes[4..length], "header after its first 4", packed)?;
        let header = match version {
            Version::One => Self::parse_1(&Fields { bytes: &bytes, order }),
            Version::Two => Self::parse_2(&Fields { bytes: &bytes, order }),
        };
        let (magic, single, pair) = match version {
            Version::One => (&bytes[344..348], MAGIC_1, MAGIC_1_PAIR),
            Version::Two => (&bytes[4..12], MAGIC_2, MAGIC_2_PAIR),
        };
        if magic == single {
            return Ok(header);
        }
        let expected = format!("'{}'", single.escape_ascii());
        let found = if magic == pair {
            format!("'{}': the voxels are in another file, of a pair .hdr and .img", magic.escape_ascii())
        } else {
            format!("'{}'", magic.escape_ascii())
        };
        Err(LoadError::field(file, "magic", expected, &found))
    }

    fn parse_1(f: &Fields<'_>) -> Self {
        let f32s = |at: usize| f64::from(f32::from_bits(f.u32(at)));
        let i16s = |at: usize| i64::from(f.u16(at) as i16);
        Self {
            version: Version::One,
            order: f.order,
            dim: std::array::from_fn(|i| i16s(40 + 2 * i)),
            intent_code: i16s(68),
            datatype: i16s(70),
            bitpix: i16s(72),
            pixdim: std::array::from_fn(|i| f32s(76 + 4 * i)),
            vox_offset: f32s(108),
            scl_slope: f32s(112),
            scl_inter: f32s(116),
            xyzt_units: i64::from(f.bytes[123]),
            qform_code: i16s(252),
            sform_code: i16s(254),
            quatern: std::array::from_fn(|i| f32s(256 + 4 * i)),
            qoffset: std::array::from_fn(|i| f32s(268 + 4 * i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| f32s(280 + 16 * r + 4 * c))),
        }
    }

    fn parse_2(f: &Fields<'_>) -> Self {
        let f64s = |at: usize| f64::from_bits(f.u64(at));
        let i64s = |at: usize| f.u64(at) as i64;
        let i32s = |at: usize| i64::from(f.u32(at) as i32);
        let i16s = |at: usize| i64::from(f.u16(at) as i16);
        Self {
            version: Version::Two,
            order: f.order,
            datatype: i16s(12),
            bitpix: i16s(14),
            dim: std::array::from_fn(|i| i64s(16 + 8 * i)),
            pixdim: std::array::from_fn(|i| f64s(104 + 8 * i)),
            // An integer here; as float64 it is exact to 2^53, far beyond any file.
            vox_offset: i64s(168) as f64,
            scl_slope: f64s(176),
            scl_inter: f64s(184),
            qform_code: i32s(344),
            sform_code: i32s(348),
            quatern: std::array::from_fn(|i| f64s(352 + 8 * i)),
            qoffset: std::array::from_fn(|i| f64s(376 + 8 * i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| f64s(400 + 32 * r + 8 * c))),
            xyzt_units: i32s(500),
            intent_code: i32s(504),
        }
    }

    /// Bytes of the header itself.
    pub(crate) fn length(&self) -> u64 {
        match self.version {
            Version::One => LENGTH_1 as u64,
            Version::Two => LENGTH_2 as u64,
        }
    }

    /// Voxels along x, y and z. The fourth is time; vectors are refused.
    pub(crate) fn dims(&self, file: &str) -> Result<[u32; 3], LoadError> {
        let axes = self.dim[0];
        if !(1..=7).contains(&axes) {
            return Err(LoadError::field(file, "dim[0]", "1 to 7 dimensions", &axes));
        }
        // Beyond the declared dimensions the fields mean nothing.
        let length = |axis: usize| if axis as i64 <= axes { self.dim[axis] } else { 1 };
        let dims = [
            checked_axis(file, "dim[1]", length(1))?,
            checked_axis(file, "dim[2]", length(2))?,
            checked_axis(file, "dim[3]", length(3))?,
        ];
        for axis in 4..=7 {
            let found = length(axis);
            if found < 1 {
                return Err(LoadError::field(file, format!("dim[{axis}]"), "1 or more", &found));
            }
            if axis > 4 && found > 1 {
                let found = format!("{found} numbers a voxel (vectors or tensors are not volumes)");
                return Err(LoadError::field(file, format!("dim[{axis}]"), "1", &found));
            }
        }
        Ok(dims)
    }

    /// Volumes that follow each other.
    pub(crate) fn steps(&self) -> u64 {
        // Known to be positive once the dimensions are.
        if self.dim[0] >= 4 { self.dim[4].unsigned_abs() } else { 1 }
    }

    /// Seconds from one volume of a series to the next. Files that say no unit mean seconds, as other readers take them.
    pub(crate) fn step_secs(&self) -> Option<f64> {
        let unit = match self.xyzt_units & 0x38 {
            0 | 8 => 1.0,
            16 => 1.0e-3,
            24 => 1.0e-6,
            // Frequencies and the like.
            _ => return None,
        };
        Some(self.pixdim[4] * unit).filter(|secs| secs.is_finite() && *secs > 0.0)
    }

    /// Type of the samples. `bitpix` says the same again and is not needed.
    pub(crate) fn stored_type(&self, file: &str) -> Result<StoredType, LoadError> {
        let what = match self.datatype {
            2 => return Ok(StoredType::U8),
            4 => return Ok(StoredType::I16),
            8 => return Ok(StoredType::I32),
            16 => return Ok(StoredType::F32),
            64 => return Ok(StoredType::F64),
            256 => return Ok(StoredType::I8),
            512 => return Ok(StoredType::U16),
            768 => return Ok(StoredType::U32),
            1024 => return Ok(StoredType::I64),
            1280 => return Ok(StoredType::U64),
            1 => "single bits",
            32 | 1792 | 2048 => "complex numbers",
            128 => "RGB colours",
            1536 => "float128",
            2304 => "RGBA colours",
            _ => "no type of the standard",
        };
        let expected =
            "integers of 8 to 64 bits, float32 or float64 (2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280)";
        Err(LoadError::field(file, "datatype", expected, &format!("{} ({what})", self.datatype)))
    }

    /// Where in the file the voxels begin, in bytes.
    pub(crate) fn voxel_offset(&self, file: &str, notes: &mut Vec<String>) -> Result<u64, LoadError> {
        let least = self.length() + EXTENDER;
        // What float64 counts exactly; no file is longer.
        let most = 1u64 << 53;
        let offset = self.vox_offset;
        if offset == 0.0 {
            notes.push(format!("vox_offset is 0: the voxels are taken to begin at byte {least}"));
            return Ok(least);
        }
        if !(least as f64..=most as f64).contains(&offset) || offset.fract() != 0.0 {
            let expected = format!("a whole number of bytes, {least} or more");
            return Err(LoadError::field(file, "vox_offset", expected, &offset));
        }
        Ok(offset as u64)
    }

    /// Slope and intercept; 1 and 0 where the file has none.
    pub(crate) fn scaling(&self, file: &str, notes: &mut Vec<String>) -> Result<(f64, f64), LoadError> {
        let (slope, intercept) = (self.scl_slope, self.scl_inter);
        if slope == 0.0 {
            return Ok((1.0, 0.0));
        }
        if !slope.is_finite() {
            notes.push(format!("scl_slope is {slope}: stored values are taken as they are"));
            return Ok((1.0, 0.0));
        }
        checked_scaling(file, ["scl_slope", "scl_inter"], slope, intercept)
    }
}

/// Numbers at fixed places of a header of 540 bytes.
struct Fields<'a> {
    bytes: &'a [u8; LENGTH_2],
    order: ByteOrder,
}

impl Fields<'_> {
    fn number<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.bytes[at..at + N]);
        if self.order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }

    fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.number(at))
    }

    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.number(at))
    }

    fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.number(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The `nifti` crate reads version 1 only; there it must agree.
    #[test]
    fn fields_agree_with_the_nifti_crate() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/nifti");
        let mut compared = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let Ok(theirs) = nifti::NiftiHeader::from_file(&path) else { continue };
            let mut bytes = std::fs::read(&path).unwrap();
            if bytes.starts_with(&[0x1f, 0x8b]) {
                let mut unpacked = Vec::new();
                flate2::read::GzDecoder::new(&bytes[..]).read_to_end(&mut unpacked).unwrap();
                bytes = unpacked;
            }
            let ours = Header::read("test", &mut &bytes[..], None).unwrap();
            assert_eq!(ours.dim, theirs.dim.map(|d| i64::from(d as i16)));
            assert_eq!(ours.pixdim, theirs.pixdim.map(f64::from));
            let codes = [ours.datatype, ours.bitpix, ours.intent_code, ours.qform_code, ours.sform_code];
            let theirs_codes =
                [theirs.datatype, theirs.bitpix, theirs.intent_code, theirs.qform_code, theirs.sform_code];
            assert_eq!(codes, theirs_codes.map(i64::from));
            assert_eq!(ours.xyzt_units, i64::from(theirs.xyzt_units));
            let numbers = [ours.vox_offset, ours.scl_slope, ours.scl_inter];
            assert_eq!(numbers, [theirs.vox_offset, theirs.scl_slope, theirs.scl_inter].map(f64::from));
            assert_eq!(ours.srow, [theirs.srow_x, theirs.srow_y, theirs.srow_z].map(|r| r.map(f64::from)));
            let (b, c, d) = (theirs.quatern_b, theirs.quatern_c, theirs.quatern_d);
            assert_eq!(ours.quatern, [b, c, d].map(f64::from));
            let (x, y, z) = (theirs.quatern_x, theirs.quatern_y, theirs.quatern_z);
            assert_eq!(ours.qoffset, [x, y, z].map(f64::from));
            compared += 1;
        }
        assert_eq!(compared, 13);
    }
}
