//! One direction of a network path.

use crate::Random;
use std::collections::BinaryHeap;
use std::ops::Range;

/// What a link does to packets. [`LinkSettings::default`] is a perfect one: no delay, no loss, no limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkSettings {
    /// Time that every packet takes, in microseconds.
    pub delay_us: u64,
    /// Further time, evenly spread from 0 to this, in microseconds.
    pub jitter_us: u64,
    /// Whether jitter keeps packets in order: a queue's jitter does, a radio's does not.
    pub keeps_order: bool,
    /// Probability that a packet vanishes.
    pub loss: f64,
    /// Probability that a packet comes twice, each with its own jitter.
    pub duplication: f64,
    /// Probability that a packet is held back by [`Self::reordering_us`], whatever [`Self::keeps_order`] says.
    pub reordering: f64,
    /// How long such a packet is held back, in microseconds.
    pub reordering_us: u64,
    /// Bits a second that pass; `None` for no limit.
    pub bandwidth_bps: Option<u64>,
    /// Bytes that may wait for the bandwidth; what does not fit is dropped at the tail. Without meaning if there is no
    /// limit.
    pub queue_bytes: u64,
    /// Times during which nothing that is sent arrives, in microseconds.
    pub blackouts_us: Vec<Range<u64>>,
}

/// What became of a packet. A sender in the real world does not know; a model of retransmission may.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrives (first) at this time, in microseconds.
    Arrives {
        /// Virtual time in microseconds.
        at_us: u64,
    },
    /// The queue before the bandwidth limit was full.
    DroppedByQueue,
    /// It vanished on the way.
    Lost,
    /// It was sent during a blackout.
    BlackedOut,
}

/// What a link has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Packets that were sent into it.
    pub sent: u64,
    /// Packets that came out, duplicates included.
    pub delivered: u64,
    /// Packets that found the queue full.
    pub dropped_by_queue: u64,
    /// Packets that vanished.
    pub lost: u64,
    /// Packets that were sent during a blackout.
    pub blacked_out: u64,
    /// Packets that came twice.
    pub duplicated: u64,
}

/// A packet on its way, ordered so that the heap gives the earliest first, and of two at one time the one sent first.
#[derive(Debug)]
struct OnTheWay<T> {
    at_us: u64,
    order: u64,
    payload: T,
}

/// One direction of a network path with virtual time. All times are microseconds of one clock that the caller keeps
/// and never sets back. The same seed, settings and calls give the same packets at the same times.
#[derive(Debug)]
pub struct Link<T> {
    settings: LinkSettings,
    random: Random,
    on_the_way: BinaryHeap<OnTheWay<T>>,
    next_order: u64,
    /// When the bandwidth limit will have let through all that it took.
    busy_until_us: u64,
    /// Earliest arrival that keeps the order.
    in_order_us: u64,
    counters: LinkCounters,
}

impl<T: Clone> Link<T> {
    /// An empty link.
    #[must_use]
    pub fn new(settings: LinkSettings, seed: u64) -> Self {
        Self {
            settings,
            random: Random::new(seed),
            on_the_way: BinaryHeap::new(),
            next_order: 0,
            busy_until_us: 0,
            in_order_us: 0,
            counters: LinkCounters::default(),
        }
    }

    /// Changes what the link does to packets that are sent from now on.
    pub fn set(&mut self, settings: LinkSettings) {
        self.settings = settings;
    }

    /// What the link does to packets.
    #[must_use]
    pub fn settings(&self) -> &LinkSettings {
        &self.settings
    }

    /// What the link has done.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Sends a packet of `bytes` bytes.
    pub fn send(&mut self, now_us: u64, payload: T, bytes: u64) -> Fate {
        self.counters.sent += 1;
        if self.settings.blackouts_us.iter().any(|blackout| blackout.contains(&now_us)) {
            self.counters.blacked_out += 1;
            return Fate::BlackedOut;
        }
        let mut leaves_us = now_us;
        if let Some(bandwidth_bps) = self.settings.bandwidth_bps {
            if self.queued_bytes(now_us) + bytes > self.settings.queue_bytes.max(bytes) {
                self.counters.dropped_by_queue += 1;
                return Fate::DroppedByQueue;
            }
            leaves_us = self.busy_until_us.max(now_us) + (bytes * 8_000_000).div_ceil(bandwidth_bps.max(1));
            self.busy_until_us = leaves_us;
        }
        // Every packet draws the same numbers, so that a change of one setting does not shuffle the others' luck.
        let (is_lost, is_duplicated) =
            (self.random.chance(self.settings.loss), self.random.chance(self.settings.duplication));
        let at_us = self.arrival(leaves_us);
        let again_us = self.arrival(leaves_us);
        if is_lost {
            self.counters.lost += 1;
            return Fate::Lost;
        }
        if is_duplicated {
            self.counters.duplicated += 1;
            self.put(again_us, payload.clone());
        }
        self.put(at_us, payload);
        Fate::Arrives { at_us: if is_duplicated { at_us.min(again_us) } else { at_us } }
    }

