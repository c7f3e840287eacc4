//! Payload of a brick: its codec, the shape of its voxels, and errors of all codecs.

use crate::VoxelType;

/// Codec of a brick's payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Codec {
    /// No payload: all stored voxels have one value, or none is present.
    Uniform = 0,
    /// The voxels as they are.
    Raw = 1,
    /// Runs of equal voxels.
    Rle = 2,
    /// Predicted differences in byte planes, compressed by Zstandard.
    Zstd = 3,
    /// Multiples of a step, transformed, as tokens, compressed by Zstandard.
    Wavelet = 4,
    /// Raw, rle or zstd, without repeated layers of apron.
    Trimmed = 5,
}

impl Codec {
    /// All codecs, in tag order.
    pub const ALL: [Self; 6] = [Self::Uniform, Self::Raw, Self::Rle, Self::Zstd, Self::Wavelet, Self::Trimmed];

    /// The codec with this tag, or `None` if this version does not know it.
    #[must_use]
    pub fn from_tag(tag: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|c| *c as u8 == tag)
    }

    /// Name, as on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Raw => "raw",
            Self::Rle => "rle",
            Self::Zstd => "zstd",
            Self::Wavelet => "wavelet",
            Self::Trimmed => "trimmed",
        }
    }
}

/// Shape and type of the voxels of a payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickShape {
    /// Type of one voxel.
    pub voxel_type: VoxelType,
    /// Number of stored voxels along x, y, z.
    pub extent: [usize; 3],
}

impl BrickShape {
    /// Number of voxels.
    #[must_use]
    pub fn voxels(self) -> usize {
        self.extent.iter().product()
    }

    /// Size of the decoded voxels in bytes.
    #[must_use]
    pub fn bytes(self) -> usize {
        self.voxels() * self.voxel_type.bytes()
    }
}

/// Reason why a payload cannot be encoded or decoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum CodecError {
    #[error("{codec} payload of {found} bytes; expected {expected}")]
    Length { codec: &'static str, expected: String, found: usize },
    #[error("{codec} payload ends inside a token at byte {at}")]
    Truncated { codec: &'static str, at: usize },
    #[error("{codec} payload holds more than the brick's {voxels} voxels (token at byte {at})")]
    Overrun { codec: &'static str, voxels: usize, at: usize },
    #[error("zstd payload: {reason}")]
    Zstd { reason: String },
    #[error("wavelet payload: {reason}")]
    Wavelet { reason: String },
    #[error("tree payload: {reason}")]
    Tree { reason: String },
    #[error("trimmed payload: {reason}")]
    Trimmed { reason: String },
    #[error("codec {codec} has no payload to decode")]
    NoPayload { codec: &'static str },
}
