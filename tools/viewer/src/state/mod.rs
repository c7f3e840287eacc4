//! State of panels and dialogs that is not part of the scene. `panels/` shows and changes it.

pub(crate) mod animation;
pub(crate) mod browser;
pub(crate) mod dialogs;
pub(crate) mod file_options;
pub(crate) mod gradients;
pub(crate) mod panels;
pub(crate) mod transfer;
