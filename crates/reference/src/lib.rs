//! The exact picture, in float64, and how far another one is from it.
//!
//! `docs/picture.md` says what a picture means; this crate computes it: along a ray each cell of the trilinear field is a
//! cubic, whose roots are the surfaces and knots, whose turns are the maxima, and over whose smooth pieces the
//! emission-absorption integral is taken adaptively to 1e-10. It is slow and obvious, and has no step, no table and no
//! early way out that could be seen: it is what the renderer is measured with ([`compare`], [`judge`]).
//!
//! This crate knows no GPU, no shader and no file.

mod beam;
mod doubt;
mod emission;
mod error;
mod field;
mod labels;
mod metrics;
mod picture;
mod polynomial;
mod quadrature;
mod ray;
mod reference;
mod several;
mod ssim;
mod surface;
mod transfer;

pub use beam::{Beam, Matter};
pub use doubt::{Answer, Answers, Uncertainty};
pub use error::ReferenceError;
pub use field::Field;
pub use metrics::{Comparison, DepthErrors, Place, Tolerance, Verdict, compare, difference, judge};
pub use picture::{Picture, Pixel};
pub use polynomial::Cubic;
pub use ray::{Ray, RaySetup, Way};
pub use reference::{Progress, Reference, render};
