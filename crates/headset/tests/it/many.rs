//! Many headsets in one process.

use crate::fake_server::{honest, start};
use headset::{LoadSettings, load};
use std::collections::HashSet;
use std::num::NonZero;
use std::time::Duration;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn all_of_them_come_run_and_go() {
    let server = start(honest());
    let settings = LoadSettings {
        each: server.simulated(),
        headsets: 12,
        ramp_per_sec: 20.0,
        traces: Vec::new(),
        decode_threads: NonZero::new(2),
    };
    let run = load(settings).await.unwrap();
    assert!(run.failed.is_empty(), "{:?}", run.failed);
    let names: Vec<_> = run.headsets.iter().map(|headset| headset.name.as_str()).collect();
    assert_eq!(names.len(), 12);
    assert_eq!((names[0], names[11]), ("test-00", "test-11"));
    for headset in &run.headsets {
        assert!(headset.ended_in_order(), "{}: {:?}", headset.name, headset.end);
        assert!(headset.violations.is_empty(), "{}: {:?}", headset.name, headset.violations);
        assert!(!headset.frames.is_empty(), "{} starves", headset.name);
    }
    let sessions: HashSet<_> =
        run.headsets.iter().map(|headset| headset.frames[0].pose_sampled_at_secs.to_bits()).collect();
    assert_eq!(sessions.len(), 12, "each has its own phase");
    assert!(run.seconds > 1.0);
    serde_json::to_string(&run).unwrap();

    while server.endpoint.open_connections() > 0 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn headsets_that_reach_nobody_are_told() {
    let server = start(honest());
    let mut each = server.simulated();
    each.headset.server = "host.invalid:1".to_owned();
    let settings =
        LoadSettings { each, headsets: 3, ramp_per_sec: 0.0, traces: Vec::new(), decode_threads: None };
    let run = load(settings).await.unwrap();
    assert!(run.headsets.is_empty());
    assert_eq!(run.failed.len(), 3);
    assert_eq!(run.failed[1].name, "test-1");
    assert!(run.failed.iter().all(|failed| failed.error.contains("host.invalid:1")), "{:?}", run.failed);
}
