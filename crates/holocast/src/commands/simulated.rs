//! What `holocast headset` and `holocast load` have in common.

use crate::cli::Simulated;
use crate::commands::shown::read_scene;
use crate::terminal::{progress, progress_done};
use anyhow::{Context as _, bail};
use headset::{DeviceModel, HeadsetSettings, SceneChange, SimulatedSettings};
use spatial::DVec3;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use trace::{Ending, Orbit, Stand, Trace};
use transport::Fingerprint;

/// How far a head may look away from the hologram in a trace that is placed before it, radians.
const MOST_AWAY_RAD: f64 = 0.15;
/// How long a walk around the hologram takes.
const ORBIT_SECS: f64 = 12.0;

/// What a simulated headset does, from the command line.
pub(crate) fn settings(
    arguments: &Simulated,
    name: &str,
    trace: Arc<Trace>,
    stop: watch::Receiver<bool>,
) -> anyhow::Result<SimulatedSettings> {
    let model: DeviceModel = arguments.device.parse()?;
    if !(1.0..=240.0).contains(&arguments.hz) {
        bail!("--hz is {}, expected 1 to 240", arguments.hz);
    }
    if !(arguments.seconds > 0.0 && arguments.seconds.is_finite()) {
        bail!("--seconds is {}, expected a positive number", arguments.seconds);
    }
    let device = model.device(arguments.hz)?;
    let fingerprint = Fingerprint::parse(&arguments.fingerprint)?;
    let headset = HeadsetSettings {
        pairing_code: arguments.pairing_code.as_str().into(),
        ..HeadsetSettings::new(arguments.connect.clone(), fingerprint, device)
    };
    Ok(SimulatedSettings {
        ending: ending(&arguments.ending)?,
        seconds: arguments.seconds,
        scene_changes: arguments.change_scene.iter().map(|s| scene_change(s)).collect::<Result<_, _>>()?,
        anchors_in_world: vec![point(&arguments.hologram)?],
        stop: Some(stop),
        ..SimulatedSettings::new(name, headset, trace)
    })
}

/// The trace of that name, placed before the hologram unless it is to stay where it was recorded.
pub(crate) fn trace_named(arguments: &Simulated, name: &str) -> anyhow::Result<Trace> {
    let target_in_world = point(&arguments.hologram)?;
    let Simulated { distance_m, azimuth_deg, .. } = *arguments;
    if !(0.05..=100.0).contains(&distance_m) {
        bail!("--distance-m is {distance_m}, expected 0.05 to 100");
    }
    if name == "orbit" {
        return Ok(Trace::orbit(&Orbit {
            centre_in_world: target_in_world,
            radius_m: distance_m,
            height_m: 0.1,
            period_secs: ORBIT_SECS,
        }));
    }
    let trace = Trace::load(Path::new(name))?;
    if arguments.as_recorded {
        return Ok(trace);
    }
    let stand = Stand { target_in_world, distance_m, azimuth_rad: azimuth_deg.to_radians() };
    Ok(trace.facing(&stand).attentive(target_in_world, MOST_AWAY_RAD))
}

fn ending(name: &str) -> anyhow::Result<Ending> {
    match name {
        "loop" => Ok(Ending::Loop),
        "hold" => Ok(Ending::Hold),
        "ping-pong" => Ok(Ending::PingPong),
        other => bail!("--ending is '{other}', expected loop, hold or ping-pong"),
    }
}

fn point(text: &str) -> anyhow::Result<DVec3> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if x.is_finite() && y.is_finite() && z.is_finite() => Ok(DVec3::new(x, y, z)),
        _ => bail!("'{text}' is no point, expected X,Y,Z in metres, such as 0,1.5,-2"),
    }
}

fn scene_change(text: &str) -> anyhow::Result<SceneChange> {
    let (secs, path) =
        text.split_once(':').with_context(|| format!("'{text}': expected SECONDS:SCENE.json"))?;
    let at_secs: f64 = secs.parse().with_context(|| format!("'{text}': '{secs}' is no number of seconds"))?;
    // A room keeps its volume, so the name of one is left out.
    let scene = scene::SceneFile { volume: None, ..read_scene(Path::new(path))? };
    Ok(SceneChange { at_secs, scene_json: scene.to_json() })
}

/// A runtime for headsets: their network is light.
pub(crate) fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("network")
        .enable_all()
        .build()
        .context("the system refused threads for the network")
}

/// Runs to the end, or until Ctrl-C, after which the goodbyes are still said; tells how it goes meanwhile.
pub(crate) async fn attended<T>(
    run: impl Future<Output = T>,
    stop: &watch::Sender<bool>,
    line: impl Fn() -> String,
) -> T {
    tokio::pin!(run);
    let mut tick = tokio::time::interval(Duration::from_millis(500));
    let mut interrupted = false;
    let result = loop {
        tokio::select! {
            result = &mut run => break result,
            _ = tick.tick() => progress(line()),
            Ok(()) = tokio::signal::ctrl_c(), if !interrupted => {
                interrupted = true;
                stop.send_replace(true);
            }
        }
    };
    progress_done();
    result
}
