//! The whole client path on loopback, against a small server that encodes synthetic pictures and can lie.

mod ends;
mod fake_server;
mod lies;
mod many;
mod one;
