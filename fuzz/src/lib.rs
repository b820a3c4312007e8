//! Laws that hold for all bytes. Each module checks one reader; the programs in `fuzz_targets` call
//! it with the inputs of libFuzzer. A broken law is a panic. libFuzzer itself finds crashes, inputs
//! that take longer than a second, and memory above its limit.
//!
//! A module also returns seeds: valid inputs from which the corpus was grown.

mod bytes;
pub mod checkpoint;
pub mod controller;
pub mod counterexample;
pub mod csv;
pub mod curve;
pub mod formula;
pub mod log;
pub mod mjcf;
pub mod monitor;
pub mod onnx;
pub mod plan;
mod run;
pub mod run_file;
mod scratch;
pub mod settings;
pub mod torch;
pub mod trace_blob;

/// A function that returns the seeds of a target.
type Seeds = fn() -> Vec<Vec<u8>>;

/// The seeds of every target, by its name.
pub const SEEDS: [(&str, Seeds); 15] = [
    ("checkpoint", checkpoint::seeds),
    ("controller", controller::seeds),
    ("counterexample", counterexample::seeds),
    ("csv", csv::seeds),
    ("curve", curve::seeds),
    ("formula", formula::seeds),
    ("log", log::seeds),
    ("mjcf", mjcf::seeds),
    ("monitor", monitor::seeds),
    ("onnx", onnx::seeds),
    ("plan", plan::seeds),
    ("run_file", run_file::seeds),
    ("settings", settings::seeds),
    ("torch", torch::seeds),
    ("trace_blob", trace_blob::seeds),
];
