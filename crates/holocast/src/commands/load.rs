//! `holocast load`.

use crate::cli::Load;
use crate::commands::reporting::{Reporting, judge};
use crate::commands::simulated::{attended, runtime, settings, trace_named};
use anyhow::{Context as _, bail};
use headset::LoadSettings;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::watch;

/// Most headsets of one process: each has a socket.
const MOST_HEADSETS: usize = 500;

pub(crate) fn run(arguments: &Load) -> anyhow::Result<()> {
    if !(1..=MOST_HEADSETS).contains(&arguments.headsets) {
        bail!("--headsets is {}, expected 1 to {MOST_HEADSETS}", arguments.headsets);
    }
    let simulated = &arguments.simulated;
    let names = if arguments.trace.is_empty() { vec!["orbit".to_owned()] } else { arguments.trace.clone() };
    let traces: Vec<_> =
        names.iter().map(|name| trace_named(simulated, name).map(Arc::new)).collect::<Result<_, _>>()?;
    let first = traces.first().context("at least one trace")?.clone();
    let (stop, stopped) = watch::channel(false);
    let each = settings(simulated, "headset", first, stopped)?;
    let told = each.progress.clone();
    let reporting = Reporting::begin(simulated, "holocast load");
    let begun = Instant::now();
    let load = LoadSettings {
        each,
        headsets: arguments.headsets,
        ramp_per_sec: arguments.ramp,
        traces,
        decode_threads: None,
    };
    let line = || {
        let (secs, frames, late) = (begun.elapsed().as_secs_f64(), told.decoded(), told.late());
        format!("{} headsets: {secs:.0} s, {frames} frames, {late} late", arguments.headsets)
    };
    let run = runtime()?
        .block_on(attended(headset::load(load), &stop, line))
        .context("the system refused threads for the decoders")?;
    reporting.write(&run.headsets, begun.elapsed(), &run.usage, None)?;
    judge(&run.headsets, &run.failed, None)
}
