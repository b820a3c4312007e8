//! What a run says about itself: written once, when its file is created.

/// What kind of run a file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RunKind {
    /// Trials that search for a violation.
    Falsify,
    /// Episodes that measure rates.
    Evaluate,
}

/// The program that made a run, as texts given by the caller; what is unknown is left empty.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Build {
    /// Version of the program, such as `0.1.0`.
    pub program_version: String,
    /// Git commit that it was built from.
    pub git_commit: String,
    /// Target triple that it was built for.
    pub target: String,
    /// Version of the Rust compiler.
    pub rustc: String,
    /// Version of the physics, such as `3.17.0`.
    pub mujoco_version: String,
    /// Architecture and instruction set of the machine that ran it.
    pub architecture: String,
}

/// One axis of the box of initial configurations.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Name of the axis, unique within its box.
    pub name: String,
    /// Unit of the axis, such as `m` or `rad`; empty if it has none.
    pub unit: String,
    /// Lower bound, in that unit.
    pub low: f64,
    /// Upper bound, in that unit.
    pub high: f64,
}

/// What was run, by which build, from which plan.
///
/// All of it is given by the caller and comes back as it was given. There is no time or date in it, so that
/// the same run gives the same header.
#[derive(Debug, Clone, PartialEq)]
pub struct RunHeader {
    /// Whether the run falsifies or evaluates.
    pub kind: RunKind,
    /// The program that made the run.
    pub build: Build,
    /// The resolved plan, as TOML.
    pub plan: String,
    /// Name or path of the controller, as the plan gives it.
    pub controller: String,
    /// Hash of what the controller means: its weights and its settings.
    pub controller_hash: String,
    /// Hash of the bytes of the controller's file.
    pub controller_bytes_hash: String,
    /// Name of the task.
    pub task: String,
    /// Name of the task preset.
    pub preset: String,
    /// Text of the formula whose robustness is recorded.
    pub formula: String,
    /// Name of the search.
    pub search: String,
    /// Seed of the whole run.
    pub seed: u64,
    /// Duration of a control step, in seconds.
    pub control_dt: f64,
    /// Names of a trace's signals, in the order of [`Trace::columns`](crate::Trace::columns).
    pub signals: Vec<String>,
    /// The axes of an initial configuration, in its order.
    pub axes: Vec<Axis>,
    /// Names of the further verdicts of a simulation, in the order of
    /// [`Simulation::verdicts`](crate::Simulation::verdicts).
    pub verdicts: Vec<String>,
}
