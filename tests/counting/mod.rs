//! A global allocator that counts what this thread asks of it and hands on to the system's.

use core::alloc::{GlobalAlloc, Layout};
use core::cell::Cell;
use std::alloc::System;

struct Counting;

thread_local! {
    // Per thread, so that tests beside this one do not count. `const`: its start-up must not allocate.
    static TAKEN: Cell<usize> = const { Cell::new(0) };
    static FREED: Cell<usize> = const { Cell::new(0) };
}

fn count_one(which: &'static std::thread::LocalKey<Cell<usize>>) {
    // A thread that is being torn down has no counter any more, and counts nothing.
    let _ = which.try_with(|c| c.set(c.get() + 1));
}

// SAFETY: every call is handed on unchanged to the system's allocator, which keeps the contract of `GlobalAlloc`.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one(&TAKEN);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count_one(&FREED);
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one(&TAKEN);
        // SAFETY: the caller keeps the contract of `realloc`.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Calls for memory so far.
pub(crate) fn taken() -> usize {
    TAKEN.with(Cell::get)
}

/// Calls of any kind so far: freeing takes the allocator's lock as well.
pub(crate) fn calls() -> usize {
    taken() + FREED.with(Cell::get)
}
