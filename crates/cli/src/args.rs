//! Command-line arguments and their help.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::LazyLock;

use clap::{Args, Parser, Subcommand};
use mishandle::Plan;
use mishandle::rollout::Noise;

use crate::numbers::{integer, number};

/// Random seeds.
const SEEDS: RangeInclusive<u64> = 0..=u64::MAX;

/// Numbers of threads: more than any machine has cores.
const THREADS: RangeInclusive<u64> = 1..=1024;

/// Numbers of trials and simulations in a run file.
const NUMBERS: RangeInclusive<u64> = 1..=u32::MAX as u64;

/// Numbers of repeated simulations of a scenario.
const REPEATS: RangeInclusive<u64> = 1..=10_000_000;

/// Numbers of random scenarios that measure noise.
const SCENARIOS: RangeInclusive<u64> = 0..=1_000_000;

/// Numbers of environment steps of a training run: those of the setting `run.total_steps`.
const STEPS: RangeInclusive<u64> = 1..=1_000_000_000_000;

/// Numbers of parallel environments: those of the setting `episodes.environments`.
const ENVIRONMENTS: RangeInclusive<u64> = 1..=1_000_000;

/// Standard deviations of noise.
const NOISE: &str = "a number from 0 to 10, such as 0.5";

fn is_noise(std: f64) -> bool {
    (0.0..=Noise::MAX_STD).contains(&std)
}

/// Failure rates.
const RATE: &str = "a number from 0 to 1, such as 0.05";

fn is_rate(rate: f64) -> bool {
    (0.0..=1.0).contains(&rate)
}

/// Sampling periods.
const PERIOD: &str = "a number of seconds above 0, such as 0.1";

fn is_period(secs: f64) -> bool {
    secs > 0.0 && secs.is_finite()
}

/// Coordinates of an initial state. Its box is checked later, by an error that names the axis.
const COORDINATE: &str = "a number in the unit of the axis, such as 0.45";

/// Version, and the paths of MuJoCo's library and of the shipped files, for questions about an installation.
static LONG_VERSION: LazyLock<String> = LazyLock::new(|| {
    let library = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let library = library.lines().find(|line| line.contains("libmujoco.so"));
    let library = library.and_then(|line| line.find('/').map(|start| &line[start..]));
    format!(
        "{}\nMuJoCo {}: {}\nshipped controllers and settings: {}",
        mishandle::VERSION_AND_COMMIT,
        mishandle::world::mujoco_version(),
        library.unwrap_or("linked statically"),
        mishandle::home_description()
    )
});

/// Train, evaluate and falsify robot controllers
#[derive(Debug, Parser)]
#[command(name = "mishandle", version = mishandle::VERSION_AND_COMMIT, long_version = LONG_VERSION.as_str())]
#[command(arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle evaluate ball-balancing --controller ppo --episodes 1000
  mishandle falsify ball-balancing --controller ppo --formula strict --trials 5

Results go to stdout, messages to stderr. Exit codes: 0 success, 1 falsified or violated, 2 error,
130 interrupted (finished work is saved).")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    Tasks(Tasks),
    Targets(Targets),
    Searches(Searches),
    Monitor(Monitor),
    Train(Train),
    Controller(Controller),
    Curve(Curve),
    Evaluate(Evaluate),
    Falsify(Falsify),
    Campaign(Campaign),
    Reproduce(Reproduce),
    Compare(Compare),
    Simulate(Simulate),
    Runs(Runs),
    Export(Export),
    Replay(Replay),
    Explain(Explain),
    Counterexamples(Counterexamples),
    Regress(Regress),
    Render(Render),
    Report(Report),
    Zoo(Zoo),
    Completions(Completions),
    Man(Man),
}

/// List the tasks, or describe one task in full
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle tasks ball-balancing
  mishandle tasks ball-balancing --mjcf scene.xml     the scene as MJCF, to load into MuJoCo")]
