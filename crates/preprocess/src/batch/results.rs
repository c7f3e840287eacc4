//! Results of a batch: one JSON object per line, in a file beside the containers.
//!
//! Lines are only appended, each by a single write. If an input has several lines, the last one counts. An unfinished
//! line of a killed process is cut off. A running batch holds the file's lock, so two batches cannot write to one
//! folder.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use supervol_files::OutputError;

use crate::error::BuildError;

/// Name of the file in the folder of the containers.
pub const FILE_NAME: &str = "results.jsonl";
/// Longest line that is read, in bytes.
const LINE_LIMIT_BYTES: u64 = 64 << 20;

/// Progress of an input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The container is being built, or the program ended during the build.
    #[default]
    Begun,
    /// The container is whole.
    Done,
    /// The build failed; `error` has the reason.
    Failed,
}

/// Result of an input. Unknown fields are left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Record {
    /// Path of the input, as given or found.
    pub source: String,
    /// Progress of the input.
    pub status: Status,
    /// Name of the container in the folder.
    pub container: String,
    /// Checksum of all files of the source.
    pub source_xxh3_64: String,
    /// Size of the source in bytes, from the container.
    pub source_bytes: u64,
    /// Files that the source reads besides the named one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub source_files: Vec<String>,
    /// Checksum of the source, from the container's manifest.
    pub manifest_xxh3_64: String,
    /// Checksum of the options that influence voxels.
    pub options: String,
    /// Checksum of the container.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub container_xxh3_64: Option<String>,
    /// Size of the container in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub container_bytes: Option<u64>,
    /// Size of level 0 as plain voxels in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel_bytes: Option<u64>,
    /// `container_bytes` over `voxel_bytes`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ratio: Option<f64>,
    /// Greatest distance of a voxel of level 0 from the source's, in data units; 0 if the container is exact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_bound: Option<f64>,
    /// Wall time of the build in milliseconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub milliseconds: Option<f64>,
    /// Reason of the failure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Observations of the source's reader.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// The results file, open and locked.
#[derive(Debug)]
pub struct Results {
    file: File,
    path: PathBuf,
    records: BTreeMap<String, Record>,
}

impl Results {
    /// Opens the results file of a folder, or creates it.
    ///
    /// # Errors
    /// If the file cannot be read or written, has other contents, or another batch holds it.
    pub fn open(folder: &Path) -> Result<Self, BuildError> {
        let path = folder.join(FILE_NAME);
        let write_error = |e| BuildError::write(&path, e);
        if path.exists() && !path.is_file() {
            return Err(OutputError::NoFile { path, found: "something else".into() }.into());
        }
        let file = File::options().read(true).append(true).create(true).open(&path).map_err(write_error)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let what = format!("{}: another batch writes to this folder. Wait for its end", path.display());
                return Err(BuildError::Options(what));
            }
            // The file system has no locks.
            Err(TryLockError::Error(_)) => {}
        }
        let (records, whole) = read(&file, &path)?;
        file.set_len(whole).map_err(write_error)?;
        Ok(Self { file, path, records })
    }

    /// The last record of each source.
    #[must_use]
    pub fn records(&self) -> &BTreeMap<String, Record> {
        &self.records
    }

    /// Appends a line.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn add(&mut self, record: Record) -> Result<(), BuildError> {
        let write_error = |e| BuildError::write(&self.path, e);
        let mut line = serde_json::to_vec(&record).map_err(|e| write_error(e.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).and_then(|()| self.file.sync_data()).map_err(write_error)?;
        self.records.insert(record.source.clone(), record);
        Ok(())
    }
}

/// The last record of each source, and the end of the last whole line in bytes.
fn read(file: &File, path: &Path) -> Result<(BTreeMap<String, Record>, u64), BuildError> {
    let (mut records, mut whole) = (BTreeMap::new(), 0);
    let mut from = BufReader::new(file);
    from.seek(SeekFrom::Start(0)).map_err(|e| BuildError::write(path, e))?;
    for number in 1u64.. {
        let mut line = Vec::new();
        let mut limited = std::io::Read::take(&mut from, LINE_LIMIT_BYTES);
        limited.read_until(b'\n', &mut line).map_err(|e| BuildError::write(path, e))?;
        let is_whole = line.ends_with(b"\n");
        match serde_json::from_slice::<Record>(&line) {
            Ok(record) if is_whole && !record.source.is_empty() => {
                whole += line.len() as u64;
                records.insert(record.source.clone(), record);
            }
            // The unfinished line of a killed process begins like a record.
            _ if line.is_empty() || (!is_whole && is_begun(&line)) => break,
            _ => {
                let found = "something else. The folder needs another name, or the file does".into();
                return Err(BuildError::Broken {
                    path: path.into(),
                    rule: format!("line {number}"),
                    expected: "what came of an input of a batch".into(),
                    found,
                });
            }
        }
    }
    Ok((records, whole))
}

/// Whether the bytes may be the beginning of a record.
fn is_begun(line: &[u8]) -> bool {
    const START: &[u8] = b"{\"source\":\"";
    let common = line.len().min(START.len());
    line[..common] == START[..common]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(source: &str, status: Status) -> Record {
        Record { source: source.into(), status, container: format!("{source}.svol"), ..Record::default() }
    }

    #[test]
    fn the_last_line_counts_and_a_torn_one_goes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE_NAME);
        let mut results = Results::open(folder.path()).unwrap();
        assert!(Results::open(folder.path()).unwrap_err().to_string().contains("another batch"));
        for (source, status) in [("a", Status::Begun), ("b", Status::Failed), ("a", Status::Done)] {
            results.add(record(source, status)).unwrap();
        }
        drop(results);
        let whole = std::fs::read(&path).unwrap();
        let last = whole[..whole.len() - 1].iter().rposition(|b| *b == b'\n').unwrap() + 1;
        for cut in last..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let mut results = Results::open(folder.path()).unwrap();
            assert_eq!(results.records()["a"].status, Status::Begun, "cut at {cut}");
            results.add(record("a", Status::Done)).unwrap();
            drop(results);
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
    }

    #[test]
    fn another_file_of_that_name_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE_NAME);
        for text in ["{\"a\": 1}\n", "mine", "\n", "{\"source\":\"a\",\"status\":\"done\"}\nmine\n"] {
            std::fs::write(&path, text).unwrap();
            let error = Results::open(folder.path()).unwrap_err();
            assert!(error.to_string().contains("line"), "{error}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
    }
}
