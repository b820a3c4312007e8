use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::plan::{EvaluatePlan, Until};
use mishandle::run::Engine;
use mishandle::store::{RunFile, RunWriter};
use mishandle::{Plan, ResolvedPlan};
use mishandle_report::{FlippedPairs, comparison_page};
use mishandle_text::shell_quote;

use crate::exit_status::ExitStatus;
use crate::flags::{self, Planned, numbers};
use crate::run;
use crate::run::sample_size::{self, Expectation};
use crate::show::progress::Bar;
use crate::show::{answer, comparison, difference, escape, output};
use crate::words::shell_command;

/// Compare two controllers, or two versions of one, on the same scenarios and seeds
#[derive(Debug, Args)]
#[command(override_usage = "mishandle compare [OPTIONS] <A> <B>\n       \
    mishandle compare [OPTIONS] <TARGET> --controller <C> --against <C>\n       \
    mishandle compare --resume <A> <B>\n       \
    mishandle compare --exact <A> <B>\n       \
    mishandle compare --expect <A> --expect <B>")]
#[command(after_help = "Examples:
  mishandle compare runs/evaluate-old.sqlite runs/evaluate-new.sqlite
  mishandle compare ball-balancing --controller ppo --against sac --episodes 1000
  mishandle compare point-reaching --controller ppo --against my.safetensors --action-noise 0.5
  mishandle compare door-opening --controller ppo --against sac --episodes 500 --until width=0.1
  mishandle compare old.sqlite new.sqlite --out compare.html     write a page
  mishandle compare old.sqlite new.sqlite --out c.html -k report.replay=true   with 3-D replays
  mishandle compare old.sqlite new.sqlite --exact                any question, to the bit
  mishandle compare --expect 0.90 --expect 0.94                  how many pairs will it take?

A and B are run files of `mishandle evaluate` with the same target, space, seed and number of
episodes. They are compared pair by pair. With --against, both controllers are evaluated first, and
the run files are kept in runs/.

Exit code 1 means that B fails in a simulation in which A succeeds, 2 also that too many simulations
of A or of B have no verdict (max-without-verdict), unless B violates the formula there. With
--exact, the runs may be of any question: simulations at the same place (trial and number) are
compared if they have the same scenario and seed. Exit code 0 means then that all trials,
simulations and traces are the same to the bit, also if the files were written by different
programs; 1 that they differ; 2 an error. With --expect, no target is simulated: the number that is
fixed beforehand is computed, and the rule that stops by itself is simulated on random verdicts.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Run file B; the first argument is then run file A
    #[arg(value_name = "B", conflicts_with_all = COMPARED)]
    pub second: Option<PathBuf>,
    /// Controller B, evaluated like the one of --controller, which is A
    #[arg(long, value_name = "C")]
    pub against: Option<String>,
    /// Number of simulations of each controller from random scenarios [default: 100, or that of the
    /// plan]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Stop by itself, looking after each batch of pairs, at most after --episodes pairs: decided
    /// (the interval of the difference excludes 0, or lies within -k compare.margin=D), or
    /// width=W. The interval and the p-value hold at any time
    #[arg(long, value_name = "RULE", conflicts_with = "second")]
    pub until: Option<Until>,
    /// Simulate nothing: show how many pairs it takes if the success rates of A and B are these, or
    /// those of two run files; give the flag twice
    #[arg(long, value_name = "RATE|RUN", value_parser = sample_size::expected, conflicts_with_all = SIMULATED)]
    pub expect: Vec<Expectation>,
    /// Show how two runs of any question differ: plan, target, program, results, and simulations
    /// with another verdict
    #[arg(long, requires = "second", conflicts_with_all = ["resume", "out", "seed"])]
    pub exact: bool,
    /// Continue the two run files of a comparison that stops by itself
    #[arg(long, requires = "second")]
    pub resume: bool,
    /// HTML page to write about the comparison
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite FILE if it exists
    #[arg(long, requires = "out")]
    pub force: bool,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

/// Arguments of `compare` that two run files already determine.
const COMPARED: [&str; 10] =
    ["controller", "space", "axis", "guard", "action_noise", "plan", "against", "episodes", "seed", "until"];

