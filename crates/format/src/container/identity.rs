//! Identity of a container's content: one checksum, from checksums that the file holds.
//!
//! - The footer page covers the header's fields, the manifest (by its checksum) and the places of all sections.
//! - The checksum of each TOC page covers its entries, and each entry covers the record of its brick.
//!
//! The identity is the XXH3-64 of the footer page followed by the checksums of all TOC pages, eight bytes each in the
//! order of the pages. So it covers every byte of the file, at the cost of eight bytes per 818 bricks. Two containers
//! with one identity have the same voxels. Damage is not its task: [`Container::entry`] and [`Container::decode_brick`]
//! find that.

use super::header::PAGE_BYTES;
use super::reader::Container;
use super::{ContainerError, checksum, toc};
use crate::cast;

/// Most TOC pages whose checksums are read: of 837,632 bricks. Beyond, only the footer page is covered.
pub const PAGES_LIMIT: u64 = 1024;

/// Part of a container that its identity covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Covers {
    /// Every byte: header, manifest, table of contents and all bricks.
    Content,
    /// Header, manifest, and the lengths of all sections, but no brick: the table of contents has more than
    /// [`PAGES_LIMIT`] pages.
    Description,
}

impl Covers {
    /// Its name in records of pictures.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Content => "content",
            Self::Description => "description",
        }
    }
}

/// Identity of a container's content; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// XXH3-64 of the covered checksums.
    pub checksum: u64,
    /// Part of the container that it covers.
    pub covers: Covers,
}

impl Identity {
    /// The checksum as 16 hexadecimal digits.
    #[must_use]
    pub fn digits(&self) -> String {
        format!("{:016x}", self.checksum)
    }
}

impl Container {
    /// The identity of the content. The place in the world ([`Container::placed`]) does not change it.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn identity(&self) -> Result<Identity, ContainerError> {
        let pages = toc::pages_for(self.pyramid().brick_count());
        let (covers, pages) =
            if pages > PAGES_LIMIT { (Covers::Description, 0) } else { (Covers::Content, cast::index(pages)) };
        let mut covered = vec![0; PAGE_BYTES + pages * toc::CHECKSUM_BYTES];
        let (footer, sums) = covered.split_at_mut(PAGE_BYTES);
        let ends = (0..pages as u64).map(|number| self.page_offset(number) + self.page_bytes(number) as u64);
        let places = ends.map(|end| end - toc::CHECKSUM_BYTES as u64).zip(sums.chunks_exact_mut(toc::CHECKSUM_BYTES));
        let mut ranges: Vec<(u64, &mut [u8])> = vec![(self.file_bytes() - PAGE_BYTES as u64, footer)];
        ranges.extend(places);
        self.byte_source().read_several(&mut ranges).map_err(|source| ContainerError::Io {
            what: "footer and checksums of the TOC pages".into(),
            offset: self.sections().toc_offset,
            bytes: (PAGE_BYTES + pages * toc::CHECKSUM_BYTES) as u64,
            source,
        })?;
        Ok(Identity { checksum: checksum(&covered), covers })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covers_have_the_names_that_records_store() {
        assert_eq!([Covers::Content, Covers::Description].map(Covers::name), ["content", "description"]);
        let identity = Identity { checksum: 0xab, covers: Covers::Content };
        assert_eq!(identity.digits(), "00000000000000ab");
    }
}
