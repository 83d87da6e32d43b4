//! The server: one room, the headsets that share it, and the threads that serve them.
//!
//! A pose comes in on a connection's task and waits in its session, where a newer one replaces it. The thread `render`
//! asks all sessions for wishes, lets the [`Scheduler`] choose, and only then takes the newest pose. While the device
//! casts, a pool of threads `encode-N` turns finished frames into access units, straight from the device's read-back;
//! the connection's task sends them.
//!
//! What is bounded, and what is dropped: a session has one wish and at most two frames being made; the read-back ring
//! has a slot for each frame on the device and in the encoders' hands; frames under way to a headset are bounded by its
//! acknowledgements. What is dropped is always the stale.
//!
//! A series in time is played by the thread `play`: it brings the next step to the device while the present one is drawn.
//!
//! This crate holds no algorithm of its own but the choice of whose frame is next, how much it may cost, and which step of
//! a series is shown when; all three are pure.

mod clock;
mod connection;
mod encoding;
mod pairing;
mod playback;
mod playing;
mod quality;
mod render_loop;
mod room;
mod scheduler;
mod seat;
mod series;
mod server;
mod settings;

pub use playback::Playback;
pub use quality::{LADDER, LADDER_WITHOUT_STEPS, QualityController, Rung};
pub use room::{SceneChangeError, Volumes};
pub use scheduler::{Scheduler, Wish};
pub use seat::SeatSnapshot;
pub use series::{LoadStep, Series};
pub use server::{Server, StartError};
pub use settings::Settings;
