//! Laws of formulas, monitors and robustness, checked on random ones and against a reference that
//! follows the definitions.

mod dense;
mod dense_diagnosis;
mod dense_laws;
mod discrete;
mod equivalence;
mod naive;
mod names;
mod online;
mod parts;
mod random_signals;
mod spans;
mod statements;
mod vacuity;
