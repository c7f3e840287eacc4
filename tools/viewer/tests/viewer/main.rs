//! The viewer, driven and drawn without a display.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

#[path = "../support/mod.rs"]
mod support;

mod ahead;
mod animations;
mod building;
mod cutting;
mod inspect;
mod sections;
mod window;
