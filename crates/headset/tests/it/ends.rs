//! How it can end.

use crate::fake_server::{Lie, honest, lying, pool, run, start};
use headset::{HeadsetError, SimulatedError, SimulatedHeadset, SimulatedSettings};
use std::time::Duration;
use tokio::sync::watch;
use transport::{ConnectError, Identity};
use wire::CloseCode;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_closes_is_quoted() {
    let server = start(lying(Lie::CloseAfter(5)));
    let run = run(SimulatedSettings { seconds: 600.0, ..server.simulated() }).await;
    assert_eq!((run.end.by, run.end.code), ("peer", CloseCode::ShuttingDown.value()));
    assert_eq!(run.end.reason, "the power is going");
    assert!(!run.ended_in_order());
    assert!(run.frames.len() <= 5 && run.seconds < 600.0);
}

#[test]
fn a_server_that_vanishes_is_given_up() {
    let runtime =
        || tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let (here, there) = (runtime(), runtime());
    let server = there.block_on(async { start(honest()) });
    let mut settings = SimulatedSettings { seconds: 600.0, ..server.simulated() };
    settings.headset.session.idle_timeout = Duration::from_secs(3);
    let progress = settings.progress.clone();
    let run = here.block_on(async {
        let running = tokio::spawn(run(settings));
        while progress.decoded() < 3 && !running.is_finished() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        // With its runtime, the server loses its socket before it can say a word.
        there.shutdown_background();
        running.await.unwrap()
    });
    assert_eq!((run.end.by, run.end.code), ("us", CloseCode::Idle.value()), "{:?}", run.end);
    assert!(run.end.reason.contains("nothing heard for 3000 ms"), "{:?}", run.end);
    assert!(run.counters.decoded >= 3);
    drop(server);
}

#[test]
fn a_connection_that_breaks_is_the_network_s_end() {
    let runtime =
        || tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let (here, there) = (runtime(), runtime());
    let server = there.block_on(async { start(honest()) });
    let mut settings = SimulatedSettings { seconds: 600.0, ..server.simulated() };
    settings.headset.transport.max_idle_timeout = Duration::from_secs(3);
    let progress = settings.progress.clone();
    let run = here.block_on(async {
        let running = tokio::spawn(run(settings));
        while progress.decoded() < 3 && !running.is_finished() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        there.shutdown_background();
        running.await.unwrap()
    });
    assert_eq!(run.end.by, "network", "{:?}", run.end);
    assert!(run.end.reason.contains("nothing came from the peer within 3000 ms"), "{:?}", run.end);
    drop(server);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_the_code_nothing_is_seen() {
    let mut behaviour = honest();
    behaviour.session.pairing_code = Some("1234".into());
    let server = start(behaviour);
    let mut settings = server.simulated();
    settings.headset.pairing_code = "4321".into();
    let refused = run(settings.clone()).await;
    assert_eq!((refused.end.by, refused.end.code), ("peer", CloseCode::NotPaired.value()));
    assert!(refused.frames.is_empty() && refused.session.is_none() && refused.started_at_secs.is_none());
    assert_eq!((refused.seconds, refused.frames_per_second()), (0.0, 0.0));

    settings.headset.pairing_code = "1234".into();
    assert!(run(settings).await.ended_in_order());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_never_welcomes_is_given_up() {
    let server = start(lying(Lie::NoWelcome));
    let mut settings = server.simulated();
    settings.headset.session.welcome_timeout = Duration::from_millis(300);
    let run = run(settings).await;
    assert_eq!((run.end.by, run.end.code), ("us", CloseCode::Idle.value()));
    assert_eq!(run.end.reason, "no welcome within 300 ms");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_run_can_be_stopped_with_a_goodbye() {
    let server = start(honest());
    let (stop, stopped) = watch::channel(false);
    let settings = SimulatedSettings { seconds: f64::INFINITY, stop: Some(stopped), ..server.simulated() };
    let progress = settings.progress.clone();
    let running = tokio::spawn(run(settings));
    while progress.decoded() < 3 && !running.is_finished() {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    stop.send(true).unwrap();
    let run = running.await.unwrap();
    assert!(run.ended_in_order() && run.counters.decoded >= 3);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_wrong_server_is_not_spoken_to() {
    let server = start(honest());
    let mut settings = server.simulated();
    settings.headset.fingerprint = Identity::ephemeral().unwrap().fingerprint();
    let error = SimulatedHeadset::connect(settings, &pool()).await.err().unwrap();
    assert!(
        matches!(
            error,
            SimulatedError::Headset(HeadsetError::Connect(ConnectError::WrongFingerprint { .. }))
        ),
        "{error:?}"
    );
}
