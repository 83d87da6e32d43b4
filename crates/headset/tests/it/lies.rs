//! Servers that do not send what was asked for.

use crate::fake_server::{Lie, lying, run, start};

async fn check(lie: Lie, kind: &str, tells: &str) {
    let server = start(lying(lie));
    let run = run(server.simulated()).await;
    assert!(run.frames.len() >= 5, "{lie:?}: {} frames", run.frames.len());
    let violations = run.violations.get(kind).unwrap_or_else(|| panic!("{lie:?}: {:?}", run.violations));
    assert!(violations.count >= run.frames.len() as u64, "every frame lies: {violations:?}");
    assert!(violations.examples[0].contains(tells), "{violations:?}");
    assert!((1..=5).contains(&violations.examples.len()));
    assert!(run.frames.iter().all(|frame| frame.violations > 0));
    assert!(run.ended_in_order(), "what is wrong is told, not shot at");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_picture_of_another_size_is_noticed() {
    check(Lie::WrongSize, "size", "picture is [128, 16] pixels, expected [128, 32]").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_black_picture_of_something_is_noticed() {
    check(Lie::Black, "black", "eye is black").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_view_from_elsewhere_is_noticed() {
    check(Lie::WrongView, "view", "from where the head is").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_does_not_decode_is_counted_and_a_key_frame_follows() {
    let server = start(lying(Lie::Garbage));
    let run = run(server.simulated()).await;
    assert!(run.counters.undecodable >= 1, "{:?}", run.counters);
    let undecodable = &run.violations["undecodable"];
    assert_eq!(undecodable.count, run.counters.undecodable);
    assert_eq!(run.violations.len(), 1, "{:?}", run.violations);
    assert!(run.counters.lost >= run.counters.undecodable);
    assert!(
        run.frames.iter().filter(|frame| frame.depends_on.is_none()).count() >= 2,
        "it goes on with a key frame"
    );
}
