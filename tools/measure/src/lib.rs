//! Measurement: render time, distance from the exact picture, and regimes in which methods fail.
//!
//! Commands and one report use this crate:
//! - `supervol chart`: scenes x methods x parameters -> points of (cost, error) ([`chart`]);
//! - `supervol chart --stability`: each regime in which a method breaks, as a curve with a gate ([`stability`]);
//! - `supervol bench --peers`: the same pictures by other programs ([`peers`]);
//! - `supervol bench --path`: frames along a camera path ([`paths`]);
//! - `supervol bench --random-scenes`: errors of random scenes against the requested error ([`random_scenes`]);
//! - `supervol bench --leaping`: cost of empty-space skipping, and the time that it saves ([`leaping`]).
//!
//! Modules, in the order of the data path:
//! - [`fixtures`], [`ricker`], [`virtual_volume`]: volumes computed from coordinates; virtual volumes are never stored;
//! - [`context`]: scale, folder and progress of a measurement;
//! - [`resident`]: a container's bricks in memory, and brick views that the streamer never hands out;
//! - [`volume`]: a volume built into a container, its scenes and its pictures; [`scenes`]: the scenes of the chart;
//! - [`methods`], [`points`]: methods with their parameters, and what was measured of each; [`record`]: their table;
//! - [`comparison`]: methods of comparison, which plug into the renderer's scalar caster;
//! - [`stated`]: stated errors of pixels against true ones;
//! - [`measure`]: the distance between two pictures; [`convergence`]: orders of convergence of the integration rules;
//! - [`chart`], [`storage`], [`reading`], [`stability`], [`peers`], [`paths`], [`leaping`], [`random_scenes`]:
//!   measurements;
//! - [`report`]: pages and plots; [`ledger`]: records by machine and date.
//!
//! Neither building nor rendering needs this crate: it calls the other crates as any program does. Pictures are drawn by
//! the runtime's renderer, below the library `supervol`. An engine is measured on a stored container and a written scene,
//! apart from the library's rules for open scenes, places of volumes and memory of the process. All random numbers are
//! seeded ([`supervol_format::random`]).

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

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
