//! Transfer syntaxes: encoding of data sets, and compression of pixels.

use std::path::Path;

use super::data_set::Spelling;
use crate::{Endian, SourceError};

/// Compression of the pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Rle,
    Jpeg,
    Jpeg2000,
    /// Not supported, known or not; its name.
    NotRead(&'static str),
}

/// Encoding of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Syntax {
    pub(super) spelling: Spelling,
    pub(super) is_deflated: bool,
    pub(super) compression: Compression,
}

/// Known but unsupported syntaxes, by the ends of their UIDs.
const REFUSED: [(&str, &str); 13] = [
    ("4.80", "JPEG-LS"),
    ("4.81", "JPEG-LS"),
    ("4.92", "JPEG 2000 of several components"),
    ("4.93", "JPEG 2000 of several components"),
    ("4.100", "MPEG-2 video"),
    ("4.101", "MPEG-2 video"),
    ("4.102", "MPEG-4 video"),
    ("4.103", "MPEG-4 video"),
    ("4.107", "HEVC video"),
    ("4.108", "HEVC video"),
    ("4.110", "JPEG XL"),
    ("4.112", "JPEG XL"),
    ("4.201", "High-Throughput JPEG 2000"),
];

impl Syntax {
    /// Syntax of uncompressed pixels.
    pub(super) fn plain(spelling: Spelling) -> Self {
        Self { spelling, is_deflated: false, compression: Compression::None }
    }

    fn compressed(compression: Compression) -> Self {
        Self { compression, ..Self::plain(Spelling::EXPLICIT) }
    }

    /// Refuses a compression without a decoder.
    pub(super) fn check(&self, path: &Path) -> Result<(), SourceError> {
        let Compression::NotRead(name) = self.compression else { return Ok(()) };
        let advice = "decompress the series first, for example with `dcmdjpls` or `gdcmconv --raw IN OUT`";
        Err(SourceError::unsupported(path, format!("its pixels are compressed by {name}, which is not read"), advice))
    }

    /// The syntax of a UID (PS3.6, annex A).
    pub(super) fn of(path: &Path, uid: &str) -> Result<Self, SourceError> {
        let Some(end) = uid.strip_prefix("1.2.840.10008.1.2") else {
            let found = format!("`{uid}`");
            return Err(SourceError::invalid(path, "transfer syntax (0002,0010)", "one of the standard's", found));
        };
        let big = Spelling { endian: Endian::Big, is_explicit: true };
        Ok(match end.trim_start_matches('.') {
            "" => Self::plain(Spelling::IMPLICIT),
            "1" => Self::plain(Spelling::EXPLICIT),
            "1.99" => Self { is_deflated: true, ..Self::plain(Spelling::EXPLICIT) },
            "2" => Self::plain(big),
            "5" => Self::compressed(Compression::Rle),
            "4.50" | "4.51" | "4.57" | "4.70" => Self::compressed(Compression::Jpeg),
            "4.90" | "4.91" => Self::compressed(Compression::Jpeg2000),
            end => {
                let name =
                    REFUSED.iter().find(|(known, _)| *known == end).map_or("an unknown compression", |known| known.1);
                // Its header can be read: in a folder the user may want another series.
                Self::compressed(Compression::NotRead(name))
            }
        })
    }
}
