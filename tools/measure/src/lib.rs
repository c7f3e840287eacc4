//! Measurement: how fast, how far from exact, and where methods fail.
//!
//! Three commands and one report stand on this crate:
//! - `supervol chart`: scenes x methods x parameters -> points of (cost, error) ([`chart`]);
//! - `supervol chart --stability`: every regime in which a method breaks, as a curve with a gate ([`stability`]);
//! - `supervol bench --peers`: the same pictures by other programs ([`peers`]); `supervol bench --path`: frames along a
//!   camera path ([`paths`]); `supervol bench --random-scenes`: is the error that is asked for kept ([`random_scenes`])?
//!   `supervol bench --leaping`: what it costs to know where nothing shows ([`leaping`]).
//!
//! In the order of the data path:
//! - [`fixtures`], [`ricker`], [`virtual_volume`]: volumes computed from coordinates; the last
//!   kind is never stored anywhere;
//! - [`resident`]: a container's bricks in memory, and views that no streamer would hand out;
//! - [`volume`]: a volume built into a container, its scenes and its pictures;
//! - [`comparison`]: the methods that the renderer's own is compared with; they plug into its scalar caster;
//! - [`measure`]: the distance between two pictures; [`convergence`]: how fast rules come to the exact one;
//! - [`chart`], [`storage`], [`reading`], [`stability`], [`peers`], [`paths`], [`leaping`], [`random_scenes`]: what is run;
//! - [`report`]: what is written; [`ledger`]: records kept by machine and date.
//!
//! Nothing here is needed to build or to render: it calls the crates as any other program does. Everything random is
//! seeded ([`supervol_format::random`]).

pub mod chart;
pub mod comparison;
pub mod context;
pub mod convergence;
pub mod fixtures;
pub mod leaping;
pub mod ledger;
pub mod measure;
pub mod methods;
pub mod paths;
pub mod peers;
pub mod points;
pub mod random_scenes;
pub mod reading;
pub mod record;
pub mod report;
pub mod resident;
pub mod ricker;
pub mod scenes;
pub mod stability;
pub mod stated;
pub mod storage;
pub mod virtual_volume;
pub mod volume;

pub use context::{ChartError, Context, Scale};
