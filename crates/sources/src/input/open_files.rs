//! Files of a source that has many: opened on demand, and only the most recently used ones stay open.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use supervol_format::recent::Recent;

/// Files kept open at once: a stack of 5,000 slices must not exceed the system's limit.
const OPEN_FILES: usize = 32;

/// Open files by their number in the source.
#[derive(Debug, Default)]
pub(crate) struct OpenFiles(Mutex<Recent<usize, Arc<File>>>);

impl OpenFiles {
    /// The file, opened if necessary. If too many are open, the least recently used one is closed.
    pub(crate) fn get(&self, number: usize, path: &Path) -> io::Result<Arc<File>> {
        // The list is consistent even after a panic, so a poisoned lock is safe to use.
        let mut open = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = open.get(&number) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(File::open(path)?);
        open.insert_within(OPEN_FILES, number, Arc::clone(&file));
        Ok(file)
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::ByteSource;

    use super::*;

    #[test]
    fn every_file_is_found_and_few_stay_open() {
        let folder = tempfile::tempdir().unwrap();
        let path = |number: usize| folder.path().join(number.to_string());
        (0..3 * OPEN_FILES).for_each(|number| std::fs::write(path(number), number.to_string()).unwrap());
        let files = OpenFiles::default();
        for number in (0..3 * OPEN_FILES).chain([0, 0, 1]) {
            let file = files.get(number, &path(number)).unwrap();
            let mut bytes = vec![0; number.to_string().len()];
            file.read_exact_at(0, &mut bytes).unwrap();
            assert_eq!(String::from_utf8(bytes).unwrap(), number.to_string());
        }
        assert_eq!(files.0.lock().unwrap().len(), OPEN_FILES);
        assert_eq!(files.get(999, &path(999)).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
