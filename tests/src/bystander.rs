//! A simulated headset that goes on while something happens to others.

use crate::{CENTRE_IN_ROOM, TestServer, until, within};
use headset::{HeadsetRun, Progress, SimulatedHeadset, SimulatedSettings};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use trace::{Ending, Orbit, Trace};

/// Latency that it reckons with before it has measured it.
const FIRST_LATENCY: Duration = Duration::from_millis(200);
/// A bystander that is not harmed sees a picture at least this often, also on a loaded machine.
const LONGEST_GAP_SECS: f64 = 2.0;

/// A headset that walks round the volume until it is told to stop. Every frame is decoded and checked.
#[derive(Debug)]
pub struct Bystander {
    progress: Arc<Progress>,
    stop: watch::Sender<bool>,
    running: JoinHandle<HeadsetRun>,
}

impl Bystander {
    /// Joins and waits for its first frame.
    pub async fn join(room: &TestServer) -> Self {
        let (stop, stopped) = watch::channel(false);
        let settings = SimulatedSettings {
            ending: Ending::Loop,
            seconds: 600.0,
            first_latency: FIRST_LATENCY,
            stop: Some(stopped),
            ..SimulatedSettings::new("bystander", room.headset("bystander"), Arc::new(walk()))
        };
        let progress = settings.progress.clone();
        let headset = within("a connection", SimulatedHeadset::connect(settings, room.pool())).await;
        let running = tokio::spawn(headset.unwrap_or_else(|e| panic!("{e}")).run());
        let bystander = Self { progress, stop, running };
        bystander.sees(1).await;
        bystander
    }

    /// Waits until it has seen so many more frames.
    pub async fn sees(&self, more: u64) {
        let wanted = self.progress.decoded() + more;
        until("the bystander sees more frames", || {
            assert!(!self.running.is_finished(), "the bystander was thrown out");
            self.progress.decoded() >= wanted
        })
        .await;
    }

    /// Ends it, and panics unless it was left alone all the while: every frame that the server sent has come, in order,
    /// decoded and as asked for, and never long after the one before.
    pub async fn was_not_harmed(self) -> HeadsetRun {
        self.sees(5).await;
        self.stop.send_replace(true);
        let run = within("the bystander's end", self.running).await.expect("it does not panic");
        assert!(run.ended_in_order(), "{:?}", run.end);
        assert_eq!(run.violation_count(), 0, "{:?}", run.violations);
        let counters = run.counters;
        assert_eq!(counters.undecodable, 0, "{counters:?}");
        // The server gives up a frame that is not through in time; on a machine that was asleep for so long that is
        // right, and it goes on with the next.
        let missed = counters.lost + counters.stale;
        assert!(missed * 20 <= counters.received, "{counters:?}");
        let gap = longest_gap_secs(&run);
        assert!(gap <= LONGEST_GAP_SECS, "no frame for {gap:.2} s");
        run
    }
}

/// A walk round the volume.
fn walk() -> Trace {
    Trace::orbit(&Orbit { centre_in_world: CENTRE_IN_ROOM, radius_m: 1.0, height_m: 0.1, period_secs: 10.0 })
}

fn longest_gap_secs(run: &HeadsetRun) -> f64 {
    run.frames.windows(2).map(|w| w[1].decoded_at_secs - w[0].decoded_at_secs).fold(0.0, f64::max)
}
