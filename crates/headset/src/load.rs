//! Many simulated headsets in one process.

use crate::decode::DecodePool;
use crate::keep::KeepSettings;
use crate::run::HeadsetRun;
use crate::simulated::{SimulatedError, SimulatedHeadset, SimulatedSettings};
use crate::usage::ProcessUsage;
use serde::Serialize;
use std::io;
use std::num::NonZero;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};
use tokio::task::JoinSet;
use trace::Trace;

/// Part of a display interval, and of the trace, between one headset and the next: the golden ratio spreads any number
/// of them evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Who comes, and how fast.
#[derive(Clone, Debug)]
pub struct LoadSettings {
    /// What each of them does. Its name, trace, offset, phase and what it keeps are set for each.
    pub each: SimulatedSettings,
    /// How many headsets.
    pub headsets: usize,
    /// How many of them come in a second; all at once if it is not above 0.
    pub ramp_per_sec: f64,
    /// Traces that they replay, in turn; `each.trace` if there is none.
    pub traces: Vec<Arc<Trace>>,
    /// Threads that decode for all of them; as many as processors, but not more than headsets, if `None`.
    pub decode_threads: Option<NonZero<usize>>,
}

/// What all of them got.
#[derive(Clone, Debug, Serialize)]
pub struct LoadRun {
    /// Those that ran, in the order in which they came.
    pub headsets: Vec<HeadsetRun>,
    /// Those that did not.
    pub failed: Vec<FailedHeadset>,
    /// From the first to the end of the last, in seconds.
    pub seconds: f64,
    /// What this process used meanwhile, for all of them.
    pub usage: ProcessUsage,
}

/// A headset that did not run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FailedHeadset {
    /// Its name.
    pub name: String,
    /// Why.
    pub error: String,
}

/// Runs many headsets, each with its own connection, phase and place in its trace, all on one runtime and one bounded
/// pool of decoding threads. Each begins its own time when it is welcomed, and ends with a goodbye.
///
/// # Errors
/// If the system gives no threads. A headset that fails is told in the result.
pub async fn load(settings: LoadSettings) -> io::Result<LoadRun> {
    let before = ProcessUsage::now();
    let origin = Instant::now();
    let processors = thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let wanted = NonZero::new(settings.headsets).unwrap_or(NonZero::<usize>::MIN);
    let pool = DecodePool::new(settings.decode_threads.unwrap_or(processors.min(wanted)))?;

    let mut running = JoinSet::new();
    for index in 0..settings.headsets {
        let (comes_after, each) = one_of_them(&settings, index, origin);
        let pool = pool.clone();
        running.spawn(async move {
            tokio::time::sleep_until((origin + comes_after).into()).await;
            let name = each.name.clone();
            (index, name, run_one(each, &pool).await)
        });
    }

    let mut results = Vec::new();
    while let Some(result) = running.join_next().await {
        match result {
            Ok(result) => results.push(result),
            Err(error) => {
                if let Ok(panic) = error.try_into_panic() {
                    std::panic::resume_unwind(panic);
                }
            }
        }
    }
    results.sort_by_key(|(index, ..)| *index);
    let mut run = LoadRun {
        headsets: Vec::new(),
        failed: Vec::new(),
        seconds: origin.elapsed().as_secs_f64(),
        usage: ProcessUsage::now().since(&before),
    };
    for (_, name, result) in results {
        match result {
            Ok(headset) => run.headsets.push(headset),
            Err(error) => run.failed.push(FailedHeadset { name, error: error.to_string() }),
        }
    }
    Ok(run)
}

async fn run_one(settings: SimulatedSettings, pool: &DecodePool) -> Result<HeadsetRun, SimulatedError> {
    Ok(SimulatedHeadset::connect(settings, pool).await?.run().await)
}

/// When a headset comes, and what it does.
#[expect(clippy::cast_precision_loss, reason = "a count of headsets")]
fn one_of_them(settings: &LoadSettings, index: usize, origin: Instant) -> (Duration, SimulatedSettings) {
    let LoadSettings { each, headsets, ramp_per_sec, traces, .. } = settings;
    let digits = headsets.saturating_sub(1).to_string().len();
    let name = format!("{}-{index:0digits$}", each.name);
    let comes_after_secs = if *ramp_per_sec > 0.0 { index as f64 / ramp_per_sec } else { 0.0 };
    let part = (index as f64 * GOLDEN).fract();
    let trace = if traces.is_empty() { &each.trace } else { &traces[index % traces.len()] };
    let keep = KeepSettings {
        pictures: each.keep.pictures.clone().map(|mut pictures| {
            pictures.directory.push(&name);
            pictures
        }),
        recording: each.keep.recording.as_ref().map(|path| {
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            path.with_file_name(format!("{name}-{file}"))
        }),
    };
    let simulated = SimulatedSettings {
        phase: each.phase + Duration::from_secs_f64(part / f64::from(each.headset.device.refresh_hz)),
        trace_offset_secs: each.trace_offset_secs + part * trace.duration_secs(),
        trace: trace.clone(),
        keep,
        name,
        origin,
        ..each.clone()
    };
    (Duration::try_from_secs_f64(comes_after_secs).unwrap_or_default(), simulated)
}