    /// The next packet that has arrived by `now_us`.
    pub fn receive(&mut self, now_us: u64) -> Option<T> {
        if self.next_arrival()? > now_us {
            return None;
        }
        self.counters.delivered += 1;
        self.on_the_way.pop().map(|packet| packet.payload)
    }

    /// When the next packet arrives; `None` if none is on the way.
    #[must_use]
    pub fn next_arrival(&self) -> Option<u64> {
        self.on_the_way.peek().map(|packet| packet.at_us)
    }

    /// Bytes that wait for the bandwidth at `now_us`; 0 if there is no limit.
    #[must_use]
    pub fn queued_bytes(&self, now_us: u64) -> u64 {
        let waiting_us = self.busy_until_us.saturating_sub(now_us);
        self.settings.bandwidth_bps.map_or(0, |bps| {
            u64::try_from(u128::from(waiting_us) * u128::from(bps) / 8_000_000).unwrap_or(u64::MAX)
        })
    }

    fn arrival(&mut self, leaves_us: u64) -> u64 {
        let settings = &self.settings;
        let jitter_us = self.random.below(settings.jitter_us.saturating_add(1));
        let is_held_back = self.random.chance(settings.reordering);
        let mut at_us = leaves_us + settings.delay_us + jitter_us;
        if settings.keeps_order {
            at_us = at_us.max(self.in_order_us);
            self.in_order_us = at_us;
        }
        if is_held_back { at_us + settings.reordering_us } else { at_us }
    }

    fn put(&mut self, at_us: u64, payload: T) {
        let order = self.next_order;
        self.next_order += 1;
        self.on_the_way.push(OnTheWay { at_us, order, payload });
    }
}

impl<T> PartialEq for OnTheWay<T> {
    fn eq(&self, other: &Self) -> bool {
        self.order == other.order
    }
}

impl<T> Eq for OnTheWay<T> {}

impl<T> PartialOrd for OnTheWay<T> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for OnTheWay<T> {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (other.at_us, other.order).cmp(&(self.at_us, self.order))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sends `count` packets of 1000 bytes, one every millisecond, and returns (arrival, number) of what comes out.
    fn through(settings: LinkSettings, count: u64) -> (Vec<(u64, u64)>, LinkCounters) {
        let mut link = Link::new(settings, 42);
        for i in 0..count {
            link.send(i * 1000, i, 1000);
        }
        let mut out = Vec::new();
        while let Some(at_us) = link.next_arrival() {
            assert_eq!(
                at_us.checked_sub(1).and_then(|early| link.receive(early)),
                None,
                "nothing comes early"
            );
            out.push((at_us, link.receive(at_us).unwrap()));
        }
        (out, link.counters())
    }

    #[test]
    fn a_perfect_link_delivers_at_once_and_in_order() {
        let (out, counters) = through(LinkSettings::default(), 100);
        assert_eq!(out, (0..100).map(|i| (i * 1000, i)).collect::<Vec<_>>());
        assert_eq!((counters.sent, counters.delivered), (100, 100));
    }

    #[test]
    fn jitter_stays_in_its_bounds_and_reorders_unless_told_not_to() {
        let settings = LinkSettings { delay_us: 5_000, jitter_us: 4_000, ..LinkSettings::default() };
        let (out, _) = through(settings.clone(), 1000);
        assert!(out.iter().all(|(at, i)| (5_000..=9_000).contains(&(at - i * 1000))));
        assert!(out.windows(2).any(|pair| pair[0].1 > pair[1].1));
        let (out, _) = through(LinkSettings { keeps_order: true, ..settings }, 1000);
        assert!(out.windows(2).all(|pair| pair[0].1 < pair[1].1));
        assert!(out.iter().all(|(at, i)| (5_000..=9_000).contains(&(at - i * 1000))));
    }

