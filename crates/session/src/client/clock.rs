//! The server's clock, learnt from pings.

use crate::time::{ClockOffset, HeadsetTime};
use std::collections::VecDeque;
use std::time::Duration;
use wire::{Ping, Pong};

/// Time between two pings. They also keep the connection alive.
const INTERVAL: Duration = Duration::from_millis(100);
/// Time between the first pings, so that the offset is good before the first frames come.
const FIRST_INTERVAL: Duration = Duration::from_millis(20);
/// Answers until which [`FIRST_INTERVAL`] holds.
const FIRST_ANSWERS: u64 = 8;
/// Pings whose answer may still come.
const MAX_WAITING: usize = 64;
/// Time after which an answer is forgotten.
const WINDOW: Duration = Duration::from_secs(10);
/// How far two clocks may drift apart, in parts of a million: quartz at its worst.
const DRIFT_PER_MILLION: u64 = 50;

/// One answered ping.
#[derive(Clone, Copy, Debug)]
struct Sample {
    answered_at: HeadsetTime,
    server_minus_headset_us: i64,
    round_trip_us: u64,
}

/// Sends pings and keeps, of their answers, the one that bounds the offset best: the true offset lies within half the
/// round trip of the middle, whatever the asymmetry of the two ways (NTP, RFC 5905 section 8), and an old answer is
/// worth less by the drift since.
#[derive(Debug)]
pub(super) struct PingFilter {
    next_sequence: u64,
    next_at: HeadsetTime,
    answered: u64,
    waiting: VecDeque<(u64, HeadsetTime)>,
    samples: VecDeque<Sample>,
}

impl PingFilter {
    pub(super) fn new(now: HeadsetTime) -> Self {
        Self {
            next_sequence: 0,
            next_at: now,
            answered: 0,
            waiting: VecDeque::new(),
            samples: VecDeque::new(),
        }
    }

    pub(super) fn next_at(&self) -> HeadsetTime {
        self.next_at
    }

    /// The ping that is due at `now`, if one is.
    pub(super) fn poll(&mut self, now: HeadsetTime) -> Option<Ping> {
        if now < self.next_at {
            return None;
        }
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        self.next_at = now + if self.answered < FIRST_ANSWERS { FIRST_INTERVAL } else { INTERVAL };
        if self.waiting.len() == MAX_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back((sequence, now));
        let clock = self.best(now).map(|best| wire::ClockReport {
            server_minus_headset_us: best.server_minus_headset_us,
            round_trip_us: u32::try_from(best.round_trip_us).unwrap_or(u32::MAX),
        });
        Some(Ping { sequence, sent_at_us: now.as_micros(), clock })
    }

    /// Takes an answer. Returns whether it answers a ping that waits, and can be true.
    pub(super) fn take(&mut self, now: HeadsetTime, pong: &Pong) -> bool {
        let Some(index) = self.waiting.iter().position(|(sequence, _)| *sequence == pong.sequence) else {
            return false;
        };
        let (_, sent_at) = self.waiting[index];
        if sent_at.as_micros() != pong.ping_sent_at_us || pong.sent_at_us < pong.received_at_us {
            return false;
        }
        let total_us = now.micros_since(sent_at);
        let Some(round_trip_us) = u64::try_from(total_us).ok().and_then(|total| {
            // A server that says it held the ping for longer than it was away is wrong.
            total.checked_sub(pong.sent_at_us - pong.received_at_us)
        }) else {
            return false;
        };
        self.waiting.remove(index);
        self.answered += 1;
        let up = i128::from(pong.received_at_us) - i128::from(sent_at.as_micros());
        let down = i128::from(pong.sent_at_us) - i128::from(now.as_micros());
        let Ok(server_minus_headset_us) = i64::try_from((up + down) / 2) else {
            return false;
        };
        self.samples.retain(|sample| now.since(sample.answered_at) <= WINDOW);
        self.samples.push_back(Sample { answered_at: now, server_minus_headset_us, round_trip_us });
        true
    }

    /// The offset as it is known at `now`; `None` before the first answer.
    pub(super) fn offset(&self, now: HeadsetTime) -> Option<ClockOffset> {
        self.best(now).map(|best| ClockOffset {
            server_minus_headset_us: best.server_minus_headset_us,
            error_us: best.error_us(now),
        })
    }

