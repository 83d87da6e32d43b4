//! The control stream: who we are, what we show, how it goes, goodbye.

use crate::bytes::{What, append, decode_all};
use crate::limits::MAX_CONTROL_BYTES;
use crate::{CloseCode, DecodeError, EncodeError, EyeGeometry, Quality};
use bincode::{Decode, Encode};

/// Bytes of the length prefix of a control message.
const PREFIX_BYTES: usize = 4;

/// What a headset says on the control stream.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub enum ClientMessage {
    /// The first message, once.
    Hello(Hello),
    /// Asks for another scene in the room.
    ChangeScene {
        /// Chosen by the headset; comes back in the answer.
        request_id: u32,
        /// The whole scene as a JSON document.
        scene_json: String,
    },
    /// How the stream arrives, about once a second.
    Statistics(ClientStatistics),
    /// The last message, once.
    Goodbye(Goodbye),
}

/// What the server says on the control stream.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub enum ServerMessage {
    /// The answer to a hello that is accepted.
    Welcome(Welcome),
    /// The room shows another scene from now on.
    SceneChanged {
        /// The request that this answers, for the headset that asked; `None` for the others.
        request_id: Option<u32>,
        /// The scene's number; frames that show it carry it.
        revision: u32,
        /// The whole scene, where the server tells it.
        scene_json: Option<String>,
    },
    /// The scene asked for is not shown.
    SceneRefused {
        /// The request that this answers.
        request_id: u32,
        /// What was expected and what was found.
        reason: String,
    },
    /// How the stream leaves, about once a second.
    Statistics(ServerStatistics),
    /// The last message, once.
    Goodbye(Goodbye),
}

/// Who a headset is. `version` stays the first field in all versions, so that a server can name both.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Hello {
    /// [`crate::PROTOCOL_VERSION`] of the headset.
    pub version: u16,
    /// The code that the server shows to those who may see; empty where none is asked for.
    pub pairing_code: String,
    /// What the headset is.
    pub device: DeviceDescription,
}

/// What a headset is and what it can take.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct DeviceDescription {
    /// For people, at most 64 bytes.
    pub name: String,
    /// Width of one eye's picture in pixels, even.
    pub eye_width_px: u32,
    /// Height of one eye's picture in pixels, even.
    pub eye_height_px: u32,
    /// Pictures that the display shows a second.
    pub refresh_hz: f32,
    /// Left eye, right eye.
    pub eyes: [EyeGeometry; 2],
    /// Most bits a second that the headset wants.
    pub max_bitrate_bps: u32,
}

/// The answer to a hello that is accepted.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Welcome {
    /// [`crate::PROTOCOL_VERSION`] of the server.
    pub version: u16,
    /// Names this session in the server's log and reports.
    pub session_id: u64,
    /// The pictures to come.
    pub stream: Stream,
    /// For people.
    pub server_name: String,
    /// The scene that the room shows now.
    pub scene_revision: u32,
}

/// What the coded pictures of a session are.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Stream {
    /// Width of the coded picture in pixels: both eyes side by side, left eye on the left.
    pub width_px: u32,
    /// Height of the coded picture in pixels.
    pub height_px: u32,
    /// Most pictures a second.
    pub refresh_hz: f32,
    /// Bits a second that the server begins with.
    pub bitrate_bps: u32,
    /// RFC 6381 name of the codec, such as `avc1.42C020`.
    pub codec: String,
}

/// What a headset has counted since its welcome, and means over the time since its last statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct ClientStatistics {
    /// Frames that arrived whole.
    pub frames_received: u64,
    /// Frames that were decoded.
    pub frames_decoded: u64,
    /// Frames whose stream was reset, whose dependency was missing, or that did not decode.
    pub frames_lost: u64,
    /// Frames that arrived whole after a newer one had been given to the decoder.
    pub frames_stale: u64,
    /// Frames that were decoded after their display time.
    pub frames_late: u64,
    /// Mean time that decoding took, in milliseconds; 0 without any.
    pub decode_ms_mean: f32,
    /// Mean time from a pose to the end of decoding the frame made for it, in milliseconds; 0 without any.
    pub pose_to_decoded_ms_mean: f32,
    /// The longest of those, in milliseconds.
    pub pose_to_decoded_ms_max: f32,
    /// Mean time from a pose to the light of its frame, in milliseconds; 0 where the headset does not report it.
    pub motion_to_photon_ms_mean: f32,
    /// Filtered round trip of a ping, in milliseconds; 0 before the first.
    pub round_trip_ms: f32,
}

