//! The build keeps to its memory budget: allocations are counted. Alone in its program, because it counts everything.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use supervol_format::VoxelType;
use supervol_preprocess::BuildOptions;
use supervol_preprocess::source::synthetic::Synthetic;
use supervol_tests::fields::{options, try_build};

/// Bytes allocated now, and the most there ever were.
static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

struct Counting;

fn grown(bytes: usize) {
    let now = NOW.fetch_add(bytes, Ordering::Relaxed) + bytes;
    PEAK.fetch_max(now, Ordering::Relaxed);
}

// SAFETY: every call goes to the system's allocator unchanged; the counters do not touch the memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        grown(new_size);
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.realloc(block, layout, new_size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Threads and file buffers: what the budget does not name.
const SLACK: usize = 2 << 20;

#[test]
fn builds_stay_within_their_budget() {
    let source = |edge: u64| {
        Synthetic::new("seismic", supervol_format::Dims([edge; 3]), Some(VoxelType::U16), 1).expect("a known name")
    };
    for (edge, core, mebibytes, threads) in
        [(256, 64, 24, 2), (256, 64, 24, 8), (256, 32, 16, 8), (256, 64, 64, 8), (200, 128, 192, 8)]
    {
        let source = source(edge);
        let before = NOW.load(Ordering::Relaxed);
        PEAK.store(before, Ordering::Relaxed);
        let options = BuildOptions { memory_bytes: mebibytes << 20, threads, ..options(core) };
        let built = try_build(&source, &options).unwrap_or_else(|e| panic!("{e}"));
        let peak = PEAK.load(Ordering::Relaxed) - before;
        let allowed = (mebibytes << 20) as usize + SLACK;
        println!(
            "MEASURED: {edge}^3 u16, bricks of {core}, {threads} threads asked for, {} used: budget {mebibytes} MiB, planned {:.1} MiB, peak {:.1} MiB",
            built.report.threads,
            built.report.memory_planned_bytes as f64 / 1048576.0,
            peak as f64 / 1048576.0
        );
        assert!(built.report.memory_planned_bytes <= mebibytes << 20, "the plan exceeds the budget");
        assert!(peak <= allowed, "{peak} bytes at the peak, {allowed} allowed");
    }
}
