//! Traces, temporal-logic formulas and their robustness.
