//! Whether the picture on the device is true: against closed forms, and against the float64 reference.
//!
//! `tolerances.rs` says how far off a picture may be, and why. Figures of all comparisons are printed; to see them:
//! `cargo test -p render --test truth -- --nocapture`. A picture that fails leaves itself, the exact one and their
//! difference as PNG in cargo's folder for tests.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

mod closed_forms;
mod convergence;
mod hard_cases;
mod labels;
mod levels;
mod light_span;
mod scenes;
mod setting;
mod several;
mod skipping;
mod stereo;
mod tolerances;
