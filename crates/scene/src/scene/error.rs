//! Errors of scenes.

use crate::camera::CameraError;
use crate::clip::mesh_file::MeshFileError;
use crate::transfer_function::TransferFunctionError;

/// Reason why a text is no scene, or why a scene cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum SceneError {
    #[error("the scene is not valid: {0}")]
    Json(#[from] serde_json::Error),
    #[error("scene key `{key}`: expected {expected}, found {found}")]
    Value { key: String, expected: String, found: String },
    #[error("scene key `camera`: {0}")]
    Camera(#[from] CameraError),
    #[error("scene key `transfer_function`: {0}")]
    TransferFunction(#[from] TransferFunctionError),
    #[error("scene key `{key}`: {reason}")]
    Mesh { key: String, reason: Box<MeshFileError> },
}
