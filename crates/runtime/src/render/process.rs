//! Facts of the operating system about this process: processor time and memory.

use std::num::NonZero;
use std::time::Duration;

use crate::stream::loader::READERS;

/// Processor time of all threads of this process; zero if the system does not tell.
#[must_use]
pub fn cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        let (seconds, nanoseconds) = (u64::try_from(time.tv_sec), u32::try_from(time.tv_nsec));
        Duration::new(seconds.unwrap_or(0), nanoseconds.unwrap_or(0))
    }
    #[cfg(not(unix))]
    Duration::ZERO
}

/// Peak resident memory of this process, bytes; 0 if the system does not tell (all but Linux).
#[must_use]
pub fn peak_resident_bytes() -> u64 {
    bytes_of("VmHWM:")
}

/// Resident memory of this process, bytes; 0 if the system does not tell (all but Linux).
#[must_use]
pub fn resident_bytes() -> u64 {
    bytes_of("VmRSS:")
}

/// Bytes of a thread beside its casting memory: the used part of its stack, and memory that the allocator keeps for it.
const THREAD_BYTES: u64 = 2 << 20;

/// Bytes that the process holds beside pictures to be drawn with `threads` threads (`None`: one per processor). Counted
/// in [`RenderOptions::process_bytes`](super::options::RenderOptions::process_bytes), they make the host budget a limit
/// of the whole process.
#[must_use]
pub fn bytes_beside_pictures(threads: Option<usize>) -> u64 {
    let threads = threads.or_else(|| std::thread::available_parallelism().ok().map(NonZero::get)).unwrap_or(1);
    resident_bytes() + THREAD_BYTES * (threads + READERS) as u64
}

/// Reads a number of `/proc/self/status`.
fn bytes_of(name: &str) -> u64 {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return 0 };
    let line = status.lines().find_map(|l| l.strip_prefix(name));
    let kibibytes = line.and_then(|l| l.trim().strip_suffix("kB")).and_then(|n| n.trim().parse::<u64>().ok());
    kibibytes.unwrap_or(0) * 1024
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_grows_with_work() {
        let before = cpu_time();
        let mut x = 1u64;
        while before == cpu_time() && x != 0 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(cfg!(not(unix)) || cpu_time() > before);
    }

    #[test]
    fn resident_memory_is_known_on_linux() {
        assert!(!cfg!(target_os = "linux") || resident_bytes() > 100_000 && peak_resident_bytes() >= resident_bytes());
    }
}
