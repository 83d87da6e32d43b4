//! When a picture will be shown: the headset's forecast.

use session::HeadsetTime;
use std::collections::VecDeque;
use std::time::Duration;

/// Frames that the forecast looks back on: two seconds at 60 Hz.
const WINDOW: usize = 120;
/// Frames without which the first guess stands.
const FEWEST: usize = 10;
/// One of so many pictures may come too late.
const LATE_ONE_IN: usize = 10;
/// A forecast beyond this helps nobody.
const LONGEST: Duration = Duration::from_secs(1);

/// Forecasts when the picture for a pose will be shown: so many display intervals later as nine of ten of the last
/// frames took from pose to decoded picture, rounded up. It begins with a guess.
#[derive(Clone, Debug)]
pub struct DisplayTiming {
    interval: Duration,
    latency: Duration,
    recent: VecDeque<Duration>,
}

impl DisplayTiming {
    /// For a display that shows a picture every `interval`; `first_guess` is the latency until frames were measured.
    #[must_use]
    pub fn new(interval: Duration, first_guess: Duration) -> Self {
        Self { interval, latency: first_guess.min(LONGEST), recent: VecDeque::new() }
    }

    /// From a pose to the display of its picture, as it is forecast now: whole display intervals, at least one.
    #[must_use]
    pub fn lead(&self) -> Duration {
        let interval = self.interval.as_micros().max(1);
        // An interval is given in whole microseconds at best: three of 16 667 are 50 001, and 50 ms fit into three.
        let intervals = self.latency.as_micros().div_ceil(interval).max(1);
        u32::try_from(intervals).map_or(Duration::MAX, |intervals| self.interval.saturating_mul(intervals))
    }

    /// When the picture is expected to be shown for a pose that was taken in the display interval that began at
    /// `interval_began_at`.
    #[must_use]
    pub fn display_at(&self, interval_began_at: HeadsetTime) -> HeadsetTime {
        interval_began_at + self.lead()
    }

    /// Learns how long a frame took from its pose to its decoded picture.
    pub fn learn(&mut self, pose_to_decoded: Duration) {
        if self.recent.len() == WINDOW {
            self.recent.pop_front();
        }
        self.recent.push_back(pose_to_decoded);
        if self.recent.len() >= FEWEST {
            let mut sorted: Vec<_> = self.recent.iter().copied().collect();
            sorted.sort_unstable();
            // Nearest rank: of ten, the ninth.
            self.latency = sorted[sorted.len() - 1 - sorted.len() / LATE_ONE_IN].min(LONGEST);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_micros(16_667);

    fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    #[test]
    fn the_first_guess_stands_until_enough_was_measured() {
        let mut timing = DisplayTiming::new(INTERVAL, ms(50));
        assert_eq!(timing.lead(), 3 * INTERVAL);
        for _ in 0..FEWEST - 1 {
            timing.learn(ms(5));
        }
        assert_eq!(timing.lead(), 3 * INTERVAL);
        timing.learn(ms(5));
        assert_eq!(timing.lead(), INTERVAL);
    }

    #[test]
    fn one_frame_in_ten_may_be_late() {
        let mut timing = DisplayTiming::new(INTERVAL, ms(50));
        for i in 0..WINDOW {
            timing.learn(ms(if i % 10 == 0 { 400 } else { 30 }));
        }
        assert_eq!(timing.lead(), 2 * INTERVAL);
        for i in 0..WINDOW {
            timing.learn(ms(if i % 9 == 0 { 400 } else { 30 }));
        }
        assert_eq!(timing.lead(), 24 * INTERVAL);
    }

    #[test]
    fn it_follows_the_latency_up_and_down() {
        let mut timing = DisplayTiming::new(INTERVAL, ms(50));
        let mut after = |latency, frames| {
            (0..frames).for_each(|_| timing.learn(latency));
            timing.lead()
        };
        assert_eq!(after(ms(70), WINDOW), 5 * INTERVAL);
        assert_eq!(after(ms(10), WINDOW), INTERVAL);
        assert_eq!(after(Duration::from_secs(3600), WINDOW), 60 * INTERVAL);
        assert_eq!(after(Duration::ZERO, WINDOW), INTERVAL, "no picture is shown before the next interval");
    }

    #[test]
    fn display_times_lie_on_the_display_s_grid() {
        let timing = DisplayTiming::new(INTERVAL, ms(50));
        let tick = HeadsetTime::from_micros(1_000_000);
        assert_eq!(timing.display_at(tick).as_micros(), 1_050_001);
        assert_eq!(timing.display_at(tick + INTERVAL).as_micros(), 1_066_668);
    }

    #[test]
    fn absurd_intervals_do_no_harm() {
        assert!(DisplayTiming::new(Duration::ZERO, ms(50)).lead() <= ms(50));
        assert_eq!(DisplayTiming::new(Duration::MAX, ms(50)).lead(), Duration::MAX);
    }
}
