//! The error of a picture, known in three ways.
//!
//! - [`predict`]: predicted while the picture is drawn, per reason;
//! - [`stated`]: stated for each pixel;
//! - [`check`]: measured afterwards, against the [`reference`](mod@reference) integrator.

pub mod check;
pub mod predict;
pub mod reference;
pub mod stated;
