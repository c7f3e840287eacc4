//! How finely packets integrate, and with which instructions.

use super::simd::InstructionSet;
use crate::engines::rules::DEFAULT_ERROR;

/// How finely packets integrate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PacketRule {
    /// Largest error of any channel of any pixel that is aimed at, 1 being white; brought to
    /// [`MAX_ERROR_LIMITS`](crate::engines::rules::MAX_ERROR_LIMITS).
    pub max_error: f64,
    /// Instructions to use; `None`: the best that the processor has.
    pub instructions: Option<InstructionSet>,
    /// Whether what cells and levels may do is summed up along rays, for a prediction: 1 to 2 % of the time.
    pub sums_errors: bool,
    /// Whether it is counted what each ray costs (`work`): several times the time.
    pub counts_work: bool,
}

impl PacketRule {
    /// Half a grey level.
    pub const DEFAULT: Self =
        Self { max_error: DEFAULT_ERROR, instructions: None, sums_errors: false, counts_work: false };
}

impl Default for PacketRule {
    fn default() -> Self {
        Self::DEFAULT
    }
}
