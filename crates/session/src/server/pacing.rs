//! How many frames a session may ask for.

use crate::time::ServerTime;
use std::time::Duration;

/// Refresh intervals that may be saved up: enough to even out jitter, too little for a burst.
const MOST_SAVED: f64 = 1.5;

/// How much faster than the refresh rate is earned. A frame that is begun late saves nothing up beyond the most, so that
/// at exactly the refresh rate every frame after it would be as late: this works the delay off.
const CATCH_UP: f64 = 1.02;

/// A token bucket that earns one frame a refresh interval.
#[derive(Clone, Debug)]
pub(super) struct FrameBudget {
    interval_us: f64,
    /// Microseconds earned and not spent.
    credit_us: f64,
    /// Microseconds that were earned beyond the most that is saved, while a frame could have been made.
    missed_us: f64,
    updated_at: ServerTime,
}

impl FrameBudget {
    /// A full budget of `refresh_hz` frames a second.
    pub(super) fn new(now: ServerTime, refresh_hz: f64) -> Self {
        let interval_us = 1e6 / refresh_hz;
        Self { interval_us, credit_us: MOST_SAVED * interval_us, missed_us: 0.0, updated_at: now }
    }

    /// Earns what is due until `now`. `wanted` says whether a frame was wanted and held up all the while; returns
    /// how many such frames were missed.
    pub(super) fn refill(&mut self, now: ServerTime, wanted: bool) -> u64 {
        let earned = now.since(self.updated_at).as_secs_f64() * 1e6 * CATCH_UP;
        self.updated_at = self.updated_at.max(now);
        let most = MOST_SAVED * self.interval_us;
        let credit = self.credit_us + earned;
        self.credit_us = credit.min(most);
        if !wanted {
            return 0;
        }
        self.missed_us += credit - self.credit_us;
        let missed = (self.missed_us / self.interval_us).floor();
        self.missed_us -= missed * self.interval_us;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small whole number")]
        let missed = missed as u64;
        missed
    }

    /// Whether a frame has been earned.
    pub(super) fn has_frame(&self) -> bool {
        // A nanosecond of slack, so that sums of rounded times are not a hair short.
        self.credit_us + 1e-3 >= self.interval_us
    }

    /// Spends one frame.
    pub(super) fn spend(&mut self) {
        self.credit_us -= self.interval_us;
    }

    /// When the next frame will have been earned.
    pub(super) fn next_frame_at(&self) -> ServerTime {
        let missing = ((self.interval_us - self.credit_us).max(0.0) / CATCH_UP).ceil();
        self.updated_at + Duration::from_secs_f64(missing * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(micros: u64) -> ServerTime {
        ServerTime::from_micros(micros)
    }

    fn frames_taken(asks_every_us: u64, seconds: u64) -> u64 {
        let mut budget = FrameBudget::new(at(0), 60.0);
        let mut taken = 0;
        for now in (0..seconds * 1_000_000).step_by(asks_every_us as usize) {
            budget.refill(at(now), false);
            if budget.has_frame() {
                budget.spend();
                taken += 1;
            }
        }
        taken
    }

    #[test]
    fn never_gives_more_than_the_refresh_rate_and_the_catch_up() {
        assert!((600..=613).contains(&frames_taken(10, 10)), "{}", frames_taken(10, 10));
    }

    #[test]
    fn gives_every_frame_to_who_asks_at_the_refresh_rate() {
        assert_eq!(frames_taken(16_667, 10), 600);
        assert_eq!(frames_taken(33_333, 10), 301);
    }

    #[test]
    fn a_pause_does_not_earn_a_burst() {
        let mut budget = FrameBudget::new(at(0), 60.0);
        budget.refill(at(60_000_000), false);
        budget.spend();
        assert!(!budget.has_frame());
        let next = budget.next_frame_at();
        budget.refill(next, false);
        assert!(budget.has_frame());
    }

    #[test]
    fn counts_what_was_wanted_and_held_up() {
        let mut budget = FrameBudget::new(at(0), 50.0);
        let missed: u64 = (1..=100).map(|i| budget.refill(at(i * 10_000), true)).sum();
        assert!((50..=51).contains(&missed), "{missed}");
        assert_eq!(budget.refill(at(5_000_000), false), 0);
    }

    #[test]
    fn a_delay_is_worked_off() {
        let mut budget = FrameBudget::new(at(0), 60.0);
        let mut last_wait_us = 0;
        for pose in 0..120u64 {
            let came = pose * 16_667;
            // The renderer is busy for half an interval when the tenth pose comes.
            let mut now = if pose == 10 { came + 9_000 } else { came };
            budget.refill(at(now), false);
            if !budget.has_frame() {
                now = budget.next_frame_at().as_micros();
                budget.refill(at(now), false);
            }
            assert!(budget.has_frame());
            budget.spend();
            last_wait_us = now - came;
        }
        assert_eq!(last_wait_us, 0);
    }

    #[test]
    fn time_that_goes_back_earns_nothing() {
        let mut budget = FrameBudget::new(at(1_000_000), 60.0);
        budget.spend();
        budget.refill(at(0), false);
        budget.refill(at(1_000_000), false);
        assert!(!budget.has_frame());
    }
}
