mod follow;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use mishandle::results::{self, LogVerdict, Number, RequirementVerdict};
use mishandle_logs::Evaluation;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, FollowFlags, LogFlags};
use crate::run::logs::{self, Requirement};
use crate::show::{log_verdicts, output};

/// Compute the robustness of temporal logic formulas on recorded logs
#[derive(Debug, Args)]
#[command(
    after_help = "A log is a CSV file (also with semicolons, tabs or spaces), JSON lines, a NumPy .npz or
.npy file, or a Parquet file. A signal is a column. The optional column `time` (seconds, or dates
with a zone) determines the sampling period; --time names another one. Columns that no formula
reads may hold anything. In a formula, the name of a column that is not a plain word stands in
backquotes: `/joint[0]/position`. In a shell, a formula with backquotes stands in single quotes.

Several files are several logs: the answer is a table of verdicts, worst first. --topic reads
several files as one log.

Windows that extend past the end of the trace are cut there, as in RTAMT. A cut window can
satisfy a formula that the whole window would violate. --strict-horizon uses whole windows
only, as verdicts about episodes do: a window without an end (`eventually p`) then ends at
the last sample at which p's own windows are inside the trace, and a formula whose windows
do not fit into the trace is an error.

Examples:
  mishandle monitor --formula 'always[0:2](d <= 0.3)' trace.csv             bounds count samples
  mishandle monitor --formula 'always[0:2s](d <= 0.3)' --period 0.1 trace.csv
  mishandle monitor --formula 'always[0:2](d <= 0.3)' --period 0.1 --unit s trace.csv  as in RTAMT
  mishandle monitor --formulas requirements.toml --junit verdicts.xml logs/*.parquet
  mishandle monitor --formula 'always(`arm/q` <= 2)' --topic arm=arm.csv --dense hold
  mishandle monitor --follow --formula 'always(force <= 20)' /tmp/forces.fifo

--follow reads a log that is still written, row by row: a pipe, or a file that grows. Each change of
a verdict is a line of JSON, and the program ends as soon as the exit code is certain. The end of
the pipe gives the verdict of the whole log. docs/guide/online.md has the keys of a line.

Exit code 1 means that a formula is violated at time 0; requirements with the severity `warning`
do not count. docs/guide/logs.md describes logs, docs/reference/formulas.md the language of
formulas."
)]
pub struct Arguments {
    /// Formula in the syntax of RTAMT
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Formula with a name; repeat the flag for several. Each has a verdict of its own
    #[arg(long, value_name = "NAME=FORMULA", allow_hyphen_values = true, value_parser = flags::named_formula)]
    pub requirement: Vec<(String, String)>,
    /// TOML file with [[requirement]] tables: name, formula, severity, unit, description
    #[arg(long, value_name = "FILE")]
    pub formulas: Option<PathBuf>,
    /// Files with a log each; - reads stdin
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Unit of interval bounds without a unit: s, ms, us or ns [default: such bounds count samples]
    #[arg(long)]
    pub unit: Option<String>,
    /// Use only windows inside the trace, instead of cutting them at its end as RTAMT does
    #[arg(long)]
    pub strict_horizon: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// With --json: print the robustness at each sample
    #[arg(long, requires = "json")]
    pub values: bool,
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
    #[arg(long, help_heading = "Following a log", conflicts_with_all = ["json", "values", "junit", "markdown", "dense"])]
    pub follow: bool,
    #[command(flatten)]
    pub following: FollowFlags,
    #[command(flatten)]
    pub log: LogFlags,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let requirements = requirements(command)?;
    let options = command.log.options();
    let sources = command.log.logs(&command.logs)?;
    logs::check_stdin(&sources)?;
    let inputs = || sources.iter().flatten().map(|source| source.path.as_path());
    for (flag, path) in [("--junit", &command.junit), ("--markdown", &command.markdown)] {
        if let Some(path) = path {
            output::refuse_inputs(path, flag, inputs())?;
        }
    }
    let formulas = logs::formulas(&requirements, &sources[0], &options)?;
    if command.follow {
        ensure!(sources.len() == 1, "--follow reads one log; --topic NAME=FILE reads several files as one");
        let following = command.following.following();
        let requested =
            follow::Requested { requirements: &requirements, formulas: &formulas, options: &options };
        return follow::run(&sources[0], &requested, following, command);
    }
    let (mut verdicts, mut values) = (Vec::new(), None);
    for source in &sources {
        let log = logs::read(source, &formulas, &options)?;
        for (requirement, formula) in requirements.iter().zip(&formulas) {
            let verdict = log.verdict(requirement, formula, command.strict_horizon);
            verdicts.push(verdict.with_context(|| format!("trace {}", log.name))?);
        }
        if command.values {
            ensure!(sources.len() == 1, "--values prints the values of one log; name one");
            let evaluation =
                Evaluation { unit: requirements[0].unit, strict_horizon: command.strict_horizon };
            values = Some(log.samples.robustness_signal(&formulas[0], &evaluation)?);
        }
    }
    let as_asked = verdicts.clone();
    logs::worst_first(&mut verdicts);
    let is_one_log = sources.len() == 1;
    if let Some(path) = &command.junit {
        output::write_atomically(path, command.force, log_verdicts::junit(&verdicts).as_bytes())?;
    }
    if let Some(path) = &command.markdown {
        output::write_atomically(path, command.force, log_verdicts::markdown(&verdicts).as_bytes())?;
    }
    let fails = verdicts.iter().any(|verdict| verdict.violated && verdict.severity == "error");
    let cut = verdicts.iter().find(|verdict| verdict.cuts_windows);
    let note = cut.filter(|_| !command.json).map(|cut| {
        let samples = cut.samples.map(|samples| format!(", which has {}", plural(samples, "sample")));
        format!(
            "note: a window extends past the end of the trace{}; it is cut there, as in RTAMT; samples after the end could \
             change the value (--strict-horizon uses whole windows only)",
            samples.unwrap_or_default()
        )
    });
    let missing = verdicts.iter().map(|verdict| verdict.missing_values).max().unwrap_or(0);
    if command.json {
        output::json(&document(command, is_one_log, &as_asked, verdicts, values))?;
    } else {
        match &verdicts[..] {
            [only] if is_one_log => output::line(&log_verdicts::text(only))?,
            _ => output::line(&log_verdicts::table(&verdicts, !is_one_log))?,
        }
        if missing > 0 {
            output::message(&format!("note: {} missing in a log", plural(missing, "value")));
        }
    }
    if let Some(note) = note {
        output::message(&note);
    }
    Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the formulas of all flags.
fn requirements(command: &Arguments) -> Result<Vec<Requirement>> {
    let unit = command.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    let plain = |name: Option<&String>, text: &String| Requirement {
        name: name.cloned(),
        text: text.clone(),
        is_error: true,
        unit,
        description: None,
    };
    let mut found: Vec<Requirement> = command.formula.iter().map(|text| plain(None, text)).collect();
    found.extend(command.requirement.iter().map(|(name, text)| plain(Some(name), text)));
    if let Some(path) = &command.formulas {
        found.extend(logs::requirements(path, unit)?);
    }
    ensure!(
        !found.is_empty(),
        "there is no formula: give --formula FORMULA, --requirement NAME=FORMULA, or --formulas FILE"
    );
    Ok(found)
}

/// Returns the document of `--json`.
fn document(
    command: &Arguments,
    is_one_log: bool,
    as_asked: &[LogVerdict],
    verdicts: Vec<LogVerdict>,
    values: Option<Vec<(mishandle_logs::At, f64)>>,
) -> results::Monitor {
    let named = as_asked.iter().filter_map(|verdict| {
        Some(RequirementVerdict {
            name: verdict.name.clone()?,
            formula: verdict.formula.clone(),
            robustness: Some(verdict.robustness),
            violated: Some(verdict.violated),
        })
    });
    let named: Vec<RequirementVerdict> = named.filter(|_| is_one_log).collect();
    let first = if is_one_log { &as_asked[0] } else { &verdicts[0] };
    let times = values.as_ref().and_then(|values| values.iter().map(|(at, _)| at.secs.map(Number)).collect());
    results::Monitor {
        robustness: first.robustness,
        violated: first.violated,
        windows: if command.strict_horizon { "whole" } else { "cut" }.to_string(),
        cuts_windows: first.cuts_windows,
        robustness_signal: values.map(|values| values.into_iter().map(|(_, value)| Number(value)).collect()),
        robustness_times: times,
        requirements: (!named.is_empty()).then_some(named),
        verdicts,
    }
}
