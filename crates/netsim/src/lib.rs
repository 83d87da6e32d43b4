//! A lossy network link with virtual time.
//!
//! A [`Link`] is one direction of a path: packets of any type go in with the time at which they are sent, and come out
//! at the time at which they arrive, late, out of order, twice, or not at all, as its [`LinkSettings`] say. Nothing
//! waits and nothing is random but by a seed, so that a test of hours runs in milliseconds and always the same way.
//!
//! This crate knows nothing of what the packets are.

mod link;
mod random;

pub use link::{Fate, Link, LinkCounters, LinkSettings};
pub use random::Random;