/// What the server has counted since the welcome, and what it sends now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct ServerStatistics {
    /// Frames that were rendered.
    pub frames_rendered: u64,
    /// Frames that were given to the network.
    pub frames_sent: u64,
    /// Frames whose stream was reset because they were late, or hung on one that was.
    pub frames_reset: u64,
    /// Frames that were due and not begun, because the network or the renderer was full.
    pub frames_skipped: u64,
    /// What the renderer spends now.
    pub quality: Quality,
    /// Bits a second that the encoder aims at now.
    pub bitrate_bps: u32,
}

/// The last message of a peer.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Goodbye {
    /// Why, for programs.
    pub code: CloseCode,
    /// Why, for people.
    pub reason: String,
}

impl ClientMessage {
    /// The bytes to append to the control stream: length and body.
    ///
    /// # Errors
    /// If the body is larger than [`MAX_CONTROL_BYTES`].
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        prefixed(self)
    }

    /// The message of which `body` are all the bytes, without the length.
    ///
    /// # Errors
    /// If the bytes are too many, too few, or no message.
    pub fn decode(body: &[u8]) -> Result<Self, DecodeError> {
        decode_all::<MAX_CONTROL_BYTES, _>(What::ControlMessage, body)
    }
}

impl ServerMessage {
    /// The bytes to append to the control stream: length and body.
    ///
    /// # Errors
    /// If the body is larger than [`MAX_CONTROL_BYTES`].
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        prefixed(self)
    }

    /// The message of which `body` are all the bytes, without the length.
    ///
    /// # Errors
    /// If the bytes are too many, too few, or no message.
    pub fn decode(body: &[u8]) -> Result<Self, DecodeError> {
        decode_all::<MAX_CONTROL_BYTES, _>(What::ControlMessage, body)
    }
}

/// The version in the body of a [`ClientMessage::Hello`] of any version of this protocol; `None` if it is no hello.
/// The rest of a hello may change between versions, its beginning does not.
#[must_use]
pub fn hello_version(body: &[u8]) -> Option<u16> {
    let (discriminant, rest) = body.split_first_chunk::<4>()?;
    let (version, _) = rest.split_first_chunk::<2>()?;
    (u32::from_le_bytes(*discriminant) == 0).then(|| u16::from_le_bytes(*version))
}

fn prefixed(message: &impl Encode) -> Result<Vec<u8>, EncodeError> {
    let mut out = vec![0; PREFIX_BYTES];
    let body = append::<MAX_CONTROL_BYTES>(What::ControlMessage, message, &mut out)?;
    let body = u32::try_from(body).expect("the limit of a control message fits 32 bits");
    out[..PREFIX_BYTES].copy_from_slice(&body.to_le_bytes());
    Ok(out)
}

/// Cuts the control stream into message bodies. It takes the stream in pieces of any size and holds at most one
/// message and the piece that was pushed last.
#[derive(Debug, Default)]
pub struct ControlReader {
    bytes: Vec<u8>,
    /// How much of `bytes` has been given out.
    used: usize,
}

