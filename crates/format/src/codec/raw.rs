//! The voxels without compression: little endian, packed, x fastest.

use super::payload::CodecError;

/// Copies the payload into `out`.
///
/// # Errors
/// If their lengths differ.
pub fn decode_into(payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    if payload.len() != out.len() {
        return Err(CodecError::Length { codec: "raw", expected: out.len().to_string(), found: payload.len() });
    }
    out.copy_from_slice(payload);
    Ok(())
}
