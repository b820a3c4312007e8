//! The largest size of each kind of file that the program reads, in bytes.
//!
//! | constant | files | limit |
//! |---|---|--:|
//! | [`PLAN`] | plans | 128 KiB |
//! | [`SETTINGS`] | training settings | 128 KiB |
//! | [`SCENARIOS`] | tables of scenarios for training | 64 MiB |
//! | [`CONTROLLER`] | controllers, and their records | 256 MiB |
//! | [`ONNX`] | ONNX models | 64 MiB |
//! | [`MODEL`] | MJCF and URDF files, meshes and textures, each | 64 MiB |
//! | [`CHECKPOINT`] | checkpoints of training runs | 64 GiB |
//! | [`TENSOR_HEADER`] | the header of a controller or a checkpoint | 1 MiB |
//! | [`CURVE`] | learning curves | 256 MiB |
//! | [`COUNTEREXAMPLE`] | counterexamples | 1 MiB |
//! | [`RESULT`] | results of hardenings | 4 MiB |
//!
//! Each is far above the largest file that the program writes in practice.

const MIB: u64 = 1 << 20;

/// Plans. A parsed plan of many tables takes a thousand times its size.
pub const PLAN: u64 = MIB / 8;

/// Training settings. As for plans.
pub const SETTINGS: u64 = MIB / 8;

/// Tables of scenarios for training: 20,000 of 100 axes.
pub const SCENARIOS: u64 = 64 * MIB;

/// Controllers: a policy of 67 million parameters. Their records.
pub const CONTROLLER: u64 = 256 * MIB;

/// ONNX models: a policy of 16 million parameters. A model is in memory up to four times while it
/// is checked.
pub const ONNX: u64 = 64 * MIB;

/// Files of a robot's model: a mesh of a million triangles.
pub const MODEL: u64 = 64 * MIB;

/// Checkpoints, whose largest part is a replay buffer.
pub const CHECKPOINT: u64 = 64 * 1024 * MIB;

/// The header of a safetensors file.
pub const TENSOR_HEADER: u64 = MIB;

/// Learning curves: a million iterations.
pub const CURVE: u64 = 256 * MIB;

/// Counterexamples: scenarios of thousands of axes.
pub const COUNTEREXAMPLE: u64 = MIB;

/// Results of hardenings: thousands of failure modes.
pub const RESULT: u64 = 4 * MIB;
