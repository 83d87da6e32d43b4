//! NRRD with its voxels, compressed by gzip.

use super::samples::unscaled;
use super::{Picture, SaveError, SaveOptions, Saved, write_file, write_samples};
use flate2::Compression;
use flate2::write::GzEncoder;
use spatial::DVec3;
use std::io::Write as _;
use std::path::Path;
use volume::VoxelType;

pub(super) fn save(path: &Path, picture: Picture, options: &SaveOptions) -> Result<Saved, SaveError> {
    let Picture { grid, channel, notes } = unscaled(picture);
    let [x, y, z] = grid.dims();
    // Rust writes the shortest number that is read as the same float64.
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let transform = grid.volume_from_index();
    let [a, b, c] =
        [transform.matrix3.x_axis, transform.matrix3.y_axis, transform.matrix3.z_axis].map(vector);
    let kind = match channel.voxels.voxel_type() {
        VoxelType::U8 => "uint8",
        VoxelType::I16 => "int16",
        VoxelType::U16 => "uint16",
        VoxelType::F32 => "float",
        VoxelType::F64 => "double",
    };
    let header = format!(
        "NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {x} {y} {z}\n\
         space directions: {a} {b} {c}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space origin: {}\n\n",
        vector(transform.translation)
    );
    let file = write_file(path, options.overwrite, |out| {
        out.write_all(header.as_bytes())?;
        let mut packed = GzEncoder::new(out, Compression::default());
        write_samples(&mut packed, &channel.voxels, options)?;
        packed.finish().map(drop)
    })?;
    Ok(Saved { dims: grid.dims(), files: vec![file], notes })
}
