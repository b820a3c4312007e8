use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use mishandle::evaluation::{Corners, Estimate};
use mishandle::{
    ComparedPair, ComparedRun, Comparison, EvaluatePlan, PairedMeans, PairedRates, Plan, ResolvedPlan,
    decimal, p_value_text, plural, shell_quote,
};
use mishandle_report::comparison_page;
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::output::{self, number};
use crate::show::progress::Bar;
use crate::show::{escape, scenario};

/// Compare two controllers, or two versions of one, on the same scenarios and seeds
#[derive(Debug, Args)]
#[command(override_usage = "mishandle compare [OPTIONS] <A> <B>\n       \
    mishandle compare [OPTIONS] <TARGET> --controller <C> --against <C>")]
#[command(after_help = "Examples:
  mishandle compare runs/evaluate-old.sqlite runs/evaluate-new.sqlite
  mishandle compare ball-balancing --controller ppo --against sac --episodes 1000
  mishandle compare point-reaching --controller ppo --against my.safetensors --action-noise 0.5
  mishandle compare old.sqlite new.sqlite --out compare.html     write a page

A and B are run files of `mishandle evaluate` with the same target, space, seed and number of
episodes. They are compared pair by pair. With --against, both controllers are evaluated first, and
the run files are kept in runs/.

Exit code 1 means that B fails in a simulation in which A succeeds.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Run file B; the first argument is then run file A
    #[arg(value_name = "B", conflicts_with_all = COMPARED)]
    pub second: Option<PathBuf>,
    /// Controller B, evaluated like the one of --controller, which is A
    #[arg(long, value_name = "C")]
    pub against: Option<String>,
    /// Number of simulations of each controller from random scenarios [default: 100, or that of the plan]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// HTML page to write about the comparison
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite FILE if it exists
    #[arg(long, requires = "out")]
    pub force: bool,
    /// Do not check the whole run files before reading them; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    #[command(flatten)]
    pub run: flags::Run,
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

/// Largest number of new or fixed failures in the text. The JSON document lists all.
const MAX_LISTED: usize = 20;

