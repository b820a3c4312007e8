//! A VFS of SQLite that forwards every call to the VFS of the system. On command, it returns an
//! error from the n-th call of a kind, and records the calls that change files.
//!
//! It replaces the default VFS of the process, so the code under test uses it without knowing. Its
//! settings are thread-local, so tests do not disturb each other. It never syncs to the real disk,
//! which would only cost time: the model in [`super::disk`] decides what a power cut leaves.
//!
//! SQLite maps the file ending in `-shm` into memory without the VFS. That file holds nothing of
//! value: after a power cut SQLite computes it from the log.

#![allow(unsafe_code, unsafe_op_in_unsafe_fn)] // SQLite calls these functions with its own valid pointers

use std::cell::{Cell, RefCell};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::Once;
use std::sync::atomic::{AtomicPtr, Ordering};

use rusqlite::ffi;

use super::disk::{Disk, FileId};

/// A kind of call that can fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Call {
    Open,
    Delete,
    Access,
    Read,
    Write,
    Truncate,
    Sync,
    FileSize,
    Lock,
    ShmMap,
    ShmLock,
}

/// The error of one call, or of it and all later calls of the kind.
#[derive(Debug, Clone, Copy)]
pub struct Fault {
    pub call: Call,
    /// Number of the call that fails, from 1.
    pub nth: u64,
    /// Whether all later calls fail, too, as on a disk that stays full.
    pub lasts: bool,
    /// Code of SQLite that the call returns.
    pub code: c_int,
}

thread_local! {
    static FAULT: Cell<Option<Fault>> = const { Cell::new(None) };
    static CALLS: RefCell<[u64; 11]> = const { RefCell::new([0; 11]) };
    static FAILED: Cell<bool> = const { Cell::new(false) };
    static DISK: RefCell<Option<Disk>> = const { RefCell::new(None) };
    static CHECKPOINT_PAGES: Cell<c_int> = const { Cell::new(1000) };
}

/// Sets the fault of this thread and counts calls from 0.
pub fn set_fault(fault: Option<Fault>) {
    FAULT.set(fault);
    FAILED.set(false);
    CALLS.set([0; 11]);
}

/// Returns the number of calls of a kind since [`set_fault`].
pub fn calls(call: Call) -> u64 {
    CALLS.with_borrow(|calls| calls[call as usize])
}

/// Returns whether the fault has happened.
pub fn has_failed() -> bool {
    FAILED.get()
}

/// Sets the number of pages after which SQLite moves the log into the file, for connections that
/// this thread opens. A small run otherwise never reaches SQLite's limit of 1,000 pages.
pub fn set_checkpoint_pages(pages: c_int) {
    CHECKPOINT_PAGES.set(pages);
}

/// Starts to record the calls of this thread that change files.
pub fn start_recording() {
    DISK.set(Some(Disk::default()));
}

/// Records that a step of the caller has succeeded.
pub fn mark() {
    record(Disk::mark);
}

/// Returns the recorded calls.
pub fn stop_recording() -> Disk {
    DISK.take().unwrap_or_default()
}

fn record<T>(event: impl FnOnce(&mut Disk) -> T) -> Option<T> {
    DISK.with_borrow_mut(|disk| disk.as_mut().map(event))
}

/// Counts a call and returns its error, if it has to fail.
fn error_of(call: Call) -> Option<c_int> {
    let number = CALLS.with_borrow_mut(|calls| {
        calls[call as usize] += 1;
        calls[call as usize]
    });
    let fault = FAULT.get().filter(|fault| fault.call == call)?;
    let fails = number == fault.nth || (fault.lasts && number > fault.nth);
    FAILED.set(FAILED.get() || fails);
    fails.then_some(fault.code)
}

static REAL: AtomicPtr<ffi::sqlite3_vfs> = AtomicPtr::new(std::ptr::null_mut());

/// Makes this VFS the default of the process.
pub fn install() {
    static INSTALL: Once = Once::new();
    INSTALL.call_once(|| unsafe {
        let real = ffi::sqlite3_vfs_find(std::ptr::null());
        REAL.store(real, Ordering::Release);
        let shim = Box::leak(Box::new(*real));
        shim.zName = c"mishandle-faults".as_ptr();
        shim.szOsFile += size_of::<File>() as c_int;
        shim.pNext = std::ptr::null_mut();
        shim.xOpen = Some(open);
        shim.xDelete = Some(delete);
        shim.xAccess = Some(access);
        assert_eq!(ffi::sqlite3_vfs_register(shim, 1), ffi::SQLITE_OK);
        assert_eq!(ffi::sqlite3_auto_extension(Some(set_up_connection)), ffi::SQLITE_OK);
    });
}

