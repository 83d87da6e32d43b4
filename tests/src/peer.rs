//! A peer that speaks QUIC and then whatever a test makes it say.

use crate::{TestServer, device, within};
use std::net::SocketAddr;
use transport::{Connection, Event, Fingerprint, TransportSettings};
use wire::{
    ClientDatagram, ClientMessage, CloseCode, ControlReader, Hello, PoseSample, ServerMessage, Welcome,
};

/// How a connection ended, as the peer saw it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ending {
    /// Code of the close, if the server gave one.
    pub code: Option<CloseCode>,
    /// Its reason.
    pub reason: String,
    /// Code and reason of the goodbye before it, if there was one.
    pub goodbye: Option<(CloseCode, String)>,
}

/// A connection without a session behind it.
#[derive(Debug)]
pub struct RawPeer {
    /// The connection.
    pub connection: Connection,
    control: ControlReader,
    next_pose: u64,
}

impl RawPeer {
    /// Connects, and says nothing.
    pub async fn connect(room: &TestServer) -> Self {
        Self::connect_to(room.address(), room.fingerprint()).await
    }

    /// Connects to a server by way of some address.
    pub async fn connect_to(address: SocketAddr, fingerprint: Fingerprint) -> Self {
        let streams = u32::try_from(wire::MAX_FRAMES_IN_FLIGHT).expect("a small number");
        let settings = TransportSettings::receiving(streams, wire::MAX_FRAME_BYTES);
        let address = address.to_string();
        let connection = transport::connect(&address, fingerprint, wire::ALPN, &settings);
        let connection = within("a connection", connection).await.unwrap_or_else(|e| panic!("{e}"));
        Self { connection, control: ControlReader::new(), next_pose: 0 }
    }

    /// A hello that is accepted where no pairing code is asked for.
    #[must_use]
    pub fn hello() -> Hello {
        Hello {
            version: wire::PROTOCOL_VERSION,
            pairing_code: String::new(),
            device: device("raw").to_wire(),
        }
    }

    /// Puts bytes on the control stream.
    pub fn say_bytes(&self, bytes: Vec<u8>) {
        self.connection.send_control(bytes).unwrap_or_else(|e| panic!("{e}"));
    }

    /// Puts a message on the control stream.
    pub fn say(&self, message: &ClientMessage) {
        self.say_bytes(message.encode().unwrap_or_else(|e| panic!("{e}")));
    }

    /// Says hello and waits for the welcome.
    pub async fn be_welcomed(&mut self) -> Welcome {
        self.say(&ClientMessage::Hello(Self::hello()));
        match self.message().await {
            ServerMessage::Welcome(welcome) => welcome,
            other => panic!("expected a welcome, found {other:?}"),
        }
    }

    /// The next message on the control stream. Frames and datagrams are let go by.
    async fn message(&mut self) -> ServerMessage {
        within("a message", async {
            loop {
                if let Some(message) = self.next_message() {
                    return message;
                }
                match self.connection.next_event().await {
                    Event::Control(bytes) => self.control.push(&bytes),
                    Event::Closed { code, reason, .. } => panic!("closed with {code:?}: {reason}"),
                    _ => {}
                }
            }
        })
        .await
    }

    fn next_message(&mut self) -> Option<ServerMessage> {
        let body = self.control.next_body().unwrap_or_else(|e| panic!("{e}"))?;
        Some(ServerMessage::decode(body).unwrap_or_else(|e| panic!("{e}")))
    }

    /// A pose in front of the volume, the next in order, taken at `sampled_at_us`.
    pub fn pose(&mut self, sampled_at_us: u64) -> PoseSample {
        let sequence = self.next_pose;
        self.next_pose += 1;
        Self::pose_of(sequence, sampled_at_us)
    }

    /// A pose in front of the volume.
    #[must_use]
    pub fn pose_of(sequence: u64, sampled_at_us: u64) -> PoseSample {
        let pose = crate::in_front();
        PoseSample {
            sequence,
            sampled_at_us,
            display_at_us: sampled_at_us + 50_000,
            world_from_head: wire::Pose {
                position_m: pose.position_m.as_vec3().to_array(),
                orientation_xyzw: pose.orientation.as_quat().to_array(),
            },
        }
    }

    /// Sends a pose.
    pub fn send_pose(&self, pose: PoseSample) {
        self.connection.send_datagram(ClientDatagram::Pose(pose).encode());
    }

    /// Waits for frames, so many.
    pub async fn frames(&mut self, count: usize) {
        let mut left = count;
        while left > 0 {
            match within("a frame", self.connection.next_event()).await {
                Event::Stream { .. } => left -= 1,
                Event::Closed { code, reason, .. } => panic!("closed with {code:?}: {reason}"),
                _ => {}
            }
        }
    }

    /// Reads on until the connection is closed.
    pub async fn ending(mut self) -> Ending {
        let mut goodbye = None;
        within("the connection's end", async {
            loop {
                while let Some(message) = self.next_message() {
                    if let ServerMessage::Goodbye(said) = message {
                        goodbye = Some((said.code, said.reason));
                    }
                }
                match self.connection.next_event().await {
                    Event::Control(bytes) => self.control.push(&bytes),
                    Event::Closed { code, reason, .. } => {
                        let code = code.and_then(CloseCode::from_value);
                        return Ending { code, reason, goodbye };
                    }
                    _ => {}
                }
            }
        })
        .await
    }
}

impl Ending {
    /// Panics unless the server closed with this code, and said so in a goodbye before, with a reason that holds
    /// `reason`.
    pub fn assert_is(&self, code: CloseCode, reason: &str) {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(self.reason.contains(reason), "expected '{reason}' in {self:?}");
        assert_eq!(self.goodbye, Some((code, self.reason.clone())), "a goodbye says what the close says");
    }
}
