use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::inspect::{EvaluatedCount, ExplainedSimulation, Explanation};
use mishandle::stl::{DecisivePredicate, Formula};
use mishandle::store::{RunFile, RunHeader};
use mishandle_text::{decimal, instant, plural};
use serde_json::{Value, json};

use super::counterexamples;
use crate::output::{self, number};
use crate::progress::Bar;
use crate::{ExitStatus, args, escape, numbers, run};

/// Explain a recorded simulation: when, where and by which predicate the formula is violated
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle explain runs/RUN.sqlite                      the first counterexample
  mishandle explain runs/RUN.sqlite --trial 2 --simulation 17
  mishandle explain runs/RUN.sqlite --masking            which conjuncts hide others
  mishandle explain failure.json                         an exported counterexample

A counterexample of any target is explained from its recorded trace. Other simulations have none and
are replayed.")]
pub struct Arguments {
    #[command(flatten)]
    pub recorded: args::Recorded,
    /// Explain the whole run: how often each conjunct sets the robustness, and how often each one fails, over at most N
    /// simulations, which are simulated again; violated ones first [default of N: 500]
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "500", require_equals = true)]
    #[arg(allow_negative_numbers = true, value_parser = numbers::integer::<u64>(1..=u64::MAX))]
    #[arg(conflicts_with_all = ["trial", "simulation"])]
    pub masking: Option<u64>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Numbers of evenly spaced samples in the table of signals, up to the decisive one and behind it.
const ROWS_BEFORE: usize = 8;
const ROWS_AFTER: usize = 3;

/// Largest number of signals in the table of signals.
const SIGNAL_COLUMNS: usize = 4;

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if counterexamples::is_file(&command.recorded.file) {
        return counterexample(command);
    }
    let file = run::read(&command.recorded.file, command.recorded.skip_check)?;
    if let Some(limit) = command.masking {
        return masking(command, &file, limit);
    }
    let Some((trial, simulation)) =
        mishandle::replay::select_simulation(&file, command.recorded.trial, command.recorded.simulation)?
    else {
        bail!("{} has no decided simulation to explain", command.recorded.file.display());
    };
    let explained =
        mishandle::inspect::explain(&file, trial, simulation, command.recorded.controller.as_deref())?;
    let header = file.header();
    if command.json {
        let run = json!({ "run": command.recorded.file.to_string_lossy() });
        output::json(output::joined(run, document(header, &explained)))?;
    } else {
        let name = run::simulation_text(header, &explained.recorded);
        output::line(&format!("{name}, {}", text(header, &explained)))?;
    }
    let is_violated = explained.recorded.robustness.is_some_and(|rho| rho < 0.0);
    Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Prints which conjuncts set the robustness of a run and which ones fail.
fn masking(command: &Arguments, file: &RunFile, limit: u64) -> Result<ExitStatus> {
    let resolved =
        match mishandle::resolve::recorded_plan(file.header(), command.recorded.controller.as_deref()) {
            Ok(resolved) => Some(resolved),
            Err(error) => {
                output::message(&format!("only recorded counterexamples are explained: {error}"));
                None
            }
        };
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let mut evaluated = 0;
    let found = mishandle::inspect::masking(file, resolved.as_ref(), limit, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        evaluated = done;
        run::control_flow()
    })?;
    bar.clear();
    let Some(found) = found else {
        run::report_loss(evaluated, "nothing is kept, the counts of the conjuncts are lost");
        return Ok(ExitStatus::Interrupted);
    };
    let (satisfied, violated) = (found.satisfied, found.violated);
    ensure!(
        satisfied.evaluated + violated.evaluated > 0,
        "{} has no simulation to explain",
        command.recorded.file.display()
    );
    if command.json {
        let count = |count: EvaluatedCount| json!({ "evaluated": count.evaluated, "total": count.total });
        output::json(json!({
            "run": command.recorded.file.to_string_lossy(),
            "formula": file.header().formula,
            "satisfied": count(satisfied),
            "violated": count(violated),
            "conjuncts": found.conjuncts.iter().map(|conjunct| json!({
                "formula": conjunct.text,
                "sets_satisfied": conjunct.sets_satisfied,
                "sets_violated": conjunct.sets_violated,
                "fails": conjunct.fails,
            })).collect::<Vec<_>>(),
        }))?;
        return Ok(ExitStatus::Done);
    }
    let share = |count: u64, of: EvaluatedCount| match of.evaluated {
        0 => "-".to_string(),
        n => format!("{count} ({:.1} %)", 100.0 * count as f64 / n as f64),
    };
    let header = ["conjunct", "decides if satisfied", "decides if violated", "fails if violated"];
    let mut rows = vec![header.map(String::from).to_vec()];
    rows.extend(found.conjuncts.iter().map(|conjunct| {
        vec![
            escape::name(&conjunct.text),
            share(conjunct.sets_satisfied, satisfied),
            share(conjunct.sets_violated, violated),
            share(conjunct.fails, violated),
        ]
    }));
    output::line(&format!(
        "formula {}\n{}, {}\n\n{}",
        escape::name(&file.header().formula),
        count_text(violated, "violated"),
        count_text(satisfied, "satisfied"),
        output::table(&rows)
    ))?;
    Ok(ExitStatus::Done)
}

