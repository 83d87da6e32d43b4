//! The binary from outside: arguments in; exit status, output and files out.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

mod bench;
mod errors;
mod files;
mod looks;
mod network;
mod pictures;
mod program;
mod series;
mod stills;
mod volumes;