unsafe extern "C" fn set_up_connection(
    connection: *mut ffi::sqlite3,
    _message: *mut *mut c_char,
    _api: *const ffi::sqlite3_api_routines,
) -> c_int {
    ffi::sqlite3_wal_autocheckpoint(connection, CHECKPOINT_PAGES.get())
}

/// A file of this VFS. The file of the real VFS follows in memory.
#[repr(C)]
struct File {
    base: ffi::sqlite3_file,
    /// `None` for a temporary file, which no power cut can leave.
    id: Option<FileId>,
    /// Whether the first sync also syncs the folder, as SQLite's VFS for Unix does.
    syncs_folder: bool,
}

static METHODS: ffi::sqlite3_io_methods = ffi::sqlite3_io_methods {
    // Version 3 adds memory-mapped reads and writes, which this program does not enable.
    iVersion: 2,
    xClose: Some(close),
    xRead: Some(read),
    xWrite: Some(write),
    xTruncate: Some(truncate),
    xSync: Some(sync),
    xFileSize: Some(file_size),
    xLock: Some(lock),
    xUnlock: Some(unlock),
    xCheckReservedLock: Some(check_reserved_lock),
    xFileControl: Some(file_control),
    xSectorSize: Some(sector_size),
    xDeviceCharacteristics: Some(device_characteristics),
    xShmMap: Some(shm_map),
    xShmLock: Some(shm_lock),
    xShmBarrier: Some(shm_barrier),
    xShmUnmap: Some(shm_unmap),
    xFetch: None,
    xUnfetch: None,
};

unsafe fn real(file: *mut ffi::sqlite3_file) -> *mut ffi::sqlite3_file {
    file.byte_add(size_of::<File>())
}

/// Calls a method of the real file or the real VFS.
macro_rules! forward {
    (vfs.$method:ident($($argument:expr),*)) => {{
        let real = REAL.load(Ordering::Acquire);
        (*real).$method.unwrap()(real, $($argument),*)
    }};
    ($file:ident.$method:ident($($argument:expr),*)) => {{
        let real = real($file);
        (*(*real).pMethods).$method.unwrap()(real, $($argument),*)
    }};
}

unsafe fn text<'a>(name: *const c_char) -> &'a str {
    CStr::from_ptr(name).to_str().unwrap()
}

unsafe extern "C" fn open(
    _vfs: *mut ffi::sqlite3_vfs,
    name: ffi::sqlite3_filename,
    file: *mut ffi::sqlite3_file,
    flags: c_int,
    out_flags: *mut c_int,
) -> c_int {
    (*file).pMethods = std::ptr::null();
    if let Some(code) = error_of(Call::Open) {
        return code;
    }
    let before = if name.is_null() { None } else { std::fs::read(text(name)).ok() };
    let code = forward!(vfs.xOpen(name, real(file), flags, out_flags));
    if code == ffi::SQLITE_OK {
        let shim = file.cast::<File>();
        (*shim).base.pMethods = &raw const METHODS;
        (*shim).id =
            if name.is_null() { None } else { record(|disk| disk.open(text(name), before.as_deref())) };
        let journals = ffi::SQLITE_OPEN_MAIN_JOURNAL | ffi::SQLITE_OPEN_WAL;
        (*shim).syncs_folder = flags & ffi::SQLITE_OPEN_CREATE != 0 && flags & journals != 0;
    }
    code
}

unsafe extern "C" fn delete(_vfs: *mut ffi::sqlite3_vfs, name: *const c_char, sync_folder: c_int) -> c_int {
    if let Some(code) = error_of(Call::Delete) {
        return code;
    }
    let code = forward!(vfs.xDelete(name, 0));
    if code == ffi::SQLITE_OK {
        record(|disk| disk.remove(text(name), sync_folder != 0));
    }
    code
}

unsafe extern "C" fn access(
    _vfs: *mut ffi::sqlite3_vfs,
    name: *const c_char,
    flags: c_int,
    out: *mut c_int,
) -> c_int {
    match error_of(Call::Access) {
        Some(code) => code,
        None => forward!(vfs.xAccess(name, flags, out)),
    }
}

unsafe extern "C" fn close(file: *mut ffi::sqlite3_file) -> c_int {
    forward!(file.xClose())
}