/// Describes how many simulations were evaluated, such as `500 of 1,003 satisfied simulations`.
fn count_text(count: EvaluatedCount, kind: &str) -> String {
    match (count.evaluated, count.total) {
        (evaluated, total) if evaluated == total => plural(total, &format!("{kind} simulation")),
        (evaluated, total) => {
            format!("{evaluated} of {} (evenly chosen)", plural(total, &format!("{kind} simulation")))
        }
    }
}

/// Simulates an exported counterexample and explains it.
fn counterexample(command: &Arguments) -> Result<ExitStatus> {
    counterexamples::check_flags(command.recorded.trial, command.recorded.simulation)?;
    let (_, replayed) =
        counterexamples::replay(&command.recorded.file, command.recorded.controller.as_deref())?;
    let (header, explained) = (&replayed.header, &replayed.explained);
    if !replayed.differences.is_empty() {
        output::message(
            "warning: the simulation differs from the recorded one; `mishandle replay` lists the differences",
        );
    }
    if command.json {
        let run = json!({ "run": command.recorded.file.to_string_lossy() });
        output::json(output::joined(run, document(header, explained)))?;
    } else {
        output::line(&text(header, explained))?;
    }
    Ok(if explained.recorded.robustness < Some(0.0) { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the explanation as JSON. Samples count from 0, times are in seconds.
pub fn document(header: &RunHeader, explained: &ExplainedSimulation) -> Value {
    let ExplainedSimulation { recorded, explanation, .. } = explained;
    let Explanation { diagnosis, history, decided, conjuncts, .. } = explanation;
    let time = |sample: usize| sample as f64 * header.control_dt;
    let named = header.axes.iter().zip(&recorded.scenario);
    let window = |window: Option<(usize, usize)>| window.map(|(first, last)| [first, last]);
    json!({
        "target": header.target.name,
        "trial": recorded.trial,
        "simulation": recorded.number,
        "scenario": named.map(|(axis, value)| (axis.name.clone(), json!(value))).collect::<Value>(),
        "seed": recorded.seed.to_string(),
        "formula": header.formula,
        "robustness": number(diagnosis.robustness()),
        "decided": decided.map(|sample| json!({ "sample": sample, "time": time(sample) })),
        "predicate": diagnosis.predicate.as_ref().map(|predicate| json!({
            "formula": predicate.text,
            "sample": predicate.sample,
            "time": time(predicate.sample),
            "comparison": predicate.comparison,
            "sides": predicate.sides,
            "values": predicate.values.map(number),
            "robustness": number(predicate.robustness),
            "negated": predicate.is_negated,
        })),
        "window": history.as_ref().map(|history| json!({
            "samples": [history.window.0, history.window.1],
            "violated": history.violated,
            "first_violated": history.first_and_last.map(|(first, _)| first),
            "last_violated": history.first_and_last.map(|(_, last)| last),
        })),
        "path": diagnosis.path.iter().map(|found| json!({
            "formula": found.text,
            "operator": found.operator,
            "sample": found.sample,
            "time": time(found.sample),
            "window": window(found.window),
            "robustness": number(found.robustness),
        })).collect::<Vec<_>>(),
        "conjuncts": conjuncts.iter().map(|conjunct| json!({
            "formula": conjunct.text,
            "robustness": number(conjunct.robustness),
            "decided": conjunct.decided.map(|sample| json!({ "sample": sample, "time": time(sample) })),
        })).collect::<Vec<_>>(),
    })
}

/// Returns the explanation as text, which starts with the scenario.
pub fn text(header: &RunHeader, explained: &ExplainedSimulation) -> String {
    let ExplainedSimulation { recorded, explanation, .. } = explained;
    let Explanation { diagnosis, conjuncts, .. } = explanation;
    let scenario = run::recorded_scenario_text(&header.axes, &recorded.scenario, usize::MAX);
    let verdict = match diagnosis.robustness() {
        rho if rho < 0.0 => "violated",
        rho if rho > 0.0 => "satisfied",
        _ => "on the border between satisfied and violated",
    };
    let mut parts = vec![format!(
        "{}, seed {}\nformula {}\n{verdict}: robustness {}",
        scenario,
        recorded.seed,
        escape::name(&header.formula),
        decimal(diagnosis.robustness(), 4),
    )];
    let sentences: Vec<String> =
        explanation.sentences(header.control_dt).iter().map(|sentence| escape::name(sentence)).collect();
    if !sentences.is_empty() {
        parts.push(sentences.join("\n"));
    }
    parts.push(output::table(&path_table(header, explained)));
    if conjuncts.len() > 1 {
        let columns = ["conjunct on its own", "robustness", "decided at"];
        let mut rows = vec![columns.map(String::from).to_vec()];
        rows.extend(conjuncts.iter().map(|conjunct| {
            let decided = conjunct.decided.map(|sample| instant(sample, header.control_dt));
            vec![
                escape::name(&conjunct.text),
                decimal(conjunct.robustness, 4),
                decided.unwrap_or("-".to_string()),
            ]
        }));
        parts.push(output::table(&rows));
    }
    parts.extend(
        diagnosis
            .predicate
            .as_ref()
            .map(|predicate| output::table(&signal_table(header, explained, predicate))),
    );
    parts.join("\n\n")
}

/// Returns the table of the chain from the formula to the predicate.
fn path_table(header: &RunHeader, explained: &ExplainedSimulation) -> Vec<Vec<String>> {
    let columns = ["decisive sub-formula", "at", "window", "robustness"];
    let mut rows = vec![columns.map(String::from).to_vec()];
    let path = &explained.explanation.diagnosis.path;
    let is_and = |index: usize| path[index].operator == Some("and");
    // Of a chain of `and`, only the first is shown: the others are parts of its text.
    let shown = (0..path.len()).filter(|index| *index == 0 || !is_and(*index) || !is_and(index - 1));
    rows.extend(shown.map(|index| &path[index]).map(|found| {
        let window = found.window.map_or("-".to_string(), |(first, last)| format!("{first} to {last}"));
        vec![
            escape::name(&found.text),
            instant(found.sample, header.control_dt),
            window,
            decimal(found.robustness, 4),
        ]
    }));
    rows
}

/// Returns the table of the formula's signals up to the decisive sample, at the first violation, and at the end.
fn signal_table(
    header: &RunHeader,
    explained: &ExplainedSimulation,
    predicate: &DecisivePredicate,
) -> Vec<Vec<String>> {
    let ExplainedSimulation { trace, explanation, .. } = explained;
    let of = |text: &str| {
        Formula::parse(text).map(|formula| formula.signals().into_iter().map(str::to_string).collect())
    };
    let decisive: Vec<String> = of(&predicate.text).unwrap_or_default();
    let others: Vec<String> = of(&header.formula).unwrap_or_default();
    let others = others.into_iter().filter(|name| !decisive.contains(name));
    let names: Vec<String> = decisive.iter().cloned().chain(others).take(SIGNAL_COLUMNS).collect();
    let unit = |name: &str| {
        let signal = header.signals.iter().find(|signal| signal.name == name);
        signal.map_or("", |signal| signal.unit.as_str())
    };
    let mut rows = vec![vec!["at".to_string()]];
    rows[0].extend(
        names.iter().map(|name| format!("{} {}", escape::name(name), unit(name)).trim_end().to_string()),
    );
    for sample in shown_samples(predicate.sample, explanation.decided, trace.len()) {
        let mut row = vec![instant(sample, header.control_dt)];
        row.extend(names.iter().map(|name| {
            trace.signal(name).and_then(|values| values.get(sample)).map_or(String::new(), |x| decimal(*x, 4))
        }));
        rows.push(row);
    }
    rows
}

/// Returns the samples of the table: evenly spaced up to the decisive one and from there to the end, and the instant that decides
/// the formula.
fn shown_samples(decisive: usize, decided: Option<usize>, len: usize) -> Vec<usize> {
    let last = len.saturating_sub(1);
    let before = (0..ROWS_BEFORE).map(|i| decisive * i / (ROWS_BEFORE - 1));
    let after = (1..=ROWS_AFTER).map(|i| decisive + last.saturating_sub(decisive) * i / ROWS_AFTER);
    let mut samples: Vec<usize> = before.chain(after).chain(decided).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}
