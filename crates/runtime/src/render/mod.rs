//! Rendering: options in, pictures out.
//!
//! - [`options`], [`error`]: how a picture is made, and errors of rendering;
//! - [`volume`]: an open container with its facts;
//! - [`frame`]: one frame: its setting, its engine and its passes;
//! - [`renderer`]: successive pictures, interruptible, with all data kept between them;
//! - [`stats`], [`process`]: the cost of a frame.

mod enlarge;
pub mod error;
pub mod frame;
pub mod options;
pub mod process;
pub mod renderer;
pub mod stats;
pub mod volume;
