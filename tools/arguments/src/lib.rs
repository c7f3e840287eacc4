//! The command line that the executables of Supervol share.
//!
//! `supervol` runs most commands itself. `supervol-view` (the viewer) and `supervol-measure` (`bench`, `chart`) run
//! the others, because these need many more dependencies. `supervol` parses the arguments of all commands. So help,
//! completions and man pages are complete without the other executables.
//!
//! - [`program`]: start and end of each executable; [`failure`]: messages and exit codes; [`flags`]: flags in messages; [`signals`],
//!   [`allocation`]: ends caused by the system;
//! - [`terminal`], [`progress`]: standard output and standard error; [`output`]: files that commands write;
//!   [`input`]: files that commands read; [`sample`]: the built-in sample volume;
//! - [`quantity`]: numbers with units;
//! - [`source`], [`cache`], [`scene`]: options that several commands share;
//! - [`bench`](mod@bench), [`chart`], [`view`]: arguments of the commands that other executables run.
//!
//! This crate draws, builds and measures nothing.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

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
