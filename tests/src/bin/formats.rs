//! Prints the table of formats: `formats DATA_FOLDER`.

use std::io::Write;
use std::path::Path;

use supervol_tests::formats::{document, files, outcome};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let data = std::env::args().nth(1).ok_or("usage: formats DATA_FOLDER")?;
    let data = Path::new(&data);
    let work = tempfile::tempdir()?;
    let outcomes: Vec<_> = files(data)?.iter().map(|f| outcome(data, f, work.path())).collect();
    std::io::stdout().write_all(document(&outcomes).as_bytes())?;
    Ok(())
}
