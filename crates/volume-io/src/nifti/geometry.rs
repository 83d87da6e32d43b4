//! From a NIfTI header's transforms to a grid in patient millimetres.
//!
//! NIfTI's axes are to the right, anterior, superior (RAS+); ours are to the left, posterior, superior (LPS).

use super::header::Header;
use crate::LoadError;
use spatial::{DAffine3, DMat3, DQuat, DVec3};
use volume::Grid;

/// How far b² + c² + d² may exceed 1 before a quaternion is noted as wrong rather than rounded.
const QUATERNION_ROUNDING: f64 = 1.0e-4;

/// The grid, by the standard's order: `sform` if its code is positive, else `qform` if its code is, else spacing alone.
pub(super) fn grid(
    file: &str,
    header: &Header,
    dims: [u32; 3],
    notes: &mut Vec<String>,
) -> Result<Grid, LoadError> {
    let (field, ras_from_index) = if header.sform_code > 0 {
        ("sform", sform(header))
    } else if header.qform_code > 0 {
        ("qform", qform(header, notes))
    } else {
        notes.push(
            "orientation is not in the file (qform_code and sform_code are 0): axes are taken to point to the \
             patient's right, anterior, superior; the origin is the first voxel"
                .to_owned(),
        );
        ("pixdim", DAffine3::from_scale(spacing(header, notes)))
    };
    let mm = DAffine3::from_scale(DVec3::splat(mm_per_unit(header, notes)));
    let lps_from_ras = DAffine3::from_scale(DVec3::new(-1.0, -1.0, 1.0));
    Grid::new(dims, lps_from_ras * mm * ras_from_index).map_err(|source| LoadError::Grid {
        file: file.to_owned(),
        field,
        source,
    })
}

/// Method 3 of the standard: a general affine transform, shear and all.
fn sform(header: &Header) -> DAffine3 {
    let column = |c: usize| DVec3::from_array(header.srow.map(|row| row[c]));
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// Method 2 of the standard: spacing, a rotation, and a flip of the third axis.
fn qform(header: &Header, notes: &mut Vec<String>) -> DAffine3 {
    let bcd = DVec3::from_array(header.quatern);
    let squared = bcd.length_squared();
    if squared > 1.0 + QUATERNION_ROUNDING {
        notes.push(format!(
            "the quaternion's b, c, d have length {:.6}, more than 1: scaled to 1",
            squared.sqrt()
        ));
    }
    // a ≥ 0 by the standard. Rounding may leave nothing for it; the rest is then made unit.
    let a = (1.0 - squared).max(0.0).sqrt();
    let rotation = DMat3::from_quat(DQuat::from_xyzw(bcd.x, bcd.y, bcd.z, a).normalize());
    let mut scale = spacing(header, notes);
    if header.pixdim[0] < 0.0 {
        scale.z = -scale.z;
    }
    DAffine3 {
        matrix3: rotation * DMat3::from_diagonal(scale),
        translation: DVec3::from_array(header.qoffset),
    }
}

/// `pixdim` 1 to 3. The standard wants them positive; writers are not always strict about that.
fn spacing(header: &Header, notes: &mut Vec<String>) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|axis| {
        let found = header.pixdim[axis + 1];
        let used = if found == 0.0 { 1.0 } else { found.abs() };
        if used != found && !found.is_nan() {
            notes.push(format!("pixdim[{}] is {found}: a spacing of {used} is used", axis + 1));
        }
        used
    }))
}

/// Millimetres of the unit that the file says its lengths are in.
fn mm_per_unit(header: &Header, notes: &mut Vec<String>) -> f64 {
    let (unit, mm) = match header.xyzt_units & 7 {
        1 => ("metres", 1.0e3),
        3 => ("micrometres", 1.0e-3),
        // 2 is millimetres; 0 says nothing, and millimetres is what everybody means.
        _ => return 1.0,
    };
    notes.push(format!("lengths are in {unit} in the file"));
    mm
}
