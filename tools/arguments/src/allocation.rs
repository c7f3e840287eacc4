//! What happens when the system has no memory left: a sentence and exit code 3, with nothing half written left behind.
//!
//! Rust's own answer is to abort, from wherever the memory was wanted: in our code, or in that of a library.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

/// Room for what is said.
const SENTENCE_BYTES: usize = 256;

/// The system's allocator; the program ends when it has nothing to give.
pub struct OrEnd;

// SAFETY: every call goes to the system's allocator unchanged; where it fails the process ends, and nothing is returned.
unsafe impl GlobalAlloc for OrEnd {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_end(unsafe { System.realloc(block, layout, new_size) }, new_size)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.dealloc(block, layout) }
    }
}

fn or_end(block: *mut u8, bytes: usize) -> *mut u8 {
    if block.is_null() { end(bytes) } else { block }
}

/// Takes little memory itself: what was refused is nearly always a large buffer.
#[cold]
fn end(bytes: usize) -> ! {
    let _none_begins = supervol_files::unfinished::remove_all();
    // On the stack: nothing is to be allocated for it.
    let mut sentence = std::io::Cursor::new([0; SENTENCE_BYTES]);
    let _ = writeln!(
        sentence,
        "supervol: out of memory: the system refused {bytes} bytes. Use a lower --memory or --host-memory"
    );
    let written = sentence.position() as usize;
    let _ = std::io::stderr().write_all(&sentence.get_ref()[..written]);
    exit()
}

#[cfg(unix)]
fn exit() -> ! {
    signal_hook::low_level::exit(3)
}

#[cfg(not(unix))]
fn exit() -> ! {
    std::process::exit(3)
}
