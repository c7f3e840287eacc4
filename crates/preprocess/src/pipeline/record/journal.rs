//! Journal of a build: its finished tiles, so that a killed build can be continued.
//!
//! ```text
//! .supervol-build-A.partial   header page | records of the bricks, in tile order ...
//! .supervol-build-B.partial   this journal: head | frame | frame | ...
//! head    magic, identity of the build (u64), name of A (u16 length, bytes), checksum of all that (u64)
//! frame   level (u32), bricks (u32), end of the records in A (u64); then for each brick its number in the pyramid (u64)
//!         and its entry (80 bytes); checksum of the frame (u64); all little endian
//! ```
//!
//! 1. A build begins a journal beside its container. It writes a frame for each tile whose records have left the
//!    process.
//! 2. Both files are unfinished files ([`supervol_files::unfinished`]). They are removed if the data is wrong or a
//!    signal ends the build. They are kept if the process is killed, the build is stopped ([`supervol_sources::stop`]),
//!    or the machine fails: a full disk, a source that cannot be read.
//! 3. A build that would make the same bytes ([`identity`](crate::pipeline::plan::identity)) takes both files over. It
//!    trusts frames and records only if their checksums are right. The rest is cut off and made again.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use supervol_files::unfinished::{UnfinishedFile, Writer, is_name_of_build, list_builds};
use supervol_format::cast::narrow;
use supervol_format::container::toc::ENTRY_BYTES;
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: [u8; 8] = *b"SVJOURN1";
/// Bytes of a journal's head before the container's name. The last two of them are the length of the name.
pub const NAME_AT: usize = MAGIC.len() + 8 + 2;
/// Bytes of a frame before its bricks.
const FRAME_HEAD: usize = 16;
/// Bytes of a brick in a frame.
const BRICK_BYTES: usize = 8 + ENTRY_BYTES;
/// Bytes of the checksum at the end of the head and of each frame.
pub const CHECKSUM_BYTES: usize = 8;

/// Bytes of a frame of `bricks` bricks.
#[must_use]
pub const fn frame_bytes(bricks: usize) -> usize {
    FRAME_HEAD + bricks * BRICK_BYTES + CHECKSUM_BYTES
}

/// A journal being written.
#[derive(Debug)]
pub struct Journal(UnfinishedFile);

/// A tile whose bricks are written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Level of detail.
    pub lod: u32,
    /// End of its bricks' records in the container, in bytes.
    pub end: u64,
    /// Number in the pyramid and encoded entry of each brick, in the order of writing.
    pub bricks: Vec<(u64, [u8; ENTRY_BYTES])>,
}

/// An unfinished build that can be continued.
#[derive(Debug)]
pub struct Unfinished {
    /// The unfinished container.
    pub container: UnfinishedFile,
    /// Its journal.
    pub journal: Journal,
    /// Reader of the frames.
    frames: BufReader<File>,
    /// Start of the first frame that is not accepted yet, in bytes.
    at: u64,
}

impl Journal {
    /// Begins the journal of a container.
    ///
    /// # Errors
    /// If its folder cannot be written to.
    pub fn begin(folder: &Path, container: &UnfinishedFile, identity: u64) -> io::Result<Self> {
        let file = UnfinishedFile::create_for_build(folder, container.as_file().metadata()?.permissions())?;
        file.as_file().write_all(&head(identity, container.file_name().as_encoded_bytes()))?;
        Ok(Self(file))
    }

    /// Keeps the file for a later build, and returns its path.
    ///
    /// # Errors
    /// If the system does not allow it.
    pub fn abandon(self) -> io::Result<PathBuf> {
        self.0.abandon()
    }

    /// Writes the frame of a tile whose records have left the process.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn append(&self, frame: &Frame) -> io::Result<()> {
        // A single write. The checksum reveals an incomplete one.
        self.0.as_file().write_all(&frame.encode())
    }
}

fn head(identity: u64, name: &[u8]) -> Vec<u8> {
    let mut head = MAGIC.to_vec();
    head.extend(identity.to_le_bytes());
    head.extend(narrow::<u16>(name.len()).to_le_bytes());
    head.extend(name);
    head.extend(xxh3_64(&head).to_le_bytes());
    head
}

