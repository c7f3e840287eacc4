//! Benchmarks: `cargo bench -p supervol-benches --bench codecs` (or `build`, `render`). `supervol bench` measures whole
//! pictures and camera paths (`paths/`).
//!
//! Quoted results are kept under `record/` by machine and date, with their command.
//! `supervol bench --record benches/record` appends to the file of this machine and day. `tools/measure/src/ledger.rs`
//! explains the columns. Results of `--bench rates` have other columns and are kept under `rates/` (`tools/rates.py`).
