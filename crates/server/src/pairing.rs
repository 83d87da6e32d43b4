//! How often pairing codes may be guessed.

use session::ServerTime;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::time::Duration;

/// Wrong codes that are heard from an address one after the other: a person mistypes.
const AT_ONCE: u32 = 5;
/// Then one is heard in so long. Half of all codes of four digits take 41 hours.
const ONE_IN: Duration = Duration::from_secs(30);
/// Addresses that are remembered. Beyond, the one that has waited longest is forgotten.
const MOST_ADDRESSES: usize = 1024;

/// Who has guessed wrong, and until when each wrong guess counts: [`ONE_IN`] after the one before it.
#[derive(Debug, Default)]
pub(crate) struct Guesses {
    count_until: HashMap<IpAddr, ServerTime>,
}

impl Guesses {
    /// For how long no code of this address is heard, also no right one: a guesser must not learn which it was. `None` if
    /// one is heard now.
    pub(crate) fn wait(&self, from: IpAddr, now: ServerTime) -> Option<Duration> {
        let counting = self.count_until.get(&guesser(from))?.since(now);
        let wait = (counting + ONE_IN).saturating_sub(ONE_IN * AT_ONCE);
        (wait > Duration::ZERO).then_some(wait)
    }

    /// A wrong code has come from this address.
    pub(crate) fn wrong(&mut self, from: IpAddr, now: ServerTime) {
        let from = guesser(from);
        if self.count_until.len() >= MOST_ADDRESSES && !self.count_until.contains_key(&from) {
            self.count_until.retain(|_, until| *until > now);
            let first = self.count_until.iter().min_by_key(|(_, until)| **until).map(|(from, _)| *from);
            if let Some(first) = first
                && self.count_until.len() >= MOST_ADDRESSES
            {
                self.count_until.remove(&first);
            }
        }
        let until = self.count_until.entry(from).or_insert(now);
        *until = (*until).max(now) + ONE_IN;
    }
}

/// Who is behind an address: in IPv6, whoever has one of a network of 64 bits has all of them.
fn guesser(from: IpAddr) -> IpAddr {
    match from.to_canonical() {
        IpAddr::V4(v4) => v4.into(),
        IpAddr::V6(v6) => Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(secs: u64) -> ServerTime {
        ServerTime::from_micros(secs * 1_000_000)
    }

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn five_wrong_codes_are_heard_at_once_and_then_one_in_half_a_minute() {
        let mut guesses = Guesses::default();
        let (guest, other) = (ip("192.0.2.7"), ip("192.0.2.8"));
        for _ in 0..5 {
            assert_eq!(guesses.wait(guest, at(100)), None);
            guesses.wrong(guest, at(100));
        }
        assert_eq!(guesses.wait(guest, at(100)), Some(Duration::from_secs(30)));
        assert_eq!(guesses.wait(guest, at(129)), Some(Duration::from_secs(1)));
        assert_eq!(guesses.wait(other, at(129)), None, "another address is not to blame");
        assert_eq!(guesses.wait(guest, at(130)), None);
        guesses.wrong(guest, at(130));
        assert_eq!(guesses.wait(guest, at(130)), Some(Duration::from_secs(30)));
        // Left alone, it is as good as new.
        assert_eq!(guesses.wait(guest, at(130 + 150)), None);
        for _ in 0..5 {
            assert_eq!(guesses.wait(guest, at(300)), None);
            guesses.wrong(guest, at(300));
        }
        assert!(guesses.wait(guest, at(300)).is_some());
    }

    #[test]
    fn a_day_of_guessing_tries_less_than_three_thousand_codes() {
        let mut guesses = Guesses::default();
        let guest = ip("192.0.2.7");
        let mut heard = 0;
        for second in 0..24 * 3600 {
            while guesses.wait(guest, at(second)).is_none() {
                guesses.wrong(guest, at(second));
                heard += 1;
            }
        }
        assert_eq!(heard, 5 + 24 * 3600 / 30 - 1);
    }

    #[test]
    fn a_network_of_64_bits_is_one_guesser_and_a_mapped_address_is_the_plain_one() {
        let mut guesses = Guesses::default();
        for i in 0..5 {
            guesses.wrong(ip(&format!("2001:db8:0:1::{i}")), at(1));
            guesses.wrong(ip("::ffff:192.0.2.7"), at(1));
        }
        assert!(guesses.wait(ip("2001:db8:0:1:ffff::9"), at(1)).is_some());
        assert!(guesses.wait(ip("2001:db8:0:2::1"), at(1)).is_none());
        assert!(guesses.wait(ip("192.0.2.7"), at(1)).is_some());
    }

    #[test]
    fn no_more_addresses_are_remembered_than_there_is_room_for_and_the_worst_stay() {
        let mut guesses = Guesses::default();
        let worst = ip("198.51.100.1");
        for _ in 0..5 {
            guesses.wrong(worst, at(1));
        }
        for i in 0..5000u32 {
            guesses.wrong(std::net::Ipv4Addr::from_bits(0x0a00_0000 + i).into(), at(2));
        }
        assert_eq!(guesses.count_until.len(), MOST_ADDRESSES);
        assert!(guesses.wait(worst, at(2)).is_some());
    }
}
