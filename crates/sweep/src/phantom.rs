//! Volumes of which the occupied part is known.

use rayon::prelude::*;
use spatial::DVec3;
use volume::{Channel, ChannelKind, Grid, GridError, Volume, VolumeError, Voxels};

/// Blocks along a side: each is full or empty.
const BLOCKS: usize = 16;
/// Millimetres along a side, whatever the voxels.
const SIDE_MM: f64 = 256.0;

/// Why there is no phantom.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// Such a grid cannot be.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The voxels do not fit it.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// A cube of 256 mm with `side` voxels of 16 bits along each axis. About `occupied` of its blocks, 16 along a side, hold soft
/// matter of values from 1000 to 3000; the rest is 0. The same blocks at each size.
///
/// # Errors
/// If there are fewer than one voxel along a side.
pub fn phantom(side: u32, occupied: f64) -> Result<Volume, PhantomError> {
    let n = side as usize;
    let along: Vec<f32> =
        (0..n).map(|i| 333.0 * ((i as f64 + 0.5) / n.max(1) as f64 * 40.0).sin() as f32).collect();
    let block: Vec<usize> = (0..n).map(|i| i * BLOCKS / n).collect();
    let full: Vec<bool> = (0..BLOCKS.pow(3)).map(|i| chance(i as u64) < occupied).collect();
    let mut voxels = vec![0u16; n * n * n];
    voxels.par_chunks_mut((n * n).max(1)).enumerate().for_each(|(z, slice)| {
        for (y, row) in slice.chunks_mut(n).enumerate() {
            let blocks = &full[(block[z] * BLOCKS + block[y]) * BLOCKS..][..BLOCKS];
            let offset = 2000.0 + along[z] + along[y];
            for ((voxel, &along), &block) in row.iter_mut().zip(&along).zip(&block) {
                *voxel = if blocks[block] { (offset + along) as u16 } else { 0 };
            }
        }
    });
    let spacing = SIDE_MM / f64::from(side.max(1));
    let grid = Grid::axis_aligned([side; 3], DVec3::splat(spacing))?;
    let channel = Channel {
        name: "phantom".into(),
        kind: ChannelKind::Intensity,
        voxels: Voxels::U16(voxels.into()),
        slope: 1.0,
        intercept: 0.0,
    };
    Ok(Volume::new(grid, vec![channel])?)
}

/// A number from 0 to 1 that looks like chance (SplitMix64).
fn chance(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_much_is_occupied_as_was_asked_for() {
        for occupied in [0.0, 0.03, 0.1, 0.5, 1.0] {
            for side in [32, 64] {
                let volume = phantom(side, occupied).unwrap();
                let Voxels::U16(voxels) = &volume.channels()[0].voxels else { panic!("16 bits") };
                let full = voxels.iter().filter(|&&v| v > 0).count() as f64 / voxels.len() as f64;
                assert!((full - occupied).abs() < 0.02, "{full}, expected {occupied}");
                assert!(voxels.iter().all(|&v| v == 0 || (1000..=3000).contains(&v)));
            }
        }
        assert!(phantom(0, 1.0).is_err());
    }
}
