//! The server's clock: the only place that reads one.

use session::ServerTime;
use std::time::{Duration, Instant};

/// Counts from the server's start.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    origin: Instant,
}

impl Clock {
    pub(crate) fn start() -> Self {
        Self { origin: Instant::now() }
    }

    pub(crate) fn now(&self) -> ServerTime {
        ServerTime::from_micros(u64::try_from(self.origin.elapsed().as_micros()).unwrap_or(u64::MAX))
    }

    /// The instant of a time, for timers.
    pub(crate) fn instant(&self, time: ServerTime) -> Instant {
        self.origin + Duration::from_micros(time.as_micros())
    }
}
