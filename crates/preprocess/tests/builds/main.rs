//! Continuation of killed builds, and comparison of containers with their sources.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod compare_source;
mod resume;
