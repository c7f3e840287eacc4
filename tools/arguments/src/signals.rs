//! Ctrl-C, SIGTERM and SIGHUP: the program removes its unfinished files and exits with code 128 + signal.
//!
//! A separate thread waits for signals, so no loop has to check for them. Unfinished files are known by name
//! ([`supervol_files::unfinished`]). Child programs are ended. Other temporary files have no name, and disappear with
//! the process.

use crate::failure::Failure;

/// Begins to wait. `end_programs` ends the programs that this one has started; what it returns is held until the end.
///
/// # Errors
/// If signals cannot be waited for, or no thread can be started.
#[cfg(unix)]
pub fn watch<G>(end_programs: impl FnOnce() -> G + Send + 'static) -> Result<(), Failure> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let wanted = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&signal| signal != SIGHUP || !is_ignored(signal));
    let mut signals = signal_hook::iterator::Signals::new(wanted)
        .map_err(|e| Failure::Machine(format!("cannot install the signal handler: {e}")))?;
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            let _none_begins = (end_programs(), supervol_files::unfinished::remove_all());
            // Exits without destructors: other threads still run and use the data.
            signal_hook::low_level::exit(128 + signal);
        }
    };
    let thread = std::thread::Builder::new().name("signals".into()).spawn(wait);
    thread.map(drop).map_err(|e| Failure::Machine(format!("cannot start a thread for signals: {e}")))
}

/// Elsewhere the system's own handling stays.
///
/// # Errors
/// None.
#[cfg(not(unix))]
pub fn watch<G>(_: impl FnOnce() -> G + Send + 'static) -> Result<(), Failure> {
    Ok(())
}

/// Tests if the signal is ignored, as `nohup` ignores SIGHUP: the program then outlives its terminal.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
