//! What an operator may choose about sessions.

use std::time::Duration;

/// What a session may do and for how long it waits. [`ServerSettings::default`] is right for a headset in the room.
#[derive(Clone, PartialEq)]
pub struct ServerSettings {
    /// Names the session in logs, reports and the welcome.
    pub session_id: u64,
    /// For people.
    pub server_name: String,
    /// What a headset must know to see; `None` lets everyone see.
    pub pairing_code: Option<String>,
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

/// Whether there is a pairing code, and not which: what is debugged ends in logs.
impl std::fmt::Debug for ServerSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // By name, all of them: a field that is added is not forgotten here.
        let Self {
            session_id,
            server_name,
            pairing_code,
            scene_revision,
            prediction,
            hello_timeout,
            idle_timeout,
            stall_timeout,
            late_margin,
            key_frame_patience,
            statistics_interval,
        } = self;
        f.debug_struct("ServerSettings")
            .field("session_id", session_id)
            .field("server_name", server_name)
            .field("pairing_code", &pairing_code.as_ref().map(|_| "secret"))
            .field("scene_revision", scene_revision)
            .field("prediction", prediction)
            .field("hello_timeout", hello_timeout)
            .field("idle_timeout", idle_timeout)
            .field("stall_timeout", stall_timeout)
            .field("late_margin", late_margin)
            .field("key_frame_patience", key_frame_patience)
            .field("statistics_interval", statistics_interval)
            .finish()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_debugged_tells_that_there_is_a_code_and_not_which() {
        let secret = ServerSettings { pairing_code: Some("482913".to_owned()), ..Default::default() };
        let text = format!("{secret:?}");
        assert!(!text.contains("482913") && text.contains(r#"pairing_code: Some("secret")"#), "{text}");
        assert!(format!("{:?}", ServerSettings::default()).contains("pairing_code: None"));
    }
}