pub struct Tasks {
    /// Name of a task to describe: scene, formulas, initial box, observation, actions and rewards
    pub task: Option<String>,
    /// Task preset: initial boxes and formulas of the benchmark's `paper` or of its `code`
    #[arg(long, default_value = "paper")]
    pub preset: String,
    /// Write the task's scene to this MJCF file, with the initial state as keyframe `start`; the file does not contain
    /// the control of servos and gripper
    #[arg(long, value_name = "FILE", requires = "task")]
    pub mjcf: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// List the targets, or describe one target: scenario spaces, axes, signals and formulas
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle targets
  mishandle targets ball-balancing       all axes of its scenario spaces
  mishandle targets toy/car-following")]
pub struct Targets {
    /// Name of a target to describe
    pub target: Option<String>,
    /// Task preset of the described initial box and formulas: paper or code [default: paper]
    #[arg(long, requires = "target")]
    pub preset: Option<String>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// List the search algorithms, or describe one with its options
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle searches
  mishandle searches nelder-mead
  mishandle searches nelder-mead --json")]
pub struct Searches {
    /// Name of a search to describe: options with type, default, range and meaning
    pub search: Option<String>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Compute the robustness of a temporal logic formula on a recorded trace
#[derive(Debug, Args)]
#[command(after_help = "The trace is a CSV file: a header with the signal names, then one row of numbers per
sample. The optional column `time` (seconds) determines the sampling period. Columns that
the formula does not read may hold any text.

Windows that extend past the end of the trace are cut there, as in RTAMT. A cut window can
satisfy a formula that the whole window would violate. --strict-horizon uses whole windows
only, as verdicts about episodes do: a window without an end (`eventually p`) then ends at
the last sample at which p's own windows are inside the trace, and a formula whose windows
do not fit into the trace is an error.

Examples:
  mishandle monitor --formula 'always[0:2](d <= 0.3)' trace.csv             bounds count samples
  mishandle monitor --formula 'always[0:2s](d <= 0.3)' --period 0.1 trace.csv
  mishandle monitor --formula 'always[0:2](d <= 0.3)' --period 0.1 --unit s trace.csv  as in RTAMT

Exit code 1 means that the robustness at time 0 is negative.")]
pub struct Monitor {
    /// Formula in the syntax of RTAMT
    #[arg(long, allow_hyphen_values = true)]
    pub formula: String,
    /// CSV file with the trace; - reads stdin
    pub trace: PathBuf,
    /// Sampling period in seconds [default: mean step of the column `time`, or 1 without that column]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = number(PERIOD, is_period))]
    pub period: Option<f64>,
    /// Unit of interval bounds without a unit: s, ms, us or ns [default: such bounds count samples]
    #[arg(long)]
    pub unit: Option<String>,
    /// Use only windows inside the trace, instead of cutting them at its end as RTAMT does
    #[arg(long)]
    pub strict_horizon: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Flags of all commands that run simulations.
#[derive(Debug, Args)]
pub struct Run {
    /// Random seed, from 0 to 2^64 - 1 [default: 0, or the seed of the plan]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(SEEDS))]
    pub seed: Option<u64>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Flags that create or open the run file of a command that runs simulations.
#[derive(Debug, Args)]
pub struct OpenRun {
    /// Run file to create (SQLite) [default: a new file in runs/]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Resume a stopped run with its own plan; if its controller was moved, --controller is the new path
    #[arg(long, value_name = "RUN", conflicts_with_all = PLANNED)]
    pub resume: Option<PathBuf>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long, requires = "resume")]
    pub skip_check: bool,
    /// Wait after each batch until its records are on the disk. Without it, a power failure can lose the last
    /// simulations; a kill loses at most the running batch. Not stored: a resumed run needs the flag again
    #[arg(long)]
    pub durable: bool,
}

/// Arguments of all commands that a resumed run takes from its own plan. The path of the controller is not among them.
const PLANNED: [&str; 10] = [
    "target",
    "space",
    "preset",
    "action_noise",
    "observation_noise",
    "stochastic",
    "batch",
    "plan",
    "out",
    "seed",
];

/// Flags that define the target and its scenarios.
#[derive(Debug, Args)]
pub struct Subject {
    /// Name of a target: a task, or toy/NAME; `mishandle targets` lists them
    pub target: Option<String>,
    /// Controller of a task: the path of a .safetensors or .onnx file, or the name of a shipped controller such as ppo or
    /// expert
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Scenario space of the target, or several joined by + [default: starts]
    #[arg(long, value_name = "NAME")]
    pub space: Option<String>,
    /// Batch size: number of simulations run at once [default: 64]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(Plan::BATCH))]
    pub batch: Option<u32>,
    /// Task preset: initial box and formulas of the benchmark's `paper` or of its `code` [default: paper]
    #[arg(long)]
    pub preset: Option<String>,
    /// Standard deviation of the Gaussian noise on each action, added after clipping to [-1, 1]; from 0 to 10 [default: 0]
    #[arg(long, value_name = "STD", allow_negative_numbers = true, value_parser = number(NOISE, is_noise))]
    pub action_noise: Option<f64>,
    /// Standard deviation of the Gaussian noise on each observation, from 0 to 10 [default: 0]
    #[arg(long, value_name = "STD", allow_negative_numbers = true, value_parser = number(NOISE, is_noise))]
    pub observation_noise: Option<f64>,
    /// Sample actions from the policy instead of taking the mean action
    #[arg(long)]
    pub stochastic: bool,
    /// Read a plan (TOML); other flags override it
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
}

/// Help text of `--algorithm`, from the list of algorithms.
static ALGORITHM_HELP: LazyLock<String> = LazyLock::new(|| {
    let names: Vec<&str> = mishandle::training::ALGORITHMS.iter().map(|entry| entry.name).collect();
    format!("Training algorithm: {}", names.join(", "))
});

/// Train a controller
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle train point-reaching --algorithm ppo --out my_controller.safetensors
  mishandle train ball-balancing --algorithm ppo --settings my_settings.toml --seed 3
  mishandle train point-reaching --algorithm ppo --settings skrl-0.10
  mishandle train ball-balancing --algorithm ppo --out my_controller.safetensors --resume
  mishandle train ball-balancing --algorithm sac --csv curve.csv --tensorboard board
  mishandle train ball-balancing --algorithm sac --dry-run      check and print all settings

The best controller by validation is written to --out, the last one beside it: FILE.safetensors and
FILE.last.safetensors. Training also writes a checkpoint there. --resume continues from the
checkpoint with the same results, bit for bit, and continues the files of --csv and --tensorboard.
If a file cannot be written, as on a full disk, training warns, continues and tries again; it stops
if it cannot write the first checkpoint. The settings run.stop_success, run.stop_strict and
run.stop_validations enable early stopping.
Columns of the CSV file: docs/algorithms/README.md. All settings: docs/algorithms/settings.md.")]
pub struct Train {
    /// Name of a task
    pub task: String,
    #[arg(long, default_value = "ppo", help = ALGORITHM_HELP.as_str())]
    pub algorithm: String,
    /// Total number of environment steps (control steps of all parallel environments), such as 1e6; rounded up to
    /// whole iterations [default: run.total_steps of the settings]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(STEPS))]
    pub steps: Option<u64>,
    /// Reward: shaped or original
    #[arg(long, default_value = "shaped")]
    pub reward: String,
    /// File of the best controller [default: runs/TASK-ALGORITHM-sSEED.safetensors]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the learning curve to this CSV file, one row per iteration
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write TensorBoard event files to this folder
    #[arg(long, value_name = "DIR")]
    pub tensorboard: Option<PathBuf>,
    /// Settings file (TOML), or name of a settings preset: skrl-0.10 or best
    /// [default: the shipped settings of the task, or the algorithm's defaults if none are shipped]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// Resume from the checkpoint beside --out
    #[arg(long)]
    pub resume: bool,
    /// Check settings and output files, print all settings, and exit without creating files
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub run: Run,
}

/// Show the training time of a curve written by `train --csv`: when the return converged
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle curve curve.csv
  mishandle curve curve.csv --environments 512     also control steps per environment")]
pub struct Curve {
    /// CSV file of a learning curve
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Number of parallel environments of the training run
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(ENVIRONMENTS))]
    pub environments: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Show how a controller was trained, export it as ONNX, or import one from PyTorch
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:
  mishandle controller my_controller.safetensors
  mishandle controller point-reaching/ppo                     a shipped controller
  mishandle controller point-reaching/ppo --json
  mishandle controller export point-reaching/ppo --onnx ppo.onnx
  mishandle controller import model.zip --task point-reaching --out model.safetensors

The output is a valid settings file: `mishandle train --settings FILE` trains with the same
settings. Success rates are from validation during training. `mishandle evaluate` measures the
controller on other initial states.")]
pub struct Controller {
    #[command(subcommand)]
    pub command: Option<ControllerCommand>,
    /// Path of a controller, or TASK/NAME for a shipped controller
    #[arg(value_name = "FILE|TASK/NAME", required = true)]
    pub controller: Option<String>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum ControllerCommand {
    /// Write a controller as an ONNX model, with its normalizer and the clipping of observations and actions
    #[command(after_help = "Examples:
  mishandle controller export point-reaching/ppo --onnx ppo.onnx
  mishandle controller export my_controller.safetensors --onnx my_controller.onnx --json

The model's input `observation` has the shape [N, size], in the units of the task. Its output
`action` is clipped to [-1, 1], as the task does; `unclipped_action` is the controller's own output.
Both are the mean of a stochastic policy. `mishandle evaluate TASK --controller ppo.onnx` runs it.")]
    Export {
        /// Path of a controller, or TASK/NAME for a shipped controller
        #[arg(value_name = "FILE|TASK/NAME")]
        controller: String,
        /// ONNX file to create
        #[arg(long, value_name = "FILE")]
        onnx: PathBuf,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Make a controller from the weights of a policy of Stable-Baselines3, skrl or PyTorch
    Import(ImportController),
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle controller import model.zip --task point-reaching --out a.safetensors
  mishandle controller import model.zip --task point-reaching --out a.safetensors \\
      --normalizer n.json
  mishandle controller import agent.pt --task point-reaching --out a.safetensors --activation elu

FILE is a model of Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG), a checkpoint of skrl, or a state
dictionary written by `torch.save(model.state_dict(), FILE)`. Its policy must be a multi-layer
perceptron; other policies run as ONNX. Only weights are read: nothing in the file is unpickled or
executed. docs/import.md shows how to write the statistics of a VecNormalize.")]
pub struct ImportController {
    /// Model or checkpoint: .zip, .pt or .pth
    pub file: PathBuf,
    /// Task of the controller; `mishandle tasks` lists them
    #[arg(long)]
    pub task: String,
    /// Controller file to create
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Activation of the hidden layers: elu, relu, tanh, silu, gelu, leaky_relu or identity [default: that of the file]
    #[arg(long, value_name = "NAME")]
    pub activation: Option<String>,
    /// Activation of the last layer, by the same names [default: that of the algorithm, if the file shows it]
    #[arg(long, value_name = "NAME")]
    pub output_activation: Option<String>,
    /// JSON file with the statistics that normalize observations: mean, variance, epsilon, clip
    #[arg(long, value_name = "FILE")]
    pub normalizer: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Evaluate a controller: success rate, dangerous behavior rate and completion time, with 95 % intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller my_controller.safetensors --json")]
pub struct Evaluate {
    #[command(flatten)]
    pub subject: Subject,
    /// Number of random initial states; the corners and the center of the initial box are simulated as well [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Region of the initial states: whole, or reachable (the part of the box from which the task is feasible)
    /// [default: whole]
    #[arg(long = "box", value_name = "PART", conflicts_with = "resume")]
    pub starts: Option<String>,
    #[command(flatten)]
    pub file: OpenRun,
    #[command(flatten)]
    pub run: Run,
}

/// Search for counterexamples: scenarios in which a target violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle falsify ball-balancing --controller ppo --search random
  mishandle falsify ball-balancing --controller ppo --search dual-annealing --formula strict
  mishandle falsify ball-balancing --controller ppo --formula 'always[50:300](ball_speed <= 0.5)'
  mishandle falsify ball-balancing --controller ppo --space events
  mishandle falsify toy/car-following --space events+dynamics
  mishandle falsify ball-balancing --controller ppo --search nelder-mead --search-option xatol=1e-6
  mishandle falsify --resume runs/RUN.sqlite

Exit code 1 means that a counterexample was found.")]
pub struct Falsify {
    #[command(flatten)]
    pub subject: Subject,
    /// Search algorithm: random, nelder-mead or dual-annealing [default: random]
    #[arg(long, value_name = "S", conflicts_with = "resume")]
    pub search: Option<String>,
    /// Option of the search algorithm (repeatable); `mishandle searches SEARCH` lists them
    #[arg(long = "search-option", value_name = "NAME=VALUE", value_parser = name_and_value, conflicts_with = "resume")]
    pub search_options: Vec<(String, String)>,
    /// Requirement to violate: the name of a formula of the target (such as success or strict), or the text of a
    /// formula [default: the target's first formula, which is success for a task]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Number of trials: independent searches, each with its own random seed [default: 30]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(Plan::TRIALS))]
    #[arg(conflicts_with = "resume")]
    pub trials: Option<u32>,
    /// Largest number of simulations per trial [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u32>,
    /// If the target is random: number of simulations of each counterexample with other seeds, which measure how often it
    /// fails; at most as many in total as the run has; 0 skips this [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(0..=10_000_000))]
    pub repeats: Option<u32>,
    #[command(flatten)]
    pub file: OpenRun,
    #[command(flatten)]
    pub run: Run,
}

/// Run a grid of evaluations and falsifications: targets, controllers, spaces, formulas, searches, seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle campaign campaign.toml --out runs/controllers
  mishandle campaign --resume runs/controllers
  mishandle campaign campaign.toml --ray auto         on this machine's Ray cluster

The campaign file is a plan in which keys may have lists of values: see docs/campaigns.md. Each
combination is a run with a run file in the folder. Exit code 1 means that a counterexample was
found.")]
pub struct Campaign {
    /// Campaign file (TOML)
    #[arg(value_name = "FILE", required_unless_present = "resume")]
    pub campaign: Option<PathBuf>,
    /// Folder to create for the run files [default: a new folder in runs/]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Resume the stopped campaign in this folder
    #[arg(long, value_name = "DIR", conflicts_with_all = ["campaign", "out"])]
    pub resume: Option<PathBuf>,
    /// Simulate on a Ray cluster: its address, `auto` for the one that runs on this machine, or `local` to start one; needs
    /// the Python package with Ray
    #[arg(long, value_name = "ADDRESS")]
    pub ray: Option<String>,
    /// Wait after each batch until its records are on the disk
    #[arg(long)]
    pub durable: bool,
    /// Number of runs at the same time; does not affect the results. Several keep all cores busy when searches propose few
    /// simulations at a time [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    #[arg(conflicts_with = "ray")]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Write the tables of `mishandle reproduce`, with statistics, as Markdown and HTML pages to this folder
    #[arg(long, value_name = "DIR")]
    pub pages: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Reproduce the paper's tables: run their plans, and show the results beside the published values
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  mishandle reproduce falsification --out runs/falsification
  mishandle reproduce performance --out runs/performance
  mishandle reproduce tables runs/performance runs/falsification --pages pages

docs/reproduce.md explains the tables and how to read them.")]
pub struct Reproduce {
    #[command(subcommand)]
    pub command: ReproduceCommand,
}

#[derive(Debug, Subcommand)]
pub enum ReproduceCommand {
    /// Evaluate all controllers and the experts, with and without noise
    Performance(ReproduceTable),
    /// Falsify the PPO and TRPO controllers with three searches
    Falsification(ReproduceTable),
    /// Show the tables of existing campaigns or results, without simulations
    #[command(after_help = "Examples:
  mishandle reproduce tables runs/falsification
  mishandle reproduce tables experiments/paper/results/DATE --pages docs/paper

A campaign may be incomplete; its rows then say how far they are. Campaigns of `mishandle campaign`
get the same tables.")]
    Tables {
        /// Folders of campaigns or of collected results
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// Write the pages to this folder as Markdown and HTML instead of printing the tables
        #[arg(long, value_name = "DIR")]
        pages: Option<PathBuf>,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Store the rows of complete campaigns as compressed CSV files with a manifest
    #[command(after_help = "Examples:
  mishandle reproduce collect runs/performance runs/falsification \\
      --out experiments/paper/results/2026-11-22")]
    Collect {
        /// Folders of campaigns
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// Folder to create, named by the date of the results
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

/// Flags of the commands that run the plan of a table.
#[derive(Debug, Args)]
pub struct ReproduceTable {
    /// Folder of the run files. If it exists, its campaign is resumed [default: runs/ and the name of the table]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Campaign file to run instead of that of the table
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
    /// Number of runs at the same time; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Wait after each batch until its records are on the disk
    #[arg(long)]
    pub durable: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Compare two controllers, or two versions of one, on the same scenarios and seeds
#[derive(Debug, Args)]
#[command(override_usage = "mishandle compare [OPTIONS] <A> <B>\n       \
    mishandle compare [OPTIONS] <TARGET> --controller <C> --against <C>")]
#[command(after_help = "Examples:
  mishandle compare runs/evaluate-old.sqlite runs/evaluate-new.sqlite
  mishandle compare ball-balancing --controller ppo --against sac --episodes 1000
  mishandle compare point-reaching --controller ppo --against my.safetensors --action-noise 0.5

A and B are run files of `mishandle evaluate` with the same target, space, seed and number of
episodes. They are compared pair by pair. With --against, both controllers are evaluated first, and
the run files are kept in runs/.

Exit code 1 means that B fails in a simulation in which A succeeds.")]
pub struct Compare {
    #[command(flatten)]
    pub subject: Subject,
    /// Run file B; the first argument is then run file A
    #[arg(value_name = "B", conflicts_with_all = COMPARED)]
    pub second: Option<PathBuf>,
    /// Controller B, evaluated like the one of --controller, which is A
    #[arg(long, value_name = "C")]
    pub against: Option<String>,
    /// Number of simulations of each controller from random scenarios [default: 100, or that of the plan]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Do not check the whole run files before reading them; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    #[command(flatten)]
    pub run: Run,
}

/// Arguments of `compare` that two run files already determine.
const COMPARED: [&str; 11] = [
    "controller",
    "space",
    "preset",
    "action_noise",
    "observation_noise",
    "stochastic",
    "batch",
    "plan",
    "against",
    "episodes",
    "seed",
];

/// Parses `NAME=VALUE`.
fn name_and_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("expected NAME=VALUE, such as xatol=1e-6".to_string()),
    }
}

/// Simulate one chosen scenario, once or repeatedly with other random seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle simulate ball-balancing --controller ppo --at 0.2,-0.14
  mishandle simulate ball-balancing --controller ppo --at 0.2,-0.14 --action-noise 0.5 --repeat 1000
  mishandle simulate ball-balancing --controller ppo --space starts+delay --at action_delay=2

Exit code 1 means that a simulation violated the formula.")]
pub struct Simulate {
    #[command(flatten)]
    pub subject: Subject,
    /// Scenario: one value per axis of the space, or NAME=VALUE for some axes; the others are nominal [default: the
    /// nominal scenario]
    #[arg(long, value_name = "X,Y,...", value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<String>,
    /// Number of simulations with different seeds; reports the failure rate of the scenario and quantiles of the robustness
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(REPEATS))]
    pub repeat: Option<u32>,
    /// With --repeat: number of random scenarios, each simulated 20 times, that measure the share of the robustness variance
    /// that comes from the scenario; 0 skips this [default: 20]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(SCENARIOS))]
    #[arg(requires = "repeat")]
    pub scenarios: Option<u32>,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the target's first formula]
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    #[command(flatten)]
    pub run: Run,
}

/// Replay a recorded simulation and check that the result is bit-identical
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv
  mishandle replay failure.json                         an exported counterexample

Exit code 0 means that everything recorded of the simulation agrees with the plan of the run and
with the replay, bit for bit; 2 that something differs.")]
pub struct Replay {
    /// Run file of `mishandle evaluate` or `mishandle falsify`, or a .json file of `mishandle counterexamples export`
    #[arg(value_name = "RUN|FILE.json")]
    pub file: PathBuf,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample, otherwise the simulation
    /// with the minimum robustness]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub simulation: Option<u32>,
    /// New path of the run's controller, if the file was moved
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Write the trace to this CSV file
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// List run files with what they contain
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle runs
  mishandle runs runs/controllers        the folder of a campaign
  mishandle runs a.sqlite b.sqlite")]
pub struct Runs {
    /// Run files, or folders that contain run files [default: the folder runs]
    #[arg(value_name = "PATH", default_value = "runs")]
    pub paths: Vec<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Export the simulations of a run as CSV or Parquet
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle export runs/RUN.sqlite --out simulations.csv
  mishandle export runs/RUN.sqlite --out simulations.parquet

One row per simulation: trial, number, seed, robustness, end, scenario, verdicts. docs/run_file.md
describes the columns. `mishandle replay RUN --trace FILE` exports the trace of one simulation.")]
pub struct Export {
    /// Run file of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN")]
    pub file: PathBuf,
    /// File to create; it must end in .csv or .parquet
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
}

/// Explain a recorded simulation: when, where and by which predicate the formula is violated
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle explain runs/RUN.sqlite                      the first counterexample
  mishandle explain runs/RUN.sqlite --trial 2 --simulation 17
  mishandle explain runs/RUN.sqlite --masking            which predicates hide others
  mishandle explain failure.json                         an exported counterexample

A counterexample of any target is explained from its recorded trace. Other simulations have none and
are replayed.")]
pub struct Explain {
    /// Run file of `mishandle evaluate` or `mishandle falsify`, or a .json file of `mishandle counterexamples export`
    #[arg(value_name = "RUN|FILE.json")]
    pub file: PathBuf,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample, otherwise the simulation
    /// with the minimum robustness]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub simulation: Option<u32>,
    /// Explain the whole run: how often each predicate sets the robustness, and how often each one fails, over at most N
    /// simulations, which are simulated again [default of N: 500]
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "500", require_equals = true)]
    #[arg(allow_negative_numbers = true, value_parser = integer::<u64>(1..=u64::MAX))]
    #[arg(conflicts_with_all = ["trial", "simulation"])]
    pub masking: Option<u64>,
    /// New path of the run's controller, if the file was moved
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// List the failure modes of a run, or export counterexamples as files of a regression suite
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:
  mishandle counterexamples runs/RUN.sqlite
  mishandle counterexamples export runs/RUN.sqlite --out failure.json --minimize
  mishandle counterexamples export runs/RUN.sqlite --all --out failures

A failure mode is a group of failures with the same decisive predicate, similar scenarios and
similar times. Its representative is the failure nearest to the nominal scenario.")]
pub struct Counterexamples {
    #[command(subcommand)]
    pub command: Option<CounterexamplesCommand>,
    /// Run file of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN", required = true)]
    pub file: Option<PathBuf>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum CounterexamplesCommand {
    /// Write counterexamples as JSON files, which `replay`, `explain` and `regress` run
    Export(ExportCounterexamples),
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle counterexamples export runs/RUN.sqlite --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --mode 2 --minimize --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --trial 2 --simulation 17 --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --all --out failures

--minimize moves the scenario toward the nominal one while it still fails: as few axes as possible
off nominal, with offsets that cannot shrink by 1 % of the width of an axis. The random seed stays.
docs/counterexamples.md describes the file.")]
pub struct ExportCounterexamples {
    /// Run file of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN")]
    pub file: PathBuf,
    /// File to create; with --all a folder for one file per mode
    #[arg(long, value_name = "FILE|DIR")]
    pub out: PathBuf,
    /// Failure mode, from 1, whose representative is exported [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    #[arg(conflicts_with_all = ["all", "trial", "simulation"])]
    pub mode: Option<u32>,
    /// Export the representatives of all failure modes
    #[arg(long, conflicts_with_all = ["trial", "simulation"])]
    pub all: bool,
    /// Number of the trial, from 1, of the exported simulation
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    #[arg(requires = "simulation")]
    pub trial: Option<u32>,
    /// Number of the exported simulation within its trial, from 1
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub simulation: Option<u32>,
    /// Move the scenario toward the nominal one while it still fails
    #[arg(long)]
    pub minimize: bool,
    /// Largest number of simulations that minimize a counterexample [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(Plan::BUDGET))]
    #[arg(requires = "minimize")]
    pub budget: Option<u64>,
    /// With --minimize: new path of the run's controller, if the file was moved
    #[arg(long, value_name = "C", requires = "minimize")]
    pub controller: Option<String>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Simulate a folder of counterexamples with another controller, and report which still fail
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle regress failures --controller my_controller.safetensors
  mishandle regress failures --controller ppo --junit report.xml
  mishandle regress failures --controller ppo --repeat 100 --max-failure-rate 0.05

Each file *.json in the folder is one test. It passes if the scenario satisfies the formula. Exit
code 0 means that all pass, 1 that at least one still fails, 2 that a test could not run.")]
pub struct Regress {
    /// Folder with files of `mishandle counterexamples export`
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Controller: the path of a .safetensors or .onnx file, or the name of a shipped controller
    /// [default: the one of each counterexample]
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Number of simulations with other random seeds, which decide the test; without it, the recorded seed does
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(REPEATS))]
    pub repeat: Option<u32>,
    /// With --repeat: largest failure rate of a test that passes [default: 0]
    #[arg(long, value_name = "RATE", requires = "repeat", allow_negative_numbers = true)]
    #[arg(value_parser = number(RATE, is_rate))]
    pub max_failure_rate: Option<f64>,
    /// Write the results to this file as JUnit XML; an existing file is replaced
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Render the initial state of a task, or a video or filmstrip of a recorded simulation
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle render ball-pushing --out start.png
  mishandle render ball-pushing --at 0.45,-0.1 --out start.png
  mishandle render --run runs/RUN.sqlite --out video.mp4           the first counterexample
  mishandle render --run runs/RUN.sqlite --trial 2 --simulation 17 --out strip.png   six frames

Rendering needs no display. Videos need the program ffmpeg.")]
pub struct Render {
    /// Name of a task, to render its initial state
    #[arg(conflicts_with = "run")]
    pub task: Option<String>,
    /// Initial state: one value per axis of the initial box, in the axis' unit [default: the center of the box]
    #[arg(long, value_name = "X,Y,...", value_delimiter = ',', allow_hyphen_values = true)]
    #[arg(conflicts_with = "run", value_parser = number(COORDINATE, |_| true))]
    pub at: Option<Vec<f64>>,
    /// Run file, to render one of its simulations
    #[arg(long, value_name = "RUN")]
    pub run: Option<PathBuf>,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", requires = "run", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample, otherwise the simulation
    /// with the minimum robustness]
    #[arg(long, value_name = "N", requires = "run", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub simulation: Option<u32>,
    /// New path of the run's controller, if the file was moved
    #[arg(long, value_name = "C", requires = "run")]
    pub controller: Option<String>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long, requires = "run")]
    pub skip_check: bool,
    /// Output file: .png for a picture or a filmstrip, .mp4 for a video
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Width and height of each frame, in pixels [default: picture 960x720, video 640x480, filmstrip 480x360]
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
}

/// Write a page about runs: verdict, failure modes, robustness maps, traces, pictures
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle report runs/RUN.sqlite --out report.html
  mishandle report runs/A.sqlite runs/B.sqlite --out report.html     one section each, and a table
  mishandle report runs/RUN.sqlite --no-simulations --out report.html

The page is one HTML file that loads nothing and runs no script. docs/report.md explains its
charts. If the target of a run is available, scenarios around each failure mode are simulated,
corners, and repeats with other seeds. Otherwise the page has what the run file contains.")]
pub struct Report {
    /// Run files of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// HTML file to create
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
    /// Number of random scenarios around each failure mode, which estimate the size of the failing patch; 0 skips this
    #[arg(long, value_name = "N", default_value = "64", allow_negative_numbers = true)]
    #[arg(value_parser = integer::<u32>(SCENARIOS), conflicts_with = "no_simulations")]
    pub probes: u32,
    /// Show only what the run files contain
    #[arg(long)]
    pub no_simulations: bool,
    /// New path of the runs' controller, if the file was moved
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Do not check the whole run files before reading them; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Number of threads; does not affect the page [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
}

/// Maintain the shipped controllers: train, measure, import, write tables and charts
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  mishandle zoo list                               what is done, what is not, and why
  mishandle zoo train                              do everything that `list` shows as needed
  mishandle zoo train --only ball-pushing/sac --jobs 2
  mishandle zoo import runs                        add training runs from another machine

It works in a clone of the repository: the one that contains the program, or the folder in
MISHANDLE_HOME. Ctrl-C saves checkpoints, and the same command continues. controllers/README.md
explains the plan and the measurements.")]
pub struct Zoo {
    #[command(subcommand)]
    pub command: ZooCommand,
}

#[derive(Debug, Subcommand)]
pub enum ZooCommand {
    /// List the training runs of the plan with their states
    #[command(after_help = "Examples:
  mishandle zoo list
  mishandle zoo list --only ball-pushing --seeds 0
  mishandle zoo list --json

A controller is done if it was trained with the present settings, on the present task, in the
present file format, and measured with the present formulas.")]
    List {
        #[command(flatten)]
        selection: ZooSelection,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Train and measure what is missing or out of date, then write the tables and the charts
    #[command(after_help = "Examples:
  mishandle zoo train
  mishandle zoo train --only peg-in-hole/ppo --seeds 1 2 --jobs 2

Each training run takes one thread. It saves a checkpoint in target/controllers every minute.
A training run that fails does not end the others.")]
    Train {
        #[command(flatten)]
        selection: ZooSelection,
        #[command(flatten)]
        jobs: ZooJobs,
    },
    /// Measure controllers without training, then write the tables and the charts
    #[command(after_help = "Examples:
  mishandle zoo measure                            what is missing or out of date
  mishandle zoo measure --only cloth-placing/ppo --again

A measurement is an evaluation of 1000 episodes without noise, one with action noise 0.5, and for
the shipped PPO controllers a falsification of 10 trials by random search. Only missing parts are
measured, unless --again is given.")]
    Measure {
        #[command(flatten)]
        selection: ZooSelection,
        #[command(flatten)]
        jobs: ZooJobs,
        /// Repeat all selected measurements
        #[arg(long)]
        again: bool,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Add training runs from another machine: check, measure, and write the tables and the charts
    #[command(after_help = "Examples:
  mishandle train peg-in-hole --algorithm sac --seed 2 --threads 1 \\
      --out runs/peg-in-hole-sac-s2.safetensors --csv runs/peg-in-hole-sac-s2.csv
  mishandle zoo import runs

FOLDER holds two files for each training run: TASK-ALGORITHM-sSEED.safetensors and .csv. A run is
refused if it has not ended, or differs from the plan in its seed, its settings or its task.")]
    Import {
        /// Folder with controllers and curves
        folder: PathBuf,
        #[command(flatten)]
        selection: ZooSelection,
    },
    /// Write the tables and the charts again, from the records and the curves alone
    #[command(after_help = "Examples:
  mishandle zoo tables

Writes the tables of README.md, docs/tasks.md and controllers/README.md, and the charts
controllers/curves/TASK.svg.")]
    Tables,
}

/// A part of the plan.
#[derive(Debug, Args)]
pub struct ZooSelection {
    /// Only this task, or this controller of it
    #[arg(long, value_name = "TASK[/CONTROLLER]")]
    pub only: Option<String>,
    /// Only these random seeds; seed 0 is shipped
    #[arg(long, value_name = "N", num_args = 1.., allow_negative_numbers = true, value_parser = integer::<u64>(SEEDS))]
    pub seeds: Vec<u64>,
    /// Treat controllers as trained on the present task if nothing but their task differs
    #[arg(long)]
    pub adopt: bool,
}

/// Number of parallel jobs.
#[derive(Debug, Args)]
pub struct ZooJobs {
    /// Number of parallel jobs, one thread each [default: all cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub jobs: Option<usize>,
}

/// Print a shell script that completes commands and flags
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle completions bash > ~/.local/share/bash-completion/completions/mishandle
  mishandle completions zsh > ~/.zfunc/_mishandle
  mishandle completions fish > ~/.config/fish/completions/mishandle.fish")]
pub struct Completions {
    /// Name of the shell
    pub shell: clap_complete::Shell,
}

/// Print the manual page, or write the pages of all commands to a folder
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle man | man -l -
  mishandle man ~/.local/share/man/man1")]
pub struct Man {
    /// Folder for mishandle.1 and one page per command; existing pages are replaced
    #[arg(value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    /// Width at which clap wraps help.
    const WIDTH: usize = 100;

    fn check(command: &clap::Command) {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "help of {} wraps the line: {line}", command.get_name());
        }
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn no_help_text_with_line_breaks_of_its_own_is_wrapped_again() {
        check(&Arguments::command());
    }
}
