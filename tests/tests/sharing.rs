//! Several headsets at once.

use end_to_end::{CENTRE_IN_ROOM, TestServer, settings, subject, within};
use headset::{LoadSettings, SimulatedSettings};
use std::sync::Arc;
use std::time::Duration;
use trace::{Ending, Orbit, Trace};

const HEADSETS: usize = 4;
/// Part of the mean rate that the worst of them gets at least. A benchmark holds it stricter, on a quiet machine.
const FAIR: f64 = 0.6;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn four_headsets_share_the_device_and_each_gets_what_it_asked_for() {
    let room = TestServer::start(subject(), "{}", settings());
    let orbit = Orbit { centre_in_world: CENTRE_IN_ROOM, radius_m: 1.0, height_m: 0.1, period_secs: 10.0 };
    let each = SimulatedSettings {
        ending: Ending::Loop,
        seconds: 3.0,
        first_latency: Duration::from_millis(200),
        ..SimulatedSettings::new("headset", room.headset("headset"), Arc::new(Trace::orbit(&orbit)))
    };
    let load = LoadSettings {
        each,
        headsets: HEADSETS,
        ramp_per_sec: 0.0,
        traces: Vec::new(),
        decode_threads: None,
    };
    let run = within("all headsets", headset::load(load)).await.expect("threads");
    assert!(run.failed.is_empty(), "{:?}", run.failed);
    assert_eq!(run.headsets.len(), HEADSETS);
    let rates: Vec<f64> = run.headsets.iter().map(headset::HeadsetRun::frames_per_second).collect();
    for headset in &run.headsets {
        assert!(headset.ended_in_order(), "{}: {:?}", headset.name, headset.end);
        assert_eq!(headset.violation_count(), 0, "{}: {:?}", headset.name, headset.violations);
        assert_eq!(headset.counters.undecodable, 0, "{}", headset.name);
        // Each shows its own head: no two made the same way, so that no frame came to the wrong one.
        let session = headset.session.as_ref().expect("it was welcomed").session_id;
        println!("{} (session {session}): {} frames", headset.name, headset.frames.len());
    }
    let mean = rates.iter().sum::<f64>() / HEADSETS as f64;
    let worst = rates.iter().copied().fold(f64::INFINITY, f64::min);
    println!("mean {mean:.1}, worst {worst:.1} frames a second");
    assert!(mean > 0.0 && worst >= FAIR * mean, "rates are {rates:.1?}");
    room.is_empty().await;
    room.shutdown().await;
}
