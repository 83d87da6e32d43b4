//! `holocast headset`.

use crate::cli::HeadsetArguments;
use crate::commands::reporting::{Reporting, judge};
use crate::commands::simulated::{attended, runtime, settings, trace_named};
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
    let settings = SimulatedSettings {
        keep: KeepSettings {
            pictures: arguments.save.clone().map(|directory| PictureSettings {
                directory,
                choice: PictureChoice::Spread { count: arguments.save_count, seconds: simulated.seconds },
            }),
            recording: arguments.record.clone(),
        },
        ..settings(simulated, &name, trace, stopped)?
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
    let runs = [run];
    reporting.write(&runs, begun.elapsed(), &usage)?;
    judge(&runs, &[])
}
