//! Checks of single numbers of a scene. Errors name the key, the expectation and the value found.

use supervol_format::readable::Number;

use super::error::SceneError;
use super::limits::SHADING_LIMIT;
use crate::camera::unit_vector;

pub(super) fn check(
    good: bool,
    key: &str,
    expected: impl FnOnce() -> String,
    found: impl std::fmt::Display,
) -> Result<(), SceneError> {
    if good {
        return Ok(());
    }
    Err(SceneError::Value { key: key.into(), expected: expected(), found: found.to_string() })
}

pub(super) fn check_color(key: &str, color: [f64; 3]) -> Result<(), SceneError> {
    let good = color.iter().all(|c| (0.0..=1.0).contains(c));
    check(good, key, || "three numbers between 0 and 1".into(), format!("{color:?}"))
}

pub(super) fn check_share(key: &str, share: f64) -> Result<(), SceneError> {
    check((0.0..=1.0).contains(&share), key, || "a number between 0 and 1".into(), Number(share))
}

pub(super) fn check_factor(key: &str, factor: f64) -> Result<(), SceneError> {
    check(
        (0.0..=SHADING_LIMIT).contains(&factor),
        key,
        || format!("a number between 0 and {SHADING_LIMIT:e}"),
        Number(factor),
    )
}

pub(super) fn check_direction(key: &str, v: [f64; 3]) -> Result<(), SceneError> {
    let good = unit_vector(v.into()).is_some();
    check(good, key, || "three finite numbers, not all zero".into(), format!("{v:?}"))
}
