//! What an operator may choose about sessions.

use crate::pairing::PairingCode;
use std::time::Duration;

/// What a session may do and for how long it waits. [`ServerSettings::default`] is right for a headset in the room.
#[derive(Clone, Debug, PartialEq)]
pub struct ServerSettings {
    /// Names the session in logs, reports and the welcome.
    pub session_id: u64,
    /// For people.
    pub server_name: String,
    /// What a headset must know to see; `None` lets everyone see.
    pub pairing_code: Option<PairingCode>,
    /// The scene that the room shows when the session begins.
    pub scene_revision: u32,
    /// Where the eyes will be.
    pub prediction: Prediction,
    /// For how long a peer may be connected without saying hello.
    pub hello_timeout: Duration,
    /// For how long a peer may be silent.
    pub idle_timeout: Duration,
    /// For how long frames may be under way with none of them completed.
    pub stall_timeout: Duration,
    /// How long after its display time, or after it was sent if that is later, a frame may still be under way.
    pub late_margin: Duration,
    /// How much longer a key frame may be: another one in its place would be as large.
    pub key_frame_patience: Duration,
    /// Time between two statistics messages.
    pub statistics_interval: Duration,
}

/// Whether and how far a head's motion is carried on to the display time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    /// Off renders for the pose as it came.
    pub enabled: bool,
    /// Never farther ahead than this.
    pub horizon: Duration,
}

/// What the server will send, told in the welcome.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamTerms {
    /// Width of the coded picture in pixels: both eyes side by side.
    pub width_px: u32,
    /// Height of the coded picture in pixels.
    pub height_px: u32,
    /// Most frames a second; not more than the device shows.
    pub refresh_hz: f32,
    /// Bits a second that the encoder begins with.
    pub bitrate_bps: u32,
    /// RFC 6381 name of the codec, such as `avc1.42C020`.
    pub codec: String,
}

impl Default for Prediction {
    fn default() -> Self {
        Self { enabled: true, horizon: Duration::from_millis(100) }
    }
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            session_id: 0,
            server_name: "holocast".to_owned(),
            pairing_code: None,
            scene_revision: 0,
            prediction: Prediction::default(),
            hello_timeout: Duration::from_secs(5),
            idle_timeout: Duration::from_secs(5),
            stall_timeout: Duration::from_secs(5),
            late_margin: Duration::from_millis(100),
            key_frame_patience: Duration::from_millis(500),
            statistics_interval: Duration::from_secs(1),
        }
    }
}
