//! Headsets that come and go, a thousand times, and what they leave behind. The only test of its process: it counts
//! the process's threads and memory.

use end_to_end::{
    Bystander, RawPeer, TestServer, Viewer, open_files, resident_bytes, settings, subject, threads, until,
};

/// At a time.
const TOGETHER: usize = 6;
/// Comings before anything is counted: arenas, caches and pools have their size then.
const WARMING: usize = 60;
const COUNTED: usize = 1000;
/// What the counted ones may leave in memory: allocators do not give all back. Found: from nothing to 37 MB, up and down,
/// and no more after 2000. Two of three had an encoder and a decoder; if they left those, it would be hundreds.
const MOST_LEFT_BYTES: u64 = 64 << 20;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thousand_headsets_come_and_go_and_leave_nothing() {
    let room = TestServer::start(subject(), "{}", settings());
    let bystander = Bystander::join(&room).await;
    come_and_go(&room, WARMING).await;
    let before = (threads(), open_files(), resident_bytes());
    come_and_go(&room, COUNTED).await;
    // A pool keeps an idle thread for ten seconds; one that a headset left would stay longer.
    until("no threads are left but those from before", || beyond(&before.0, threads()).is_empty()).await;
    let after = (threads(), open_files(), resident_bytes());
    println!(
        "{COUNTED} came and went: {} bytes more, {} threads, {} files before and {} after",
        after.2.saturating_sub(before.2),
        after.0.len(),
        before.1,
        after.1
    );
    assert_eq!(after.1, before.1, "open files");
    assert!(after.2 <= before.2 + MOST_LEFT_BYTES, "memory grew from {} to {} bytes", before.2, after.2);
    let run = bystander.was_not_harmed().await;
    println!("the bystander saw {} frames, {} lost", run.counters.decoded, run.counters.lost);
    room.is_empty().await;
    room.shutdown().await;
}

/// Those of `now` that are not among `before`.
fn beyond(before: &[String], mut now: Vec<String>) -> Vec<String> {
    for name in before {
        if let Some(at) = now.iter().position(|n| n == name) {
            now.swap_remove(at);
        }
    }
    now
}

/// Lets headsets come, some at a time, and waits until their seats are free.
async fn come_and_go(room: &TestServer, count: usize) {
    let mut left = count;
    while left > 0 {
        let now = left.min(TOGETHER);
        left -= now;
        // Three ways to go, twice: in order, without a word after a frame, and without even a hello.
        tokio::join!(
            greet(room),
            drop_after_a_frame(room, now > 1),
            drop_at_once(room, now > 2),
            greet_if(room, now > 3),
            drop_after_a_frame(room, now > 4),
            drop_at_once(room, now > 5),
        );
    }
    until("all but the bystander are gone", || room.server.seats().len() == 1).await;
    // The sockets of the last ones are closed a moment after their seats are free.
    tokio::time::sleep(std::time::Duration::from_secs(1)).await;
}

async fn greet(room: &TestServer) {
    let mut viewer = Viewer::join(room, "greeting").await;
    viewer.frame_after(0).await;
    viewer.leave().await;
}

async fn greet_if(room: &TestServer, comes: bool) {
    if comes {
        greet(room).await;
    }
}

async fn drop_after_a_frame(room: &TestServer, comes: bool) {
    if comes {
        let mut viewer = Viewer::join(room, "dropping").await;
        viewer.frame_after(0).await;
    }
}

async fn drop_at_once(room: &TestServer, comes: bool) {
    if comes {
        drop(RawPeer::connect(room).await);
    }
}
