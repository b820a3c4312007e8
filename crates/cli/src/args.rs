//! Command-line arguments and their help.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::LazyLock;

use anyhow::{Result, ensure};
use clap::{Args, Parser, Subcommand};
use mishandle::rollout::Noise;
use mishandle::{AxisSetting, Plan};

use crate::commands::{
    campaign, compare, completions, controller, counterexamples, curve, evaluate, explain, export, falsify,
    man, margin, monitor, regress, render, replay, report, reproduce, risk, runs, searches, simulate,
    targets, tasks, train,
};
use crate::numbers::{integer, number};

/// Random seeds.
pub const SEEDS: RangeInclusive<u64> = 0..=u64::MAX;

/// Numbers of threads: more than any machine has cores.
pub const THREADS: RangeInclusive<u64> = 1..=1024;

/// Numbers of trials and simulations in a run file.
pub const NUMBERS: RangeInclusive<u64> = 1..=u32::MAX as u64;

/// Numbers of repeated simulations of a scenario.
pub const REPEATS: RangeInclusive<u64> = 1..=10_000_000;

/// Numbers of random scenarios that measure noise.
pub const SCENARIOS: RangeInclusive<u64> = 0..=1_000_000;

/// Standard deviations of noise.
const NOISE: &str = "a number from 0 to 10, such as 0.5";

fn is_noise(std: f64) -> bool {
    (0.0..=Noise::MAX_STD).contains(&std)
}

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
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    Tasks(tasks::Arguments),
    Targets(targets::Arguments),
    Searches(searches::Arguments),
    Monitor(monitor::Arguments),
    Train(train::Arguments),
    Controller(controller::Arguments),
    Curve(curve::Arguments),
    Evaluate(evaluate::Arguments),
    Falsify(falsify::Arguments),
    Campaign(campaign::Arguments),
    Reproduce(reproduce::Arguments),
    Compare(compare::Arguments),
    Margin(margin::Arguments),
    Risk(risk::Arguments),
    Simulate(simulate::Arguments),
    Runs(runs::Arguments),
    Export(export::Arguments),
    Replay(replay::Arguments),
    Explain(explain::Arguments),
    Counterexamples(counterexamples::Arguments),
    Regress(regress::Arguments),
    Render(render::Arguments),
    Report(report::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
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
    /// Run file to create (SQLite) [default: a new file in runs/]. --backend gpu creates none: there, evaluate has no --out,
    /// and that of falsify is the .json file of its first counterexample
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

/// Where simulations are screened.
#[derive(Debug, Args)]
pub struct Screen {
    /// Physics engine of the simulations: cpu (MuJoCo C), or gpu (MuJoCo Warp; MuJoCo C repeats every violation and a random
    /// sample of the others, and only these count) [default: cpu]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<Backend>,
    /// With --backend gpu: number of worlds on the GPU [default: 16384]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(1..=1_048_576))]
    pub rows: Option<u32>,
    /// With --backend gpu: share of the simulations without a violation that MuJoCo C repeats, above 0 and up to 1
    /// [default: 0.1]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = share)]
    pub confirm: Option<f64>,
}

impl Screen {
    /// Returns whether a GPU screens the simulations.
    pub fn is_gpu(&self) -> bool {
        self.backend == Some(Backend::Gpu)
    }

    /// Returns the number of worlds.
    pub fn rows(&self) -> u32 {
        self.rows.unwrap_or(16_384)
    }

    /// Returns the share of the simulations without a violation that MuJoCo C repeats.
    pub fn confirm(&self) -> f64 {
        self.confirm.unwrap_or(0.1)
    }

    /// Checks that no flag is without effect.
    pub fn check(&self) -> Result<()> {
        ensure!(
            self.is_gpu() || (self.rows.is_none() && self.confirm.is_none()),
            "--rows and --confirm need --backend gpu"
        );
        Ok(())
    }
}

/// Physics engine of the simulations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Backend {
    /// MuJoCo C
    Cpu,
    /// MuJoCo Warp
    Gpu,
}

/// Parses a share above 0.
fn share(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    let expected = || "expected a number above 0 and up to 1, such as 0.1".to_string();
    number.filter(|share| *share > 0.0 && *share <= 1.0).ok_or_else(expected)
}

/// Arguments of all commands that a resumed run takes from its own plan. The path of the controller is not among them.
const PLANNED: [&str; 12] = [
    "target",
    "space",
    "axis",
    "set",
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
    /// Scenario space of the target, or several joined by + [default: starts; of margin: disturbance]
    #[arg(long, value_name = "NAME")]
    pub space: Option<String>,
    /// Vary this axis only from LOW to HIGH; repeat the flag for several axes. An axis outside of the space is added to it
    #[arg(long, value_name = "NAME=LOW:HIGH", allow_hyphen_values = true, value_parser = axis_range)]
    pub axis: Vec<(String, AxisSetting)>,
    /// Fix this axis at a value, or at a category; repeat the flag for several axes. It may be outside of the space
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true, value_parser = axis_value)]
    pub set: Vec<(String, AxisSetting)>,
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

/// Parses `NAME=LOW:HIGH`.
fn axis_range(text: &str) -> Result<(String, AxisSetting), String> {
    let parsed = text.split_once('=').and_then(|(name, range)| {
        let (low, high) = range.split_once(':')?;
        Some((name.to_string(), AxisSetting::Range([low.parse().ok()?, high.parse().ok()?])))
    });
    let expected = "expected the name of an axis and two numbers with decimal points, such as ball_x=0.2:0.3";
    parsed.ok_or_else(|| expected.to_string())
}

/// Parses `NAME=VALUE`.
fn axis_value(text: &str) -> Result<(String, AxisSetting), String> {
    let (name, value) = text
        .split_once('=')
        .filter(|(_, value)| !value.is_empty())
        .ok_or("expected the name of an axis and a value, such as action_delay=2")?;
    if let Some((low, high)) = value.split_once(':')
        && low.parse::<f64>().is_ok()
        && high.parse::<f64>().is_ok()
    {
        return Err(format!("expected one value, found a range; give --axis {name}={value}"));
    }
    let setting = value.parse().map_or_else(|_| AxisSetting::Category(value.to_string()), AxisSetting::Value);
    Ok((name.to_string(), setting))
}

/// Flags that choose a simulation of a run file, or an exported counterexample.
#[derive(Debug, Args)]
pub struct Recorded {
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
}

/// Flags of commands that write the trace of one simulation.
#[derive(Debug, Args)]
pub struct TraceFile {
    /// Write the trace to this CSV file
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Columns of the trace: signals; or full, which adds joint positions and velocities, actions and contact forces of
    /// tasks [default: signals]
    #[arg(long, value_name = "COLUMNS", requires = "trace", value_parser = ["signals", "full"])]
    pub record: Option<String>,
}

impl TraceFile {
    /// Returns whether the trace has more than the signals.
    pub fn is_full(&self) -> bool {
        self.record.as_deref() == Some("full")
    }
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
        check(&CommandLine::command());
    }
}
