//! Ctrl-C, SIGTERM and SIGHUP: the program removes what it has not finished, and ends with exit code 128 + signal.
//!
//! A thread of its own waits for them, so that no loop of the program need ask. What is half written is known by name
//! ([`supervol_files::unfinished`]); programs that were started are ended; everything else that is temporary has no name and goes with the process.

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
            // At once: other threads are at work, and what they use must not be taken apart under them.
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

/// Whether the program was started with a signal ignored, as `nohup` does with SIGHUP: it shall outlive its terminal.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
