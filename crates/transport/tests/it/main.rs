//! Two ends on loopback.

mod bounds;
mod common;
mod faults;
mod talk;
