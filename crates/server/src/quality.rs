//! How much a session's frames may cost: a ladder, and who decides which rung to stand on.

use session::ServerTime;
use std::time::Duration;

/// One rung of the ladder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    /// Rays along each side of the picture over pixels along it.
    pub resolution_scale: f64,
    /// Length of a step over that of the quality asked for.
    pub step_scale: f64,
}

impl Rung {
    const fn new(resolution_scale: f64, step_scale: f64) -> Self {
        Self { resolution_scale, step_scale }
    }

    /// What a frame costs compared with the topmost rung: rays times samples a ray.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.resolution_scale * self.resolution_scale / self.step_scale
    }
}

/// From all to little. Steps grow to one and a half of a voxel and no further: longer ones lose what is thin, such as a rib,
/// where fewer rays only blur it. Below the last rung a picture says nothing any more, and on a software driver a frame's
/// fixed cost outweighs its rays (measured: half of the rays take four fifths of the time); then the rate gives way.
pub const LADDER: [Rung; 12] = [
    Rung::new(1.0, 1.0),
    Rung::new(1.0, 2.0),
    Rung::new(1.0, 4.0),
    Rung::new(0.85, 4.0),
    Rung::new(0.75, 4.0),
    Rung::new(0.65, 4.0),
    Rung::new(0.57, 4.0),
    Rung::new(0.5, 4.0),
    Rung::new(0.43, 4.0),
    Rung::new(0.37, 4.0),
    Rung::new(0.31, 4.0),
    Rung::new(0.26, 4.0),
];

/// Above this part of the device's time, frames come too late: what jitters finds the device busy.
const TOO_MUCH: f64 = 0.8;
/// What a step down aims at.
const AIM: f64 = 0.65;
/// A step up is made only if it is expected to stay below this.
const ROOM: f64 = 0.6;
/// After a change the load is measured anew before it is judged.
const SETTLE: Duration = Duration::from_millis(300);
/// How long there must be room before a step up, at first.
const PATIENCE: Duration = Duration::from_secs(1);
/// And at most, after steps up that had to be taken back.
const MOST_PATIENCE: Duration = Duration::from_secs(32);
/// A step up that is taken back within this time was a mistake.
const MISTAKE: Duration = Duration::from_secs(3);
/// A step up that has held for this long was none, and patience is forgotten.
const PROVEN: Duration = Duration::from_secs(20);

/// Chooses a rung from the load of the device. Reads no clock.
#[derive(Clone, Debug)]
pub struct QualityController {
    rung: usize,
    patience: Duration,
    changed_at: Option<ServerTime>,
    raised_at: Option<ServerTime>,
    room_since: Option<ServerTime>,
}

impl Default for QualityController {
    fn default() -> Self {
        Self { rung: 0, patience: PATIENCE, changed_at: None, raised_at: None, room_since: None }
    }
}

impl QualityController {
    /// Begins on the topmost rung.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The rung it stands on.
    #[must_use]
    pub fn rung(&self) -> Rung {
        LADDER[self.rung]
    }

    /// Takes a measurement: `load` is the part of the device's time that all sessions' frames would take at their full
    /// rates, each at its present quality; above 1 the rates cannot be held. Returns whether the rung has changed.
    pub fn update(&mut self, now: ServerTime, load: f64) -> bool {
        if self.changed_at.is_some_and(|at| now.since(at) < SETTLE) {
            return false;
        }
        if load > TOO_MUCH {
            self.room_since = None;
            return self.lower(now, load);
        }
        if self.raised_at.is_some_and(|at| now.since(at) >= PROVEN) {
            self.patience = PATIENCE;
            self.raised_at = None;
        }
        self.raise(now, load)
    }

    fn lower(&mut self, now: ServerTime, load: f64) -> bool {
        let allowed = self.rung().cost() * AIM / load;
        let last = LADDER.len() - 1;
        if self.rung == last {
            return false;
        }
        if self.raised_at.is_some_and(|at| now.since(at) < MISTAKE) {
            self.patience = (self.patience * 2).min(MOST_PATIENCE);
        }
        self.raised_at = None;
        self.rung = (self.rung + 1..=last).find(|&r| LADDER[r].cost() <= allowed).unwrap_or(last);
        self.changed_at = Some(now);
        true
    }

    fn raise(&mut self, now: ServerTime, load: f64) -> bool {
        let Some(above) = self.rung.checked_sub(1) else { return false };
        if load * LADDER[above].cost() / self.rung().cost() > ROOM {
            self.room_since = None;
            return false;
        }
        let since = *self.room_since.get_or_insert(now);
        if now.since(since) < self.patience {
            return false;
        }
        self.rung = above;
        self.room_since = None;
        self.changed_at = Some(now);
        self.raised_at = Some(now);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a controller against a device for `secs`, a measurement every 16 ms: `load(secs, cost)`. Returns the rungs
    /// by time of change.
    fn run(secs: f64, load: impl Fn(f64, f64) -> f64) -> (QualityController, Vec<(f64, f64)>) {
        let mut controller = QualityController::new();
        let mut changes = Vec::new();
        let mut t = 0.0;
        while t < secs {
            let now = ServerTime::from_micros((t * 1e6) as u64);
            if controller.update(now, load(t, controller.rung().cost())) {
                changes.push((t, controller.rung().cost()));
            }
            t += 0.016;
        }
        (controller, changes)
    }

    #[test]
    fn the_ladder_goes_down_in_cost() {
        assert!(LADDER.windows(2).all(|w| w[1].cost() < w[0].cost()));
    }

    #[test]
    fn a_device_that_can_keeps_everything() {
        let (controller, changes) = run(60.0, |_, cost| 0.6 * cost);
        assert_eq!((controller.rung(), changes.len()), (LADDER[0], 0));
    }

    #[test]
    fn an_overload_is_answered_in_one_step_as_large_as_it_needs() {
        let (controller, changes) = run(1.0, |_, cost| 4.0 * cost);
        assert_eq!(changes.len(), 1, "{changes:?}");
        assert!(4.0 * controller.rung().cost() <= 0.9);
    }

    #[test]
    fn quality_comes_back_when_there_is_room_again() {
        let (controller, _) = run(60.0, |t, cost| if t < 10.0 { 4.0 * cost } else { 0.5 * cost });
        assert_eq!(controller.rung(), LADDER[0]);
    }

    #[test]
    fn a_device_between_two_rungs_does_not_flap() {
        // What a step up seems to bring, by its cost, and what it does bring differ by a fixed part of each frame.
        let (_, changes) = run(300.0, |_, cost| 0.2 + 1.15 * cost);
        assert!(changes.len() <= 4, "{changes:?}");
        // Here each step up is a mistake: twice the expected cost. It is made ever more rarely.
        let (_, changes) = run(300.0, |_, cost| if cost > 0.3 { 1.5 } else { 0.2 });
        assert!(changes.len() <= 60, "{} changes", changes.len());
        let late = changes.iter().filter(|(t, _)| *t > 200.0).count();
        assert!(late <= 16, "{late} changes in the last 100 s: {changes:?}");
    }

    #[test]
    fn even_the_last_rung_is_kept_when_nothing_helps() {
        let (controller, changes) = run(10.0, |_, _| 5.0);
        assert_eq!(controller.rung(), LADDER[LADDER.len() - 1]);
        assert!(changes.len() < LADDER.len());
    }
}
