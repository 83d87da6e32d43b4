//! In which order frames reach the decoder, and which never do.

use super::ReceivedFrame;
use crate::time::HeadsetTime;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;
use wire::MAX_FRAMES_IN_FLIGHT;

/// How long a frame waits for one that it hangs on. Then that one is taken for lost.
const LONGEST_HOLD: Duration = Duration::from_millis(250);
/// Frames whose fate is remembered.
const MAX_REMEMBERED: usize = 64;
/// Frames that wait for the decoder. A decoder that is farther behind will not catch up: all are dropped, and it goes
/// on with a key frame.
const MAX_READY: usize = 8;

/// Puts frames into decoding order. A frame goes to the decoder once the frame that it depends on has gone, a key
/// frame at once; what is older than that is stale and never goes.
#[derive(Debug, Default)]
pub(super) struct Delivery {
    /// Frames that wait for one that they depend on.
    held: BTreeMap<u64, ReceivedFrame>,
    /// Frames that wait for the decoder.
    ready: VecDeque<ReceivedFrame>,
    newest_delivered: Option<u64>,
    newest_key_frame: Option<u64>,
    /// Frames that were given to the decoder and that others may hang on, newest last.
    delivered: VecDeque<u64>,
    /// Frames that will never come.
    lost: VecDeque<u64>,
    is_key_frame_needed: bool,
}

/// What became of frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct DeliveryOutcome {
    /// Frames that came after a newer one had been delivered, or twice.
    pub(super) stale: u64,
    /// Frames that can never be decoded.
    pub(super) lost: u64,
}

impl Delivery {
    pub(super) fn is_key_frame_needed(&self) -> bool {
        self.is_key_frame_needed
    }

    /// The next frame for the decoder.
    pub(super) fn next_ready(&mut self) -> Option<ReceivedFrame> {
        self.ready.pop_front()
    }

    /// Takes a frame that has arrived whole.
    pub(super) fn take(&mut self, frame: ReceivedFrame) -> DeliveryOutcome {
        let mut outcome = DeliveryOutcome::default();
        let number = frame.header.frame;
        if self.newest_delivered.is_some_and(|newest| number <= newest) || self.held.contains_key(&number) {
            outcome.stale += 1;
            return outcome;
        }
        self.held.insert(number, frame);
        while self.held.len() > MAX_FRAMES_IN_FLIGHT {
            let (oldest, _) = self.held.pop_first().expect("more than none are held");
            remember(&mut self.lost, oldest);
            outcome.lost += 1;
            self.is_key_frame_needed = true;
        }
        self.settle(&mut outcome);
        outcome
    }

    /// A frame will never come.
    pub(super) fn lose(&mut self, number: u64) -> DeliveryOutcome {
        let mut outcome = DeliveryOutcome { stale: 0, lost: 1 };
        if self.newest_delivered.is_none_or(|newest| number > newest) {
            remember(&mut self.lost, number);
            self.is_key_frame_needed = true;
            self.settle(&mut outcome);
        }
        outcome
    }

    /// The decoder could not decode a frame, and so nothing that hangs on it.
    pub(super) fn fail(&mut self, number: u64) -> DeliveryOutcome {
        let mut outcome = DeliveryOutcome { stale: 0, lost: 1 };
        if self.newest_key_frame.is_some_and(|key| key > number) {
            return outcome;
        }
        self.break_chain(&mut outcome);
        self.settle(&mut outcome);
        outcome
    }

    /// Gives up frames that have waited too long.
    pub(super) fn expire(&mut self, now: HeadsetTime) -> DeliveryOutcome {
        let mut outcome = DeliveryOutcome::default();
        let lost = &mut self.lost;
        self.held.retain(|number, frame| {
            let keeps = now < frame.completed_at + LONGEST_HOLD;
            if !keeps {
                remember(lost, *number);
                outcome.lost += 1;
            }
            keeps
        });
        if outcome.lost > 0 {
            self.is_key_frame_needed = true;
            self.settle(&mut outcome);
        }
        outcome
    }

    pub(super) fn next_expiry(&self) -> Option<HeadsetTime> {
        self.held.values().map(|frame| frame.completed_at + LONGEST_HOLD).min()
    }

