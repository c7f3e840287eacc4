//! The viewer, driven and drawn without a display.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

#[path = "../support/mod.rs"]
mod support;

mod ahead;
mod animations;
mod building;
mod cutting;
mod gradient;
mod inspect;
mod sections;
mod window;
