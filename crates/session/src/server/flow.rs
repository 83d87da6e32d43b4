//! Frames under way: how many there may be, which are late, and what can still be decoded.

use super::ServerSettings;
use crate::time::ServerTime;
use std::collections::VecDeque;
use std::time::Duration;
use wire::{Feedback, MAX_FRAMES_IN_FLIGHT};

/// Longest round trip that is believed.
const LONGEST_ROUND_TRIP: Duration = Duration::from_secs(2);
/// A peer that was sent nothing for this long has not been stalling meanwhile.
const PAUSE: Duration = Duration::from_secs(1);
/// Frames whose fate is remembered after it is known, so that what hangs on them is known too.
const MAX_REMEMBERED: usize = 128;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Given to the network; the headset has not said that it has it.
    UnderWay,
    /// The headset has it.
    Completed,
    /// Never sent, or reset, or hanging on one that was: the headset cannot decode it.
    Undecodable,
}

#[derive(Clone, Copy, Debug)]
struct Link {
    number: u64,
    depends_on: Option<u64>,
    state: State,
    sent_at: ServerTime,
    late_at: ServerTime,
}

/// What is known of the frames given to the encoder, oldest first.
///
/// The client's feedback moves the window; its time is up to the settings. After a reset only one frame, the key
/// frame, is let through until one is completed: on a link that has just proved too slow, nothing competes with the
/// frame on which all others hang.
#[derive(Debug)]
pub(super) struct Flow {
    late_margin: Duration,
    key_frame_patience: Duration,
    refresh_hz: f64,
    links: VecDeque<Link>,
    reported_round_trip: Option<Duration>,
    shortest_frame_round_trip: Option<Duration>,
    smoothed_frame_round_trip: Option<Duration>,
    newest_feedback: Option<Feedback>,
    newest_sent: Option<u64>,
    newest_encoded: Option<u64>,
    /// The newest frame that was given to the encoder cannot be decoded by the headset.
    is_chain_broken: bool,
    /// The headset has asked for a key frame and none is on its way.
    is_key_frame_asked_for: bool,
    is_recovering: bool,
    stalled_since: Option<ServerTime>,
}

/// What feedback changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FeedbackOutcome {
    pub(super) ignored: bool,
    pub(super) completed: u64,
}

impl Flow {
    pub(super) fn new(settings: &ServerSettings) -> Self {
        Self {
            late_margin: settings.late_margin,
            key_frame_patience: settings.key_frame_patience,
            refresh_hz: 60.0,
            links: VecDeque::new(),
            reported_round_trip: None,
            shortest_frame_round_trip: None,
            smoothed_frame_round_trip: None,
            newest_feedback: None,
            newest_sent: None,
            newest_encoded: None,
            is_chain_broken: false,
            is_key_frame_asked_for: false,
            is_recovering: false,
            stalled_since: None,
        }
    }

    pub(super) fn set_refresh_hz(&mut self, refresh_hz: f64) {
        self.refresh_hz = refresh_hz;
    }

    pub(super) fn learn_round_trip(&mut self, micros: u32) {
        self.reported_round_trip = Some(Duration::from_micros(micros.into()).min(LONGEST_ROUND_TRIP));
    }

    pub(super) fn round_trip(&self) -> Option<Duration> {
        self.reported_round_trip.or(self.shortest_frame_round_trip)
    }

    pub(super) fn frame_round_trip(&self) -> Option<Duration> {
        self.smoothed_frame_round_trip
    }

    /// Frames that may be made or under way at a time.
    pub(super) fn window(&self) -> usize {
        if self.is_recovering {
            return 1;
        }
        let round_trip = self.round_trip().unwrap_or_default().as_secs_f64();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2 s × 240 Hz")]
        let in_a_round_trip = (round_trip * self.refresh_hz).ceil() as usize;
        (in_a_round_trip + 2).clamp(2, MAX_FRAMES_IN_FLIGHT)
    }

    pub(super) fn in_flight(&self) -> usize {
        self.links.iter().filter(|link| link.state == State::UnderWay).count()
    }

    /// Since when frames have been under way with none completed; `None` if none is under way now.
    pub(super) fn stalled_since(&self) -> Option<ServerTime> {
        self.stalled_since.filter(|_| self.in_flight() > 0)
    }

    pub(super) fn newest_decoded(&self) -> Option<u64> {
        self.newest_feedback.and_then(|feedback| feedback.newest_decoded)
    }

    pub(super) fn newest_encoded(&self) -> Option<u64> {
        self.newest_encoded
    }

    pub(super) fn must_be_key_frame(&self) -> bool {
        self.newest_encoded.is_none() || self.is_chain_broken || self.is_key_frame_asked_for
    }

    /// Whether the headset can decode a frame that depends on `depends_on`, once it has all that was sent.
    pub(super) fn is_decodable(&self, depends_on: Option<u64>) -> bool {
        match depends_on {
            None => true,
            Some(_) if self.is_key_frame_asked_for => false,
            Some(number) => match self.links.iter().find(|link| link.number == number) {
                Some(link) => link.state != State::Undecodable,
                // Forgotten long ago: good only if the headset has said that it has gone beyond it.
                None => self.newest_decoded().is_some_and(|decoded| number <= decoded),
            },
        }
    }

