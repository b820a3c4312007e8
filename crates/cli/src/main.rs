//! The command line of Mishandle.

fn main() {}