/// Name of the container, and start of the frames in bytes, of a journal with this identity.
fn read_head(from: &mut impl Read, identity: u64) -> Option<(String, u64)> {
    let mut found = vec![0; NAME_AT];
    from.read_exact(&mut found).ok()?;
    let name_bytes = usize::from(u16::from_le_bytes([found[NAME_AT - 2], found[NAME_AT - 1]]));
    found.resize(NAME_AT + name_bytes + CHECKSUM_BYTES, 0);
    from.read_exact(&mut found[NAME_AT..]).ok()?;
    let name = &found[NAME_AT..NAME_AT + name_bytes];
    if found != head(identity, name) {
        return None;
    }
    let name = std::str::from_utf8(name).ok()?;
    // Files that are taken over may be removed later. So they must have names of builds.
    is_name_of_build(name).then(|| (name.to_owned(), found.len() as u64))
}

impl Frame {
    fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(frame_bytes(self.bricks.len()));
        bytes.extend(self.lod.to_le_bytes());
        bytes.extend(narrow::<u32>(self.bricks.len()).to_le_bytes());
        bytes.extend(self.end.to_le_bytes());
        for (number, entry) in &self.bricks {
            bytes.extend(number.to_le_bytes());
            bytes.extend(entry);
        }
        bytes.extend(xxh3_64(&bytes).to_le_bytes());
        bytes
    }

    /// The next frame. `None` if it is incomplete or has more than `most` bricks.
    fn read(from: &mut impl Read, most: usize) -> Option<Self> {
        let mut bytes = vec![0; FRAME_HEAD];
        from.read_exact(&mut bytes).ok()?;
        let count = u32::from_le_bytes(bytes[4..8].try_into().ok()?) as usize;
        if count > most {
            return None;
        }
        bytes.resize(frame_bytes(count), 0);
        from.read_exact(&mut bytes[FRAME_HEAD..]).ok()?;
        let (content, checksum) = bytes.split_at(bytes.len() - CHECKSUM_BYTES);
        if xxh3_64(content).to_le_bytes() != checksum {
            return None;
        }
        let bricks = content[FRAME_HEAD..].chunks_exact(BRICK_BYTES).map(|brick| {
            let (number, entry) = brick.split_at(8);
            Some((u64::from_le_bytes(number.try_into().ok()?), entry.try_into().ok()?))
        });
        Some(Self {
            lod: u32::from_le_bytes(content[..4].try_into().ok()?),
            end: u64::from_le_bytes(content[8..16].try_into().ok()?),
            bricks: bricks.collect::<Option<_>>()?,
        })
    }
}

impl Unfinished {
    /// An unfinished build with this identity in `folder`, whose process has ended.
    #[must_use]
    pub fn find(folder: &Path, identity: u64) -> Option<Self> {
        let left = list_builds(folder).ok()?;
        let dead = left.iter().filter(|leftover| leftover.writer == Writer::Dead);
        let paths: Vec<_> = dead.map(|leftover| leftover.path.clone()).collect();
        // The list holds the files' locks.
        drop(left);
        paths.iter().find_map(|path| Self::take_over(folder, path, identity))
    }

    fn take_over(folder: &Path, journal: &Path, identity: u64) -> Option<Self> {
        let (name, at) = read_head(&mut File::open(journal).ok()?, identity)?;
        let journal = UnfinishedFile::adopt(journal).ok()??;
        let container = UnfinishedFile::adopt(&folder.join(name)).ok()??;
        let mut frames = journal.as_file().try_clone().ok()?;
        frames.seek(SeekFrom::Start(at)).ok()?;
        Some(Self { container, journal: Journal(journal), frames: BufReader::new(frames), at })
    }

    /// The next finished tile, of at most `most` bricks.
    pub fn next_frame(&mut self, most: usize) -> Option<Frame> {
        Frame::read(&mut self.frames, most)
    }

    /// Accepts the frame that was read last.
    pub fn accept(&mut self, frame: &Frame) {
        self.at += frame_bytes(frame.bricks.len()) as u64;
    }

    /// Keeps container and journal for a later build, and returns their paths.
    ///
    /// # Errors
    /// If the system does not allow it.
    pub fn abandon(self) -> io::Result<[PathBuf; 2]> {
        Ok([self.container.abandon()?, self.journal.abandon()?])
    }

