//! What the exact picture must be.

mod brute_force;
mod closed_forms;
mod common;
mod convergence;
mod doubt;
mod hard_cases;
mod labels;
mod several;
