//! Cost of building and storing volumes: [`builds`] by size, and [`codecs`] on the bricks of several volumes.

pub mod builds;
pub mod codecs;

use supervol_format::codec::{Codec, CodecChoice};

use crate::context::{ChartError, Context};
use builds::Built;
use codecs::Rates;

/// Compared codecs, simplest first.
pub const CHOICES: [CodecChoice; 5] = [
    CodecChoice::Only(Codec::Raw),
    CodecChoice::Only(Codec::Rle),
    CodecChoice::Only(Codec::Zstd),
    CodecChoice::Only(Codec::Wavelet),
    CodecChoice::Smallest,
];

/// Results.
#[derive(Debug, Clone, Default)]
pub struct Storage {
    /// Builds of the synthetic survey, by codec and then by size.
    pub builds: Vec<Built>,
    /// Results of the codecs, by volume and then by allowed error.
    pub rates: Vec<Rates>,
    /// Volumes that were left out, one sentence each.
    pub notes: Vec<String>,
}

/// Measurements for the report. Call it first: memory already used by the process is subtracted from that of a build.
///
/// # Errors
/// If a volume cannot be made or built.
pub fn for_report(context: &Context<'_>) -> Result<Storage, ChartError> {
    let builds = builds::measure(context)?;
    let (rates, notes) = codecs::measure(context)?;
    Ok(Storage { builds, rates, notes })
}