    /// Cuts off everything that was not accepted. The container is cut at `end` bytes.
    ///
    /// # Errors
    /// If the files cannot be written.
    pub fn resume(self, end: u64) -> io::Result<(UnfinishedFile, Journal)> {
        for (mut file, end) in [(self.journal.0.as_file(), self.at), (self.container.as_file(), end)] {
            file.set_len(end)?;
            file.seek(SeekFrom::Start(end))?;
        }
        Ok((self.container, self.journal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(lod: u32, bricks: u64) -> Frame {
        Frame { lod, end: 4096 + 100 * bricks, bricks: (0..bricks).map(|n| (n, [n as u8 + 1; ENTRY_BYTES])).collect() }
    }

    #[test]
    fn frames_are_believed_only_where_they_are_whole() {
        let bytes: Vec<u8> = [frame(0, 3), frame(1, 0)].iter().flat_map(Frame::encode).collect();
        let read = |bytes: &[u8], most| {
            let mut from = bytes;
            std::iter::from_fn(|| Frame::read(&mut from, most)).collect::<Vec<_>>()
        };
        assert_eq!(read(&bytes, 3), [frame(0, 3), frame(1, 0)]);
        assert!(read(&bytes, 2).is_empty());
        let first = frame(0, 3).encode().len();
        for cut in 0..bytes.len() {
            assert_eq!(read(&bytes[..cut], 3).len(), usize::from(cut >= first), "cut at {cut}");
        }
        for byte in 0..first {
            let mut wrong = bytes.clone();
            wrong[byte] ^= 0x10;
            assert!(read(&wrong, 1 << 20).is_empty(), "byte {byte}");
        }
    }

    #[test]
    fn a_journal_that_names_a_file_of_somebody_else_is_not_believed() {
        let folder = tempfile::tempdir().unwrap();
        let build = ".supervol-build-a.partial";
        let elsewhere = format!("{build}/../b.partial");
        for name in ["photo.jpg", ".supervol-a.partial", ".supervol-build-a", elsewhere.as_str(), ""] {
            let bytes = head(7, name.as_bytes());
            assert_eq!(read_head(&mut &bytes[..], 7), None, "{name:?}");
            std::fs::write(folder.path().join("photo.jpg"), b"a user's").unwrap();
            std::fs::write(folder.path().join(build), bytes).unwrap();
            assert!(Unfinished::find(folder.path(), 7).is_none());
            assert!(folder.path().join("photo.jpg").exists(), "{name:?}");
        }
        let bytes = head(7, build.as_bytes());
        assert_eq!(read_head(&mut &bytes[..], 7), Some((build.into(), bytes.len() as u64)));
    }

    #[test]
    fn builds_of_the_same_identity_are_found_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let permissions = std::fs::metadata(folder.path()).unwrap().permissions();
        let container = UnfinishedFile::create_for_build(folder.path(), permissions).unwrap();
        let journal = Journal::begin(folder.path(), &container, 7).unwrap();
        journal.append(&frame(0, 2)).unwrap();
        container.as_file().write_all(&[1; 5000]).unwrap();
        assert!(Unfinished::find(folder.path(), 7).is_none(), "another process writes it");
        container.abandon().unwrap();
        journal.abandon().unwrap();
        assert!(Unfinished::find(folder.path(), 8).is_none());
        let mut found = Unfinished::find(folder.path(), 7).unwrap();
        assert!(Unfinished::find(folder.path(), 7).is_none(), "it is taken over already");
        let first = found.next_frame(10).unwrap();
        assert_eq!(first, frame(0, 2));
        found.accept(&first);
        assert!(found.next_frame(10).is_none());
        let (container, journal) = found.resume(4296).unwrap();
        assert_eq!(container.as_file().metadata().unwrap().len(), 4296);
        journal.append(&frame(1, 1)).unwrap();
        container.abandon().unwrap();
        journal.abandon().unwrap();
        let mut again = Unfinished::find(folder.path(), 7).unwrap();
        assert_eq!([again.next_frame(10), again.next_frame(10)], [Some(frame(0, 2)), Some(frame(1, 1))]);
        drop(again);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "dropped, it is removed");
    }
}
