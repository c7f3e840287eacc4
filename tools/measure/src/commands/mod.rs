//! The commands of `supervol-measure`: `supervol bench` and `supervol chart`.

pub mod bench;
pub mod chart;
