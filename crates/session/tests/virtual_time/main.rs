//! Both ends of a session over a simulated network in virtual time. Nothing here waits, and the same seed gives the
//! same run.

mod clocks;
mod faults;
mod network;
mod operations;
mod prediction;
mod streaming;
mod world;
