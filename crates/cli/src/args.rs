//! What can be typed.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// Finds out what makes a robot's controller fail.
#[derive(Debug, Parser)]
#[command(name = "mishandle", version, arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle evaluate ball-balancing --controller ppo --episodes 1000
  mishandle falsify ball-balancing --controller ppo --formula strict --trials 5

Words go to stderr, data to stdout. Exit codes: 0 done, 1 falsified or violated, 2 an error.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    Tasks(Tasks),
    Monitor(Monitor),
    Train(Train),
    Evaluate(Evaluate),
    Falsify(Falsify),
    Replay(Replay),
}

/// Lists the tasks with their formulas, initial boxes and controllers; explains one in full
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle tasks ball-balancing
  mishandle tasks ball-balancing --mjcf scene.xml     the scene, to load into MuJoCo")]
pub struct Tasks {
    /// Name of a task, to explain it in full
    pub task: Option<String>,
    /// Reading of the original benchmark: paper or code
    #[arg(long, default_value = "paper")]
    pub preset: String,
    /// Write the task's MJCF document to this file
    #[arg(long, value_name = "FILE", requires = "task")]
    pub mjcf: Option<PathBuf>,
    /// One JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

/// Measures the robustness of a formula on a recorded trace
#[derive(Debug, Args)]
#[command(
    after_help = "The trace is a CSV file: a header of signal names, then a row of numbers for each sample. A column
named `time` (seconds) gives the sampling period.

Examples:
  mishandle monitor --formula 'always[0:2](d <= 0.3)' trace.csv             bounds count samples
  mishandle monitor --formula 'always[0:2s](d <= 0.3)' --period 0.1 trace.csv
  mishandle monitor --formula 'always[0:2](d <= 0.3)' --period 0.1 --unit s trace.csv    as RTAMT reads it

Exit code 1 if the robustness at time 0 is negative."
)]
pub struct Monitor {
    /// The formula, in RTAMT's syntax
    #[arg(long)]
    pub formula: String,
    /// CSV file with the trace; - for stdin
    pub trace: PathBuf,
    /// Seconds between samples; without it, the `time` column says, else 1
    #[arg(long)]
    pub period: Option<f64>,
    /// Unit of interval bounds that have none (s, ms, us or ns); without it, they count samples
    #[arg(long)]
    pub unit: Option<String>,
    /// Refuse a formula that reaches past the end of the trace, instead of cutting its windows there
    #[arg(long)]
    pub strict_horizon: bool,
    /// One JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

/// What every command that runs simulations takes.
#[derive(Debug, Args)]
pub struct Run {
    /// Seed of everything random
    #[arg(long)]
    pub seed: Option<u64>,
    /// Number of threads; results never depend on it [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// One JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

/// Which controller acts in which task, and how.
#[derive(Debug, Args)]
#[group(id = "subject", multiple = true)]
pub struct Subject {
    /// Name of a task
    #[arg(required_unless_present_any = ["plan", "resume"])]
    pub task: Option<String>,
    /// A shipped controller's name (ppo, expert), or a path
    #[arg(long, value_name = "C", required_unless_present_any = ["plan", "resume"])]
    pub controller: Option<String>,
    /// Reading of the original benchmark: paper or code
    #[arg(long)]
    pub preset: Option<String>,
    /// Standard deviation of the noise on each action, added after the action is clipped to [-1, 1]
    #[arg(long, value_name = "STD", allow_negative_numbers = true)]
    pub action_noise: Option<f64>,
    /// Standard deviation of the noise on each observation
    #[arg(long, value_name = "STD", allow_negative_numbers = true)]
    pub observation_noise: Option<f64>,
    /// Sample the policy's actions instead of taking their mean
    #[arg(long)]
    pub stochastic: bool,
    /// Start from this plan (TOML); flags edit it
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
}

/// Trains a controller
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle train point-reaching --algorithm ppo --out my_controller.safetensors
  mishandle train ball-balancing --algorithm ppo --settings my_settings.toml --seed 3
  mishandle train ball-balancing --algorithm ppo --out my_controller.safetensors --resume

Training writes a checkpoint beside FILE as it goes; --resume carries on from it to the same bits.")]
pub struct Train {
    /// Name of a task
    pub task: String,
    /// Training algorithm: ppo, trpo, sac, td3 or ddpg
    #[arg(long, default_value = "ppo")]
    pub algorithm: String,
    /// Control steps to train for, over all parallel environments [default: as the settings say]
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Reward to learn from: shaped or original
    #[arg(long, default_value = "shaped")]
    pub reward: String,
    /// Where the controller goes [default: runs/TASK-ALGORITHM-sSEED.safetensors]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Settings (TOML) [default: experiments/training/TASK/ALGORITHM.toml]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// Carry on from the checkpoint beside the output
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub run: Run,
}

/// Measures a controller: success rates, dangerous behavior, completion time, with 95 % intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller my_controller.safetensors --json")]
pub struct Evaluate {
    #[command(flatten)]
    pub subject: Subject,
    /// Number of simulations [default: 100]
    #[arg(long, value_name = "N")]
    pub episodes: Option<u64>,
    /// Where they start: whole, or reachable (the part of the box from which the task can be done)
    #[arg(long = "box", value_name = "PART")]
    pub starts: Option<String>,
    /// Run file for the simulations [default: a new one in runs/]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Carry on a run that was stopped, as its own plan says
    #[arg(long, value_name = "RUN", conflicts_with_all = ["subject", "episodes", "starts", "out", "seed"])]
    pub resume: Option<PathBuf>,
    #[command(flatten)]
    pub run: Run,
}

/// Searches for initial configurations from which a controller violates its formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle falsify ball-balancing --controller ppo --search random
  mishandle falsify ball-balancing --controller ppo --search dual-annealing --formula strict --trials 5
  mishandle falsify ball-balancing --controller ppo --formula 'always[50:300](ball_height_above_tray > 0)'
  mishandle falsify --resume runs/RUN.sqlite

Exit code 1 if a counterexample was found.")]
pub struct Falsify {
    #[command(flatten)]
    pub subject: Subject,
    /// Search: random, nelder-mead or dual-annealing [default: random]
    #[arg(long, value_name = "S")]
    pub search: Option<String>,
    /// What is to be violated: success, strict, or the text of a formula [default: success]
    #[arg(long)]
    pub formula: Option<String>,
    /// Number of trials [default: 30]
    #[arg(long, value_name = "N")]
    pub trials: Option<u32>,
    /// Simulations that a trial may spend [default: 300]
    #[arg(long, value_name = "N")]
    pub budget: Option<u32>,
    /// Run file for the simulations [default: a new one in runs/]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Carry on a run that was stopped, as its own plan says
    #[arg(long, value_name = "RUN")]
    #[arg(conflicts_with_all = ["subject", "search", "formula", "trials", "budget", "out", "seed"])]
    pub resume: Option<PathBuf>,
    #[command(flatten)]
    pub run: Run,
}

/// Runs a recorded simulation again and checks that it is the same to the bit
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv

Exit code 0 if the replay is the same to the bit, 2 if it is not.")]
pub struct Replay {
    /// Run file
    #[arg(value_name = "RUN")]
    pub file: PathBuf,
    /// Number of the trial [default: with --simulation 1, else any]
    #[arg(long, value_name = "N")]
    pub trial: Option<u32>,
    /// Number of the simulation within the trial [default: the first counterexample, else the least robust]
    #[arg(long, value_name = "N")]
    pub simulation: Option<u32>,
    /// Write the trace to this CSV file
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Number of threads; the result never depends on it [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// One JSON document on stdout
    #[arg(long)]
    pub json: bool,
}
