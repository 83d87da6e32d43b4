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
//! This crate holds no algorithm of its own but the choice of whose frame is next and how much it may cost, both pure.

mod clock;
mod connection;
mod encoding;
mod pairing;
mod quality;
mod render_loop;
mod room;
mod scheduler;
mod seat;
mod server;
mod settings;

pub use quality::{LADDER, QualityController, Rung};
pub use room::{SceneChangeError, Volumes};
pub use scheduler::{Scheduler, Wish};
pub use seat::SeatSnapshot;
pub use server::{Server, StartError};
pub use settings::Settings;
