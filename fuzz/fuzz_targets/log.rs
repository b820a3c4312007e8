#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| mishandle_fuzz::log::check(bytes));