    /// The shortest round trip of late; `None` before the first answer.
    pub(super) fn round_trip(&self, now: HeadsetTime) -> Option<Duration> {
        self.best(now).map(|best| Duration::from_micros(best.round_trip_us))
    }

    fn best(&self, now: HeadsetTime) -> Option<&Sample> {
        self.samples.iter().min_by_key(|sample| sample.error_us(now))
    }
}

impl Sample {
    fn error_us(&self, now: HeadsetTime) -> u64 {
        let age_us = now.since(self.answered_at).as_micros() as u64;
        self.round_trip_us.div_ceil(2) + age_us.saturating_mul(DRIFT_PER_MILLION).div_ceil(1_000_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(micros: u64) -> HeadsetTime {
        HeadsetTime::from_micros(micros)
    }

    /// The answer of a server whose clock is 5 s ahead, `up_us` and `down_us` away.
    fn exchange(filter: &mut PingFilter, now_us: u64, up_us: u64, down_us: u64) -> bool {
        let ping = filter.poll(at(now_us)).expect("a ping is due");
        let received_at_us = now_us + up_us + 5_000_000;
        let pong = Pong {
            sequence: ping.sequence,
            ping_sent_at_us: ping.sent_at_us,
            received_at_us,
            sent_at_us: received_at_us + 100,
        };
        filter.take(at(now_us + up_us + 100 + down_us), &pong)
    }

    #[test]
    fn the_shortest_round_trip_is_believed_most() {
        let mut filter = PingFilter::new(at(0));
        assert!(exchange(&mut filter, 0, 9_000, 1_000));
        assert_eq!(filter.offset(at(10_100)).unwrap().server_minus_headset_us, 5_004_000);
        assert!(exchange(&mut filter, 100_000, 1_000, 1_200));
        assert!(exchange(&mut filter, 200_000, 1_000, 30_000));
        let offset = filter.offset(at(231_100)).unwrap();
        assert_eq!(offset.server_minus_headset_us, 4_999_900);
        assert!((1_100..1_200).contains(&offset.error_us), "{offset:?}");
        assert_eq!(filter.round_trip(at(231_100)), Some(Duration::from_micros(2_200)));
    }

    #[test]
    fn an_old_answer_gives_way_to_a_newer_one_at_last() {
        let mut filter = PingFilter::new(at(0));
        assert!(exchange(&mut filter, 0, 1_000, 1_000));
        assert!(exchange(&mut filter, 11_000_000, 3_000, 3_000));
        assert_eq!(filter.round_trip(at(11_010_000)), Some(Duration::from_micros(6_000)));
    }

    #[test]
    fn answers_that_cannot_be_true_are_ignored() {
        let mut filter = PingFilter::new(at(1_000));
        let ping = filter.poll(at(1_000)).unwrap();
        let pong = Pong { sequence: 0, ping_sent_at_us: 1_000, received_at_us: 50, sent_at_us: 60 };
        assert!(!filter.take(at(2_000), &Pong { sequence: 1, ..pong }));
        assert!(!filter.take(at(2_000), &Pong { ping_sent_at_us: 999, ..pong }));
        assert!(!filter.take(at(2_000), &Pong { sent_at_us: 49, ..pong }));
        assert!(!filter.take(at(2_000), &Pong { sent_at_us: 9_999, ..pong }));
        assert!(!filter.take(at(500), &pong));
        assert_eq!(filter.offset(at(2_000)), None);
        assert_eq!(ping.clock, None);
        assert!(filter.take(at(2_000), &pong));
        assert!(!filter.take(at(2_000), &pong), "an answer counts once");
    }

    #[test]
    fn the_first_pings_come_faster() {
        let mut filter = PingFilter::new(at(0));
        for _ in 0..FIRST_ANSWERS {
            let now = filter.next_at().as_micros();
            assert!(exchange(&mut filter, now, 500, 500));
        }
        let now = filter.next_at();
        assert_eq!(now.as_micros(), FIRST_ANSWERS * 20_000);
        filter.poll(now).unwrap();
        assert_eq!(filter.next_at(), now + INTERVAL);
    }
}
