use std::path::PathBuf;

use mishandle_training::TrainingError;

/// What can be wrong with what a user asks for, or with the run that does it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MishandleError {
    /// A name that is none of those known.
    #[error("there is no {kind} `{name}`; there are: {}", known.join(", "))]
    Name {
        /// What was named.
        kind: &'static str,
        /// The name given.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// A task without a controller.
    #[error("{target} needs a controller: --controller NAME or FILE; there are: {}", known.join(", "))]
    NoController {
        /// The task.
        target: String,
        /// The controllers there are.
        known: Vec<String>,
    },
    /// An option that a target does not take.
    #[error("{target} takes no {option}; only tasks do")]
    NotForTarget {
        /// The target.
        target: String,
        /// The option.
        option: &'static str,
    },
    /// A plan that cannot be read.
    #[error("the plan cannot be read: {0}")]
    Plan(String),
    /// A plan of a newer format.
    #[error("the plan has format {found}, this program knows formats up to {known}: use a newer Mishandle")]
    NewerPlan {
        /// Format of the plan.
        found: u32,
        /// Newest format known.
        known: u32,
    },
    /// `MISHANDLE_HOME` names no folder with our data files.
    #[error("MISHANDLE_HOME is `{}`, which has no folder `{wanted}`", path.display())]
    Home {
        /// What it is set to.
        path: PathBuf,
        /// What is missing there.
        wanted: &'static str,
    },
    /// Another process writes to the same file.
    #[error("another training is writing {}; wait until it ends, or choose another {flag}", path.display())]
    Busy {
        /// The file.
        path: PathBuf,
        /// The flag that says where it is.
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
        /// Its path.
        path: PathBuf,
        /// What is wrong.
        problem: crate::CurveProblem,
    },
    /// A recorded simulation of an evaluation is not the one that its plan asks for.
    #[error(
        "simulation {number} of the run is not the one that its plan asks for: rows are missing, or the run was made by \
         another build and has to be resumed with that"
    )]
    OtherSimulation {
        /// Number of the simulation that the plan asks for.
        number: u32,
    },
    /// The plan is not for this.
    #[error("there is nothing to {wanted}: the plan has no [{wanted}] table, as a run of another command")]
    OtherPlan {
        /// The table that is missing.
        wanted: &'static str,
    },
    /// A number that makes no sense.
    #[error("{what} is {value}; it has to be {wanted}")]
    Value {
        /// What the number is for.
        what: &'static str,
        /// The number given.
        value: String,
        /// What would be right.
        wanted: &'static str,
    },
    /// A start that lies in no task preset's initial box.
    #[error(
        "{axis} is {value} {unit}, outside the initial box: from {low} to {high} {unit} in task preset paper"
    )]
    OutsideBox {
        /// The axis on which it lies outside.
        axis: &'static str,
        /// Its value there.
        value: f64,
        /// Unit of value and bounds.
        unit: &'static str,
        /// Smallest value in the paper's box.
        low: f64,
        /// Largest value in the paper's box.
        high: f64,
    },
    /// A formula that reaches past the end of an episode can never be decided.
    #[error("`{formula}` needs {needed} control steps, an episode has {steps}: it could never be decided")]
    Undecidable {
        /// The formula.
        formula: String,
        /// Control steps it needs.
        needed: String,
        /// Control steps of an episode.
        steps: usize,
    },
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Its path.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// What a training writes down as it goes cannot be written.
    #[error("cannot write the {what} {}", path.display())]
    Write {
        /// What it is.
        what: &'static str,
        /// Its path.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A controller file is damaged, foreign, or made for something else.
    #[error(transparent)]
    Controller(#[from] mishandle_controllers::ControllerError),
    /// A task cannot be built.
    #[error(transparent)]
    Task(#[from] mishandle_tasks::TaskError),
    /// An expert cannot be built.
    #[error("the expert of {task}")]
    Expert {
        /// The task.
        task: String,
        /// What is wrong.
        source: mishandle_world::WorldError,
    },
    /// Episodes cannot run.
    #[error(transparent)]
    Rollout(#[from] mishandle_rollout::RolloutError),
    /// A record says that a target has other parts than it has now.
    #[error("the run's target has other parts than {target} has now: {recorded}, now {found}")]
    OtherParts {
        /// The target.
        target: String,
        /// The parts in the record.
        recorded: String,
        /// The present ones.
        found: String,
    },
    /// The controller of a record is another one now.
    #[error(
        "controller `{controller}` is not the run's: that had hash {recorded}, this one has {found}; if it was moved, \
         --controller FILE says where it is now"
    )]
    OtherController {
        /// As the plan names it.
        controller: String,
        /// Hash in the record.
        recorded: String,
        /// Hash of the present one.
        found: String,
    },
    /// The controller of a record cannot be loaded from where it was.
    #[error(
        "the run's controller `{controller}` (hash {hash}) is not where it was; if it was moved, --controller FILE says \
         where it is now"
    )]
    LostController {
        /// As the plan names it.
        controller: String,
        /// Hash in the record.
        hash: String,
        /// What was found there.
        source: Box<MishandleError>,
    },
    /// A record ended in a way that this program does not know.
    #[error(
        "a simulation of the run ended in a way that this program does not know: {0}; use a newer Mishandle"
    )]
    UnknownEnd(String),
    /// A system returned no episode for a request.
    #[error("the simulation returned no episode")]
    NoEpisode,
    /// An evaluation cannot run.
    #[error(transparent)]
    Evaluation(#[from] mishandle_evaluation::EvaluationError),
    /// A falsification cannot run.
    #[error(transparent)]
    Falsification(#[from] mishandle_falsification::FalsificationError),
    /// A training cannot run.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// Training settings that cannot be used.
    #[error("{}", path.display())]
    Settings {
        /// The settings file.
        path: PathBuf,
        /// What is wrong.
        source: Box<TrainingError>,
    },
    /// A search cannot be made.
    #[error(transparent)]
    Search(#[from] mishandle_search::SearchError),
    /// The run file.
    #[error(transparent)]
    Store(#[from] mishandle_store::StoreError),
}