/// Largest number of axes whose values the text shows.
const MAX_VALUES: usize = 6;

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    if let Some(out) = &command.out {
        // Fails before the simulations if the output cannot be written.
        drop(output::create(out, command.force)?);
    }
    let paths = match (&command.subject.target, &command.second) {
        (Some(first), Some(second)) => [PathBuf::from(first), second.clone()],
        (_, None) if command.against.is_some() => match evaluate_both(command)? {
            Some(paths) => paths,
            None => return Ok(ExitStatus::Interrupted),
        },
        _ => bail!(
            "expected two run files, or a target with --controller and --against: see mishandle compare --help"
        ),
    };
    let [first, second] = paths;
    let (a, b) = (run::read(&first, command.skip_check)?, run::read(&second, command.skip_check)?);
    let found = mishandle::compare(&a, &b)?;
    if let Some(out) = &command.out {
        output::write_atomically(out, command.force, comparison_page(&found, [&a, &b]).as_bytes())?;
        output::message(&format!("Page: {}", shell_quote(&out.to_string_lossy())));
    }
    if command.run.json {
        output::json(document(&found))?;
    } else {
        output::line(&text(&found))?;
    }
    Ok(if found.has_new_failures() { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Evaluates both controllers. Returns `None` if a signal interrupts it.
fn evaluate_both(command: &Arguments) -> Result<Option<[PathBuf; 2]>> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let evaluate = plan.evaluate.take().unwrap_or_default();
    (plan.falsify, plan.risk) = (None, None);
    plan.evaluate = Some(EvaluatePlan {
        episodes: command.episodes.unwrap_or(evaluate.episodes),
        batch: command.subject.batch.unwrap_or(evaluate.batch),
        ..evaluate
    });
    let mut other = plan.clone();
    other.controller = command.against.clone().unwrap_or_default();
    // Both before the first simulation, so that a mistake in the second is reported at once.
    let plans = [ResolvedPlan::new(&plan)?, ResolvedPlan::new(&other)?];
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    // Both files, so that the commands that resume them work after an interruption.
    let [first, second] = &plans;
    let files = [mishandle::create_run(first, None)?, mishandle::create_run(second, None)?];
    let paths = files.each_ref().map(|run| run.file().path().to_path_buf());
    let names = paths.each_ref().map(|path| shell_quote(&path.to_string_lossy()));
    for (index, (resolved, file)) in plans.iter().zip(files).enumerate() {
        bar.set_length(mishandle::evaluation_simulations(resolved));
        bar.set_note(resolved.plan.controller.clone());
        let outcome = mishandle::evaluate(resolved, file, |done| {
            bar.set_position(done);
            run::control_flow()
        })?;
        if !outcome.is_complete {
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

/// Returns the JSON document.
pub fn document(found: &Comparison) -> Value {
    let compared = |run: &ComparedRun| {
        json!({
            "run": run.path.to_string_lossy(),
            "controller": run.controller,
            "controller_hash": run.controller_hash,
            "target_hash": run.target_hash,
            "commit": run.commit,
        })
    };
    let rates = |rates: &PairedRates| {
        json!({
            "first": output::estimate(&rates.first),
            "second": output::estimate(&rates.second),
            "difference": output::estimate(&rates.difference),
            "first_only": rates.counts.first_only,
            "second_only": rates.counts.second_only,
            "p_value": number(rates.p_value),
        })
    };
    let means = |means: &PairedMeans| {
        let (smaller, larger) = means.smaller_and_larger;
        json!({
            "first": means.first.map(number),
            "second": means.second.map(number),
            "difference": output::estimate(&means.difference),
            "smaller": smaller,
            "larger": larger,
            "p_value": number(means.p_value),
        })
    };
    let pairs = |pairs: &[ComparedPair], run: &ComparedRun| {
        let entries = pairs.iter().map(|pair| {
            let named = found.axes.iter().zip(&pair.scenario);
            json!({
                "trial": pair.trial,
                "simulation": pair.number,
                "seed": pair.seed.to_string(),
                "scenario": named.map(|(axis, value)| (axis.name.clone(), json!(value))).collect::<Value>(),
                "first_robustness": pair.first_robustness.map(number),
                "second_robustness": pair.second_robustness.map(number),
                "replay": replay(found, run, pair),
            })
        });
        entries.collect::<Vec<_>>()
    };
    json!({
        "target": found.target,
        "formula": found.formula,
        "first": compared(&found.first),
        "second": compared(&found.second),
        "differences": found.differences,
        "pairs": found.pairs,
        "success": rates(&found.success),
        "strict_success": found.strict.as_ref().map(rates),
        "robustness": means(&found.robustness),
        "dangerous_steps": found.dangerous_steps.as_ref().map(means),
        "completion_step": found.completion_step.as_ref().map(means),
        "new_failures": pairs(&found.new_failures, &found.second),
        "fixed_failures": pairs(&found.fixed_failures, &found.first),
    })
}

/// Returns the command that replays the failure.
fn replay(found: &Comparison, run: &ComparedRun, pair: &ComparedPair) -> String {
    mishandle::replay_command(&found.target_kind, &run.path, pair.trial, pair.number)
}

fn text(found: &Comparison) -> String {
    let name = |run: &ComparedRun| {
        let controller =
            run.controller.as_deref().map_or(String::new(), |name| format!("{}, ", escape::name(name)));
        format!("{controller}{}", escape::name(&run.path.to_string_lossy()))
    };
    let mut parts = vec![format!(
        "{}: {} on the same scenarios and seeds\nA: {}\nB: {}",
        escape::name(&found.target),
        plural(found.pairs, "pair"),
        name(&found.first),
        name(&found.second),
    )];
    if found.first.controller_hash == found.second.controller_hash
        && found.first.target_hash == found.second.target_hash
    {
        parts.push("A and B have the same controller and target".to_string());
    }
    if !found.differences.is_empty() {
        let listed: Vec<String> =
            found.differences.iter().map(|difference| escape::name(difference)).collect();
        parts.push(format!("A and B also differ in:\n  {}", listed.join("\n  ")));
    }
    parts.push(output::table(&table(found)));
    parts.push(format!("{} The other p-values are of exact sign tests.", found.verdict()));
    let lists = [
        ("New failures: A succeeds, B fails", &found.new_failures, &found.second),
        ("Fixed failures: A fails, B succeeds", &found.fixed_failures, &found.first),
    ];
    parts.extend(
        lists
            .into_iter()
            .filter(|(_, pairs, _)| !pairs.is_empty())
            .map(|(title, pairs, run)| list(found, title, pairs, run)),
    );
    parts.join("\n\n")
}

fn table(found: &Comparison) -> Vec<Vec<String>> {
    let mut rows = vec![["", "A", "B", "B - A", "95 % interval", "p", "n"].map(String::from).to_vec()];
    let percent = |value: Option<f64>| value.map_or("-".to_string(), |rate| format!("{:.2} %", 100.0 * rate));
    let rates = [("success rate", Some(&found.success)), ("strict success rate", found.strict.as_ref())];
    for (name, rates) in rates.into_iter().filter_map(|(name, rates)| Some((name, rates?))) {
        let PairedRates { first, second, difference, p_value, .. } = rates;
        let points = |value: f64| format!("{:+.2}", 100.0 * value);
        rows.push(vec![
            name.to_string(),
            percent(first.value),
            percent(second.value),
            difference.value.map_or("-".to_string(), points),
            interval(difference, &points),
            p_value_text(*p_value),
            difference.n.to_string(),
        ]);
    }
    let means = [
        ("robustness", 4, Some(&found.robustness)),
        ("dangerous control steps", 2, found.dangerous_steps.as_ref()),
        ("completion step, if both succeed", 2, found.completion_step.as_ref()),
    ];
    for (name, decimals, means) in means.into_iter().filter_map(|(name, n, means)| Some((name, n, means?))) {
        let mean = |value: Option<f64>| value.map_or("-".to_string(), |mean| decimal(mean, decimals));
        let signed = |value: f64| {
            let sign = if value.is_sign_negative() { "" } else { "+" };
            format!("{sign}{}", decimal(value, decimals))
        };
        rows.push(vec![
            name.to_string(),
            mean(means.first),
            mean(means.second),
            means.difference.value.map_or("-".to_string(), signed),
            interval(&means.difference, &signed),
            p_value_text(means.p_value),
            means.difference.n.to_string(),
        ]);
    }
    rows
}

fn interval(estimate: &Estimate, show: &dyn Fn(f64) -> String) -> String {
    let ends = estimate.low.zip(estimate.high);
    ends.map_or("-".to_string(), |(low, high)| format!("[{}, {}]", show(low), show(high)))
}

fn list(found: &Comparison, title: &str, pairs: &[ComparedPair], run: &ComparedRun) -> String {
    let mut rows = vec![
        ["trial", "simulation", "seed", "scenario", "robustness A", "robustness B"]
            .map(String::from)
            .to_vec(),
    ];
    let robustness = |value: Option<f64>| value.map_or("no verdict".to_string(), |rho| decimal(rho, 4));
    for pair in pairs.iter().take(MAX_LISTED) {
        rows.push(vec![
            pair.trial.to_string(),
            pair.number.to_string(),
            pair.seed.to_string(),
            scenario::recorded_text(&found.axes, &pair.scenario, MAX_VALUES),
            robustness(pair.first_robustness),
            robustness(pair.second_robustness),
        ]);
    }
    let more = pairs.len().saturating_sub(MAX_LISTED);
    let more = if more > 0 { format!("\n… and {more} more: --json lists all") } else { String::new() };
    let example = pairs.first().map_or(String::new(), |pair| replay(found, run, pair));
    let has_corners = pairs.iter().any(|pair| pair.trial == Corners::TRIAL);
    let corners = if has_corners { "; trial 2: corners and center of the initial box" } else { "" };
    format!("{title} ({}){corners}\n{}{more}\nReplay the first: {example}", pairs.len(), output::table(&rows))
}