    /// Delivers what can be delivered and drops what never can.
    fn settle(&mut self, outcome: &mut DeliveryOutcome) {
        // The newest key frame makes everything before it stale.
        if let Some(key) =
            self.held.iter().rev().find(|(_, f)| f.header.depends_on.is_none()).map(|(n, _)| *n)
        {
            self.deliver(key, outcome);
        }
        loop {
            if let Some(number) = self.first_decodable() {
                self.deliver(number, outcome);
            } else if let Some(number) = self.first_undecodable() {
                self.held.remove(&number);
                remember(&mut self.lost, number);
                outcome.lost += 1;
                self.is_key_frame_needed = true;
            } else {
                return;
            }
        }
    }

    fn first_decodable(&self) -> Option<u64> {
        self.held
            .iter()
            .find(|(_, frame)| frame.header.depends_on.is_some_and(|number| self.delivered.contains(&number)))
            .map(|(number, _)| *number)
    }

    /// A frame that hangs on one that is lost, or on one that was passed over.
    fn first_undecodable(&self) -> Option<u64> {
        self.held
            .iter()
            .find(|(_, frame)| {
                frame.header.depends_on.is_some_and(|number| {
                    self.lost.contains(&number)
                        || self.newest_delivered.is_some_and(|newest| number <= newest)
                            && !self.delivered.contains(&number)
                })
            })
            .map(|(number, _)| *number)
    }

    fn deliver(&mut self, number: u64, outcome: &mut DeliveryOutcome) {
        let Some(frame) = self.held.remove(&number) else {
            return;
        };
        if frame.header.depends_on.is_none() {
            self.newest_key_frame = Some(number);
            self.delivered.clear();
            self.is_key_frame_needed = false;
            // The decoder need not be bothered with what came before.
            outcome.stale += self.ready.len() as u64;
            self.ready.clear();
        } else if self.lost.iter().all(|lost| *lost < number) {
            // It hangs on a frame from before the loss: the server has found a way around it.
            self.is_key_frame_needed = false;
        }
        self.newest_delivered = Some(number);
        remember(&mut self.delivered, number);
        // What is older came too late or not at all.
        let newer = self.held.split_off(&number);
        outcome.stale += self.held.len() as u64;
        self.held = newer;
        self.ready.push_back(frame);
        if self.ready.len() > MAX_READY {
            self.break_chain(outcome);
        }
    }

    /// Nothing that was delivered can be built upon.
    fn break_chain(&mut self, outcome: &mut DeliveryOutcome) {
        outcome.lost += self.ready.len() as u64;
        self.ready.clear();
        self.delivered.clear();
        self.is_key_frame_needed = true;
    }
}

