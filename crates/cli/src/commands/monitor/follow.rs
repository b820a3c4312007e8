//! `monitor --follow`: a log that is still written.

use std::time::Duration;

use anyhow::{Context, Result};
use mishandle::results::{FirstViolation, MonitorChange, Number, Severity};
use mishandle::stl::Formula;
use mishandle_logs::{Answer, Follow, Next, Requirement, Source, Watch, Watched};
use mishandle_text::plural;

use super::Arguments;
use crate::exit_status::ExitStatus;
use crate::interrupt;
use crate::show::output;

/// Time between two looks at the signals that interrupt the command.
const WAIT: Duration = Duration::from_millis(50);

/// Follows a log until the exit code is certain.
pub fn run(log: &[Source], requirements: &[Requirement], command: &Arguments) -> Result<ExitStatus> {
    let paths: Vec<String> = log.iter().map(|source| source.path.display().to_string()).collect();
    interrupt::listen(|| output::message("stopped by a signal; the log may go on"), || {})?;
    follow(log, requirements, command).with_context(|| format!("trace {}", paths.join(", ")))
}

fn follow(log: &[Source], requirements: &[Requirement], command: &Arguments) -> Result<ExitStatus> {
    let options = &command.question.log.options();
    let formulas: Vec<Formula> = requirements.iter().map(|found| found.formula.clone()).collect();
    let following = command.following.following();
    let mut follow = Follow::open(log, &formulas, options, following)?;
    let watched = requirements.iter().zip(&formulas);
    let watched: Vec<Watched> = watched
        .map(|(requirement, formula)| Watched { formula: formula.clone(), unit: requirement.unit })
        .collect();
    let mut watch = Watch::new(&watched, follow.signals(), options.period, command.question.strict_horizon)?;
    let mut known: Vec<Answer> = (0..watched.len()).map(|i| watch.answer(i).clone()).collect();
    loop {
        let next = follow.next(WAIT)?;
        let event = match next {
            Next::Sample => {
                watch.push(follow.sample(), follow.time())?;
                "verdict"
            }
            Next::End => {
                watch.finish()?;
                "end"
            }
            Next::Waiting => "",
        };
        if next != Next::Waiting {
            for (i, known) in known.iter_mut().enumerate().filter(|(_, known)| known.verdict.is_none()) {
                let answer = watch.answer(i);
                let event = match answer.verdict {
                    Some(_) => event,
                    None if command.following.bounds && answer.bounds != known.bounds => "bounds",
                    None => continue,
                };
                known.clone_from(answer);
                output::json_line(&change(event, &requirements[i], answer, &watch, &follow))?;
            }
        }
        let is_violated =
            |i: usize| requirements[i].severity != Severity::Warning && known[i].verdict == Some(false);
        let fails = (0..known.len()).any(is_violated);
        let is_decided = known.iter().all(|answer| answer.verdict.is_some());
        if is_decided || next == Next::End || (fails && !command.following.keep_going) {
            notes(&known, &watch, &follow);
            return Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done });
        }
        if interrupt::requested() {
            for (i, _) in known.iter().enumerate().filter(|(_, known)| known.verdict.is_none()) {
                let answer = watch.answer(i);
                output::json_line(&change("interrupted", &requirements[i], answer, &watch, &follow))?;
            }
            return Ok(ExitStatus::Interrupted);
        }
    }
}

/// Returns the line about a formula.
fn change(
    event: &str,
    requirement: &Requirement,
    answer: &Answer,
    watch: &Watch,
    follow: &Follow,
) -> MonitorChange {
    MonitorChange {
        event: event.to_string(),
        name: requirement.name.clone(),
        samples: watch.len() as u64,
        time: follow.time().map(Number),
        origin_ns: follow.origin_ns().and_then(|origin| i64::try_from(origin).ok()),
        low: answer.bounds.low.into(),
        high: answer.bounds.high.into(),
        violated: answer.verdict.map(|is_satisfied| !is_satisfied),
        violation: answer.violation.as_ref().map(|violation| FirstViolation {
            formula: violation.formula.clone(),
            sample: violation.sample as u64,
            time: violation.time.map(Number),
            robustness: violation.robustness.into(),
        }),
        cuts_windows: answer.cuts_windows,
    }
}

fn notes(known: &[Answer], watch: &Watch, follow: &Follow) {
    if follow.missing() > 0 {
        output::message(&format!("note: {} missing in a log", plural(follow.missing() as u64, "value")));
    }
    if known.iter().any(|answer| answer.cuts_windows) {
        output::message(&format!(
            "note: a window extends past the end of the trace, which has {}; it is cut there, as in RTAMT; samples after the \
             end could change the value (--strict-horizon uses whole windows only)",
            plural(watch.len() as u64, "sample")
        ));
    }
}
