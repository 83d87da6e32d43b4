//! What the end-to-end tests in `tests/tests/` share: a real server on the real GPU path, headsets and worse peers on
//! real QUIC over loopback, and pictures to compare.
//!
//! A [`TestServer`] is alone in its process while it lives, so that tests of one file do not take each other's time.
//! Nothing here waits for ever: [`within`] ends what takes longer than [`PATIENCE`], and says what that was.

mod bystander;
mod cable;
mod likeness;
mod peer;
mod process;
mod subject;
mod test_server;
mod viewer;
mod waiting;

pub use bystander::Bystander;
pub use cable::Cable;
pub use likeness::{Likeness, Planes};
pub use peer::{Ending, RawPeer};
pub use process::{open_files, resident_bytes, threads};
pub use subject::{
    BEACON_IN_ROOM, CENTRE_IN_ROOM, beacon, growing, labels, scene_of_mode, scene_with, subject,
};
pub use test_server::{REFRESH_HZ, SIZE_PX, TestServer, device, gpu, settings};
pub use viewer::{Viewer, in_front};
pub use waiting::{PATIENCE, until, within};
