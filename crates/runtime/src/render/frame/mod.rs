//! One frame, from an open container to an image.
//!
//! - [`setting`]: memory, streamer and classifier of a frame;
//! - [`cpu`]: frames of the CPU engines;
//! - [`walk`]: the passes of a frame, for any [`Engine`](crate::engines::engine::Engine).
//!
//! ```text
//! plan the host budget --> for each band of rows: advance --> wanted --> fetch --> advance ... --> image
//! ```
//!
//! Without a deadline the picture always converges. It does not depend on budgets, the number of threads, or the order
//! in which bricks arrive. With a deadline, rays that still wait continue through coarser bricks, or pause, as
//! [`crate::render::renderer`] decides.

pub mod cpu;
#[cfg_attr(not(feature = "gpu"), path = "no_gpu.rs")]
pub(crate) mod gpu;
pub(crate) mod on_device;
pub mod setting;
pub mod walk;

pub use crate::render::error::RenderError;
pub use crate::render::options::{Backend, LevelChoice, OnProgress, Progress, RenderOptions};
pub(crate) use cpu::cpu_frame_of;
pub use cpu::{cpu_frame, render_cpu};
pub use gpu::render_gpu_surviving;
pub(crate) use setting::plan_host_for;
pub use setting::{classifier_for, plan_host, streamer_for};
pub use walk::{FrameWalk, PASS_LIMIT};
