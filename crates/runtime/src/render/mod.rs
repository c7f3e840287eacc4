//! Rendering: options in, pictures out.
//!
//! - [`options`], [`error`]: how a picture is made, and errors of rendering;
//! - [`volume`]: an open container with its facts;
//! - [`accuracy`]: the predicted, the stated and the measured error of a picture;
//! - [`frame`]: one frame: its setting, its engine and its passes;
//! - `drawing`: pictures in progress;
//! - [`renderer`]: successive pictures, interruptible, with all data kept between them;
//! - [`stats`], [`process`]: the cost of a frame;
//! - [`record`], [`fidelity`]: what a picture says of itself.

pub mod accuracy;
mod drawing;
mod enlarge;
pub mod error;
pub mod fidelity;
pub mod frame;
pub mod options;
pub mod process;
pub mod record;
pub mod renderer;
pub mod stats;
pub mod volume;
