mod follow;

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::results::LogExplanations;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{Keys, LogQuestion};
use crate::run::log_question::{self, Question};
use crate::run::path_kind;
use crate::show::{explanation, log_verdicts, output, verdict};

/// Compute the robustness of temporal logic formulas on recorded logs
#[derive(Debug, Args)]
#[command(
    after_help = "A log is a CSV file (also with semicolons, tabs or spaces), JSON lines, a NumPy .npz or
.npy file, or a Parquet file. A signal is a column. The optional column `time` (seconds, or dates
with a zone) determines the sampling period; log.time names another one. Columns that no formula
reads may hold anything. In a formula, the name of a column that is not a plain word stands in
backquotes: `/joint[0]/position`. In a shell, a formula with backquotes stands in single quotes.

Several files are several logs: the answer is a table of verdicts, worst first. log.topics
reads several files as one log.

Windows that extend past the end of the trace are cut there, as in RTAMT. A cut window can
satisfy a formula that the whole window would violate. log.strict-horizon uses whole windows
only, as verdicts about episodes do: a window without an end (`eventually p`) then ends at
the last sample at which p's own windows are inside the trace, and a formula whose windows
do not fit into the trace is an error.

Examples:
  mishandle monitor --formula 'always[0:2](d <= 0.3)' trace.csv             bounds count samples
  mishandle monitor --formula 'always[0:2s](d <= 0.3)' -k log.period=0.1 trace.csv
  mishandle monitor --formula 'always[0:2](d <= 0.3)' -k log.period=0.1 -k log.unit=s trace.csv
  mishandle monitor --requirements requirements.toml --junit verdicts.xml logs/*.parquet
  mishandle monitor --explain --formula 'always(force <= 2)' rig.csv        what decides, and when
  mishandle monitor --formula 'always(`arm/q` <= 2)' -k log.topics.arm=arm.csv -k log.dense=hold
  mishandle monitor --follow --formula 'always(force <= 20)' /tmp/forces.fifo

--follow reads a log that is still written, row by row: a pipe, or a file that grows. Each change of
a verdict is a line of JSON, and the program ends as soon as the exit code is certain. The end of
the pipe gives the verdict of the whole log. docs/reference/json.md has the keys of a line.

Exit code 1 means that a formula is violated at time 0, otherwise 2 that one has no verdict on a
log, or asks nothing of any log: the first sample decides it, or its premise never holds.
Requirements with the severity `warning` do not count as violated. docs/guide/logs.md describes
logs, docs/reference/formulas.md the language of formulas."
)]
pub struct Arguments {
    /// Files with a log each; - reads stdin
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// Explain each verdict instead: the chain from the formula to the predicate that decides, and
    /// the signals around that instant
    #[arg(long, conflicts_with_all = ["junit", "markdown"])]
    pub explain: bool,
    /// File to create with the verdicts as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// File to create with the verdicts as a table in Markdown
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Overwrite the files of --junit and --markdown
    #[arg(long)]
    pub force: bool,
    /// Read a log that is still written and print changes as JSON lines; ends with the verdict
    #[arg(long, conflicts_with_all = ["json", "explain", "junit", "markdown"])]
    pub follow: bool,
    #[command(flatten)]
    pub keys: Keys,
    #[command(flatten)]
    pub question: LogQuestion,
}

/// Keys that only a log has that is still written.
const OF_FOLLOWED: [&str; 4] = ["monitor.bounds", "monitor.keep-going", "monitor.lateness", "monitor.idle"];

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let (settings, planned) = command.keys.settings("monitor")?;
    if let Some(key) = OF_FOLLOWED.iter().find(|key| !command.follow && planned.has_stated(key)) {
        bail!("{key} is for a log that is still written: pass --follow");
    }
    let is_in_vain = !command.json || command.explain;
    if settings.monitor.values && is_in_vain && planned.has_stated("monitor.values") {
        bail!("monitor.values adds to the document of --json: pass --json, without --explain");
    }
    let has_values = settings.monitor.values && !is_in_vain;
    for log in &command.logs {
        path_kind::refuse_others(log, &[path_kind::LOG, path_kind::CURVE])?;
    }
    let question = Question::new(&command.question, &settings.log, &command.logs)?;
    let sources = &question.sources;
    ensure!(!has_values || sources.len() == 1, "monitor.values prints the values of one log; name one");
    for (flag, path) in [("--junit", &command.junit), ("--markdown", &command.markdown)] {
        let Some(path) = path else { continue };
        output::refuse_inputs(path, flag, question.inputs())?;
    }
    if let (Some(junit), Some(markdown)) = (&command.junit, &command.markdown) {
        ensure!(junit != markdown, "--junit and --markdown name the same file {}", junit.display());
    }
    if command.follow {
        ensure!(sources.len() == 1, "--follow reads one log; log.topics reads several files as one");
        return follow::run(&question, &settings);
    }
    if command.explain {
        return explain(&question, command.json);
    }
    let mut verdicts = Vec::new();
    let mut values = None;
    let without = question.ask(|asked| {
        if has_values && values.is_none() {
            let samples = &asked.log.samples;
            ensure!(
                samples.run.is_none(),
                "monitor.values prints the values of one log; cut this one into its runs"
            );
            values = Some(samples.robustness_signal(&asked.requirement.formula, &asked.evaluation)?);
        }
        verdicts.push(asked.verdict);
        Ok(())
    })?;
    // A log can be several runs.
    let names: BTreeSet<&str> = verdicts.iter().map(|verdict| verdict.log.as_str()).collect();
    let logs = sources.len().max(names.len());
    let strict_horizon = settings.log.strict_horizon;
    let found = (!verdicts.is_empty())
        .then(|| mishandle_logs::document(verdicts, without.list.clone(), logs, strict_horizon, values));
    let verdicts = found.as_ref().map_or(&[][..], |found| &found.verdicts[..]);
    if let Some(path) = &command.junit {
        output::write_atomically(
            path,
            command.force,
            log_verdicts::junit(verdicts, &without.list).as_bytes(),
        )?;
    }
    if let Some(path) = &command.markdown {
        output::write_atomically(
            path,
            command.force,
            log_verdicts::markdown(verdicts, &without.list).as_bytes(),
        )?;
    }
    let cut = verdicts.iter().find(|verdict| verdict.cuts_windows);
    let note = cut.filter(|_| !command.json).map(|cut| {
        let samples = cut.samples.map(|samples| format!(", which has {}", plural(samples, "sample")));
        format!(
            "note: a window extends past the end of the trace{}; it is cut there, as in RTAMT; samples after the end could \
             change the value (log.strict-horizon uses whole windows only)",
            samples.unwrap_or_default()
        )
    });
    let missing = verdicts.iter().map(|verdict| verdict.missing_values).max().unwrap_or(0);
    match &found {
        None => {}
        Some(found) if command.json => output::json(found)?,
        Some(found) => output::styled(&verdict::text(&mishandle::verdict::monitor(found, logs)))?,
    }
    if !command.json && missing > 0 {
        output::message(&format!("note: {} missing in a log", plural(missing, "value")));
    }
    if let Some(note) = note {
        output::message(&note);
    }
    log_question::conclude(log_question::status_of(verdicts.iter()), without, sources.len())
}

/// Explains the verdicts, worst first.
fn explain(question: &Question<'_>, is_json: bool) -> Result<ExitStatus> {
    let mut found = Vec::new();
    let without = question.ask(|asked| {
        found.push(asked.explanation()?);
        Ok(())
    })?;
    mishandle_logs::worst_first(&mut found, |(explained, _)| &explained.verdict);
    let status = log_question::status_of(found.iter().map(|(explained, _)| &explained.verdict));
    if is_json && !found.is_empty() {
        let explanations = found.into_iter().map(|(explained, _)| explained).collect();
        output::json(&LogExplanations { explanations, no_verdict: without.list.clone() })?;
    } else if !found.is_empty() {
        let texts: Vec<String> =
            found.iter().map(|(explained, start)| explanation::log_text(explained, *start)).collect();
        output::styled(&texts.join("\n\n\n"))?;
    }
    log_question::conclude(status, without, question.sources.len())
}