fn remember(numbers: &mut VecDeque<u64>, number: u64) {
    if numbers.len() == MAX_REMEMBERED {
        numbers.pop_front();
    }
    numbers.push_back(number);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(number: u64, depends_on: Option<u64>) -> ReceivedFrame {
        ReceivedFrame::for_test(number, depends_on, HeadsetTime::from_micros(number * 16_667))
    }

    fn ready(delivery: &mut Delivery) -> Vec<u64> {
        std::iter::from_fn(|| delivery.next_ready()).map(|frame| frame.header.frame).collect()
    }

    /// Frames `number:depends_on`, `number` alone for a key frame, `!number` for a lost one, `?number` for one that
    /// did not decode. Returns what was delivered and whether a key frame is needed.
    fn delivered(arrivals: &str) -> (Vec<u64>, bool) {
        let mut delivery = Delivery::default();
        let mut all = Vec::new();
        for arrival in arrivals.split_whitespace() {
            if let Some(number) = arrival.strip_prefix('!') {
                delivery.lose(number.parse().unwrap());
            } else if let Some(number) = arrival.strip_prefix('?') {
                delivery.fail(number.parse().unwrap());
            } else if let Some((number, depends_on)) = arrival.split_once(':') {
                delivery.take(frame(number.parse().unwrap(), Some(depends_on.parse().unwrap())));
            } else {
                delivery.take(frame(arrival.parse().unwrap(), None));
            }
            all.extend(ready(&mut delivery));
        }
        (all, delivery.is_key_frame_needed())
    }

    #[test]
    fn frames_go_in_the_order_of_their_dependencies() {
        let check = |arrivals, expected: &[u64], is_key_frame_needed| {
            assert_eq!(delivered(arrivals), (expected.to_vec(), is_key_frame_needed), "{arrivals}");
        };
        check("0 1:0 2:1", &[0, 1, 2], false);
        check("0 2:1 3:2 1:0", &[0, 1, 2, 3], false);
        check("1:0 0", &[0, 1], false);
        check("0 1:0 1:0", &[0, 1], false);
        // A gap in the numbers is none in the chain.
        check("0 5:0 9:5", &[0, 5, 9], false);
    }

    #[test]
    fn a_lost_frame_takes_with_it_what_hangs_on_it() {
        let check = |arrivals, expected: &[u64], is_key_frame_needed| {
            assert_eq!(delivered(arrivals), (expected.to_vec(), is_key_frame_needed), "{arrivals}");
        };
        check("0 2:1 !1", &[0], true);
        check("0 !1 2:1 3:2", &[0], true);
        check("0 !1 2:1 3 4:3", &[0, 3, 4], false);
        check("0 !1 2:1 3:0 4:3", &[0, 3, 4], false);
        // A loss before the newest key frame matters no more.
        check("0 3 !1", &[0, 3], false);
    }

    #[test]
    fn nothing_stale_goes_after_something_fresh() {
        let check = |arrivals, expected: &[u64], is_key_frame_needed| {
            assert_eq!(delivered(arrivals), (expected.to_vec(), is_key_frame_needed), "{arrivals}");
        };
        check("0 3 1:0 2:1", &[0, 3], false);
        check("0 2:1 3 1:0", &[0, 3], false);
        check("5 4", &[5], false);
    }

    #[test]
    fn a_frame_that_did_not_decode_ends_its_chain() {
        let check = |arrivals, expected: &[u64], is_key_frame_needed| {
            assert_eq!(delivered(arrivals), (expected.to_vec(), is_key_frame_needed), "{arrivals}");
        };
        check("0 1:0 ?1 2:1", &[0, 1], true);
        check("0 1:0 ?1 2:1 3", &[0, 1, 3], false);
        check("0 1:0 2 ?1 3:2", &[0, 1, 2, 3], false);
    }

    #[test]
    fn a_frame_waits_only_so_long_for_its_dependency() {
        let mut delivery = Delivery::default();
        delivery.take(frame(0, None));
        delivery.take(frame(2, Some(1)));
        let expiry = delivery.next_expiry().unwrap();
        assert_eq!(expiry.as_micros(), 2 * 16_667 + 250_000);
        assert_eq!(delivery.expire(expiry).lost, 1);
        assert!(delivery.is_key_frame_needed());
        assert_eq!(delivery.next_expiry(), None);
        assert_eq!(ready(&mut delivery), [0]);
    }

    #[test]
    fn a_decoder_that_falls_behind_goes_on_with_a_key_frame() {
        let mut delivery = Delivery::default();
        delivery.take(frame(0, None));
        for number in 1..=MAX_READY as u64 {
            delivery.take(frame(number, Some(number - 1)));
        }
        assert!(delivery.is_key_frame_needed());
        assert_eq!(ready(&mut delivery), []);
        delivery.take(frame(9, Some(8)));
        assert_eq!(ready(&mut delivery), []);
        delivery.take(frame(10, None));
        assert!(!delivery.is_key_frame_needed());
        assert_eq!(ready(&mut delivery), [10]);
    }

    #[test]
    fn a_key_frame_passes_over_what_waits_for_the_decoder() {
        let mut delivery = Delivery::default();
        delivery.take(frame(0, None));
        delivery.take(frame(1, Some(0)));
        assert_eq!(delivery.take(frame(2, None)).stale, 2);
        assert_eq!(ready(&mut delivery), [2]);
    }

    proptest! {
        #[test]
        fn what_is_delivered_can_always_be_decoded(
            arrivals in prop::collection::vec((0u64..40, 0u64..4, 0u8..12), 0..200),
        ) {
            let mut delivery = Delivery::default();
            let mut decoder: Vec<u64> = Vec::new();
            for (number, back, kind) in arrivals {
                match kind {
                    0 => { delivery.lose(number); }
                    1 => { delivery.fail(number); }
                    2 => { delivery.expire(HeadsetTime::from_micros(number * 20_000)); }
                    _ => { delivery.take(frame(number, number.checked_sub(back).filter(|n| *n < number))); }
                }
                while let Some(frame) = delivery.next_ready() {
                    let number = frame.header.frame;
                    prop_assert!(decoder.last().is_none_or(|newest| *newest < number));
                    match frame.header.depends_on {
                        Some(other) => prop_assert!(decoder.contains(&other)),
                        None => decoder.clear(),
                    }
                    decoder.push(number);
                }
                prop_assert!(delivery.held.len() <= MAX_FRAMES_IN_FLIGHT);
            }
        }
    }
}
