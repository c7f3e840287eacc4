//! The error of a picture, known in four ways.
//!
//! - [`predict`]: predicted while the picture is drawn, per reason;
//! - [`stated`]: stated for each pixel;
//! - [`check`]: measured afterwards, against the [`reference`](mod@reference) integrator;
//! - [`proof`]: proved of a picture file and its container.

pub mod check;
pub mod predict;
pub mod proof;
pub mod reference;
pub mod stated;
