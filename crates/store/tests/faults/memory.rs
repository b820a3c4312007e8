//! The memory of SQLite, which is exhausted on command.

#![allow(unsafe_code, unsafe_op_in_unsafe_fn)] // SQLite calls these functions with its own valid pointers

use std::cell::Cell;
use std::ffi::{c_int, c_void};
use std::sync::{Once, OnceLock};

use rusqlite::ffi;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
    static FAILING: Cell<(u64, bool)> = const { Cell::new((0, false)) };
}

type Allocate = unsafe extern "C" fn(c_int) -> *mut c_void;
type Reallocate = unsafe extern "C" fn(*mut c_void, c_int) -> *mut c_void;

/// SQLite's own functions.
static REAL: OnceLock<(Allocate, Reallocate)> = OnceLock::new();

/// Fails the n-th allocation of this thread from now on, and all later ones if it `lasts`. 0 fails
/// none.
pub fn fail(nth: u64, lasts: bool) {
    ALLOCATIONS.set(0);
    FAILING.set((nth, lasts));
}

/// Returns the number of allocations since [`fail`].
pub fn allocations() -> u64 {
    ALLOCATIONS.get()
}

fn fails() -> bool {
    ALLOCATIONS.set(ALLOCATIONS.get() + 1);
    let (nth, lasts) = FAILING.get();
    nth != 0 && (ALLOCATIONS.get() == nth || (lasts && ALLOCATIONS.get() > nth))
}

/// Replaces the memory allocator of SQLite. No SQLite function may be called before.
pub fn install() {
    static INSTALL: Once = Once::new();
    INSTALL.call_once(|| unsafe {
        let mut methods = std::mem::zeroed::<ffi::sqlite3_mem_methods>();
        assert_eq!(ffi::sqlite3_config(ffi::SQLITE_CONFIG_GETMALLOC, &raw mut methods), ffi::SQLITE_OK);
        REAL.get_or_init(|| (methods.xMalloc.unwrap(), methods.xRealloc.unwrap()));
        methods.xMalloc = Some(allocate);
        methods.xRealloc = Some(reallocate);
        assert_eq!(ffi::sqlite3_config(ffi::SQLITE_CONFIG_MALLOC, &raw mut methods), ffi::SQLITE_OK);
        // Otherwise, connections take small blocks from a buffer of their own.
        assert_eq!(ffi::sqlite3_config(ffi::SQLITE_CONFIG_LOOKASIDE, 0, 0), ffi::SQLITE_OK);
    });
}

unsafe extern "C" fn allocate(size: c_int) -> *mut c_void {
    match REAL.get().filter(|_| !fails()) {
        Some((allocate, _)) => allocate(size),
        None => std::ptr::null_mut(),
    }
}

unsafe extern "C" fn reallocate(block: *mut c_void, size: c_int) -> *mut c_void {
    match REAL.get().filter(|_| !fails()) {
        Some((_, reallocate)) => reallocate(block, size),
        None => std::ptr::null_mut(),
    }
}
