//! Frames under way: how many there may be, which are late, and what can still be decoded.

use super::ServerSettings;
use crate::time::ServerTime;
use std::collections::VecDeque;
use std::time::Duration;
use wire::{Feedback, MAX_FRAMES_IN_FLIGHT};

/// Longest round trip that is believed.
const LONGEST_ROUND_TRIP: Duration = Duration::from_secs(2);
/// Time in which the round trip that counts at most doubles.
const ROUND_TRIP_DOUBLES_IN: Duration = Duration::from_secs(10);
/// One frame arrives while the next is made.
const SMALLEST_WINDOW: usize = 2;
/// Frames that must be completed, with none late between them, before the window may grow again by one.
const COMPLETED_BEFORE_GROWTH: u64 = 60;
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
    /// Its stream was reset. It may have been through already: then feedback tells so later.
    Reset,
    /// Never sent.
    Dropped,
}

#[derive(Clone, Copy, Debug)]
struct Link {
    number: u64,
    depends_on: Option<u64>,
    state: State,
    /// The headset has it or will, and all that it hangs on.
    is_decodable: bool,
    sent_at: ServerTime,
    late_at: ServerTime,
    is_reset_told: bool,
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
    /// The headset's round trip without the queue that the frames themselves make.
    base_round_trip: Option<(ServerTime, Duration)>,
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
    /// What the window may not exceed since frames were late: halved then, and grown again with time.
    window_limit: usize,
    completed_since_limit: u64,
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
            base_round_trip: None,
            shortest_frame_round_trip: None,
            smoothed_frame_round_trip: None,
            newest_feedback: None,
            newest_sent: None,
            newest_encoded: None,
            is_chain_broken: false,
            is_key_frame_asked_for: false,
            is_recovering: false,
            window_limit: MAX_FRAMES_IN_FLIGHT,
            completed_since_limit: 0,
            stalled_since: None,
        }
    }

    pub(super) fn set_refresh_hz(&mut self, refresh_hz: f64) {
        self.refresh_hz = refresh_hz;
    }

    /// Takes the round trip that the headset has measured. Its pings wait in the same queues as the frames: on a full
    /// link they tell of the queue, and a window that followed them would make it longer still. So the round trip
    /// that counts falls at once and rises slowly.
    pub(super) fn learn_round_trip(&mut self, now: ServerTime, micros: u32) {
        let reported = Duration::from_micros(micros.into()).min(LONGEST_ROUND_TRIP);
        let base = self.base_round_trip.map_or(reported, |(at, base)| {
            let doublings = now.since(at).as_secs_f64() / ROUND_TRIP_DOUBLES_IN.as_secs_f64();
            // The millisecond lets a round trip of nothing grow too.
            let risen = (base.as_secs_f64() + 1e-3 * doublings) * doublings.min(8.0).exp2();
            reported.min(Duration::from_secs_f64(risen))
        });
        self.base_round_trip = Some((now, base));
    }

    pub(super) fn round_trip(&self) -> Option<Duration> {
        self.base_round_trip.map(|(_, base)| base).or(self.shortest_frame_round_trip)
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
        (in_a_round_trip + 2).clamp(SMALLEST_WINDOW, MAX_FRAMES_IN_FLIGHT).min(self.window_limit)
    }

    pub(super) fn in_flight(&self) -> usize {
        self.links.iter().filter(|link| link.state == State::UnderWay).count()
    }

    /// Frames that count against the window: from the oldest that is under way to the newest that was sent. A newer
    /// frame goes first on the network, so one that overtakes another must not make room for the next to do so too:
    /// the overtaken one would starve, and all hang on it.
    pub(super) fn in_window(&self) -> usize {
        let is_sent = |link: &&Link| matches!(link.state, State::UnderWay | State::Completed);
        self.links.iter().skip_while(|link| link.state != State::UnderWay).filter(is_sent).count()
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
                Some(link) => link.is_decodable,
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
        // A frame that waits behind the one it hangs on is not late before that one is.
        let late_at = self
            .links
            .iter()
            .find(|link| Some(link.number) == depends_on && link.state == State::UnderWay)
            .map_or(late_at, |link| link.late_at.max(late_at));
        let has_paused = self.links.back().is_none_or(|newest| now >= newest.sent_at + PAUSE);
        if self.stalled_since.is_none() || (has_paused && self.in_flight() == 0) {
            self.stalled_since = Some(now);
        }
        self.remember(Link {
            number,
            depends_on,
            state: State::UnderWay,
            is_decodable: true,
            sent_at: now,
            late_at,
            is_reset_told: false,
        });
        self.newest_sent = Some(number);
        self.newest_encoded = Some(number);
        self.is_chain_broken = false;
        if depends_on.is_none() {
            self.is_key_frame_asked_for = false;
        }
    }

    /// A frame was encoded and does not go out, so that nothing that hangs on it may.
    pub(super) fn dropped(&mut self, now: ServerTime, number: u64, depends_on: Option<u64>) {
        self.remember(Link {
            number,
            depends_on,
            state: State::Dropped,
            is_decodable: false,
            sent_at: now,
            late_at: now,
            is_reset_told: false,
        });
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
        let mut was_reset_in_vain = false;
        for link in &mut self.links {
            if !matches!(link.state, State::UnderWay | State::Reset) || !feedback.is_completed(link.number) {
                continue;
            }
            was_reset_in_vain |= link.state == State::Reset;
            link.state = State::Completed;
            completed += 1;
            let took = now.since(link.sent_at);
            self.shortest_frame_round_trip =
                Some(self.shortest_frame_round_trip.map_or(took, |shortest| shortest.min(took)));
            self.smoothed_frame_round_trip =
                Some(self.smoothed_frame_round_trip.map_or(took, |smoothed| (smoothed * 7 + took) / 8));
        }
        if was_reset_in_vain {
            self.follow_dependencies();
        }
        if completed > 0 {
            self.is_recovering = false;
            self.completed_since_limit += completed;
            if self.completed_since_limit >= COMPLETED_BEFORE_GROWTH {
                self.completed_since_limit = 0;
                self.window_limit = (self.window_limit + 1).min(MAX_FRAMES_IN_FLIGHT);
            }
            self.stalled_since = (self.in_flight() > 0).then_some(now);
        }
        if feedback.key_frame_needed && !self.is_help_under_way() {
            self.is_key_frame_asked_for = true;
        }
        FeedbackOutcome { ignored: false, completed }
    }

    /// Whether a frame is under way that the headset can go on with: a key frame, or one that hangs on what it has
    /// decoded.
    fn is_help_under_way(&self) -> bool {
        let decoded = self.newest_decoded();
        self.links.iter().any(|link| {
            let helps = link.depends_on.is_none_or(|number| decoded.is_some_and(|decoded| number <= decoded));
            link.state == State::UnderWay && helps
        })
    }

    /// Gives up every frame that is late, and all that hang on it. Returns those whose streams are to be reset.
    pub(super) fn reset_late(&mut self, now: ServerTime) -> Vec<u64> {
        let window = self.window();
        let mut is_any_late = false;
        for link in &mut self.links {
            if link.state == State::UnderWay && now >= link.late_at {
                link.state = State::Reset;
                link.is_decodable = false;
                is_any_late = true;
            }
        }
        if !is_any_late {
            return Vec::new();
        }
        if !self.is_recovering {
            self.window_limit = (window / 2).max(SMALLEST_WINDOW);
        }
        self.completed_since_limit = 0;
        self.is_recovering = true;
        self.follow_dependencies();
        let mut reset = Vec::new();
        for link in &mut self.links {
            if link.state == State::UnderWay && !link.is_decodable {
                link.state = State::Reset;
            }
            if link.state == State::Reset && !link.is_reset_told {
                link.is_reset_told = true;
                reset.push(link.number);
            }
        }
        reset
    }

    /// Finds anew what the headset can decode, once it has all that is under way.
    fn follow_dependencies(&mut self) {
        // Oldest first: what a frame hangs on comes before it.
        for i in 0..self.links.len() {
            let link = self.links[i];
            let hangs_on_nothing_bad = link.depends_on.is_none_or(|number| {
                self.links
                    .iter()
                    .take(i)
                    .find(|other| other.number == number)
                    .is_none_or(|other| other.is_decodable)
            });
            let arrives = matches!(link.state, State::UnderWay | State::Completed);
            self.links[i].is_decodable = arrives && hangs_on_nothing_bad;
        }
        self.is_chain_broken = self.links.back().is_some_and(|newest| !newest.is_decodable);
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
