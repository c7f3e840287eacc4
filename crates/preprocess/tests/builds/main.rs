//! Builds that were killed go on, and containers are compared with their sources.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod compare_source;
mod resume;
