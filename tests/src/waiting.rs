//! Waiting for what must come, but not for ever.

use std::time::{Duration, Instant};

/// Far longer than anything takes on a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Between two looks at something that does not tell by itself.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// What a future gives, if it does so within [`PATIENCE`]; else panics, saying what was waited for.
pub async fn within<T>(what: &str, future: impl Future<Output = T>) -> T {
    match tokio::time::timeout(PATIENCE, future).await {
        Ok(result) => result,
        Err(_) => panic!("waited {} s for {what}", PATIENCE.as_secs()),
    }
}

/// Returns once something holds; panics if it does not within [`PATIENCE`].
pub async fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < PATIENCE, "waited {} s until {what}", PATIENCE.as_secs());
        tokio::time::sleep(LOOK_EVERY).await;
    }
}
