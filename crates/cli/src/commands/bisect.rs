use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::bisect::{BisectionPlan, BisectionTest, bisect, folder_candidates, git_candidates};
use mishandle_text::shell_quote;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{bisection, output};

/// Success rates.
const RATE: &str = "a number between 0 and 1, such as 0.95";

fn is_rate(rate: f64) -> bool {
    0.0 < rate && rate < 1.0
}

/// Find the first checkpoint, or Git revision of a controller, that fails a counterexample or falls
/// below a success rate
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle bisect checkpoints --counterexamples failures
  mishandle bisect checkpoints --target point-reaching --rate 0.95 --episodes 2000
  mishandle bisect --git policy.onnx --good v1.0 --bad HEAD --target arm.toml --rate 0.9

The controllers of a folder are ordered by name, with numbers by value. A test by a rate gives all
candidates the same scenarios and seeds, and ends as soon as an interval that holds at any time is
on one side of the rate. Finished tests are kept in the folder of --cache: the same command
continues.

Exit code 0 means that the first failing candidate was found, 1 that the first candidate does not
pass or the last one does not fail, 2 an error.")]
pub struct Arguments {
    /// Folder of controllers (*.safetensors, *.onnx), the oldest first
    #[arg(value_name = "DIR", required_unless_present = "git")]
    pub folder: Option<PathBuf>,
    /// Controller file in a Git repository: its revisions are the candidates. The working tree is
    /// not touched
    #[arg(long, value_name = "FILE", conflicts_with = "folder")]
    pub git: Option<PathBuf>,
    /// Revision that passes [default: the first one that has the file]
    #[arg(long, value_name = "REV", requires = "git")]
    pub good: Option<String>,
    /// Revision that fails [default: HEAD]
    #[arg(long, value_name = "REV", requires = "git")]
    pub bad: Option<String>,
    /// Counterexample or folder of them, as for `mishandle regress`: a candidate fails if it
    /// violates one
    #[arg(long, value_name = "PATH", conflicts_with_all = ["rate", "target", "plan"])]
    pub counterexamples: Option<PathBuf>,
    /// Lowest success rate of a candidate that passes
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, value_parser = numbers::number(RATE, is_rate))]
    #[arg(required_unless_present = "counterexamples")]
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
    /// Folder of finished tests, and of revisions
    #[arg(long, value_name = "DIR", default_value = "runs/bisect")]
    pub cache: PathBuf,
    #[command(flatten)]
    pub run: flags::Run,
}

/// Default of --episodes.
const EPISODES: u64 = 1000;

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let test = test(command)?;
    let candidates = match (&command.folder, &command.git) {
        (Some(folder), _) => folder_candidates(folder)?,
        (None, Some(file)) => {
            let range = (command.good.as_deref(), command.bad.as_deref());
            git_candidates(file, range, &command.cache.join("revisions"))?
        }
        (None, None) => bail!("name a folder of controllers, or a file with --git"),
    };
    let plan = BisectionPlan { candidates, test, all: command.all, cache: command.cache.clone() };
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
    match command.run.json {
        true => output::json(&found)?,
        false => output::line(&bisection::text(&found))?,
    }
    if !found.is_complete {
        let cache = shell_quote(&command.cache.to_string_lossy());
        output::message(&format!(
            "interrupted: finished tests are kept in {cache}; the same command continues"
        ));
        return Ok(ExitStatus::Interrupted);
    }
    Ok(if found.found { ExitStatus::Done } else { ExitStatus::Violated })
}

fn test(command: &Arguments) -> Result<BisectionTest> {
    if let Some(path) = &command.counterexamples {
        ensure!(command.run.seed.is_none(), "--seed does not apply: counterexamples have seeds of their own");
        return Ok(BisectionTest::Counterexamples(path.clone()));
    }
    let Some(bar) = command.rate else { bail!("give a test: --counterexamples PATH or --rate RATE") };
    ensure!(
        command.target.is_some() || command.plan.is_some(),
        "--rate needs a target: give --target TARGET or --plan FILE"
    );
    let subject = flags::Subject {
        target: command.target.clone(),
        command: None,
        controller: None,
        guard: None,
        space: command.space.clone(),
        axes: flags::Axes { axis: Vec::new(), set: Vec::new() },
        requirement: Vec::new(),
        batch: None,
        preset: None,
        action_noise: command.action_noise,
        observation_noise: None,
        stochastic: false,
        plan: command.plan.clone(),
    };
    let plan = flags::plan(&subject, &command.run)?;
    let mut plan = plan.only(mishandle::store::RunKind::Evaluate);
    let is_planned = plan.evaluate.is_some();
    let mut evaluate = plan.evaluate.take().unwrap_or_default();
    evaluate.episodes = match (command.episodes, is_planned) {
        (Some(episodes), _) => episodes,
        (None, true) => evaluate.episodes,
        (None, false) => EPISODES,
    };
    plan.evaluate = Some(evaluate);
    ensure!(
        plan.screening.is_none(),
        "a bisection has no screening: remove the table [screening] of the plan"
    );
    Ok(BisectionTest::Rate { plan: Box::new(plan), bar })
}
