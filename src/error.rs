//! Errors of plans and of the runs that execute them.

mod curve;
mod remedies;

use std::error::Error;
use std::iter::successors;
use std::path::{Path, PathBuf};

use mishandle_training::TrainingError;

pub use curve::CurveProblem;

/// An error in a plan or its arguments, or in the run that executes it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MishandleError {
    /// The name is unknown.
    #[error("there is no {kind} `{name}`; choose from: {}", names(known))]
    UnknownName {
        /// Kind of the named object, such as `task`.
        kind: &'static str,
        /// Name given by the user.
        name: String,
        /// Known names.
        known: Vec<String>,
    },
    /// The target is a path, but not that of a target file.
    #[error(
        "{}; a target is a name such as ball-balancing, which `mishandle list` shows, or the path of a target file (.toml)",
        not_a_target(name)
    )]
    NotATarget {
        /// The path.
        name: String,
    },
    /// A task needs a controller, and the plan names none.
    #[error("{target} needs a controller: give --controller NAME or FILE; shipped are: {}", known.join(", "))]
    NoController {
        /// Name of the task.
        target: String,
        /// Names of the task's shipped controllers.
        known: Vec<String>,
    },
    /// The option applies to tasks only.
    #[error("{target} does not support {option}; only tasks do")]
    UnsupportedOption {
        /// Name of the target.
        target: String,
        /// Name of the option.
        option: &'static str,
    },
    /// A file names a program that the user has not allowed.
    #[error(
        "the {role} is the program `{command}`, which a file names; if you trust the file, allow it with {variable}=1 in \
         the environment"
    )]
    ProgramNotAllowed {
        /// Simulator, policy or trainer.
        role: &'static str,
        /// Command of the program.
        command: String,
        /// Variable of the environment that allows programs.
        variable: &'static str,
    },
    /// The trainer of a hardening gave no controller.
    #[error(
        "the trainer `{command}` {problem}; what is recorded remains, and --resume calls it again; the end of {}: {end}",
        log.display()
    )]
    Trainer {
        /// Command of the trainer.
        command: String,
        /// Its failure, as a verb.
        problem: String,
        /// File with all that it printed.
        log: PathBuf,
        /// Last lines of this file.
        end: String,
    },
    /// A simulation of others would start a program.
    #[error("its simulator or its policy is a program, and no program is started from a file of others")]
    ForeignProgram,
    /// The plan is not valid TOML.
    #[error("line {line} of the plan, `{found}`, is not valid TOML: {message}")]
    PlanSyntax {
        /// Line of the plan, counted from 1.
        line: usize,
        /// The line, or the start of a long one.
        found: String,
        /// Message of the TOML parser.
        message: String,
    },
    /// The plan has an unknown key.
    #[error("line {line} of the plan: there is no key `{key}`; known keys are: {}", keys_beside(key, known))]
    UnknownPlanKey {
        /// Line of the plan, counted from 1.
        line: usize,
        /// Table and key.
        key: String,
        /// All keys of plans.
        known: Vec<&'static str>,
    },
    /// There is no key with this name.
    #[error("there is no key `{key}`; known keys are: {}", keys_beside(key, known))]
    UnknownKey {
        /// Table and key.
        key: String,
        /// All keys.
        known: Vec<&'static str>,
    },
    /// A key was set to a value of the wrong type.
    #[error("the key `{key}` is {found}; it must be {expected}")]
    KeyValue {
        /// Table and key.
        key: String,
        /// The value as written.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// A key of the plan has a value of the wrong type.
    #[error("line {line} of the plan: the key `{key}` is {found}; it must be {expected}")]
    PlanValue {
        /// Line of the plan, counted from 1.
        line: usize,
        /// Table and key.
        key: String,
        /// The value as written.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// A plan sets an axis to a value that it cannot have.
    #[error("the axis {axis} cannot be {setting}: expected {expected}")]
    AxisSetting {
        /// Name of the axis.
        axis: String,
        /// The value as written.
        setting: String,
        /// Allowed values.
        expected: String,
    },
    /// A plan sets an axis that has no effect with the values of the other axes.
    #[error("the axis {axis} has no effect: set {} so that it has one", needed.join(" and "))]
    IdleAxis {
        /// Name of the axis.
        axis: String,
        /// Names of the axes that decide.
        needed: Vec<String>,
    },
    /// The plan has a newer format.
    #[error("the plan has format {found}, this program reads format {known}: use a newer Mishandle")]
    NewerPlan {
        /// Format of the plan.
        found: u32,
        /// Format that this program reads.
        known: u32,
    },
    /// The plan has an older format.
    #[error(
        "the plan has format {found}, this program reads format {known}: write it again with the keys of docs/reference/plans.md"
    )]
    OlderPlan {
        /// Format of the plan.
        found: u32,
        /// Format that this program reads.
        known: u32,
    },
    /// A run of a campaign has an invalid plan.
    #[error("run `{name}` of the campaign")]
    CampaignRun {
        /// Name of the run.
        name: String,
        /// Cause of the error.
        source: Box<MishandleError>,
    },
    /// A folder does not contain a complete campaign.
    #[error("{} is not the folder of a campaign: there is no file {}", path.display(), file.display())]
    NoCampaign {
        /// Path of the folder.
        path: PathBuf,
        /// The missing file.
        file: PathBuf,
    },
    /// A run file or hardening in the folder of a campaign is not that of its run.
    #[error("{} does not belong to the run `{name}`: {problem}", path.display())]
    CampaignMismatch {
        /// Path of the file.
        path: PathBuf,
        /// Name of the run.
        name: String,
        /// The difference.
        problem: String,
    },
    /// The folder in `MISHANDLE_HOME` does not contain the shipped files.
    #[error("MISHANDLE_HOME is `{}`, which has no folder `{folder}`", path.display())]
    Home {
        /// Value of the variable.
        path: PathBuf,
        /// Name of the missing folder.
        folder: &'static str,
    },
    /// Units of a file of requirements are wrong.
    #[error("{problem}")]
    Units {
        /// The problem.
        problem: String,
    },
    /// A requirement of a file is wrong.
    #[error("requirement `{name}`")]
    OfRequirement {
        /// Its name.
        name: String,
        /// Cause of the error.
        source: Box<MishandleError>,
    },
    /// The folder for a check or a bisection has other files.
    #[error(
        "{} has `{name}` and is not the folder of a {what}; choose another --out: a {what} writes no file into the folder of \
         something else",
        path.display()
    )]
    ForeignFolder {
        /// The thing that would be written, such as "check".
        what: &'static str,
        /// Path of the folder.
        path: PathBuf,
        /// A file in it.
        name: String,
    },
    /// The result of a check does not follow from its runs.
    #[error("{} does not follow from the runs of the check: {}", path.display(), problems.join("; "))]
    ChangedCheck {
        /// Path of the result.
        path: PathBuf,
        /// The differences.
        problems: Vec<String>,
    },
    /// Another process checks into the same folder.
    #[error("another check is writing {}; wait until it ends, or choose another --out", path.display())]
    CheckRuns {
        /// Path of the folder.
        path: PathBuf,
    },
    /// Another process writes to the same file.
    #[error("another training run is writing {}; wait until it ends, or choose another {flag}", path.display())]
    Busy {
        /// Path of the file.
        path: PathBuf,
        /// Flag that sets the path.
        flag: &'static str,
    },
    /// An output file of a new training run exists.
    #[error("{} exists already; choose another {flag}, or resume with --resume", path.display())]
    Exists {
        /// The existing file.
        path: PathBuf,
        /// Flag of this output.
        flag: &'static str,
    },
    /// There is no checkpoint to resume from.
    #[error(
        "there is no checkpoint {} to resume from; to start again, delete the output files and omit --resume",
        path.display()
    )]
    NoCheckpoint {
        /// Path of the checkpoint.
        path: PathBuf,
    },
    /// Two outputs of a training run have the same path.
    #[error("{} is the path of both {first} and {second}; choose another {flag}", path.display())]
    SameOutput {
        /// The path.
        path: PathBuf,
        /// Name of the first output.
        first: &'static str,
        /// Name of the second output.
        second: &'static str,
        /// Flag of the second output.
        flag: &'static str,
    },
    /// The CSV file of a learning curve is damaged, or belongs to another training run.
    #[error("{}: {problem}", path.display())]
    Curve {
        /// Path of the file.
        path: PathBuf,
        /// Cause of the error.
        problem: CurveProblem,
    },
    /// A recorded simulation of an evaluation differs from the simulation of its plan.
    #[error(
        "simulation {number} of the run differs from simulation {number} of its plan: rows are missing or were added or \
         changed, or another build made the run and must resume it"
    )]
    SimulationMismatch {
        /// Number of the simulation.
        number: u32,
    },
    /// Recorded outcomes of a screening are those of other requests.
    #[error(
        "the screened chunk {number} of the run has other requests than chunk {number} of its plan: rows were changed, or \
         another build made the run and must resume it"
    )]
    ScreeningMismatch {
        /// Number of the chunk.
        number: u32,
    },
    /// The program lacks the device of a plan.
    #[error(
        "the device `{device}` needs the Python package with its extra: run pip install '.[gpu]' in a clone of Mishandle, then \
         the package's command `mishandle`"
    )]
    NoDevice {
        /// Name of the device.
        device: String,
    },
    /// The result of a hardening cannot be read.
    #[error(
        "{} is not the result of a hardening of this version: {problem}; delete the file and resume the hardening, which makes \
         it again from the recorded simulations, or choose another --out",
        path.display()
    )]
    HardeningResult {
        /// Path of the file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// A run cannot be continued with other settings, because the scenarios that its search
    /// proposed depend on them.
    #[error(
        "the run was made with other settings: {}; a run continues with its own settings only: pass those, or make a new run file",
        differences.join("; ")
    )]
    OtherSettings {
        /// Each difference, with the recorded and the given value.
        differences: Vec<String>,
    },
    /// Recorded scenarios do not fit the space of the new ones.
    #[error(
        "the scenarios of {} are of another space: {}; pass files that were made with the same axes",
        path.display(),
        differences.join("; ")
    )]
    OtherSpace {
        /// Path of the file.
        path: PathBuf,
        /// Each difference.
        differences: Vec<String>,
    },
    /// A file of failures is of another target, or of another version of it.
    #[error(
        "{} has failures of {found}{}, and training on them needs those of {expected} as it is now: search again with \
         `mishandle falsify {} -k falsify.keep-going=true`",
        path.display(),
        if expected == found { " in another version" } else { "" },
        mishandle_text::shell_quote(target)
    )]
    ArchiveOfOtherTarget {
        /// Path of the file.
        path: PathBuf,
        /// Name of the target.
        expected: String,
        /// Name of the target in the file.
        found: String,
        /// The target as commands name it.
        target: String,
    },
    /// A run file contradicts its plan.
    #[error(
        "the run file does not match: {}; the target, its formulas or its space are others than those of the run, the file was \
         changed, or another build made it: pass what the run was made with, or make a new run file",
        differences.join("; ")
    )]
    RunMismatch {
        /// Each difference, with the recorded and the expected value.
        differences: Vec<String>,
    },
    /// Another build than those of the run would add rows to it.
    #[error(
        "another build made the run, and its rows would stand beside those of this one: {}; continue it with the build of the \
         run, or set `engine.any-build`, which records this build in the run file, too",
        differences.join("; ")
    )]
    OtherBuild {
        /// Each difference, with the recorded and the present value.
        differences: Vec<String>,
    },
    /// A system that is not part of this program does something else than in the run.
    #[error(
        "the system is not that of the run, although its hash is the recorded one: the first recorded simulation differs: {}; \
         resume with the code, data and libraries of the run, or make a new run file",
        differences.join("; ")
    )]
    OtherSystem {
        /// Each difference, with the recorded and the repeated value.
        differences: Vec<String>,
    },
    /// A recorded simulation has no digest of its trace, so no replay could be compared with it.
    #[error("the run file was changed: simulation {number} of trial {trial} has no digest of its trace")]
    NoDigest {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// The simulation has no robustness.
    #[error(
        "simulation {number} of trial {trial} has no robustness, so there is nothing to explain; choose another one{}",
        if reason.is_empty() { String::new() } else { format!("\nit ended because: {reason}") }
    )]
    NothingToExplain {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Why it ended so, in the words of the target; empty if it said nothing.
        reason: String,
    },
    /// The formula is too long to be explained.
    #[error("the formula has {subformulas} sub-formulas; one with more than {limit} cannot be explained")]
    LongFormula {
        /// Number of sub-formulas.
        subformulas: usize,
        /// Largest number that is explained.
        limit: usize,
    },
    /// The trace of a simulation of a Python system is not stored.
    #[error(
        "simulation {number} of trial {trial} has no recorded trace, because it is no counterexample{}. The system of the run is \
         written in Python, so replay it there: {replay}",
        if *run_has_counterexamples { "" } else { ", and the run has none" }
    )]
    TraceNotStored {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Whether the run has counterexamples, whose traces are stored.
        run_has_counterexamples: bool,
        /// The call in Python that replays the simulation.
        replay: String,
    },
    /// Two runs cannot be compared pair by pair.
    #[error("the runs cannot be compared: {problem}")]
    NotComparable {
        /// The reason, and what to do.
        problem: String,
    },
    /// A bisection cannot begin or go on.
    #[error("{problem}")]
    Bisect {
        /// The reason, and what to do.
        problem: String,
    },
    /// A file is not a counterexample.
    #[error("not a counterexample file: {problem}")]
    CounterexampleFile {
        /// The problem, such as an unknown key.
        problem: String,
    },
    /// A counterexample file has a newer format.
    #[error(
        "the counterexample has format {found}, this program reads formats up to {known}: use a newer Mishandle"
    )]
    NewerCounterexample {
        /// Format of the file.
        found: u64,
        /// Newest format that this program reads.
        known: u64,
    },
    /// A simulation ended without a robustness.
    #[error("the simulation has no verdict: it ended with {end:?}")]
    NoVerdict {
        /// The end.
        end: mishandle_rollout::EpisodeEnd,
    },
    /// The first simulations of a search all failed.
    #[error(
        "the first {count} simulations have no verdict, so the search stopped; this is the end of the first one: {end}"
    )]
    NothingRuns {
        /// Number of simulations.
        count: u32,
        /// End of the first simulation, with its reason.
        end: String,
    },
    /// The space of a counterexample has other axes now.
    #[error("the counterexample has the axes {recorded}; the space {space} of {target} has: {found}")]
    CounterexampleAxes {
        /// Name of the target.
        target: String,
        /// Name of the space.
        space: String,
        /// Recorded axes.
        recorded: String,
        /// Present axes.
        found: String,
    },
    /// An answer is that of another question.
    #[error(transparent)]
    OtherQuestion(#[from] mishandle_results::OtherQuestion),
    /// The plan lacks the table of the command.
    #[error(
        "cannot {table}: the plan has no table [{table}]; add it, or resume a run with the command that made it"
    )]
    MissingPlanTable {
        /// Name of the missing table.
        table: &'static str,
    },
    /// A file of scenarios is wrong.
    #[error("the scenarios {}: {problem}", path.display())]
    ScenarioFile {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// Training shall show NaN to the policy.
    #[error(
        "{axis} may show NaN to the policy, from which none can learn: give --axis {axis}={}:{}",
        allowed[0],
        allowed[1]
    )]
    NotANumberInTraining {
        /// Axis of the fault.
        axis: String,
        /// Values without NaN.
        allowed: [f64; 2],
    },
    /// A value is out of its range.
    #[error("{what} is {value}; it must be {expected}")]
    InvalidValue {
        /// Meaning of the value.
        what: &'static str,
        /// Value given by the user.
        value: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// An initial state is outside the initial boxes of all task presets.
    #[error(
        "{axis} is {value} {unit}, outside the initial box: from {low} to {high} {unit} in task preset paper"
    )]
    OutsideBox {
        /// Axis whose value is outside.
        axis: &'static str,
        /// Value on that axis.
        value: f64,
        /// Unit of value and bounds.
        unit: &'static str,
        /// Lower bound of task preset `paper`.
        low: f64,
        /// Upper bound of task preset `paper`.
        high: f64,
    },
    /// The formula has no signal.
    #[error(
        "`{formula}` contains no signal, so every episode has the same verdict; use signals of the target, which `mishandle list targets` lists"
    )]
    ConstantFormula {
        /// Text of the formula.
        formula: String,
    },
    /// The formula reaches past the end of an episode, so that no episode can decide it.
    #[error("`{formula}` needs {needed} control step{}, an episode has {steps}: no episode can decide it",
        if needed == "1" { "" } else { "s" })]
    Undecidable {
        /// Text of the formula.
        formula: String,
        /// Control steps that the formula needs.
        needed: String,
        /// Control steps of an episode.
        steps: usize,
    },
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// An output of a training run cannot be written.
    #[error("cannot write the {what} {}", path.display())]
    Write {
        /// Kind of output.
        what: &'static str,
        /// Path of the output.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A controller file is damaged, is not a controller, or is for another task.
    #[error(transparent)]
    Controller(#[from] mishandle_controllers::ControllerError),
    /// A policy in the format of another tool cannot be used.
    #[error(transparent)]
    Interchange(#[from] mishandle_interchange::InterchangeError),
    /// A guard cannot be made.
    #[error(transparent)]
    Guard(#[from] mishandle_controllers::guard::GuardError),
    /// The fallback of a guard cannot be loaded.
    #[error("the fallback of the guard, `{fallback}`: {source}")]
    Fallback {
        /// Its name or path.
        fallback: String,
        /// Why.
        source: Box<MishandleError>,
    },
    /// A key of the guard is missing.
    #[error("the guard has no `{key}`; expected {expected}")]
    GuardKey {
        /// The key.
        key: &'static str,
        /// Its value in words.
        expected: &'static str,
    },
    /// The threshold of a guard cannot be chosen.
    #[error("{}", too_few_to_tune(*failures, *successes, *scenarios, *fewest))]
    TooFewToTune {
        /// Number of training scenarios that violate the requirement.
        failures: usize,
        /// Number of those that satisfy it.
        successes: usize,
        /// Number of training scenarios.
        scenarios: u64,
        /// Fewest failures and fewest successes.
        fewest: usize,
    },
    /// The scene of pictures cannot be built or drawn.
    #[error(transparent)]
    World(#[from] mishandle_world::WorldError),
    /// A picture cannot be drawn by ray casting.
    #[error(transparent)]
    Camera(#[from] mishandle_camera::CameraError),
    /// A task cannot be built.
    #[error(transparent)]
    Task(#[from] mishandle_tasks::TaskError),
    /// A target file is wrong.
    #[error(transparent)]
    Robot(Box<mishandle_robots::RobotError>),
    /// A simulator that is a program does not work.
    #[error(transparent)]
    Simulator(#[from] mishandle_simulators::SimulatorError),
    /// An expert cannot be built.
    #[error("cannot build the expert of {task}")]
    Expert {
        /// Name of the task.
        task: String,
        /// Cause of the error.
        source: mishandle_world::WorldError,
    },
    /// Episodes cannot run.
    #[error(transparent)]
    Rollout(#[from] mishandle_rollout::RolloutError),
    /// The target of a run has other components now.
    #[error("the run was made with the components {recorded}; {target} now has: {found}")]
    ComponentMismatch {
        /// Name of the target.
        target: String,
        /// Roles of the recorded components.
        recorded: String,
        /// Roles of the present components.
        found: String,
    },
    /// The controller differs from the controller of the run.
    #[error(
        "controller `{controller}` is not the controller of the run: expected hash {recorded}, found {found}; if the \
         file was moved, give its new path as `engine.controller`"
    )]
    ControllerMismatch {
        /// Name or path in the plan.
        controller: String,
        /// Recorded hash.
        recorded: String,
        /// Hash of the present controller.
        found: String,
    },
    /// Parts of the target of a run differ from those of the run.
    #[error(
        "{} changed since the run: restore {}{}; with the change, make a new run",
        joined(parts),
        if parts.len() == 1 { "it" } else { "them" },
        if *has_file {
            ", or if unchanged files are elsewhere, give the path of the target file as `engine.target`"
        } else {
            ""
        }
    )]
    ChangedParts {
        /// Role and name of each part.
        parts: Vec<String>,
        /// Whether the target is a file.
        has_file: bool,
    },
    /// The target file of a run cannot be used any more.
    #[error(
        "cannot use the target of the run, `{target}`; if its folder was moved, give its new path as `engine.target`; if a \
         file was changed since the run, restore it"
    )]
    MissingTarget {
        /// Path in the plan.
        target: String,
        /// Cause of the error.
        source: Box<MishandleError>,
    },
    /// A new path was given for a target that has none.
    #[error(
        "the target of the run, `{target}`, is not a file, so it has no new path: leave out `engine.target`"
    )]
    TargetNotMoved {
        /// Name of the target.
        target: String,
    },
    /// A file of a target is outside the folder of the target file.
    #[error(
        "{} is outside the folder of the target file, {}; only files in it can stand beside a counterexample: move the file \
         there",
        path.display(),
        folder.display()
    )]
    OutsideTargetFolder {
        /// The file.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// A file of a target would replace another one.
    #[error("{} exists already and has another content; choose another folder", path.display())]
    OtherContent {
        /// The file.
        path: PathBuf,
    },
    /// The controller of a run cannot be loaded from its recorded path.
    #[error(
        "cannot load the run's controller `{controller}` (hash {hash}); if the file was moved, give its new path with \
         --controller FILE"
    )]
    MissingController {
        /// Name or path in the plan.
        controller: String,
        /// Recorded hash.
        hash: String,
        /// Cause of the error.
        source: Box<MishandleError>,
    },
    /// The target of a run is not part of this program.
    #[error(
        "the target `{name}` of the run is not part of this program; a run that was made in Python is replayed and resumed in \
         Python, by `mishandle.replay` and `mishandle.falsify` (docs/guide/python.md)"
    )]
    ForeignTarget {
        /// Name of the target.
        name: String,
    },
    /// A recorded simulation has an end that its target does not have.
    #[error(
        "the run file was changed: simulation {number} of trial {trial} has the end {end:?}, which its target does not have"
    )]
    ImpossibleEnd {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// The end.
        end: mishandle_store::SimulationEnd,
    },
    /// A recorded number of control steps or samples is impossible.
    #[error(
        "the run file was changed: `{name}` of simulation {number} of trial {trial} is {value}; it must be a whole \
         number from 0 to {limit}"
    )]
    InvalidCount {
        /// Name of the value.
        name: &'static str,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// The impossible value.
        value: f64,
        /// Largest possible value.
        limit: f64,
    },
    /// The recorded values of a simulation contradict each other.
    #[error("the run file was changed: simulation {number} of trial {trial}: {problem}")]
    Contradiction {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// The contradiction.
        problem: &'static str,
    },
    /// No simulation became a part of a data set.
    #[error(
        "none of {} is in the data set, so nothing is written: without `record.successful`, all episodes with a control step are kept",
        mishandle_text::plural(*simulations, "simulation")
    )]
    NoDemonstrations {
        /// Number of simulations.
        simulations: u64,
    },
    /// A system returned no episode for a request.
    #[error("the system returned no episode")]
    NoEpisode,
    /// An evaluation cannot run.
    #[error(transparent)]
    Evaluation(#[from] mishandle_evaluation::EvaluationError),
    /// A failure probability cannot be estimated.
    #[error(transparent)]
    Risk(#[from] mishandle_risk::RiskError),
    /// A falsification cannot run.
    #[error(transparent)]
    Falsification(#[from] mishandle_falsification::FalsificationError),
    /// A training run cannot start or continue.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// Training settings are invalid.
    #[error("{}", path.display())]
    Settings {
        /// Path of the settings file.
        path: PathBuf,
        /// Cause of the error.
        source: Box<TrainingError>,
    },
    /// A search cannot be constructed.
    #[error(transparent)]
    Search(#[from] mishandle_search::SearchError),
    /// A run file cannot be read or written.
    #[error(transparent)]
    Store(#[from] mishandle_store::StoreError),
}

impl From<mishandle_robots::RobotError> for MishandleError {
    fn from(error: mishandle_robots::RobotError) -> MishandleError {
        MishandleError::Robot(Box::new(error))
    }
}

impl MishandleError {
    /// Returns the text of the error with those of its causes, the outermost first. A cause that
    /// the text contains already is left out.
    pub fn with_causes(&self) -> String {
        let causes = successors(Some(self as &dyn Error), |error| (*error).source());
        causes.map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
            "" => cause,
            known if known.ends_with(&cause) => text,
            known => format!("{known}: {cause}"),
        })
    }
}

/// Largest number of known names that an error lists.
const LISTED: usize = 24;

/// Joins parts of a sentence: `a`, `a and b`, `a, b and c`.
fn joined(parts: &[String]) -> String {
    match parts {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        parts => parts.concat(),
    }
}

/// Says why a path is not a target.
fn not_a_target(name: &str) -> String {
    if Path::new(name).exists() {
        format!("{name} is not a target file")
    } else {
        format!("no such file: {name}")
    }
}

/// Lists known names, the first ones if they are many.
fn names(known: &[String]) -> String {
    match known.len().saturating_sub(LISTED) {
        0 => known.join(", "),
        more => format!("{}, and {more} more", known[..LISTED].join(", ")),
    }
}

/// Lists the known keys in the table of an unknown key. The keys outside of tables include the
/// names of the tables.
fn keys_beside(key: &str, known: &[&'static str]) -> String {
    let table = key.rsplit_once('.').map_or(String::new(), |(table, _)| format!("{table}."));
    let beside = known.iter().filter_map(|known| known.strip_prefix(table.as_str()));
    let mut names: Vec<&str> = beside.map(|key| key.split('.').next().unwrap_or(key)).collect();
    names.dedup();
    names.join(", ")
}

/// Says why a threshold cannot be chosen.
fn too_few_to_tune(failures: usize, successes: usize, scenarios: u64, fewest: usize) -> String {
    let few = if failures < successes { failures } else { successes };
    let (kind, cure) = if failures < successes {
        ("fail", "a space in which the controller fails more often")
    } else {
        ("succeed", "a space in which the controller fails less often")
    };
    format!(
        "{few} of {scenarios} training scenarios {kind}, and a threshold rests on at least {fewest}: use more --episodes, or \
         {cure} (`space` and `axes`)"
    )
}
