//! Allocator that ends the program if the system has no memory left: one message, exit code 3, no unfinished files.
//!
//! By default, Rust aborts wherever the allocation failed: in our code or in that of a library.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

use supervol_format::cast::index;

/// Greatest length of the message.
const SENTENCE_BYTES: usize = 256;

/// System allocator; a failed allocation ends the program.
#[derive(Debug)]
pub struct ExitOnOutOfMemory;

// SAFETY: every call goes to the system allocator unchanged; if it fails, the process ends and nothing is returned.
unsafe impl GlobalAlloc for ExitOnOutOfMemory {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_exit(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_exit(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the caller's promises are the system allocator's conditions.
        or_exit(unsafe { System.realloc(block, layout, new_size) }, new_size)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.dealloc(block, layout) }
    }
}

fn or_exit(block: *mut u8, bytes: usize) -> *mut u8 {
    if block.is_null() { end(bytes) } else { block }
}

/// Uses little memory itself: the refused allocation is nearly always a large buffer.
#[cold]
fn end(bytes: usize) -> ! {
    let _none_begins = supervol_files::unfinished::remove_all();
    // On the stack, because allocation has failed.
    let mut sentence = std::io::Cursor::new([0; SENTENCE_BYTES]);
    let _ = writeln!(
        sentence,
        "supervol: out of memory: the system refused {bytes} bytes. Use a lower --memory or --host-memory"
    );
    let written = index(sentence.position());
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
