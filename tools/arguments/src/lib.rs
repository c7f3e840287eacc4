//! The command line that the executables of Supervol share.
//!
//! `supervol` runs most commands itself. `supervol-view` (the viewer) and `supervol-measure` (`bench`, `chart`) run the
//! others; they have dependencies that nobody needs who builds and renders. `supervol` reads the arguments of all
//! commands, so that help, completions and man pages are whole without these executables.
//!
//! - [`program`]: start and end of each executable; [`failure`]: messages and exit codes; [`flags`]: flags in messages; [`signals`], [`allocation`]:
//!   ends that come from the system;
//! - [`terminal`], [`progress`]: standard output and standard error; [`output`]: files that commands write;
//!   [`input`]: files that commands read; [`sample`]: the volume that comes with the program;
//! - [`quantity`]: numbers with units;
//! - [`source`], [`cache`], [`scene`]: options that several commands have;
//! - [`bench`](mod@bench), [`chart`], [`view`]: arguments of the commands that other executables run.
//!
//! Nothing here draws, builds or measures.

pub mod allocation;
pub mod bench;
pub mod cache;
pub mod chart;
pub mod failure;
pub mod flags;
pub mod input;
pub mod output;
pub mod program;
pub mod progress;
pub mod quantity;
pub mod sample;
pub mod scene;
pub mod signals;
pub mod source;
pub mod terminal;
pub mod view;