    #[test]
    fn loss_and_duplication_are_as_probable_as_asked() {
        let (out, counters) =
            through(LinkSettings { loss: 0.05, duplication: 0.02, ..LinkSettings::default() }, 20_000);
        assert!((900..1100).contains(&counters.lost), "{counters:?}");
        assert!((330..470).contains(&counters.duplicated), "{counters:?}");
        assert_eq!(out.len() as u64, 20_000 - counters.lost + counters.duplicated);
    }

    #[test]
    fn reordering_holds_packets_back() {
        let settings = LinkSettings { reordering: 0.1, reordering_us: 2_500, ..LinkSettings::default() };
        let (out, _) = through(settings, 1000);
        let held = out.iter().filter(|(at, i)| at - i * 1000 == 2_500).count();
        assert!((70..130).contains(&held), "{held}");
        assert!(out.windows(2).any(|pair| pair[0].1 > pair[1].1));
    }

    #[test]
    fn bandwidth_spaces_packets_and_the_queue_drops_what_does_not_fit() {
        // 1000 bytes every millisecond are 8 Mbit/s; the link carries half of that.
        let settings = LinkSettings {
            bandwidth_bps: Some(4_000_000),
            queue_bytes: 10_000,
            delay_us: 1_000,
            ..LinkSettings::default()
        };
        let (out, counters) = through(settings, 1000);
        assert!(out.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 2_000));
        assert!((480..=520).contains(&counters.dropped_by_queue), "{counters:?}");
        let worst = out.iter().map(|(at, i)| at - i * 1000).max().unwrap();
        assert!(worst <= 1_000 + 20_000, "{worst} µs: delay and ten packets of 2 ms");
    }

    #[test]
    fn a_packet_larger_than_the_queue_passes_an_idle_link() {
        let settings =
            LinkSettings { bandwidth_bps: Some(8_000_000), queue_bytes: 100, ..LinkSettings::default() };
        let mut link = Link::new(settings, 1);
        assert_eq!(link.send(0, (), 1000), Fate::Arrives { at_us: 1000 });
        assert_eq!(link.queued_bytes(0), 1000);
        assert_eq!(link.send(0, (), 1000), Fate::DroppedByQueue);
    }

    #[test]
    fn nothing_sent_in_a_blackout_arrives() {
        let settings = LinkSettings {
            delay_us: 500,
            blackouts_us: vec![100_000..200_000, 300_000..301_000],
            ..LinkSettings::default()
        };
        let (out, counters) = through(settings, 1000);
        assert_eq!(counters.blacked_out, 101);
        assert!(out.iter().all(|(_, i)| !(100..200).contains(i) && *i != 300));
    }

    proptest! {
        #[test]
        fn the_same_seed_gives_the_same_packets(
            seed in any::<u64>(),
            loss in 0.0..0.5f64, duplication in 0.0..0.5f64, reordering in 0.0..0.5f64, jitter_us in 0u64..10_000,
        ) {
            let settings = LinkSettings {
                delay_us: 1_000, jitter_us, loss, duplication, reordering, reordering_us: 3_000,
                bandwidth_bps: Some(10_000_000), queue_bytes: 20_000, ..LinkSettings::default()
            };
            let run = || {
                let mut link = Link::new(settings.clone(), seed);
                let fates: Vec<_> = (0..200u64).map(|i| link.send(i * 500, i, 1 + i % 1500)).collect();
                let mut out = Vec::new();
                while let Some(at) = link.next_arrival() {
                    out.push((at, link.receive(at)));
                }
                (fates, out)
            };
            prop_assert_eq!(run(), run());
        }

        #[test]
        fn every_packet_has_one_fate(seed in any::<u64>(), loss in 0.0..1.0f64, duplication in 0.0..1.0f64) {
            let mut link = Link::new(LinkSettings { loss, duplication, ..LinkSettings::default() }, seed);
            for i in 0..300 {
                link.send(i, i, 1);
            }
            while link.receive(u64::MAX).is_some() {}
            let counters = link.counters();
            prop_assert_eq!(counters.delivered, counters.sent - counters.lost + counters.duplicated);
        }
    }
}
