//! Which step of a series in time is shown when.

use session::ServerTime;
use std::time::Duration;

/// Makings that are remembered, of which the middle one counts: one that was slow by chance is outvoted by its neighbours.
const REMEMBERED: usize = 3;

/// A series that is played round and round. Pure: it is told what time it is.
///
/// Steps are counted on from the beginning of the play without going back to 0: the count 12 of a series of 10 steps is
/// its third, the second time. Its clock starts when its first step is on view, not when it was asked for. A step that
/// cannot be made in time is left out, so that the play neither slows down nor piles up.
#[derive(Clone, Debug, PartialEq)]
pub struct Playback {
    steps_per_sec: f64,
    from: u32,
    steps: u32,
    on_view: Option<OnView>,
    /// What making a step took, the newest last; nothing, before so many were made.
    makings: [Duration; REMEMBERED],
}

/// What of a play is on view.
#[derive(Clone, Copy, Debug, PartialEq)]
struct OnView {
    count: u64,
    /// When the count 0 was due.
    began: ServerTime,
}

impl Playback {
    /// A play that begins with step `from` of so many `steps`, at least 1. A rate of 0 stands still there.
    #[must_use]
    pub fn new(steps_per_sec: f64, from: u32, steps: u32) -> Self {
        Self {
            steps_per_sec,
            from,
            steps: steps.max(1),
            on_view: None,
            makings: [Duration::ZERO; REMEMBERED],
        }
    }

    /// The step that a count stands for, 0 to `steps` - 1.
    #[must_use]
    pub fn step(&self, count: u64) -> u32 {
        // Both are below 2^32, and so is the rest.
        ((u64::from(self.from) + count % u64::from(self.steps)) % u64::from(self.steps)) as u32
    }

    /// What of it is on view; `None` before its first step.
    #[must_use]
    pub fn on_view(&self) -> Option<u64> {
        self.on_view.map(|on_view| on_view.count)
    }

    /// When a count is to be shown; `None` for never. The first step is due at once.
    #[must_use]
    pub fn due_at(&self, count: u64) -> Option<ServerTime> {
        match self.on_view {
            None => (count == 0).then_some(ServerTime::default()),
            Some(on_view) => Some(on_view.began + self.after(count)?),
        }
    }

    /// How long after the first step a count is due; `None` for never. A play of centuries is none.
    fn after(&self, count: u64) -> Option<Duration> {
        if count == 0 {
            return Some(Duration::ZERO);
        }
        Duration::try_from_secs_f64(count as f64 / self.steps_per_sec).ok()
    }

    /// The count to make now: the first that will be ready when it is due, by what making one has taken so far; the first
    /// step before all others. `None` if nothing is left to be shown.
    #[must_use]
    pub fn next(&self, now: ServerTime) -> Option<u64> {
        let Some(OnView { count: on_view, began }) = self.on_view else { return Some(0) };
        let ready_at = now + self.making_takes();
        let behind = ready_at.since(began).as_secs_f64() * self.steps_per_sec;
        let count = on_view.saturating_add(1).max(behind.ceil() as u64);
        // Who leaves out as many as there are would see the same one for ever.
        let is_same = self.steps > 1 && self.step(on_view) == self.step(count);
        let count = count.saturating_add(u64::from(is_same));
        self.due_at(count).map(|_| count)
    }

    /// A count is on view from now on, or would be if it could be had.
    pub fn shown(&mut self, now: ServerTime, count: u64) {
        let began = self.on_view.map_or(now, |on_view| on_view.began);
        self.on_view = Some(OnView { count, began });
    }

    /// Goes on after a rest, as if what is on view had come just now.
    pub fn go_on(&mut self, now: ServerTime) {
        if let Some(OnView { count, .. }) = self.on_view
            && let Some(after) = self.after(count)
        {
            self.on_view = Some(OnView { count, began: now - after });
        }
    }

    /// Making a step, from its file to the device, took this long.
    pub fn made_in(&mut self, took: Duration) {
        self.makings.rotate_left(1);
        self.makings[REMEMBERED - 1] = took;
    }

