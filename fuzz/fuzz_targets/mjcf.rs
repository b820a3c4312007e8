#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| mishandle_fuzz::mjcf::check(bytes));
