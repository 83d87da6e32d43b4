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
/// where fewer rays only blur it. From twice the step on rays are spared first where their neighbours agree
/// ([`render::Quality::coarser`]). Below the last rung a picture says nothing any more, and on a software driver a frame's
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

/// The same where nothing is gone through in steps, so that longer ones would bring nothing: only rays are given up.
pub const LADDER_WITHOUT_STEPS: [Rung; 10] = [
    Rung::new(1.0, 1.0),
    Rung::new(0.85, 1.0),
    Rung::new(0.75, 1.0),
    Rung::new(0.65, 1.0),
    Rung::new(0.57, 1.0),
    Rung::new(0.5, 1.0),
    Rung::new(0.43, 1.0),
    Rung::new(0.37, 1.0),
    Rung::new(0.31, 1.0),
    Rung::new(0.26, 1.0),
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
/// The least part of a frame's cost that is taken to go with its rays and samples when a step up is weighed, whatever two
/// measurements seem to say.
const LEAST_VARIABLE: f64 = 0.2;
/// How long after a change the load there is held against that before it.
const MEASURE: Duration = Duration::from_secs(1);
/// What that has told is forgotten after this time: what is drawn may be another thing by now.
const FORGET: Duration = Duration::from_secs(30);
/// A step up that has held for this long was none, and patience is forgotten.
const PROVEN: Duration = Duration::from_secs(20);

/// Chooses a rung from the load of the device. Reads no clock.
#[derive(Clone, Debug)]
pub struct QualityController {
    ladder: &'static [Rung],
    rung: usize,
    patience: Duration,
    changed_at: Option<ServerTime>,
    /// Cost of the rung before this one, and the load there when it was left.
    before: Option<(f64, f64)>,
    /// What part of the load here goes with the cost, as the last change has shown.
    variable: Option<f64>,
    raised_at: Option<ServerTime>,
    room_since: Option<ServerTime>,
}

impl Default for QualityController {
    fn default() -> Self {
        Self {
            ladder: &LADDER,
            rung: 0,
            patience: PATIENCE,
            changed_at: None,
            before: None,
            variable: None,
            raised_at: None,
            room_since: None,
        }
    }
}

impl QualityController {
    /// Begins on the topmost rung, with a scene that is gone through in steps.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The rung it stands on.
    #[must_use]
    pub fn rung(&self) -> Rung {
        self.ladder[self.rung]
    }

    /// Says whether the scene that is drawn from now on is gone through in steps. What is given up of the resolution stays.
    pub fn draws(&mut self, now: ServerTime, takes_steps: bool) {
        let ladder: &'static [Rung] = if takes_steps { &LADDER } else { &LADDER_WITHOUT_STEPS };
        if ladder.len() == self.ladder.len() {
            return;
        }
        let Rung { resolution_scale, .. } = self.rung();
        // Every resolution is on both; of the topmost one the rung with all steps.
        self.rung = ladder.iter().position(|r| r.resolution_scale <= resolution_scale).unwrap_or_default();
        (self.ladder, self.changed_at, self.room_since) = (ladder, Some(now), None);
        (self.before, self.variable) = (None, None);
    }

    /// Takes a measurement: `load` is the part of the device's time that all sessions' frames would take at their full
    /// rates, each at its present quality; above 1 the rates cannot be held. Returns whether the rung has changed.
    pub fn update(&mut self, now: ServerTime, load: f64) -> bool {
        if self.changed_at.is_some_and(|at| now.since(at) < SETTLE) {
            return false;
        }
        self.measure(now, load);
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
        let last = self.ladder.len() - 1;
        if self.rung == last {
            return false;
        }
        if self.raised_at.is_some_and(|at| now.since(at) < MISTAKE) {
            self.patience = (self.patience * 2).min(MOST_PATIENCE);
        }
        self.raised_at = None;
        self.before = Some((self.rung().cost(), load));
        self.rung = (self.rung + 1..=last).find(|&r| self.ladder[r].cost() <= allowed).unwrap_or(last);
        self.changed_at = Some(now);
        true
    }

    fn raise(&mut self, now: ServerTime, load: f64) -> bool {
        let Some(above) = self.rung.checked_sub(1) else { return false };
        if self.expected_load(load, self.ladder[above].cost()) > ROOM {
            self.room_since = None;
            return false;
        }
        let since = *self.room_since.get_or_insert(now);
        if now.since(since) < self.patience {
            return false;
        }
        self.before = Some((self.rung().cost(), load));
        self.rung = above;
        self.room_since = None;
        self.changed_at = Some(now);
        self.raised_at = Some(now);
        true
    }

    /// Learns from the load on both sides of a change what part of it goes with the cost. Only soon after the change: later
    /// the two are loads of different things.
    fn measure(&mut self, now: ServerTime, load: f64) {
        let since = self.changed_at.map(|at| now.since(at));
        if since.is_some_and(|since| since >= FORGET) {
            self.variable = None;
        }
        let (Some((cost_before, load_before)), Some(since)) = (self.before, since) else { return };
        if since >= MEASURE {
            self.before = None;
        } else if load > 0.0 {
            let here = self.rung().cost();
            let part = (load_before - load) / (cost_before - here) * here / load;
            self.variable = Some(part.clamp(LEAST_VARIABLE, 1.0));
        }
    }

    /// What the load would be at another cost. A part of each frame costs the same on every rung, such as converting and
    /// reading back; whoever took all of it to grow with the rays would never go up the last rungs. Where nothing is known
    /// of it, a step up is tried: one that is taken back tells.
    fn expected_load(&self, load: f64, cost: f64) -> f64 {
        let variable = self.variable.unwrap_or(LEAST_VARIABLE);
        load * (1.0 + variable * (cost / self.rung().cost() - 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: f64) -> ServerTime {
        ServerTime::from_micros((secs * 1e6) as u64)
    }

    /// Runs a controller against a device for `secs`, a measurement every 16 ms: `load(secs, cost)`. Returns the rungs
    /// by time of change.
    fn run(secs: f64, load: impl Fn(f64, f64) -> f64) -> (QualityController, Vec<(f64, f64)>) {
        run_mut(secs, load)
    }

    fn run_mut(secs: f64, mut load: impl FnMut(f64, f64) -> f64) -> (QualityController, Vec<(f64, f64)>) {
        let mut controller = QualityController::new();
        let mut changes = Vec::new();
        let mut t = 0.0;
        while t < secs {
            if controller.update(at(t), load(t, controller.rung().cost())) {
                changes.push((t, controller.rung().cost()));
            }
            t += 0.016;
        }
        (controller, changes)
    }

    #[test]
    fn the_ladders_go_down_in_cost_and_have_the_same_resolutions() {
        assert!(LADDER.windows(2).all(|w| w[1].cost() < w[0].cost()));
        assert!(LADDER_WITHOUT_STEPS.windows(2).all(|w| w[1].cost() < w[0].cost()));
        let mut scales: Vec<f64> = LADDER.iter().map(|r| r.resolution_scale).collect();
        scales.dedup();
        assert_eq!(scales, LADDER_WITHOUT_STEPS.map(|r| r.resolution_scale));
        assert!(LADDER_WITHOUT_STEPS.iter().all(|r| r.step_scale == 1.0));
    }

    #[test]
    fn where_no_step_is_taken_only_rays_are_given_up_and_no_more_than_needed() {
        let mut controller = QualityController::new();
        controller.draws(at(0.0), false);
        // Three times too much: half of the rays along each side are 0.75 of the device's time.
        for i in 0..1000 {
            let scale = controller.rung().resolution_scale;
            controller.update(at(f64::from(i) * 0.016), 3.0 * scale * scale);
            assert_eq!(controller.rung().step_scale, 1.0);
        }
        assert_eq!(controller.rung().resolution_scale, 0.43);
    }

    #[test]
    fn another_scene_keeps_the_resolution_and_has_its_steps_back() {
        let (mut controller, _) = run(2.0, |_, cost| 9.0 * cost);
        let Rung { resolution_scale, step_scale } = controller.rung();
        assert!(resolution_scale < 1.0 && step_scale > 1.0);
        controller.draws(at(2.0), false);
        assert_eq!(controller.rung(), Rung { resolution_scale, step_scale: 1.0 });
        // What the old scene cost is not held against the new one.
        assert!(!controller.update(at(2.1), 5.0));
        controller.draws(at(3.0), true);
        assert_eq!(controller.rung(), Rung { resolution_scale, step_scale });
        let mut full = QualityController::new();
        full.draws(at(0.0), false);
        full.draws(at(1.0), true);
        assert_eq!(full.rung(), LADDER[0]);
    }

    #[test]
    fn quality_comes_back_to_the_best_that_holds_although_a_part_of_each_frame_costs_the_same_everywhere() {
        for (fixed, best) in [(0.1, LADDER[0]), (0.3, LADDER[0]), (0.4, LADDER[1]), (0.45, LADDER[2])] {
            let load = |t: f64, cost: f64| if t < 5.0 { 0.3 + 9.0 * cost } else { fixed + 0.29 * cost };
            let (controller, changes) = run(120.0, load);
            assert_eq!(controller.rung(), best, "fixed part {fixed}: {changes:?}");
            let late = changes.iter().filter(|(t, _)| *t > 60.0).count();
            assert_eq!(late, 0, "fixed part {fixed}: {changes:?}");
        }
    }

    #[test]
    fn quality_comes_back_after_another_scene_of_which_nothing_is_known() {
        let (mut controller, _) = run(2.0, |_, cost| 0.3 + 9.0 * cost);
        assert!(controller.rung().resolution_scale < 0.5);
        controller.draws(at(2.0), false);
        for i in 0..7500 {
            let load = 0.44 + 0.05 * controller.rung().cost();
            controller.update(at(2.0 + f64::from(i) * 0.016), load);
        }
        assert_eq!(controller.rung(), LADDER_WITHOUT_STEPS[0]);
    }

    #[test]
    fn a_change_that_came_with_another_load_is_not_held_against_it_for_good() {
        // The load falls just when the rung does: all of it seems to go with the rays.
        let (controller, changes) = run(120.0, |t, cost| if t < 0.01 { 9.3 } else { 0.45 + 0.29 * cost });
        assert_eq!(controller.rung(), LADDER[2], "{changes:?}");
    }

    #[test]
    fn a_load_that_jitters_does_not_make_it_flap() {
        for tenths in 2..40u32 {
            let whole = f64::from(tenths) / 10.0;
            // A tenth up and down from frame to frame, smoothed as the server does.
            let (mut smoothed, mut last) = (None, 0.0);
            let mut seed = tenths;
            let (_, changes) = run_mut(300.0, |_, cost| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let jitter = 0.9 + 0.2 * f64::from(seed >> 8) / f64::from(1 << 24);
                let new = (0.15 + whole * cost) * jitter;
                let old = smoothed.filter(|_| last == cost).unwrap_or(new);
                last = cost;
                *smoothed.insert(old + 0.2 * (new - old))
            });
            let late = changes.iter().filter(|(t, _)| *t > 60.0).count();
            assert!(late <= 16, "{whole}: {late} changes in four minutes: {changes:?}");
        }
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
