//! Learned policies, their file format, and the parts that experts are made of.

pub mod kinematic;
