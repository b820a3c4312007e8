//! The paper's tables, from small campaigns and from the kept results.

#![allow(clippy::unwrap_used)]

mod recompute;
mod reproduce;
mod units;
