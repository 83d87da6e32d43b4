//! Whose frame is next.

use session::ServerTime;
use std::collections::HashMap;
use std::time::Duration;

/// A session's wish for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wish {
    /// The session.
    pub session: u64,
    /// When its frame should be handed to the network to be shown in time.
    pub deadline: ServerTime,
    /// Time between two of its frames.
    pub period: Duration,
}

/// Serves the earliest deadline. A session that was passed over for two of its periods counts as due since then: when
/// the device cannot hold all rates, deadlines move on with every pose, and without this the same session could win
/// each time.
#[derive(Debug, Default)]
pub struct Scheduler {
    /// When each session's last frame was begun, or its first wish was seen.
    begun: HashMap<u64, ServerTime>,
}

impl Scheduler {
    /// The session whose frame is to be begun now; `None` if there is no wish.
    pub fn choose(&mut self, now: ServerTime, wishes: &[Wish]) -> Option<u64> {
        let mut due = |wish: &Wish| {
            let begun = *self.begun.entry(wish.session).or_insert(now);
            (wish.deadline.min(begun + 2 * wish.period), wish.session)
        };
        let chosen = wishes.iter().min_by_key(|wish| due(wish))?.session;
        self.begun.insert(chosen, now);
        Some(chosen)
    }

    /// Forgets sessions that are gone.
    pub fn retain(&mut self, is_here: impl Fn(u64) -> bool) {
        self.begun.retain(|session, _| is_here(*session));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_micros(16_667);

    fn at(ms: u64) -> ServerTime {
        ServerTime::from_micros(ms * 1000)
    }

    fn wish(session: u64, deadline_ms: u64) -> Wish {
        Wish { session, deadline: at(deadline_ms), period: PERIOD }
    }

    #[test]
    fn the_earliest_deadline_is_served() {
        let mut scheduler = Scheduler::default();
        assert_eq!(scheduler.choose(at(0), &[]), None);
        assert_eq!(scheduler.choose(at(30), &[wish(1, 50), wish(2, 40), wish(3, 60)]), Some(2));
    }

    #[test]
    fn nobody_starves_when_the_device_holds_half_the_rate() {
        // Two sessions whose deadlines are always 10 ms and 40 ms ahead; a frame takes 16 ms.
        let mut scheduler = Scheduler::default();
        let mut served = [0u32; 2];
        for step in 0..1000 {
            let now = step * 16;
            let chosen = scheduler.choose(at(now), &[wish(0, now + 10), wish(1, now + 40)]).unwrap();
            served[chosen as usize] += 1;
        }
        assert!(served.iter().all(|&n| n >= 300), "{served:?}");
    }

    #[test]
    fn who_has_left_is_forgotten() {
        let mut scheduler = Scheduler::default();
        scheduler.choose(at(0), &[wish(1, 5), wish(2, 5)]);
        scheduler.retain(|s| s == 2);
        assert_eq!(scheduler.begun.len(), 1);
    }
}
