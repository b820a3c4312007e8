use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use mishandle::results::{FormulaDescription, FormulaExample};
use mishandle::stl::Formula;
use mishandle_logs::Evaluation;
use mishandle_requirements::{Context, describe_formula, draw, find_examples, pattern, with_values};

use crate::exit_status::ExitStatus;
use crate::flags::{LogFlags, numbers};
use crate::run::formula_context::{self, Drawn};
use crate::run::logs;
use crate::show::{formula as shown, formula_chart, output};

/// Durations of episodes.
const EPISODE: &str = "a number of seconds above 0, such as 5";

fn is_duration(secs: f64) -> bool {
    secs > 0.0 && secs.is_finite()
}

/// Explain a formula in words, warn about known traps, and draw it over an example
#[derive(Debug, Args)]
#[command(override_usage = "mishandle formula [OPTIONS] <FORMULA> [LOG]...\n       \
    mishandle formula [OPTIONS] --pattern <NAME> [--set <NAME=VALUE>]... [LOG]...")]
#[command(
    after_help = "The formula is a text, the name of a formula of --target, or that of a requirement of --formulas.
It is drawn over the logs, over the nominal episode of the target, or over two traces that the
program finds for it: one satisfies it, one violates it.

Examples:
  mishandle formula 'always[0:2s](force <= 20)'
  mishandle formula 'always(closed >= 1 implies eventually[0:2s] force >= 5)' rig.csv
  mishandle formula success --target ball-balancing
  mishandle formula --pattern response --set p='x >= 1' --set q='y <= 0.1' --set deadline=2s

With --strict, a warning gives exit code 1; notes do not. docs/guide/requirements.md describes the
traps, docs/reference/patterns.md the patterns."
)]
pub struct Arguments {
    /// Formula, and files with a log each to draw it over; with --pattern, logs only
    #[arg(value_name = "FORMULA|LOG", required_unless_present = "pattern")]
    pub words: Vec<String>,
    /// Pattern that makes the formula
    #[arg(long, value_name = "NAME")]
    pub pattern: Option<String>,
    /// Parameter of the pattern; repeat the flag for several. Without any, the pattern is shown
    /// with the values of its reference page
    #[arg(long, value_name = "NAME=VALUE", requires = "pattern", allow_hyphen_values = true, value_parser = setting)]
    pub set: Vec<(String, String)>,
    /// Target whose signals the formula reads: a task, toy/NAME, or a target file (.toml)
    #[arg(long, value_name = "TARGET")]
    pub target: Option<String>,
    /// Controller of the episode of a task [default: expert]
    #[arg(long, value_name = "C", requires = "target")]
    pub controller: Option<String>,
    /// TOML file with [[requirement]] tables and [units]
    #[arg(long, value_name = "FILE", conflicts_with = "pattern")]
    pub formulas: Option<PathBuf>,
    /// Unit of interval bounds without a unit: s, ms, us or ns [default: such bounds count samples]
    #[arg(long)]
    pub unit: Option<String>,
    /// Duration of an episode in seconds, with which the windows are compared
    #[arg(long, value_name = "SECONDS", conflicts_with = "target", allow_negative_numbers = true, value_parser = numbers::number(EPISODE, is_duration))]
    pub episode: Option<f64>,
    /// Exit with 1 if there is a warning
    #[arg(long)]
    pub strict: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// File to create with the drawing as SVG
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Overwrite the file of --svg
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub log: LogFlags,
}

