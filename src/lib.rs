//! Mishandle.
