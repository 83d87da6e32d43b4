//! Volumes and scenes that the tests write.

use crate::program::text;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Voxels along x, y and z.
pub(crate) const DIMS: [u16; 3] = [12, 10, 8];

/// A folder with a volume; gone with the test.
pub(crate) struct Folder {
    folder: TempDir,
}

impl Folder {
    pub(crate) fn new() -> Self {
        let folder = Self { folder: tempfile::tempdir().unwrap() };
        folder.write("ball.nii", &nifti());
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The path as an argument.
    pub(crate) fn arg(&self, name: &str) -> String {
        text(&self.path(name)).to_owned()
    }

    /// Writes a file; returns its path as an argument.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> String {
        fs::write(self.path(name), bytes).unwrap();
        self.arg(name)
    }

    pub(crate) fn volume(&self) -> String {
        self.arg("ball.nii")
    }
}

/// Width and height of a PNG file, and whether all of it is one colour.
pub(crate) fn png(path: &Path) -> ([u32; 2], bool) {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).to_rgb8();
    let first = *picture.get_pixel(0, 0);
    (picture.dimensions().into(), picture.pixels().all(|p| *p == first))
}

/// Values of a ball, 0 to 250, x fastest.
fn ball() -> Vec<i16> {
    let [nx, ny, nz] = DIMS;
    let mut values = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let along = |i: u16, n: u16| (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
                let r = [along(x, nx), along(y, ny), along(z, nz)].iter().map(|c| c * c).sum::<f64>().sqrt();
                values.push((250.0 * (1.3 - r).clamp(0.0, 1.0)) as i16);
            }
        }
    }
    values
}

/// The ball as NIfTI-1: int16, voxels of 20×20×25 mm.
pub(crate) fn nifti() -> Vec<u8> {
    nifti_of(&[100])
}

/// A series in time, for each step the percents of the ball's values that it has; of one step a plain volume.
pub(crate) fn nifti_of(percents: &[i32]) -> Vec<u8> {
    let steps = percents.len() as u16;
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    for (i, dim) in
        [if steps > 1 { 4 } else { 3 }, DIMS[0], DIMS[1], DIMS[2], steps, 1, 1, 1].into_iter().enumerate()
    {
        put(40 + 2 * i, &dim.to_le_bytes());
    }
    // int16
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for (i, size) in [1.0f32, 20.0, 20.0, 25.0].into_iter().enumerate() {
        put(76 + 4 * i, &size.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(112, &1f32.to_le_bytes());
    // Millimetres, seconds.
    put(123, &[10]);
    put(344, b"n+1\0");
    for percent in percents {
        bytes.extend(ball().iter().flat_map(|&v| ((i32::from(v) * percent / 100) as i16).to_le_bytes()));
    }
    bytes
}

/// The ball as raw voxels with their JSON header.
pub(crate) fn raw() -> (Vec<u8>, String) {
    let [nx, ny, nz] = DIMS;
    let header = format!(
        r#"{{"raw": "ball.raw", "dims": [{nx}, {ny}, {nz}], "type": "int16", "endian": "little",
            "spacing_mm": [20, 20, 25], "name": "ct", "slope": 2, "intercept": -100}}"#
    );
    (ball().iter().flat_map(|v| v.to_le_bytes()).collect(), header)
}