fn setting(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("expected a name and a value, such as deadline=2s".to_string()),
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let (found, words) = describe(command)?;
    if let Some(path) = &command.svg {
        ensure!(!found.examples.is_empty(), "there is nothing to draw: no trace was found for the formula");
        output::write_atomically(path, command.force, formula_chart::svg(&found).as_bytes())?;
        output::message(&format!("wrote {}", path.display()));
    }
    if command.json {
        output::json(&without_values(&found))?;
    } else {
        output::line(&shown::text(&found, words.as_deref(), output::width()))?;
    }
    let warns = found.traps.iter().any(|trap| trap.severity == "warning");
    Ok(if command.strict && warns { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the document without the values of logs and episodes, which the caller has.
fn without_values(found: &FormulaDescription) -> FormulaDescription {
    let mut found = found.clone();
    for example in &mut found.examples {
        if matches!(example.kind.as_str(), "log" | "episode") {
            example.values = None;
        }
    }
    found
}

/// The description of the formula, and the sentence of its pattern.
fn describe(command: &Arguments) -> Result<(FormulaDescription, Option<String>)> {
    let options = command.log.options();
    let (typed, paths) = match (&command.pattern, command.words.split_first()) {
        (None, Some((text, paths))) => (Some(text.as_str()), paths),
        (_, _) => (None, command.words.as_slice()),
    };
    let has_logs = !paths.is_empty() || !command.log.topic.is_empty();
    let paths: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
    let sources = if has_logs { command.log.logs(&paths)? } else { Vec::new() };
    logs::check_stdin(&sources)?;
    if let Some(path) = &command.svg {
        let inputs = sources.iter().flatten().map(|source| source.path.as_path());
        output::refuse_inputs(path, "--svg", inputs.chain(command.formulas.as_deref()))?;
        drop(output::create(path, command.force)?);
    }
    let plan = command.target.as_deref().map(|name| {
        let plan = formula_context::described_plan(name, None);
        let controller = command.controller.clone().unwrap_or_else(|| plan.controller.clone());
        mishandle::Plan { controller, ..plan }
    });
    let target = plan.as_ref().map(mishandle::resolve::described_target).transpose()?;
    let mut context = target.as_ref().map_or_else(Context::default, formula_context::of_target);
    context.unit = command.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    context.period = command.log.period.or(context.period);
    context.episode_secs = command.episode;

    let mut text = String::new();
    let mut words = None;
    let mut examples = Vec::new();
    if let Some(name) = &command.pattern {
        let found = pattern(name)?;
        let is_shown = command.set.is_empty() && target.is_none() && sources.is_empty();
        let settings = if is_shown { found.shown_settings() } else { command.set.clone() };
        let (formula, sentence) = found.fill(&settings)?;
        (text, words) = (formula, Some(sentence));
        if is_shown {
            examples = found.examples()?;
            context.period = context.period.or(Some(1.0));
        }
    }
    if let Some(typed) = typed {
        text = typed.to_string();
        if let Some(target) = &target {
            text = formula_context::named_formula(target, typed).unwrap_or(typed).to_string();
        }
        if let Some(path) = &command.formulas {
            let (requirements, units) = formula_context::of_file(path)?;
            context.units.extend(units);
            if let Some(found) = requirements.iter().find(|found| found.name.as_deref() == Some(typed)) {
                text.clone_from(&found.text);
                context.unit = found.unit.or(context.unit);
            }
        }
    }
    let first = sources.first().map_or(&[][..], Vec::as_slice);
    let formula = logs::formula(None, &text, first, &options)?;
    if let Some(target) = &target {
        formula_context::check_signals(target, &formula)?;
    }
    let drawn = traces(command, &formula, plan.as_ref(), &sources, &context)?;
    if !drawn.is_empty() {
        context = formula_context::with_logs(context, &drawn);
    }
    let mut found = describe_formula(&formula, &context)?;
    found.pattern.clone_from(&command.pattern);
    found.examples = examples;
    for drawn in &drawn {
        found.examples.extend(draw_one(&formula, drawn)?);
    }
    if found.examples.is_empty() && drawn.is_empty() {
        found.examples = find_examples(&formula, &context);
    }
    Ok((found, words))
}

/// Draws a formula over a trace. A bound that does not fit its samples is among the traps already.
fn draw_one(formula: &Formula, drawn: &Drawn) -> Result<Option<FormulaExample>> {
    if let Err(error) = formula_context::fits(formula, drawn) {
        output::message(&format!("note: not drawn over {}: {error}", drawn.name));
        return Ok(None);
    }
    let example = draw(formula, drawn.kind, &drawn.name, &drawn.trace, drawn.clock);
    let example = example.with_context(|| format!("trace {}", drawn.name))?;
    Ok(Some(with_values(example, &drawn.trace, &formula.signals())))
}

/// Returns the traces over which the formula is drawn: those of the logs, or the nominal episode.
fn traces(
    command: &Arguments,
    formula: &Formula,
    plan: Option<&mishandle::Plan>,
    sources: &[Vec<mishandle_logs::Source>],
    context: &Context,
) -> Result<Vec<Drawn>> {
    let evaluation = Evaluation { unit: context.unit, strict_horizon: false };
    if !sources.is_empty() {
        return formula_context::of_logs(sources, &command.log.options(), formula, evaluation);
    }
    let Some(plan) = plan else { return Ok(Vec::new()) };
    match formula_context::nominal_episode(plan, &formula.to_string()) {
        Ok(trace) => {
            let name = plan.target.clone();
            Ok(vec![Drawn { kind: "episode", name, trace, clock: context.clock(), start: 0.0 }])
        }
        Err(error) => {
            output::message(&format!("note: not drawn over the nominal episode: {error}"));
            Ok(Vec::new())
        }
    }
}
