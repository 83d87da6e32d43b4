//! `holocast serve`.

use crate::cli::Serve;
use crate::commands::series::series_of;
use crate::commands::shown::{Shown, load_options, quality_named};
use crate::machine;
use crate::terminal::{progress, progress_done, say, tell};
use ::render::{Gpu, VolumeOnDevice};
use anyhow::{Context as _, bail};
use server::{Server, Settings, Volumes};
use session::Prediction;
use std::path::PathBuf;
use std::sync::Arc;
use transport::Identity;
use volume_io::Sequence;
use volume_io::describe::VolumeDescription;

pub(crate) fn run(arguments: &Serve) -> anyhow::Result<()> {
    let quality = quality_named(&arguments.quality)?;
    let shown = Shown::load_all(
        arguments.scene.as_deref(),
        arguments.volume.as_deref(),
        &arguments.chosen,
        &arguments.look,
    )?;
    let identity_folder = match &arguments.identity {
        Some(folder) => folder.clone(),
        None => default_identity_folder()?,
    };
    let identity = Identity::load_or_create(&identity_folder)?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let mut on_device = Vec::new();
    for volume in shown.volumes() {
        let uploaded = VolumeOnDevice::upload(&gpu, volume, |part| {
            progress(format!("uploading: {:.0} %", part * 100.0));
        });
        progress_done();
        on_device.push(Arc::new(uploaded?));
    }
    if gpu.adapter().is_software {
        machine::put_rays_behind();
    }
    shown.tell_register()?;

    let defaults = Settings::new(arguments.listen);
    let settings = Settings {
        pairing_code: arguments.pairing_code.clone().map(Into::into),
        max_headsets: arguments.max_headsets,
        quality,
        adapt_quality: !arguments.fixed_quality,
        prediction: Prediction { enabled: !arguments.no_prediction, ..Prediction::default() },
        bits_per_pixel: arguments.bits_per_pixel,
        encoder_threads: arguments.encoder_threads.unwrap_or(defaults.encoder_threads),
        device_queue: arguments
            .device_queue
            .unwrap_or(if gpu.adapter().is_software { 1 } else { 2 })
            .clamp(1, 4),
        ..defaults
    };
    let description = VolumeDescription::of(&shown.volume_path.display().to_string(), &shown.loaded);
    let series = series_of(
        &shown,
        &load_options(&arguments.chosen),
        arguments.series_memory_mb.saturating_mul(1_000_000),
    )?;
    let volumes = Volumes { on_device, facts: shown.facts, others: shown.others_facts, series };
    // The scene and its volume were named on the command line; what headsets ask for names none.
    let scene = scene::SceneFile { volume: None, ..shown.file };
    let sequence = shown.loaded.report.sequence;
    // All of it is on the device now: the host's copies go.
    drop((shown.loaded, shown.others));

    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(network_threads())
        .thread_name("network")
        .enable_all()
        .build()
        .context("the system refused threads for the network")?;
    runtime.block_on(async {
        let server = Server::start(settings, &identity, &gpu, volumes, &scene)?;
        // Before the server tells of itself: who has read that may ask it to stop at once.
        let stopped = stop_signal()?;
        announce(arguments, &server, &gpu, &description, &identity_folder, (sequence, scene.play))?;
        tokio::select! {
            () = stopped => {}
            () = server.failed() => {
                server.shutdown().await;
                bail!("the device failed; see the log above");
            }
        }
        tell("stopping: saying goodbye to the headsets");
        server.shutdown().await;
        say_usage(arguments.json)
    })
}

/// Threads for the network: one does for a few headsets, and a second would be woken for half of what comes only to find
/// that the first has it already.
fn network_threads() -> usize {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    (cores / 4).clamp(1, 4)
}

/// What serving took of the machine.
fn say_usage(json: bool) -> anyhow::Result<()> {
    let usage = headset::ProcessUsage::now();
    if json {
        say(serde_json::to_string(&usage)?);
    } else if let (Some(cpu_secs), Some(peak)) = (usage.cpu_secs, usage.rss_peak_bytes) {
        say(format!(
            "used         {cpu_secs:.1} s of processor time, at most {} MB of memory",
            peak / 1_000_000
        ));
    }
    Ok(())
}

/// Ctrl-C, or the polite signal that service managers send.
fn stop_signal() -> anyhow::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let handler = |kind| signal(kind).context("no signal handler could be installed");
    let (mut interrupt, mut terminate) =
        (handler(SignalKind::interrupt())?, handler(SignalKind::terminate())?);
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
    })
}

fn announce(
    arguments: &Serve,
    server: &Server,
    gpu: &Gpu,
    description: &VolumeDescription,
    identity_folder: &std::path::Path,
    (series, play): (Option<Sequence>, Option<scene::Play>),
) -> anyhow::Result<()> {
    if arguments.json {
        say(serde_json::to_string(&serde_json::json!({
            "address": server.address().to_string(),
            "fingerprint": server.fingerprint().to_string(),
            "adapter": gpu.adapter().name,
            "adapter_is_software": gpu.adapter().is_software,
            "volume": {
                "name": arguments.volume.as_deref().or(arguments.scene.as_deref()).map(|p| p.display().to_string()),
                "dims": description.dims,
                "spacing_mm": description.spacing_mm,
                "steps": series.map_or(1, |series| series.steps),
            },
        }))?);
        return Ok(());
    }
    let [nx, ny, nz] = description.dims;
    let [sx, sy, sz] = description.spacing_mm;
    say(format!("listening    {} (UDP)", server.address()));
    say(format!("fingerprint  {}", server.fingerprint()));
    say(format!("identity     {}", identity_folder.display()));
    say(format!("adapter      {}", gpu.adapter()));
    say(format!(
        "volume       {}: {nx}x{ny}x{nz} voxels of {sx:.3}x{sy:.3}x{sz:.3} mm, {}",
        description.file, description.orientation
    ));
    if let Some(told) = told_series(series, play) {
        say(told);
    }
    if arguments.pairing_code.is_none() {
        say("pairing      none: everyone who reaches the port sees; --pairing-code CODE asks for one");
    }
    say("Ctrl-C stops.");
    Ok(())
}

/// What people are told of a series in time.
fn told_series(series: Option<Sequence>, play: Option<scene::Play>) -> Option<String> {
    let Sequence { steps, loaded, .. } = series?;
    let from = play.and_then(|play| play.from).map_or(loaded, u64::from);
    let how = match play {
        Some(play) if play.steps_per_sec > 0.0 => {
            format!("played from step {from} at {} a second", play.steps_per_sec)
        }
        _ => format!("step {from} is shown; a scene with \"play\" plays them"),
    };
    Some(format!("series       {steps} steps in time, {how}"))
}

/// Where certificate and key lie unless told otherwise.
fn default_identity_folder() -> anyhow::Result<PathBuf> {
    let from = |variable: &str| std::env::var_os(variable).filter(|v| !v.is_empty()).map(PathBuf::from);
    from("XDG_CONFIG_HOME")
        .or_else(|| from("HOME").map(|home| home.join(".config")))
        .map(|folder| folder.join("holocast"))
        .context("neither HOME nor XDG_CONFIG_HOME is set; name a folder with --identity DIR")
}