unsafe extern "C" fn read(
    file: *mut ffi::sqlite3_file,
    buffer: *mut c_void,
    amount: c_int,
    offset: ffi::sqlite3_int64,
) -> c_int {
    match error_of(Call::Read) {
        Some(code) => code,
        None => forward!(file.xRead(buffer, amount, offset)),
    }
}

unsafe extern "C" fn write(
    file: *mut ffi::sqlite3_file,
    buffer: *const c_void,
    amount: c_int,
    offset: ffi::sqlite3_int64,
) -> c_int {
    let failure = error_of(Call::Write);
    // A disk that becomes full takes a part of the bytes.
    let amount = match failure {
        Some(ffi::SQLITE_FULL) => amount / 2,
        Some(code) => return code,
        None => amount,
    };
    let code = forward!(file.xWrite(buffer, amount, offset));
    if let (ffi::SQLITE_OK, Some(id)) = (code, (*file.cast::<File>()).id) {
        let bytes = std::slice::from_raw_parts(buffer.cast::<u8>(), amount as usize);
        record(|disk| disk.write(id, offset as usize, bytes));
    }
    failure.unwrap_or(code)
}

unsafe extern "C" fn truncate(file: *mut ffi::sqlite3_file, size: ffi::sqlite3_int64) -> c_int {
    if let Some(code) = error_of(Call::Truncate) {
        return code;
    }
    let code = forward!(file.xTruncate(size));
    if let (ffi::SQLITE_OK, Some(id)) = (code, (*file.cast::<File>()).id) {
        record(|disk| disk.truncate(id, size as usize));
    }
    code
}

unsafe extern "C" fn sync(file: *mut ffi::sqlite3_file, _flags: c_int) -> c_int {
    if let Some(code) = error_of(Call::Sync) {
        return code;
    }
    let shim = file.cast::<File>();
    let syncs_folder = std::mem::replace(&mut (*shim).syncs_folder, false);
    if let Some(id) = (*shim).id {
        record(|disk| disk.sync(id, syncs_folder));
    }
    ffi::SQLITE_OK
}

unsafe extern "C" fn file_size(file: *mut ffi::sqlite3_file, size: *mut ffi::sqlite3_int64) -> c_int {
    match error_of(Call::FileSize) {
        Some(code) => code,
        None => forward!(file.xFileSize(size)),
    }
}

unsafe extern "C" fn lock(file: *mut ffi::sqlite3_file, level: c_int) -> c_int {
    match error_of(Call::Lock) {
        Some(code) => code,
        None => forward!(file.xLock(level)),
    }
}

unsafe extern "C" fn unlock(file: *mut ffi::sqlite3_file, level: c_int) -> c_int {
    forward!(file.xUnlock(level))
}

unsafe extern "C" fn check_reserved_lock(file: *mut ffi::sqlite3_file, out: *mut c_int) -> c_int {
    forward!(file.xCheckReservedLock(out))
}

unsafe extern "C" fn file_control(
    file: *mut ffi::sqlite3_file,
    operation: c_int,
    argument: *mut c_void,
) -> c_int {
    forward!(file.xFileControl(operation, argument))
}

unsafe extern "C" fn sector_size(file: *mut ffi::sqlite3_file) -> c_int {
    forward!(file.xSectorSize())
}

unsafe extern "C" fn device_characteristics(file: *mut ffi::sqlite3_file) -> c_int {
    forward!(file.xDeviceCharacteristics())
}

unsafe extern "C" fn shm_map(
    file: *mut ffi::sqlite3_file,
    page: c_int,
    page_size: c_int,
    extend: c_int,
    out: *mut *mut c_void,
) -> c_int {
    match error_of(Call::ShmMap) {
        Some(code) => code,
        None => forward!(file.xShmMap(page, page_size, extend, out)),
    }
}

unsafe extern "C" fn shm_lock(
    file: *mut ffi::sqlite3_file,
    offset: c_int,
    count: c_int,
    flags: c_int,
) -> c_int {
    // SQLite ignores errors when it unlocks, and would then never release the lock.
    let failure = if flags & ffi::SQLITE_SHM_LOCK == 0 { None } else { error_of(Call::ShmLock) };
    match failure {
        Some(code) => code,
        None => forward!(file.xShmLock(offset, count, flags)),
    }
}

unsafe extern "C" fn shm_barrier(file: *mut ffi::sqlite3_file) {
    forward!(file.xShmBarrier());
}

unsafe extern "C" fn shm_unmap(file: *mut ffi::sqlite3_file, delete: c_int) -> c_int {
    forward!(file.xShmUnmap(delete))
}
