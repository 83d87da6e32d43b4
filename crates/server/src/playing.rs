//! The thread `play`: brings the next step of a series to the device while the present one is drawn.

use crate::playback::Playback;
use crate::room::{Play, PreparedStep};
use crate::series::{Series, StepError};
use crate::server::Shared;
use session::ServerTime;
use std::time::Duration;

/// Longest sleep without a play: a scene that was missed costs no more.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);
/// How often it is looked whether the last picture of a former step is made.
const LOOK: Duration = Duration::from_millis(2);

/// Runs until the server stops. At most two steps are on the device at a time: the one on view, and the next or the former.
pub(crate) fn run(shared: &Shared, series: &Series) {
    let mut player: Option<Player<'_>> = None;
    while !shared.is_stopping() {
        let Some(play) = shared.room.play() else {
            rest(shared);
            continue;
        };
        match &mut player {
            Some(player) if player.play.number == play.number => player.go_on(),
            _ => player = Some(Player::new(shared, series, play)),
        }
    }
}

/// Waits for something to do, and keeps nothing on the device that is not needed meanwhile.
fn rest(shared: &Shared) {
    shared.room.former_step_is_gone();
    shared.played.wait(LONGEST_SLEEP);
}

/// Who plays one play.
struct Player<'a> {
    shared: &'a Shared,
    series: &'a Series,
    play: Play,
    playback: Playback,
    /// Whether the play stands because nobody looks.
    rests: bool,
    /// Steps in a row that could not be made.
    failures: u32,
}

impl<'a> Player<'a> {
    fn new(shared: &'a Shared, series: &'a Series, play: Play) -> Self {
        let mut playback = Playback::new(play.steps_per_sec, play.from, series.steps());
        if play.is_on_view {
            playback.shown(shared.clock.now(), 0);
        }
        Self { shared, series, play, playback, rests: true, failures: 0 }
    }

    /// Makes the next step, waits until it is due, and shows it; or waits, if nothing is to be made now.
    fn go_on(&mut self) {
        // The first step is made for whoever comes, and no other for nobody.
        if self.playback.on_view().is_some() && !self.shared.has_headsets() {
            self.rests = true;
            return rest(self.shared);
        }
        let begun = self.shared.clock.now();
        if std::mem::take(&mut self.rests) {
            self.playback.go_on(begun);
        }
        let Some(count) = self.playback.next(begun) else {
            return rest(self.shared);
        };
        let step = self.playback.step(count);
        let prepared = match self.prepare(step) {
            Ok(None) => return,
            Ok(Some(prepared)) => Ok(prepared),
            Err(error) => Err(error),
        };
        let took = self.shared.clock.now().since(begun);
        self.playback.made_in(took);
        let due_at = self.playback.due_at(count).unwrap_or(begun);
        if !self.sleeps_until(due_at) {
            return;
        }
        let shown = prepared.and_then(|prepared| self.shared.room.show_step(prepared));
        let now = self.shared.clock.now();
        self.playback.shown(now, count);
        match shown {
            Ok(()) => {
                let late = if count == 0 { Duration::ZERO } else { now.since(due_at) };
                tracing::debug!(step, ?took, ?late, "step shown");
                self.failures = 0;
                self.shared.wishes.wake();
            }
            Err(error) => self.failed(step, &error),
        }
    }

    /// A step on the device, beside the one on view; `None` if the play was over before it was there.
    fn prepare(&self, step: u32) -> Result<Option<PreparedStep>, StepError> {
        let volume = self.series.load(step)?;
        while !self.shared.room.former_step_is_gone() {
            if !self.goes_on() {
                return Ok(None);
            }
            self.shared.played.wait(LOOK);
        }
        self.shared.room.prepare_step(step, self.play.number, &volume).map(Some)
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
            self.shared.room.stop_playing(self.play.number);
        }
    }

    /// Whether the play still goes on when the time has come.
    fn sleeps_until(&self, time: ServerTime) -> bool {
        while self.goes_on() {
            let left = time.since(self.shared.clock.now());
            if left.is_zero() {
                return true;
            }
            self.shared.played.wait(left);
        }
        false
    }

    /// Whether this play is the one that the room is to play.
    fn goes_on(&self) -> bool {
        !self.shared.is_stopping()
            && self.shared.room.play().is_some_and(|play| play.number == self.play.number)
    }
}
