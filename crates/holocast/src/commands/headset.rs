//! `holocast headset`.

use crate::cli::HeadsetArguments;
use crate::commands::reporting::{Reporting, judge};
use crate::commands::simulated::{attended, runtime, settings, trace_named};
use crate::commands::verification::{Known, verified};
use anyhow::Context as _;
use headset::{
    DecodePool, KeepSettings, PictureChoice, PictureSettings, ProcessUsage, SimulatedHeadset,
    SimulatedSettings,
};
use std::num::NonZero;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::watch;

pub(crate) fn run(arguments: &HeadsetArguments) -> anyhow::Result<()> {
    let simulated = &arguments.simulated;
    let trace = Arc::new(trace_named(simulated, &arguments.trace)?);
    let stem = Path::new(&arguments.trace).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = arguments.name.clone().unwrap_or(stem);
    let (stop, stopped) = watch::channel(false);
    // What cannot be verified is said before the run, not after it.
    let known = arguments.verify.map(|_| Known::load(arguments)).transpose()?;
    let settings = settings(simulated, &name, trace, stopped)?;
    let settings = SimulatedSettings {
        anchors_in_world: match &known {
            Some(known) => known.exact()?.anchors_in_world(),
            None => settings.anchors_in_world,
        },
        sampled_frames: arguments.verify.unwrap_or(0),
        keep: KeepSettings {
            pictures: arguments.save.clone().map(|directory| PictureSettings {
                directory,
                choice: PictureChoice::Spread { count: arguments.save_count, seconds: simulated.seconds },
            }),
            recording: arguments.record.clone(),
        },
        ..settings
    };
    let reporting = Reporting::begin(simulated, "holocast headset");
    let pool =
        DecodePool::new(NonZero::<usize>::MIN).context("the system refused a thread for the decoder")?;
    let before = ProcessUsage::now();
    let begun = Instant::now();
    let told = settings.progress.clone();
    let line = || {
        let (secs, frames) = (begun.elapsed().as_secs_f64(), told.decoded());
        let (late, wrong) = (told.late(), told.violations());
        format!("{name}: {secs:.0} s, {frames} frames, {late} late, {wrong} wrong")
    };
    let run = runtime()?.block_on(async {
        let run =
            async { Ok::<_, anyhow::Error>(SimulatedHeadset::connect(settings, &pool).await?.run().await) };
        attended(run, &stop, line).await
    })?;
    let usage = ProcessUsage::now().since(&before);
    let took = begun.elapsed();
    let verified = known.map(|known| verified(&known, &run));
    let runs = [run];
    reporting.write(&runs, took, &usage, verified.clone())?;
    judge(&runs, &[], verified.as_ref())
}
