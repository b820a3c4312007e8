//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

mod check;
mod guarded;
mod hostile;
mod process;
mod simulations;
mod tank;
