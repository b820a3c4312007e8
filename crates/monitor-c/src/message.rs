//! The text of the last error of each thread, in a buffer that is never allocated.

use std::cell::RefCell;
use std::ffi::c_char;
use std::fmt::{Arguments, Write};

use crate::MishandleStatus;

/// Bytes of a text with the 0 at its end.
const CAPACITY: usize = 512;

// The text comes first, so that a pointer to the buffer is one to the text.
#[repr(C)]
struct Buffer {
    bytes: [u8; CAPACITY],
    length: usize,
}

impl Write for Buffer {
    /// Appends what fits, whole characters only. A 0 would end the text.
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for character in text.chars() {
            let character = if character == '\0' { '\u{fffd}' } else { character };
            let end = self.length + character.len_utf8();
            if end >= CAPACITY {
                return Err(std::fmt::Error);
            }
            character.encode_utf8(&mut self.bytes[self.length..end]);
            self.length = end;
        }
        Ok(())
    }
}

thread_local! {
    static LAST: RefCell<Buffer> = const { RefCell::new(Buffer { bytes: [0; CAPACITY], length: 0 }) };
}

/// Keeps the text of an error, and returns its status.
pub fn fail(status: MishandleStatus, text: Arguments<'_>) -> MishandleStatus {
    // The buffer is borrowed while a text writes itself; a panic in there would come back here.
    LAST.with(|last| {
        if let Ok(mut buffer) = last.try_borrow_mut() {
            buffer.length = 0;
            // Texts that are too long are cut.
            let _cut = buffer.write_fmt(text);
            let end = buffer.length;
            buffer.bytes[end] = 0;
        }
    });
    status
}

/// Returns the text, which ends with 0.
pub fn last_message() -> *const c_char {
    LAST.with(|last| last.as_ptr().cast::<Buffer>()).cast_const().cast::<c_char>()
}
