//! How long the exact picture takes where it is slowest: 256³ voxels of fog too thin to end any ray, at 320 × 180.
//!
//! `cargo run -p reference --example speed [-- PART]` prints seconds a picture for smooth fog and for noise, unlit and
//! lit, and for the other modes; PART picks those whose name has it.
#![expect(clippy::print_stdout, reason = "a program for a person")]

use reference::{RaySetup, Reference};
use scene::{Camera, Headlight, Mode, Scene, SceneFile, VolumeFacts};
use spatial::DVec3;
use std::time::Instant;
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

const VOXELS: u32 = 256;
const SIZE_PX: (u32, u32) = (320, 180);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let part = std::env::args().nth(1).unwrap_or_default();
    let smooth = volume(|x, y, z| 500.0 + 150.0 * ((x * 0.11).sin() + (y * 0.07).sin() + (z * 0.13).cos()))?;
    let mut state = 1u64;
    let noise = volume(|_, _, _| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 54) as f64
    })?;
    let light = Headlight { power: 20.0, ..Headlight::default() };
    for mode in Mode::ALL {
        for (name, volume) in [("smooth", &smooth), ("noise", &noise)] {
            for light in [None, Some(light)] {
                if light.is_some() && mode != Mode::EmissionAbsorption {
                    continue;
                }
                let lit = if light.is_some() { ", lit" } else { "" };
                let name = format!("{}, {name}{lit}", mode.name());
                if name.contains(&part) {
                    time(&name, volume, &Scene { mode, light, ..fog(volume)? })?;
                }
            }
        }
    }
    Ok(())
}

fn time(name: &str, volume: &Volume, scene: &Scene) -> Result<(), Box<dyn std::error::Error>> {
    let camera =
        Camera { eye: [-100.0, 60.0, 400.0], target: [127.5; 3], up: [0.0, 1.0, 0.0], fov_y_deg: 22.0 };
    let setup = RaySetup::of_camera(volume.grid(), &camera, SIZE_PX.0, SIZE_PX.1)?;
    let start = Instant::now();
    let picture = Reference::new(volume, scene)?.picture(&setup, SIZE_PX.0, SIZE_PX.1, &|_| ())?;
    let hit = picture.pixels().iter().filter(|p| p.rgba[3] > 0.0).count();
    let least = picture.pixels().iter().map(|p| 1.0 - p.rgba[3]).fold(1.0, f64::min);
    let secs = start.elapsed().as_secs_f64();
    println!(
        "{name:40} {secs:7.2} s   {:.0} % of pixels hit, transmittance at least {least:.3}",
        100.0 * hit as f64 / picture.pixels().len() as f64
    );
    Ok(())
}

fn fog(volume: &Volume) -> Result<Scene, Box<dyn std::error::Error>> {
    let file = SceneFile::from_json(
        r#"{"transfer": [[0, 0, 0.2, 1, 0.0005], [300, 0, 1, 0, 0.001], [550, 1, 1, 0, 0.0015], [1024, 1, 0, 0, 0.003]],
            "threshold": 1020, "surface_opacity": 0.5, "window": [0, 1024]}"#,
    )?;
    Ok(file.resolve(&VolumeFacts::of(volume))?)
}

fn volume(mut value: impl FnMut(f64, f64, f64) -> f64) -> Result<Volume, Box<dyn std::error::Error>> {
    let mut samples = Vec::with_capacity((VOXELS * VOXELS * VOXELS) as usize);
    for z in 0..VOXELS {
        for y in 0..VOXELS {
            for x in 0..VOXELS {
                samples.push(value(f64::from(x), f64::from(y), f64::from(z)) as i16);
            }
        }
    }
    let grid = Grid::axis_aligned([VOXELS; 3], DVec3::ONE)?;
    let channel = Channel {
        name: "fog".into(),
        kind: ChannelKind::Intensity,
        voxels: Voxels::I16(samples.into()),
        slope: 1.0,
        intercept: 0.0,
    };
    Ok(Volume::new(grid, vec![channel])?)
}
