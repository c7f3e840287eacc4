//! Measurements: `cargo bench -p supervol-benches --bench codecs` (or `build`, `render`); whole pictures and camera paths
//! (`paths/`) by `supervol bench`. Results that are quoted anywhere are kept under `record/`, by machine and date, with the
//! command that made them; `supervol bench --record benches/record` appends to the file of this machine and day. The columns
//! are explained in `tools/measure/src/ledger.rs`. `--bench rates` has columns of its own, kept under `rates/` (`tools/rates.py`).
