//! Which step of a series in time is shown when.

use session::ServerTime;
use std::time::Duration;

/// A series that is played round and round. Pure: it is told what time it is.
///
/// Steps are counted on from the beginning of the play without going back to 0: the count 12 of a series of 10 steps is
/// its third, the second time. A step that could not be made in time is left out, so that the play neither slows down nor
/// piles up: what is shown is late by less than what making a step takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    began: ServerTime,
    steps_per_sec: f64,
    from: u32,
    steps: u32,
}

impl Playback {
    /// Begins now with step `from` of so many `steps`, at least 1. A rate of 0 stands still there.
    #[must_use]
    pub fn begin(now: ServerTime, steps_per_sec: f64, from: u32, steps: u32) -> Self {
        Self { began: now, steps_per_sec, from, steps: steps.max(1) }
    }

    /// The step that a count stands for, 0 to `steps` - 1.
    #[must_use]
    pub fn step(&self, count: u64) -> u32 {
        // Both are below 2^32, and so is the rest.
        ((u64::from(self.from) + count % u64::from(self.steps)) % u64::from(self.steps)) as u32
    }

    /// When a count is to be shown; `None` for never.
    #[must_use]
    pub fn due_at(&self, count: u64) -> Option<ServerTime> {
        if count == 0 {
            return Some(self.began);
        }
        // A play of centuries is none.
        let after = Duration::try_from_secs_f64(count as f64 / self.steps_per_sec).ok()?;
        (self.steps_per_sec > 0.0).then(|| self.began + after)
    }

    /// The count to make after `shown` (`None`: nothing of this play is shown yet), if it will be ready at `ready_at`: the
    /// first that is due then or later. `None` if nothing is left to be shown.
    #[must_use]
    pub fn next(&self, shown: Option<u64>, ready_at: ServerTime) -> Option<u64> {
        let after_shown = shown.map_or(0, |shown| shown.saturating_add(1));
        let behind = ready_at.since(self.began).as_secs_f64() * self.steps_per_sec;
        let count = after_shown.max(behind.ceil() as u64);
        // Who leaves out as many as there are would see the same one for ever.
        let is_on_view = self.steps > 1 && shown.is_some_and(|shown| self.step(shown) == self.step(count));
        let count = count.saturating_add(u64::from(is_on_view));
        self.due_at(count).map(|_| count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> ServerTime {
        ServerTime::from_micros(ms * 1000)
    }

    /// Four a second of ten, from the eighth; it begins at 1000 ms.
    fn play() -> Playback {
        Playback::begin(at(1000), 4.0, 7, 10)
    }

    /// What is shown when, by a maker that takes `making_ms` for each step and knows it.
    fn shown(play: &Playback, making_ms: u64, until_ms: u64) -> Vec<(u64, u32)> {
        let (mut now_ms, mut count, mut found) = (1000, Some(0), vec![(1000, play.step(0))]);
        while now_ms < until_ms {
            let ready_ms = now_ms + making_ms;
            let Some(next) = play.next(count, at(ready_ms)) else { break };
            let due_ms = play.due_at(next).unwrap().as_micros() / 1000;
            now_ms = ready_ms.max(due_ms);
            count = Some(next);
            found.push((now_ms, play.step(next)));
        }
        found
    }

    #[test]
    fn steps_follow_each_other_at_the_rate_and_begin_anew_after_the_last() {
        let expected: Vec<(u64, u32)> =
            [7, 8, 9, 0, 1, 2].iter().enumerate().map(|(i, &step)| (1000 + 250 * i as u64, step)).collect();
        for making_ms in [0, 30, 250] {
            assert_eq!(shown(&play(), making_ms, 2250), expected, "{making_ms} ms");
        }
    }

    #[test]
    fn a_step_that_cannot_be_ready_in_time_is_left_out_and_none_is_shown_late() {
        // 600 ms a step: every third is made, and shown when it is due.
        assert_eq!(shown(&play(), 600, 3000), [(1000, 7), (1750, 0), (2500, 3), (3250, 6)]);
    }

    #[test]
    fn a_step_that_took_longer_than_expected_is_followed_by_one_that_is_not_late() {
        // Count 1 was to be ready at 1250 and was at 1900: 2 and 3 are past.
        assert_eq!(play().next(Some(1), at(1910)), Some(4));
        assert_eq!(play().due_at(4), Some(at(2000)));
    }

    #[test]
    fn who_can_only_make_every_third_of_three_steps_still_sees_them_change() {
        let play = Playback::begin(at(1000), 4.0, 0, 3);
        let steps: Vec<u32> = shown(&play, 600, 4000).iter().map(|(_, step)| *step).collect();
        assert_eq!(steps, [0, 1, 2, 0]);
    }

    #[test]
    fn standing_still_shows_its_step_and_no_other() {
        let still = Playback::begin(at(1000), 0.0, 3, 10);
        assert_eq!(still.next(None, at(5000)), Some(0));
        assert_eq!((still.step(0), still.due_at(0)), (3, Some(at(1000))));
        assert_eq!(still.next(Some(0), at(5000)), None);
    }

    #[test]
    fn the_ends_of_time_and_of_counting_are_no_panic() {
        let slow = Playback::begin(at(0), f64::MIN_POSITIVE, u32::MAX, u32::MAX);
        assert_eq!(slow.next(Some(0), ServerTime::from_micros(u64::MAX)), None);
        assert!(slow.step(u64::MAX) < u32::MAX);
        assert_eq!(Playback::begin(at(0), 60.0, 0, 0).step(5), 0);
    }
}