    /// A frame was encoded and goes out.
    pub(super) fn sent(
        &mut self,
        now: ServerTime,
        number: u64,
        depends_on: Option<u64>,
        display_at: ServerTime,
    ) {
        let patience = if depends_on.is_none() { self.key_frame_patience } else { Duration::ZERO };
        let round_trip = self.round_trip().unwrap_or_default();
        let late_at = display_at.max(now) + self.late_margin + patience + round_trip;
        let has_paused = self.links.back().is_none_or(|newest| now >= newest.sent_at + PAUSE);
        if self.stalled_since.is_none() || (has_paused && self.in_flight() == 0) {
            self.stalled_since = Some(now);
        }
        self.remember(Link { number, depends_on, state: State::UnderWay, sent_at: now, late_at });
        self.newest_sent = Some(number);
        self.newest_encoded = Some(number);
        self.is_chain_broken = false;
        if depends_on.is_none() {
            self.is_key_frame_asked_for = false;
        }
    }

    /// A frame was encoded and does not go out, so that nothing that hangs on it may.
    pub(super) fn dropped(&mut self, now: ServerTime, number: u64, depends_on: Option<u64>) {
        let state = State::Undecodable;
        self.remember(Link { number, depends_on, state, sent_at: now, late_at: now });
        self.newest_encoded = Some(number);
        self.is_chain_broken = true;
    }

    fn remember(&mut self, link: Link) {
        while self.links.len() >= MAX_REMEMBERED
            && self.links.front().is_some_and(|oldest| oldest.state != State::UnderWay)
        {
            self.links.pop_front();
        }
        self.links.push_back(link);
    }

    pub(super) fn take_feedback(&mut self, now: ServerTime, feedback: &Feedback) -> FeedbackOutcome {
        let is_old = self.newest_feedback.is_some_and(|newest| feedback.sequence <= newest.sequence);
        // A frame that was never sent cannot have arrived.
        let is_false = [feedback.newest_completed, feedback.newest_decoded]
            .into_iter()
            .flatten()
            .any(|frame| self.newest_sent.is_none_or(|sent| frame > sent));
        if is_old || is_false {
            return FeedbackOutcome { ignored: true, completed: 0 };
        }
        self.newest_feedback = Some(*feedback);
        let mut completed = 0;
        for link in &mut self.links {
            if !feedback.is_completed(link.number) {
                continue;
            }
            if link.state == State::UnderWay {
                link.state = State::Completed;
                completed += 1;
                let took = now.since(link.sent_at);
                self.shortest_frame_round_trip =
                    Some(self.shortest_frame_round_trip.map_or(took, |shortest| shortest.min(took)));
                self.smoothed_frame_round_trip =
                    Some(self.smoothed_frame_round_trip.map_or(took, |smoothed| (smoothed * 7 + took) / 8));
                self.is_recovering = false;
            }
        }
        if completed > 0 {
            self.stalled_since = (self.in_flight() > 0).then_some(now);
        }
        if feedback.key_frame_needed && !self.is_key_frame_under_way() {
            self.is_key_frame_asked_for = true;
        }
        FeedbackOutcome { ignored: false, completed }
    }

    fn is_key_frame_under_way(&self) -> bool {
        self.links.iter().any(|link| link.state == State::UnderWay && link.depends_on.is_none())
    }

    /// Gives up every frame that is late, and all that hang on it. Returns those whose streams are to be reset.
    pub(super) fn reset_late(&mut self, now: ServerTime) -> Vec<u64> {
        let mut reset = Vec::new();
        let mut undecodable: Vec<u64> = self
            .links
            .iter()
            .filter(|link| link.state == State::Undecodable)
            .map(|link| link.number)
            .collect();
        // Oldest first, so that one pass reaches everything that hangs on a late frame.
        for link in &mut self.links {
            if link.state == State::Undecodable {
                continue;
            }
            let is_late = link.state == State::UnderWay && now >= link.late_at;
            let is_hanging = link.depends_on.is_some_and(|number| undecodable.contains(&number));
            if is_late || is_hanging {
                if link.state == State::UnderWay {
                    reset.push(link.number);
                }
                link.state = State::Undecodable;
                undecodable.push(link.number);
            }
        }
        if !reset.is_empty() {
            self.is_recovering = true;
            self.is_chain_broken = self.newest_encoded.is_some_and(|newest| undecodable.contains(&newest));
        }
        reset
    }

    /// When the next frame will be late, if it is not completed before.
    pub(super) fn next_late(&self) -> Option<ServerTime> {
        self.links.iter().filter(|link| link.state == State::UnderWay).map(|link| link.late_at).min()
    }

    pub(super) fn forget_all(&mut self) {
        self.links.clear();
        self.stalled_since = None;
    }
}
