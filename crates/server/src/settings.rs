//! What an operator may choose.

use render::Quality;
use session::{PairingCode, Prediction};
use std::net::SocketAddr;
use transport::TransportSettings;

/// What an operator may choose. [`Settings::new`] is right for a room.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Where to listen.
    pub listen: SocketAddr,
    /// For people.
    pub server_name: String,
    /// What a headset must know to see; `None` lets everyone see. An address may guess wrong five times, then once in half
    /// a minute.
    pub pairing_code: Option<PairingCode>,
    /// Most headsets at a time.
    pub max_headsets: usize,
    /// What a frame may cost on the topmost rung of the ladder.
    pub quality: Quality,
    /// Whether quality is lowered to hold the rate.
    pub adapt_quality: bool,
    /// Whether and how far poses are carried on to their display time.
    pub prediction: Prediction,
    /// Bits a pixel of the stream; a headset may ask for less.
    pub bits_per_pixel: f64,
    /// Threads that encode.
    pub encoder_threads: usize,
    /// Frames that the device may hold at a time: 2 keep it busy while one is read back, 1 takes the pose later.
    pub device_queue: usize,
    /// Bounds of connections.
    pub transport: TransportSettings,
}

impl Settings {
    /// Listens on `listen`; the number of threads follows the machine.
    #[must_use]
    pub fn new(listen: SocketAddr) -> Self {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        Self {
            listen,
            server_name: "holocast".to_owned(),
            pairing_code: None,
            max_headsets: 64,
            quality: Quality::BALANCED,
            adapt_quality: true,
            prediction: Prediction::default(),
            bits_per_pixel: 0.15,
            encoder_threads: (cores / 2).clamp(1, 32),
            device_queue: 1,
            transport: TransportSettings::default(),
        }
    }
}
