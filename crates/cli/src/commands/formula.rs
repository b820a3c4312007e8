mod mine;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use mishandle::plan::Settings;
use mishandle::results::{ExampleKind, FormulaDescription, FormulaExample, TrapSeverity};
use mishandle::stl::Formula;
use mishandle_logs::{Evaluation, Options, Source};
use mishandle_requirements::{Context, add_examples, describe_formula, draw, pattern, with_values};

use crate::exit_status::ExitStatus;
use crate::flags::Keys;
use crate::run::formula_context::{self, Drawn};
use crate::run::logs;
use crate::show::{formula as shown, formula_chart, output};

/// Explain a formula in words, warn about known traps, and draw it over an example; or find the
/// tightest values of its parameters
#[derive(Debug, Args)]
#[command(override_usage = "mishandle formula [OPTIONS] <FORMULA> [LOG]...\n       \
    mishandle formula [OPTIONS] --pattern <NAME> [--parameter <NAME=VALUE>]... [LOG]...\n       \
    mishandle formula [OPTIONS] <FORMULA> --parameter <NAME=LOW:HIGH>... <LOG>...")]
#[command(
    after_help = "The formula is a text, the name of a formula of --target, or the name of one of --requirements.
It is drawn over the logs, over the nominal episode of the target, or over two traces that the
program finds for it: one satisfies it, one violates it.

With --parameter and no --pattern, names in the formula are parameters: a number, or a bound of a
window. Their tightest values for which logs, or random simulations of run files of `evaluate` and
`falsify`, satisfy the formula are found. The direction comes from the formula: `force <= limit` is
tighter with a smaller limit, `always[0:T] p` with a greater T. One parameter has one tightest
value, exact to the next number, or for a bound to the next sample. Several have a Pareto front: no
parameter of a point can be tighter without another one that is looser. Windows are cut at the end
of a log, as in `mishandle monitor`. If the ends of the ranges decide, the output says so.

