//! The streamer: makes wanted bricks resident in a host cache of fixed size.
//!
//! Data path: a request is ranked ([`priority`]), read ([`io`], [`loader`]), decoded ([`decode`]) and kept ([`cache`]).
//! Only [`state`] changes the state of a brick. Engines see resident bricks through [`residency::BrickView`].
//!
//! - [`streamer`]: the entry: fetch these bricks, tell which came;
//! - [`classify`]: bricks that need no reading, by their entries in the table of contents;
//! - [`budget`], [`capacity`]: bytes for the cache, the states and what is on its way;
//! - [`field`]: keys of bricks, states and slots: a field (channel, time step) and a brick;
//! - [`packed`]: voxels in fewer bits, without loss; [`held`]: bricks in either form; [`form`]: which form is used;
//! - [`counters`]: sums of what streaming, rays and devices did.

pub mod budget;
pub mod cache;
pub mod capacity;
pub mod classify;
pub mod counters;
pub mod decode;
pub mod field;
pub mod form;
mod forms;
pub mod held;
pub mod io;
pub mod loader;
mod on_its_way;
pub mod packed;
pub mod priority;
pub mod residency;
pub mod state;
pub mod streamer;
pub mod view;
