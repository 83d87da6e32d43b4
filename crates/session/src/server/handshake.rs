//! Hello and welcome.

use super::{Phase, ServerEvent, ServerSession, StreamTerms};
use crate::device::Device;
use crate::server::pacing::FrameBudget;
use crate::time::ServerTime;
use wire::{CloseCode, Hello, ServerMessage, Stream, Welcome};

impl ServerSession {
    /// Tells the headset what it will get. Frames may be begun from now on. Does nothing unless a
    /// [`ServerEvent::Connected`] waits for its answer.
    pub fn welcome(&mut self, now: ServerTime, terms: &StreamTerms) {
        let (Phase::AwaitingWelcome, Some(device)) = (self.phase, &self.device) else {
            return;
        };
        let refresh_hz = terms.refresh_hz.min(device.refresh_hz);
        self.phase = Phase::Streaming;
        self.budget = FrameBudget::new(now, refresh_hz.into());
        self.flow.set_refresh_hz(refresh_hz.into());
        self.statistics_at = Some(now + self.settings.statistics_interval);
        self.bitrate_bps = terms.bitrate_bps;
        self.last_heard_at = now;
        self.send(&ServerMessage::Welcome(Welcome {
            version: wire::PROTOCOL_VERSION,
            session_id: self.settings.session_id,
            stream: Stream {
                width_px: terms.width_px,
                height_px: terms.height_px,
                refresh_hz,
                bitrate_bps: terms.bitrate_bps,
                codec: terms.codec.clone(),
            },
            server_name: self.settings.server_name.clone(),
            scene_revision: self.scene_revision,
        }));
    }

    pub(super) fn handle_hello(&mut self, now: ServerTime, hello: &Hello) {
        // The version was compared before the rest was decoded.
        if let Some(expected) = &self.settings.pairing_code
            && !equal_in_constant_time(expected.as_str().as_bytes(), hello.pairing_code.as_bytes())
        {
            let reason = if hello.pairing_code.is_empty() {
                "no pairing code, expected the one that the server shows"
            } else {
                "wrong pairing code, expected the one that the server shows"
            };
            self.guessed_wrong = !hello.pairing_code.is_empty();
            return self.close(now, CloseCode::NotPaired, reason);
        }
        match Device::checked(&hello.device) {
            Ok(device) => {
                self.phase = Phase::AwaitingWelcome;
                self.device = Some(device.clone());
                self.events.push_back(ServerEvent::Connected { device });
            }
            Err(error) => self.close(now, CloseCode::BadDevice, &error.to_string()),
        }
    }
}

/// Compares without telling by its time how many bytes were right. The time does tell the length of `found`, which
/// its sender knows, and nothing else.
fn equal_in_constant_time(expected: &[u8], found: &[u8]) -> bool {
    let mut difference = u8::from(expected.len() != found.len());
    for (i, byte) in found.iter().enumerate() {
        difference |= byte ^ expected.get(i).copied().unwrap_or(!byte);
    }
    std::hint::black_box(difference) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_equal_codes_are_equal() {
        for (expected, found) in [("", ""), ("482913", "482913")] {
            assert!(equal_in_constant_time(expected.as_bytes(), found.as_bytes()));
        }
        for (expected, found) in
            [("482913", ""), ("482913", "48291"), ("48291", "482913"), ("482913", "482914")]
        {
            assert!(!equal_in_constant_time(expected.as_bytes(), found.as_bytes()));
        }
    }
}