    /// What making the next step is expected to take.
    fn making_takes(&self) -> Duration {
        let mut sorted = self.makings;
        sorted.sort_unstable();
        sorted[REMEMBERED / 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> ServerTime {
        ServerTime::from_micros(ms * 1000)
    }

    /// Four a second of ten, from the eighth.
    fn play() -> Playback {
        Playback::new(4.0, 7, 10)
    }

    /// What is shown when, until a time, to somebody who comes at 1000 ms. Making the n-th takes `making_ms(n)`.
    fn shown(mut play: Playback, making_ms: impl Fn(usize) -> u64, until_ms: u64) -> Vec<(u64, u32)> {
        let (mut now_ms, mut found) = (1000, Vec::new());
        while now_ms < until_ms {
            let Some(count) = play.next(at(now_ms)) else { break };
            let making_ms = making_ms(found.len());
            play.made_in(Duration::from_millis(making_ms));
            let due_ms = play.due_at(count).unwrap().as_micros() / 1000;
            now_ms = (now_ms + making_ms).max(due_ms);
            play.shown(at(now_ms), count);
            found.push((now_ms, play.step(count)));
        }
        found
    }

    #[test]
    fn steps_follow_each_other_at_the_rate_from_the_first_on_and_begin_anew_after_the_last() {
        for making_ms in [0, 30, 250] {
            let expected: Vec<(u64, u32)> = [7, 8, 9, 0, 1, 2]
                .iter()
                .enumerate()
                .map(|(i, &step)| (1000 + making_ms + 250 * i as u64, step))
                .collect();
            assert_eq!(shown(play(), |_| making_ms, 2250 + making_ms), expected, "{making_ms} ms");
        }
    }

    #[test]
    fn the_clock_starts_with_the_first_step_however_long_that_took() {
        assert_eq!(
            shown(play(), |n| if n == 0 { 9000 } else { 10 }, 10_500),
            [(10_000, 7), (10_250, 8), (10_500, 9)]
        );
    }

    #[test]
    fn a_step_that_cannot_be_ready_in_time_is_left_out_and_none_is_late_that_could_be_foreseen() {
        // 600 ms a step. One cannot know that before the second is there; then every third is made, and shown when it is due.
        assert_eq!(shown(play(), |_| 600, 4200), [(1600, 7), (2200, 8), (2850, 2), (3600, 5), (4350, 8)]);
    }

    #[test]
    fn one_slow_step_holds_up_no_other() {
        // The third takes 2 s. The first that can be ready after it is due after that is the next.
        let shown = shown(play(), |n| if n == 2 { 2000 } else { 20 }, 4200);
        assert_eq!(shown, [(1020, 7), (1270, 8), (3270, 9), (3520, 7), (3770, 8), (4020, 9), (4270, 0)]);
    }

    #[test]
    fn who_can_only_make_every_third_of_three_steps_still_sees_them_change() {
        let play = Playback::new(4.0, 0, 3);
        let steps: Vec<u32> = shown(play, |_| 600, 3850).iter().map(|(_, step)| *step).collect();
        assert_eq!(steps, [0, 1, 2, 0]);
    }

    #[test]
    fn a_play_that_rests_goes_on_where_it_was() {
        let mut play = play();
        play.shown(at(1000), 0);
        play.shown(at(1250), 1);
        play.go_on(at(60_000));
        assert_eq!((play.on_view(), play.next(at(60_001))), (Some(1), Some(2)));
        assert_eq!(play.due_at(2), Some(at(60_250)));
    }

    #[test]
    fn standing_still_shows_its_step_and_no_other() {
        let mut still = Playback::new(0.0, 3, 10);
        assert_eq!((still.next(at(5000)), still.step(0)), (Some(0), 3));
        still.shown(at(5000), 0);
        assert_eq!(still.next(at(9000)), None);
        still.go_on(at(9000));
        assert_eq!(still.next(at(9000)), None);
    }

    #[test]
    fn the_ends_of_time_and_of_counting_are_no_panic() {
        let mut slow = Playback::new(f64::MIN_POSITIVE, u32::MAX, u32::MAX);
        slow.shown(at(0), 0);
        assert_eq!(slow.next(ServerTime::from_micros(u64::MAX)), None);
        assert!(slow.step(u64::MAX) < u32::MAX);
        slow.shown(at(0), u64::MAX);
        slow.go_on(at(1));
        slow.made_in(Duration::MAX);
        assert_eq!(Playback::new(60.0, 0, 0).step(5), 0);
    }
}