Examples:
  mishandle formula 'always[0:2s](force <= 20)'
  mishandle formula 'always(closed >= 1 implies eventually[0:2s] force >= 5)' rig.csv
  mishandle formula success --target ball-balancing
  mishandle formula --pattern response --parameter p='x >= 1' --parameter q='y <= 0.1' \\
      --parameter deadline=2s
  mishandle formula 'always(force <= limit)' --parameter limit=0:50 logs/*.csv
  mishandle formula 'eventually[0:T](d <= 0.1)' --parameter T=0:5s runs/RUN.sqlite
  mishandle formula 'eventually[0:T] always(abs(x - 1) <= band)' --parameter T=0:5s \\
      --parameter band=0:1 -k formula.resolution.band=0.01 logs/*.csv

Exit code 1 means a warning with --strict; notes do not count. With parameters, it means that even
the loosest values violate the formula, or that no log supports a value. docs/guide/requirements.md
describes the traps and the search for values, docs/reference/patterns.md the patterns."
)]
pub struct Arguments {
    /// Formula, and files with a log each, - for stdin; with --pattern, logs only
    #[arg(value_name = "FORMULA|LOG", required_unless_present = "pattern")]
    pub words: Vec<String>,
    /// Pattern that makes the formula
    #[arg(long, value_name = "NAME")]
    pub pattern: Option<String>,
    /// Parameter of the pattern; without any, the pattern is shown with the values of its reference
    /// page. Without --pattern: a name in the formula, and the range of its values, LOW:HIGH; a
    /// bound of a window has a unit, such as T=0:5s, or counts samples. Repeat the flag for several
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true, value_parser = setting)]
    pub parameter: Vec<(String, String)>,
    /// Target whose signals the formula reads: a task, toy/NAME, or a target file (.toml)
    #[arg(long, value_name = "TARGET")]
    pub target: Option<String>,
    /// Controller of the episode of a task [default: expert]
    #[arg(long, value_name = "C", requires = "target")]
    pub controller: Option<String>,
    /// TOML file with [[requirement]] tables and [units]
    #[arg(long, value_name = "FILE", conflicts_with = "pattern")]
    pub requirements: Option<PathBuf>,
    /// Exit with 1 if there is a warning
    #[arg(long)]
    pub strict: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// File to create: an .svg with the drawing; with parameters, a .csv with the points
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite the file of --out
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub keys: Keys,
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
    let (settings, _) = command.keys.settings("formula")?;
    if command.pattern.is_none() && !command.parameter.is_empty() {
        return mine::run(command, &settings);
    }
    let (found, words) = describe(command, &settings)?;
    if let Some(path) = &command.out {
        ensure!(!found.examples.is_empty(), "there is nothing to draw: no trace was found for the formula");
        output::write_atomically(path, command.force, formula_chart::svg(&found).as_bytes())?;
        output::message(&format!("wrote {}", path.display()));
    }
    if command.json {
        output::json(&without_values(&found))?;
    } else {
        output::line(&shown::text(&found, words.as_deref(), output::width()))?;
    }
    let warns = found.traps.iter().any(|trap| trap.severity == TrapSeverity::Warning);
    Ok(if command.strict && warns { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Checks the ending of the output, and that it can be created and replaces no input.
fn check_out<'a>(command: &'a Arguments, ending: &str, inputs: impl Iterator<Item = &'a Path>) -> Result<()> {
    let Some(path) = &command.out else { return Ok(()) };
    let has_ending = path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    ensure!(has_ending, "expected a .{ending} file for --out, found {}", path.display());
    output::refuse_inputs(path, "--out", inputs.chain(command.requirements.as_deref()))?;
    drop(output::create(path, command.force)?);
    Ok(())
}

/// Returns the document without the values of logs and episodes, which the caller has.
fn without_values(found: &FormulaDescription) -> FormulaDescription {
    let mut found = found.clone();
    for example in &mut found.examples {
        if matches!(example.kind, ExampleKind::Log | ExampleKind::Episode) {
            example.values = None;
        }
    }
    found
}

/// The description of the formula, and the sentence of its pattern.
fn describe(command: &Arguments, settings: &Settings) -> Result<(FormulaDescription, Option<String>)> {
    let log = &settings.log;
    let options = log.options()?;
    let (typed, paths) = match (&command.pattern, command.words.split_first()) {
        (None, Some((text, paths))) => (Some(text.as_str()), paths),
        (_, _) => (None, command.words.as_slice()),
    };
    let has_logs = !paths.is_empty() || !log.topics.is_empty();
    let paths: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
    let sources = if has_logs { logs::sources(log, &paths)? } else { Vec::new() };
    check_out(command, "svg", sources.iter().flatten().map(|source| source.path.as_path()))?;
    let plan = command.target.as_deref().map(|name| {
        let plan = formula_context::described_plan(name, None);
        let controller = command.controller.clone().unwrap_or_else(|| plan.controller.clone());
        mishandle::Plan { controller, ..plan }
    });
    let target = plan.as_ref().map(mishandle::resolve::described_target).transpose()?;
    let mut context = target.as_ref().map_or_else(Context::default, formula_context::of_target);
    context.unit = log.unit;
    context.period = log.period.or(context.period);
    context.episode_secs = settings.formula.episode;
    ensure!(
        target.is_none() || context.episode_secs.is_none(),
        "the target states the duration of its episodes: leave out formula.episode"
    );

    let mut text = String::new();
    let mut words = None;
    let mut examples = Vec::new();
    if let Some(name) = &command.pattern {
        let found = pattern(name)?;
        let is_shown = command.parameter.is_empty() && target.is_none() && sources.is_empty();
        let settings = if is_shown { found.shown_settings() } else { command.parameter.clone() };
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
            let named = formula_context::named_formula(target, typed);
            context.at_every_sample = named.is_some() && matches!(typed, "safe" | "completion");
            text = named.unwrap_or(typed).to_string();
        }
        if let Some(path) = &command.requirements {
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
    let drawn = traces(&options, &formula, plan.as_ref(), &sources, &context)?;
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
        add_examples(&mut found, &formula, &context);
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
    options: &Options,
    formula: &Formula,
    plan: Option<&mishandle::Plan>,
    sources: &[Vec<Source>],
    context: &Context,
) -> Result<Vec<Drawn>> {
    let evaluation = Evaluation { unit: context.unit, strict_horizon: false };
    if !sources.is_empty() {
        return formula_context::of_logs(sources, options, formula, evaluation);
    }
    let Some(plan) = plan else { return Ok(Vec::new()) };
    match formula_context::nominal_episode(plan, &formula.to_string()) {
        Ok(trace) => {
            let name = plan.target.clone();
            Ok(vec![Drawn { kind: ExampleKind::Episode, name, trace, clock: context.clock(), start: 0.0 }])
        }
        Err(error) => {
            output::message(&format!("note: not drawn over the nominal episode: {error}"));
            Ok(Vec::new())
        }
    }
}
