//! The thread `play`: brings the next step of a series to the device while the present one is drawn.

use crate::room::{Played, PreparedStep};
use crate::series::{Series, StepError};
use crate::server::Shared;
use render::VolumeOnDevice;
use session::ServerTime;
use std::sync::Weak;
use std::time::Duration;

/// Longest sleep without a play: a scene that was missed costs no more.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);
/// How often it is looked whether the last picture of a former step is made, and how often at most: who keeps it longer
/// does so on purpose.
const LOOK: (Duration, usize) = (Duration::from_millis(2), 100);

/// Runs until the server stops. At most two steps are on the device at a time: the one on view, and the next.
pub(crate) fn run(shared: &Shared, series: &Series) {
    let mut player = Player {
        shared,
        series,
        play: 0,
        count: None,
        former: Weak::new(),
        making_takes: Duration::ZERO,
        failures: 0,
    };
    while !shared.is_stopping() {
        match shared.room.played() {
            Some(played) => player.go_on(&played),
            None => shared.played.wait(LONGEST_SLEEP),
        }
    }
}

struct Player<'a> {
    shared: &'a Shared,
    series: &'a Series,
    /// The number of the play that is gone on with.
    play: u32,
    /// What of it is on view.
    count: Option<u64>,
    /// The step that was on view before that.
    former: Weak<VolumeOnDevice>,
    /// What loading and uploading a step is expected to take.
    making_takes: Duration,
    /// Steps in a row that could not be made.
    failures: u32,
}

impl Player<'_> {
    /// Makes the next step, waits until it is due, and shows it.
    fn go_on(&mut self, played: &Played) {
        let Played { playback, number, on_view } = played;
        if self.play != *number {
            // It may begin with what is on view.
            (self.play, self.count) = (*number, (playback.step(0) == *on_view).then_some(0));
            self.failures = 0;
        }
        let begun = self.shared.clock.now();
        let Some(count) = playback.next(self.count, begun + self.making_takes) else {
            return self.shared.played.wait(LONGEST_SLEEP);
        };
        let step = playback.step(count);
        let prepared = self.prepare(step);
        let took = self.shared.clock.now().since(begun);
        // What takes longer once may do so again; what goes faster is believed by and by.
        self.making_takes = took.max((self.making_takes * 3 + took) / 4);
        if let Some(due_at) = playback.due_at(count)
            && !self.sleep_until(due_at)
        {
            return;
        }
        self.count = Some(count);
        match prepared.and_then(|prepared| self.shared.room.show_step(prepared)) {
            Ok(former) => {
                let late = playback.due_at(count).map(|due_at| self.shared.clock.now().since(due_at));
                tracing::debug!(step, ?took, ?late, "step shown");
                self.failures = 0;
                self.former = former.map(|former| std::sync::Arc::downgrade(&former)).unwrap_or_default();
                self.shared.wishes.wake();
            }
            Err(error) => self.failed(step, &error),
        }
    }

    fn prepare(&self, step: u32) -> Result<PreparedStep, StepError> {
        let volume = self.series.load(step)?;
        let (look, times) = LOOK;
        for _ in 0..times {
            if self.former.strong_count() == 0 {
                break;
            }
            std::thread::sleep(look);
        }
        self.shared.room.prepare_step(step, self.play, &volume)
    }

    /// A step that cannot be had is left out; a series of which none can be had is not asked for again and again.
    fn failed(&mut self, step: u32, error: &StepError) {
        tracing::warn!(step, "step not shown: {error}");
        self.failures += 1;
        if self.failures >= self.series.steps() {
            tracing::error!(
                "{} steps in a row could not be shown; the series is not played any more",
                self.failures
            );
            self.shared.room.stop_playing(self.play);
        }
    }

    /// Whether the play still goes on when the time has come.
    fn sleep_until(&self, time: ServerTime) -> bool {
        loop {
            let goes_on = self.shared.room.played().is_some_and(|played| played.number == self.play);
            if self.shared.is_stopping() || !goes_on {
                return false;
            }
            let left = time.since(self.shared.clock.now());
            if left.is_zero() {
                return true;
            }
            self.shared.played.wait(left);
        }
    }
}
