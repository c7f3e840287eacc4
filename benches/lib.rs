//! Measurements: `cargo bench -p supervol-benches --bench codecs` (or `build`, `render`). Results that are quoted
//! anywhere are kept under `record/`, by machine and date, with the command that made them.
