//! The largest size of each kind of file that the program reads, in bytes.
//!
//! | constant | files | limit |
//! |---|---|--:|
//! | [`PLAN`] | plans | 1 MiB |
//! | [`SETTINGS`] | training settings | 1 MiB |
//! | [`CONTROLLER`] | controllers, and other files of the controller zoo | 256 MiB |
//! | [`CHECKPOINT`] | checkpoints of training runs | 64 GiB |
//! | [`TENSOR_HEADER`] | the header of a controller or a checkpoint | 1 MiB |
//! | [`CURVE`] | learning curves | 256 MiB |
//!
//! Each is far above the largest file that the program writes in practice.

const MIB: u64 = 1 << 20;

/// Plans.
pub const PLAN: u64 = MIB;

/// Training settings.
pub const SETTINGS: u64 = MIB;

/// Controllers: a policy of 67 million parameters. Records and pages of the controller zoo.
pub const CONTROLLER: u64 = 256 * MIB;

/// Checkpoints, whose largest part is a replay buffer.
pub const CHECKPOINT: u64 = 64 * 1024 * MIB;

/// The header of a safetensors file.
pub const TENSOR_HEADER: u64 = MIB;

/// Learning curves: a million iterations.
pub const CURVE: u64 = 256 * MIB;
