//! The header of a run, which is written when the file is created. Later, versions can be added.

/// Kind of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RunKind {
    /// A falsification: trials that search for a counterexample.
    Falsify,
    /// An evaluation: episodes with random scenarios.
    Evaluate,
    /// A search for the smallest disturbance that violates the requirement.
    Margin,
    /// Relations between pairs of scenarios.
    Metamorphic,
    /// An estimation of the failure probability.
    Risk,
}

impl RunKind {
    /// All kinds with their names, which are those of the commands and of the plan's tables.
    pub const ALL: [(RunKind, &str); 5] = [
        (RunKind::Evaluate, "evaluate"),
        (RunKind::Falsify, "falsify"),
        (RunKind::Margin, "margin"),
        (RunKind::Metamorphic, "metamorphic"),
        (RunKind::Risk, "risk"),
    ];

    /// Returns the name of the command that makes runs of this kind.
    pub fn name(self) -> &'static str {
        RunKind::ALL.iter().find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }

    /// Returns the kind with this name.
    pub fn of_name(name: &str) -> Option<RunKind> {
        RunKind::ALL.iter().find(|(_, known)| *known == name).map(|(kind, _)| *kind)
    }
}

/// The program that made a run. Unknown fields are empty.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BuildRecord {
    /// Version of the program, such as `0.1.0`.
    pub program_version: String,
    /// Git commit of the source code.
    pub git_commit: String,
    /// Target triple of the build.
    pub target: String,
    /// Version of the Rust compiler.
    pub rustc: String,
    /// Architecture and instruction set of the build.
    pub architecture: String,
}

/// The system under test.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TargetRecord {
    /// Kind of target, such as `task` or `python`.
    pub kind: String,
    /// Name of the target.
    pub name: String,
    /// Hash of the target's content; empty if unknown.
    pub hash: String,
    /// Whether the same scenario and seed give the same trace.
    pub is_deterministic: bool,
}

/// An exchangeable part of the system under test.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ComponentRecord {
    /// Role of the component, such as `controller`.
    pub role: String,
    /// Name or path, as in the plan.
    pub name: String,
    /// Hash of the content that determines the behavior: weights and settings.
    pub hash: String,
    /// Hash of the bytes of the file; empty if there is no file.
    pub file_hash: String,
}

impl ComponentRecord {
    /// Role of a part that no hash covers. Its name describes it, and its hashes are empty.
    pub const NOT_COVERED: &str = "not covered";

    /// Returns whether no hash covers this part.
    pub fn is_not_covered(&self) -> bool {
        self.role == Self::NOT_COVERED
    }
}

/// A formula of the target.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FormulaRecord {
    /// Name of the formula, unique within the run.
    pub name: String,
    /// Text of the formula.
    pub text: String,
}

/// A recorded signal.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SignalRecord {
    /// Name of the signal, unique within the run.
    pub name: String,
    /// Unit of the signal, such as `m`; empty if it has none.
    pub unit: String,
}

/// One axis of the scenario space.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AxisRecord {
    /// Name of the axis, unique within the run.
    pub name: String,
    /// Unit of the axis, such as `m` or `rad`; empty if it has none.
    pub unit: String,
    /// Kind of the axis, such as `start` or `model`.
    pub kind: String,
    /// Lower bound, in that unit.
    pub low: f64,
    /// Upper bound, in that unit.
    pub high: f64,
    /// Value of the undisturbed episode; `None` if it is a random draw.
    pub nominal: Option<f64>,
    /// The values between the bounds that the axis can take, such as `continuous`. Column `domain`
    /// of the file.
    pub values: String,
    /// Description for people; may be empty.
    pub meaning: String,
}

/// The header of a run: plan, target, scenario space and build.
///
/// The caller provides all of it, and reading returns it unchanged. It contains no time or date, so
/// that equal runs have equal headers.
#[derive(Debug, Clone, PartialEq)]
pub struct RunHeader {
    /// Whether the run falsifies or evaluates.
    pub kind: RunKind,
    /// The program that made the run.
    pub build: BuildRecord,
    /// Name and version of each dependency that affects episodes, such as (`MuJoCo`, `3.17.0`), and
    /// each further program that continued the run.
    pub versions: Vec<(String, String)>,
    /// The resolved plan, as TOML.
    pub plan: String,
    /// The system under test.
    pub target: TargetRecord,
    /// The exchangeable parts of the target, such as its controller.
    pub components: Vec<ComponentRecord>,
    /// Name of the scenario space.
    pub space: String,
    /// Text of the requirement. Simulations record its robustness.
    pub formula: String,
    /// All named formulas of the target.
    pub formulas: Vec<FormulaRecord>,
    /// Name of the search.
    pub search: String,
    /// Random seed of the whole run.
    pub seed: u64,
    /// Duration of a control step, in seconds.
    pub control_dt: f64,
    /// Control steps of a complete episode.
    pub episode_steps: u32,
    /// The signals of a trace, in the order of
    /// [`StoredTrace::columns`](crate::StoredTrace::columns).
    pub signals: Vec<SignalRecord>,
    /// The axes of the scenario space, in the order of
    /// [`Simulation::scenario`](crate::Simulation::scenario).
    pub axes: Vec<AxisRecord>,
    /// Names of the verdicts in addition to the robustness, in the order of
    /// [`Simulation::verdicts`](crate::Simulation::verdicts).
    pub verdicts: Vec<String>,
    /// Warnings of the checks before the first simulation, in words.
    pub preflight: Vec<String>,
}
