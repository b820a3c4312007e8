//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

mod chasing_cars;
mod power_mode;
mod problems;
mod reference;