impl ControlReader {
    /// A reader at the beginning of a stream.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the stream's next bytes. Call [`Self::next_body`] until it has no more before pushing again.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.used);
        self.used = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole body, without its length; `None` until more bytes come.
    ///
    /// # Errors
    /// If a message announces more than [`MAX_CONTROL_BYTES`]. The stream cannot be read further.
    pub fn next_body(&mut self) -> Result<Option<&[u8]>, DecodeError> {
        let Some((prefix, rest)) = self.bytes[self.used..].split_first_chunk::<PREFIX_BYTES>() else {
            return Ok(None);
        };
        let length = u32::from_le_bytes(*prefix) as usize;
        if length > MAX_CONTROL_BYTES {
            return Err(DecodeError::TooLarge {
                what: What::ControlMessage,
                bytes: length,
                max: MAX_CONTROL_BYTES,
            });
        }
        let Some(body) = rest.get(..length) else {
            return Ok(None);
        };
        self.used += PREFIX_BYTES + length;
        Ok(Some(body))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goodbye(reason: &str) -> ClientMessage {
        ClientMessage::Goodbye(Goodbye { code: CloseCode::Goodbye, reason: reason.to_owned() })
    }

    #[test]
    fn a_stream_cut_anywhere_gives_the_same_messages() {
        let messages = [goodbye("one"), goodbye(""), goodbye("three")];
        let stream: Vec<u8> = messages.iter().flat_map(|m| m.encode().unwrap()).collect();
        for piece in 1..stream.len() {
            let mut reader = ControlReader::new();
            let mut read = Vec::new();
            for bytes in stream.chunks(piece) {
                reader.push(bytes);
                while let Some(body) = reader.next_body().unwrap() {
                    read.push(ClientMessage::decode(body).unwrap());
                }
            }
            assert_eq!(read, messages, "in pieces of {piece} bytes");
        }
    }

    #[test]
    fn a_message_that_announces_too_much_is_refused_before_it_comes() {
        let mut reader = ControlReader::new();
        reader.push(&u32::to_le_bytes(MAX_CONTROL_BYTES as u32 + 1));
        assert_eq!(
            reader.next_body().unwrap_err().to_string(),
            "control message has 262145 bytes, expected at most 262144"
        );
    }

    #[test]
    fn a_message_beyond_the_limit_is_not_encoded() {
        let error = goodbye(&"x".repeat(MAX_CONTROL_BYTES)).encode().unwrap_err();
        assert!(matches!(error, EncodeError::TooLarge { what: What::ControlMessage, .. }), "{error}");
        goodbye(&"x".repeat(MAX_CONTROL_BYTES - 16)).encode().unwrap();
    }

    #[test]
    fn a_text_that_announces_more_than_the_limit_is_refused_without_allocating_it() {
        let mut bytes = goodbye("").encode().unwrap().split_off(4);
        let length_at = bytes.len() - 8;
        bytes[length_at..].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(
            ClientMessage::decode(&bytes),
            Err(DecodeError::BeyondLimit { what: What::ControlMessage, max: MAX_CONTROL_BYTES })
        );
    }

    #[test]
    fn the_version_of_an_unreadable_hello_is_still_found() {
        let mut body = 0u32.to_le_bytes().to_vec();
        body.extend(9u16.to_le_bytes());
        body.extend([0xff; 7]);
        assert!(ClientMessage::decode(&body).is_err());
        assert_eq!(hello_version(&body), Some(9));
        assert_eq!(hello_version(&[3, 0, 0, 0, 9, 0]), None);
        assert_eq!(hello_version(&[0, 0, 0, 0, 9]), None);
    }

    #[test]
    fn what_is_wrong_with_a_message_is_said() {
        let check = |bytes: &[u8], expected: &str| {
            assert_eq!(ClientMessage::decode(bytes).unwrap_err().to_string(), expected);
        };
        check(&[], "control message ends after 0 bytes, expected at least 4 more");
        check(&[9, 0, 0, 0], "control message: 9 is no variant of ClientMessage");
        let mut bytes = goodbye("a").encode().unwrap().split_off(4);
        bytes.push(0);
        check(&bytes, "control message is complete after 17 bytes, found 18");
        bytes.pop();
        *bytes.last_mut().unwrap() = 0xff;
        check(&bytes, "control message: a text is not UTF-8 after its first 0 bytes");
    }
}
