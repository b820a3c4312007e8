use std::path::PathBuf;

use anyhow::{Result, anyhow, bail, ensure};
use clap::{Args, FromArgMatches};
use mishandle::Plan;
use mishandle::bisect::{BisectionPlan, BisectionTest, Watch, bisect};
use mishandle::results::Bisection;
use mishandle_text::{path_text, shell_quote};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{bisection, output};

/// Default of --out.
const OUT: &str = "runs/bisect";

/// Arguments of a test by a rate.
const OF_RATE: [&str; 6] = ["rate", "target", "space", "action_noise", "episodes", "plan"];

/// Success rates.
const RATE: &str = "a number between 0 and 1, such as 0.95";

fn is_rate(rate: f64) -> bool {
    0.0 < rate && rate < 1.0
}

/// Find the first checkpoint that fails a counterexample or falls below a success rate
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle bisect checkpoints --counterexamples failures
  mishandle bisect checkpoints --target point-reaching --rate 0.95 --episodes 2000

The controllers of a folder are ordered by name, with numbers by value. A test by a rate gives all
candidates the same scenarios and seeds, and ends as soon as an interval that holds at any time is
on one side of the rate. What was simulated is kept in the folder of --out: the same command
continues, and `mishandle report` writes a page about the folder.

Exit code 0 means that the first failing candidate was found, 1 that it was not: the first candidate
does not pass, the last one does not fail, or candidates between are undecided; 2 an error.")]
pub struct Arguments {
    /// Folder of controllers (*.safetensors, *.onnx), the oldest first
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Counterexample (.json) or folder of counterexamples, as for `mishandle regress`: a candidate
    /// fails if it violates one
    #[arg(long, value_name = "PATH", conflicts_with_all = OF_RATE)]
    pub counterexamples: Option<PathBuf>,
    /// Lowest success rate of a candidate that passes
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, value_parser = numbers::number(RATE, is_rate))]
    pub rate: Option<f64>,
    /// With --rate: the target, a task, or the path of a target file (.toml)
    #[arg(long, value_name = "TARGET", requires = "rate")]
    pub target: Option<String>,
    /// With --rate: scenario space of the target, or several joined by + [default: the first one]
    #[arg(long, value_name = "NAME", requires = "rate")]
    pub space: Option<String>,
    /// With --rate: standard deviation of the Gaussian noise on each action [default: 0]
    #[arg(long, value_name = "STD", requires = "rate")]
    pub action_noise: Option<f64>,
    /// With --rate: largest number of simulations of a candidate [default: 1000, or that of the
    /// plan]
    #[arg(long, value_name = "N", requires = "rate", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// With --rate: plan of the evaluation (TOML); other flags override it
    #[arg(long, value_name = "FILE", requires = "rate")]
    pub plan: Option<PathBuf>,
    /// Test every candidate, and say whether one passes after one that fails
    #[arg(long)]
    pub all: bool,
    /// Folder of the result and of finished tests
    #[arg(long, value_name = "DIR", default_value = OUT)]
    pub out: PathBuf,
    #[command(flatten)]
    pub run: flags::Run,
}

impl Arguments {
    /// Returns the question.
    fn plan(&self) -> Result<BisectionPlan> {
        Ok(BisectionPlan {
            controllers: self.folder.clone(),
            test: self.test()?,
            all: self.all,
            folder: self.out.clone(),
            command: self.command(),
        })
    }

    fn test(&self) -> Result<BisectionTest> {
        if let Some(path) = &self.counterexamples {
            ensure!(
                self.run.seed.is_none(),
                "--seed does not apply: counterexamples have seeds of their own"
            );
            return Ok(BisectionTest::Counterexamples(path.clone()));
        }
        let Some(bar) = self.rate else { bail!("give a test: --counterexamples PATH or --rate RATE") };
        ensure!(
            self.target.is_some() || self.plan.is_some(),
            "--rate needs a target: give --target TARGET or --plan FILE"
        );
        let mut planned = flags::Planned::new(&flags::Keys { keys: Vec::new(), plan: self.plan.clone() })?;
        planned.flag("--target", "target", self.target.clone())?;
        planned.flag("--space", "space", self.space.clone())?;
        planned.flag("--action-noise", "action-noise", self.action_noise)?;
        planned.number("--seed", "seed", self.run.seed)?;
        Ok(BisectionTest::rate(planned.plan()?.0, bar, self.episodes)?)
    }

    /// Returns the command that asks the question, without the flags that do not change the result.
    fn command(&self) -> String {
        let path = |path: &Option<PathBuf>| path.as_deref().map(path_text);
        let number = |number: Option<u64>| number.map(|number| number.to_string());
        let given = [
            ("--counterexamples", path(&self.counterexamples)),
            ("--rate", self.rate.map(|rate| rate.to_string())),
            ("--target", self.target.clone()),
            ("--space", self.space.clone()),
            ("--action-noise", self.action_noise.map(|noise| noise.to_string())),
            ("--episodes", number(self.episodes)),
            ("--plan", path(&self.plan)),
            ("--seed", number(self.run.seed)),
            ("--out", path(&Some(self.out.clone())).filter(|out| out != OUT)),
        ];
        let mut words = vec![format!("mishandle bisect {}", shell_quote(&path_text(&self.folder)))];
        words.extend(
            given.into_iter().filter_map(|(flag, value)| Some(format!("{flag} {}", shell_quote(&value?)))),
        );
        words.extend(self.all.then(|| "--all".to_string()));
        words.join(" ")
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let plan = command.plan()?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let found = bisect(&plan, &mut |progress| {
        let (done, most) = progress.simulations;
        bar.set_note(progress.candidate.name.clone());
        bar.set_length(most);
        bar.set_position(done);
        run::control_flow()
    });
    bar.clear();
    let found = found?;
    if command.run.json {
        output::json(&found)?;
    } else {
        output::line(&bisection::text(&found))?;
    }
    let folder = shell_quote(&path_text(&command.out));
    if !found.is_complete {
        output::message(&format!(
            "interrupted: what was simulated is kept in {folder}; the same command continues"
        ));
        return Ok(ExitStatus::Interrupted);
    }
    output::message(&format!("Write a page with: mishandle report {folder} --out bisection.html"));
    Ok(if found.found { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Asks the question of command-line words, without the names of the program and of the command.
///
/// # Errors
/// If a word is wrong, or as for [`bisect`].
pub fn ask(words: &[String], watch: Watch<'_>) -> Result<Bisection> {
    let program = Arguments::augment_args(clap::Command::new("bisect").no_binary_name(true));
    let parsed = program.try_get_matches_from(words);
    let parsed = parsed.and_then(|matches| Arguments::from_arg_matches(&matches));
    let command = parsed.map_err(|error| {
        // What follows are hints for a terminal.
        let text = error.to_string();
        let problem = text.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
        anyhow!("{}", problem.split_whitespace().collect::<Vec<_>>().join(" "))
    })?;
    Ok(bisect(&command.plan()?, watch)?)
}