/// Arguments that mean nothing without simulations.
const SIMULATED: [&str; 9] =
    ["target", "controller", "against", "guard", "space", "axis", "action_noise", "out", "resume"];

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    if !command.expect.is_empty() {
        ensure!(command.expect.len() == 2, "give --expect twice: what is expected of A, and of B");
        return sample_size::show(&command.expect, planned(command)?, command.run.json);
    }
    if let Some(out) = &command.out {
        // Fails before the simulations if the output cannot be written.
        drop(output::create(out, command.force)?);
    }
    // Keys of the plan belong to the simulations, others to the reading and the conclusion.
    let keys = &command.subject.keys.keys;
    let (settings, max_share) = match command.second {
        Some(_) => flags::settings_of_runs(keys, "compare")?,
        None => Default::default(),
    };
    let skip_check = settings.engine.skip_check;
    ensure!(
        !command.exact || max_share.is_none(),
        "max-without-verdict has no effect with --exact, which compares records and concludes nothing; leave it out"
    );
    let paths = match (&command.subject.target, &command.second) {
        (Some(first), Some(second)) => {
            let paths = [PathBuf::from(first), second.clone()];
            if command.resume && !resume_pairs(&paths)? {
                return Ok(ExitStatus::Interrupted);
            }
            paths
        }
        (_, None) if command.against.is_some() => match evaluate_both(command)? {
            Some(paths) => paths,
            None => return Ok(ExitStatus::Interrupted),
        },
        _ => bail!(
            "expected two run files, or a target with --controller and --against: see mishandle compare --help"
        ),
    };
    let [first, second] = paths;
    if command.exact {
        return exact(&run::read(&first, skip_check)?, &run::read(&second, skip_check)?, command.run.json);
    }
    let a = run::read(&first, skip_check)?;
    let b = run::read(&second, skip_check)?;
    let mut found = mishandle::inspect::compare(&a, &b, shell_command)?;
    if let Some(max_share) = max_share {
        found.set_max_share(max_share);
    }
    if let Some(out) = &command.out {
        let has_replay = match command.second {
            Some(_) => settings.report.replay,
            None => planned(command)?.plan()?.1.report.replay,
        };
        let mut must_end = || run::control_flow().is_break();
        let flipped = FlippedPairs::simulate(&found, [&a, &b], has_replay, &mut must_end);
        let page = comparison_page(&found, [&a, &b], &flipped)?;
        output::write_atomically(out, command.force, page.as_bytes())?;
        output::message(&format!("Page: {}", shell_quote(&out.to_string_lossy())));
    }
    if command.run.json {
        output::json(&found)?;
    } else {
        let verdict = mishandle::verdict::comparison(&found);
        let details = if command.verbose.verbose { comparison::details(&found) } else { String::new() };
        answer::print_parts(Some(&verdict), &comparison::text(&found), &details)?;
    }
    // Exit code 0 would say that B fails nowhere, and 1 that it fails.
    ensure!(
        found.has_verdicts(),
        "the controllers were not compared: no random simulation of one of them has a verdict"
    );
    if let Some(reason) = &found.asks_nothing {
        bail!("no conclusion: both runs ask nothing: {}", escape::name(reason));
    }
    for (name, run) in [("A", &found.first), ("B", &found.second)] {
        run::answers::conclude(&run.without_verdict, found.new_violations > 0).context(name)?;
    }
    Ok(if !found.new_failures.is_empty() { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Shows how two runs differ. They are the same if all trials, simulations and traces are.
fn exact(first: &RunFile, second: &RunFile, as_json: bool) -> Result<ExitStatus> {
    let found = mishandle::inspect::run_difference(first, second)?;
    if as_json {
        output::json(&found)?;
    } else {
        output::line(&difference::text(&found))?;
    }
    Ok(if found.same_records { ExitStatus::Done } else { ExitStatus::Violated })
}

fn planned(command: &Arguments) -> Result<Planned> {
    let mut planned = flags::planned("compare", &command.subject, &command.run)?;
    planned.number("--episodes", "evaluate.episodes", command.episodes)?;
    planned.flag("--until", "compare.until", command.until.map(String::from))?;
    Ok(planned)
}

/// Evaluates both controllers. Returns `None` if a signal interrupts it.
fn evaluate_both(command: &Arguments) -> Result<Option<[PathBuf; 2]>> {
    let planned = planned(command)?;
    let has_rule = planned.stated_in("compare").next().is_none() || planned.has("compare", "until");
    let (mut plan, _) = planned.plan()?;
    ensure!(
        has_rule,
        "the keys of the table compare need a rule that stops the comparison: give --until decided or --until width=W"
    );
    let Plan { evaluate, compare, .. } = plan.clone();
    plan = Plan { compare, ..plan.without_questions() };
    plan.evaluate = Some(EvaluatePlan {
        // B stands beside A, and nothing here shows a control arm.
        control: false,
        until: None,
        rate: None,
        ..evaluate.unwrap_or_default()
    });
    let mut other = plan.clone();
    other.controller = command.against.clone().unwrap_or_default();
    // Both before the first simulation, so that a mistake in the second is reported at once.
    let plans = [ResolvedPlan::new(&plan)?, ResolvedPlan::new(&other)?];
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    // Both files, so that the commands that resume them work after an interruption.
    let [first, second] = &plans;
    let files = [run::create(first, None)?, run::create(second, None)?];
    let paths = files.each_ref().map(|run| run.file().path().to_path_buf());
    let names = paths.each_ref().map(|path| shell_quote(&path.to_string_lossy()));
    if plan.compare.is_some() {
        return Ok(run_pairs([first, second], files, &names, &bar)?.then_some(paths));
    }
    for (index, (resolved, file)) in plans.iter().zip(files).enumerate() {
        bar.set_length(mishandle::run::evaluation_simulations(resolved)?);
        bar.set_note(resolved.plan.controller.clone());
        let answer = mishandle::run::ask(resolved, file, Engine::Direct, &mut |progress| {
            bar.set_position(progress.simulations);
            run::control_flow()
        })?;
        if !answer.is_complete() {
            bar.clear();
            let resume = names[index..].iter().map(|name| format!("mishandle evaluate --resume {name}"));
            let compare = format!("mishandle compare {}", names.join(" "));
            let commands: Vec<String> = resume.chain([compare]).collect();
            output::message(&format!("interrupted; continue with:\n{}", commands.join("\n")));
            return Ok(None);
        }
        output::message(&format!("Run file: {}", names[index]));
    }
    bar.clear();
    Ok(Some(paths))
}

/// Runs both evaluations in step until the rule decides. Returns `false` if a signal interrupts
/// them.
fn run_pairs(
    plans: [&ResolvedPlan; 2],
    files: [RunWriter; 2],
    names: &[String; 2],
    bar: &Bar,
) -> Result<bool> {
    let answers = mishandle::run::evaluate_pairs(plans, files, |done, max| {
        bar.set_length(max);
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    let is_complete = answers.iter().all(|answer| answer.is_complete);
    if is_complete {
        names.iter().for_each(|name| output::message(&format!("Run file: {name}")));
    } else {
        output::message(&format!(
            "interrupted; continue with:\nmishandle compare --resume {}",
            names.join(" ")
        ));
    }
    Ok(is_complete)
}

/// Continues the run files of a comparison that stops by itself. Returns `false` if a signal
/// interrupts it.
fn resume_pairs(paths: &[PathBuf; 2]) -> Result<bool> {
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let mut files = Vec::new();
    for path in paths {
        let file = RunWriter::resume(path)?;
        let resolved = mishandle::resolve::recorded_plan(file.file().header(), None)?;
        ensure!(
            resolved.plan.compare.is_some(),
            "{} is no run of a comparison that stops by itself; resume it with mishandle evaluate --resume",
            path.display()
        );
        files.push((resolved, file));
    }
    let names = paths.each_ref().map(|path| shell_quote(&path.to_string_lossy()));
    match <[_; 2]>::try_from(files) {
        Ok([(first, a), (second, b)]) => run_pairs([&first, &second], [a, b], &names, &bar),
        Err(_) => bail!("expected two run files"),
    }
}
