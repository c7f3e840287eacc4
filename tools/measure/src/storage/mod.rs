//! What volumes cost to build and to store: [`builds`] by size, and [`codecs`] on the bricks of several volumes.

pub mod builds;
pub mod codecs;

use supervol_format::codec::{Codec, CodecChoice};

use crate::context::{ChartError, Context};
use builds::Built;
use codecs::Rates;

/// What is compared, plainest first.
pub const CHOICES: [CodecChoice; 5] = [
    CodecChoice::Only(Codec::Raw),
    CodecChoice::Only(Codec::Rle),
    CodecChoice::Only(Codec::Zstd),
    CodecChoice::Only(Codec::Wavelet),
    CodecChoice::Smallest,
];

/// What was measured.
#[derive(Debug, Clone, Default)]
pub struct Storage {
    /// Builds of the synthetic survey, by codec and then by size.
    pub builds: Vec<Built>,
    /// What codecs make of bricks, by volume and then by the error allowed.
    pub rates: Vec<Rates>,
    /// Volumes that were left out: a sentence each.
    pub notes: Vec<String>,
}

/// What the report shows. To be called before anything else has been kept in memory: what builds take is what the process takes
/// beside what it has then.
///
/// # Errors
/// If a volume cannot be made or built.
pub fn for_report(context: &Context<'_>) -> Result<Storage, ChartError> {
    let builds = builds::measure(context)?;
    let (rates, notes) = codecs::measure(context)?;
    Ok(Storage { builds, rates, notes })
}
