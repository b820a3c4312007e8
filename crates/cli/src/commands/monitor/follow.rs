//! `monitor --follow`: a log that is still written.

use std::time::Duration;

use anyhow::{Context, Result};
use mishandle::plan::Settings;
use mishandle::results::{FirstViolation, MonitorChange, MonitorEvent, Number, Severity};
use mishandle::stl::{Formula, Vacuity};
use mishandle::verdict::LogAnswer;
use mishandle_logs::{Answer, Follow, Following, LogError, Next, Requirement, Watch, Watched};
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::interrupt;
use crate::run::log_question::{self, Question, Without};
use crate::run::logs;
use crate::show::output;

/// Time between two looks at the signals that interrupt the command.
const WAIT: Duration = Duration::from_millis(50);

/// A requirement that is followed.
struct Followed<'a> {
    requirement: &'a Requirement,
    watch: Watch,
    /// Its formula where it asks nothing, without an implication `None`.
    vacuous: Option<Watch>,
    /// The operands of its `and`; empty without one.
    parts: Vec<Part>,
    /// Why it is satisfied and asks nothing.
    asks_nothing: Option<String>,
    /// The last answer that was printed.
    known: Answer,
}

/// An operand of the `and` of a requirement.
struct Part {
    watch: Watch,
    vacuous: Option<Watch>,
    /// Whether the first sample alone satisfies it.
    is_by_first: bool,
}

impl Part {
    /// Returns whether it is satisfied and asks nothing.
    fn asks_nothing(&self) -> bool {
        self.is_by_first
            || self.watch.answer(0).bounds.low == f64::INFINITY
            || self.vacuous.as_ref().is_some_and(holds)
    }
}

fn holds(watch: &Watch) -> bool {
    watch.answer(0).verdict == Some(true)
}

fn name_of(requirement: &Requirement) -> String {
    requirement.name.clone().unwrap_or_else(|| requirement.formula.to_string())
}

/// Follows a log until the exit code is certain.
pub fn run(question: &Question<'_>, settings: &Settings) -> Result<ExitStatus> {
    let requirements = question.requirements()?;
    let paths: Vec<String> =
        question.sources[0].iter().map(|source| source.path.display().to_string()).collect();
    let name = paths.join(", ");
    interrupt::listen(|| output::message("stopped by a signal; the log may go on"), || {})?;
    follow(question, &name, &requirements, settings).with_context(|| format!("trace {name}"))
}

fn follow(
    question: &Question<'_>,
    name: &str,
    requirements: &[Requirement],
    settings: &Settings,
) -> Result<ExitStatus> {
    let asked = &settings.monitor;
    let following = Following { lateness: asked.lateness, idle: asked.idle.map(Duration::from_secs_f64) };
    let formulas: Vec<Formula> = requirements.iter().map(|found| found.formula.clone()).collect();
    let mut follow = Follow::open(&question.sources[0], &formulas, &question.options, following)?;
    let unreadable = loop {
        if let (true, unreadable) = follow.open_files(WAIT)? {
            break unreadable;
        }
        if interrupt::requested() {
            for requirement in requirements {
                output::json_line(&change(
                    MonitorEvent::Interrupted,
                    requirement,
                    &Answer::UNKNOWN,
                    None,
                    0,
                    &follow,
                ))?;
            }
            return Ok(ExitStatus::Interrupted);
        }
    };
    let mut errors: Vec<(usize, LogError)> = unreadable;
    let mut followed = Vec::new();
    for (index, requirement) in requirements.iter().enumerate() {
        if errors.iter().any(|(unreadable, _)| *unreadable == index) {
            continue;
        }
        // Each has its own monitor, so that an error of one takes no verdict from the others.
        let watch = |formula: Formula| {
            let watched = [Watched { formula, unit: requirement.unit }];
            Watch::new(&watched, follow.signals(), settings.log.period, settings.log.strict_horizon)
        };
        let nothing = |formula: &Formula| formula.vacuous().and_then(|formula| watch(formula).ok());
        let part = |formula: Formula| {
            let vacuous = nothing(&formula);
            Some(Part { watch: watch(formula).ok()?, vacuous, is_by_first: false })
        };
        let mut parts = requirement.formula.demands();
        if parts.len() < 2 {
            parts.clear();
        }
        match watch(requirement.formula.clone()) {
            Ok(found) => followed.push(Followed {
                requirement,
                watch: found,
                vacuous: nothing(&requirement.formula),
                parts: parts.into_iter().filter_map(part).collect(),
                asks_nothing: None,
                known: Answer::UNKNOWN,
            }),
            // A choice that the command line lacks is not missing in one requirement alone.
            Err(error) if error.is_undecided() => return Err(error.into()),
            Err(error) => errors.push((index, error)),
        }
    }
    if followed.is_empty()
        && let Some((_, error)) = errors.pop()
    {
        return Err(error.into());
    }
    let mut without = errors.len();
    let mut samples = 0;
    for (index, error) in errors {
        no_verdict(name, &requirements[index], error, samples, &follow)?;
    }
    loop {
        let next = follow.next(WAIT)?;
        let event = if next == Next::End { MonitorEvent::End } else { MonitorEvent::Verdict };
        samples += usize::from(next == Next::Sample);
        let mut index = 0;
        while next != Next::Waiting && index < followed.len() {
            let count = followed.len();
            let Followed { requirement, watch, vacuous, parts, asks_nothing, known } = &mut followed[index];
            if known.verdict.is_some() {
                index += 1;
                continue;
            }
            let push = |watch: &mut Watch| match next {
                Next::Sample => watch.push(follow.sample(), follow.time()),
                _ => watch.finish(),
            };
            // An error of the formula is one of its own, too.
            vacuous.take_if(|watch| push(watch).is_err());
            for part in parts.iter_mut() {
                // A part that is decided stays so.
                let _ = push(&mut part.watch);
                part.vacuous.take_if(|watch| push(watch).is_err());
                part.is_by_first |= samples == 1 && next == Next::Sample && holds(&part.watch);
            }
            if let Err(error) = push(watch) {
                if count == 1 {
                    return Err(error.into());
                }
                no_verdict(name, requirement, error, samples, &follow)?;
                without += 1;
                followed.remove(index);
                continue;
            }
            index += 1;
            let answer = watch.answer(0);
            let event = match answer.verdict {
                Some(_) => event,
                None if asked.bounds && answer.bounds != known.bounds => MonitorEvent::Bounds,
                None => continue,
            };
            known.clone_from(answer);
            let vacuity = match answer.verdict {
                Some(true) if answer.bounds.low == f64::INFINITY => Some(Vacuity::NoSample),
                Some(true) if samples == 1 && next == Next::Sample => Some(Vacuity::FirstSample),
                Some(true) if vacuous.as_ref().is_some_and(holds) => Some(Vacuity::Premise),
                Some(true) if !parts.is_empty() && parts.iter().all(Part::asks_nothing) => {
                    Some(Vacuity::Parts)
                }
                _ => None,
            };
            *asks_nothing = vacuity.map(|found| found.reason(&requirement.formula));
            output::json_line(&change(event, requirement, answer, asks_nothing.clone(), samples, &follow))?;
        }
        let is_violated = |found: &Followed<'_>| {
            found.requirement.severity != Severity::Warning && found.known.verdict == Some(false)
        };
        let fails = followed.iter().any(is_violated);
        let is_decided = followed.iter().all(|found| found.known.verdict.is_some());
        if is_decided || next == Next::End || (fails && !asked.keep_going) {
            notes(&followed, samples, &follow);
            log_question::check_all(Without::requirements(without), 1)?;
            let names: Vec<String> = followed.iter().map(|found| name_of(found.requirement)).collect();
            let answers = followed.iter().zip(&names).map(|(found, requirement)| LogAnswer {
                requirement,
                severity: found.requirement.severity,
                asks_nothing: found.asks_nothing.as_deref(),
            });
            return log_question::status(fails, answers);
        }
        if interrupt::requested() {
            for found in followed.iter().filter(|found| found.known.verdict.is_none()) {
                let answer = found.watch.answer(0);
                output::json_line(&change(
                    MonitorEvent::Interrupted,
                    found.requirement,
                    answer,
                    None,
                    samples,
                    &follow,
                ))?;
            }
            return Ok(ExitStatus::Interrupted);
        }
    }
}

/// Reports a requirement without a verdict, on both streams.
fn no_verdict(
    name: &str,
    requirement: &Requirement,
    error: LogError,
    samples: usize,
    follow: &Follow,
) -> Result<()> {
    let reason = Some(error.to_string());
    let line = change(MonitorEvent::NoVerdict, requirement, &Answer::UNKNOWN, None, samples, follow);
    output::json_line(&MonitorChange { reason, ..line })?;
    output::report_error(&logs::without_verdict(name, requirement, error));
    Ok(())
}

/// Returns the line about a formula.
fn change(
    event: MonitorEvent,
    requirement: &Requirement,
    answer: &Answer,
    asks_nothing: Option<String>,
    samples: usize,
    follow: &Follow,
) -> MonitorChange {
    MonitorChange {
        event,
        name: requirement.name.clone(),
        samples: samples as u64,
        time: follow.time().map(Number),
        origin_ns: follow.origin_ns().and_then(|origin| i64::try_from(origin).ok()),
        low: answer.bounds.low.into(),
        high: answer.bounds.high.into(),
        violated: answer.verdict.map(|is_satisfied| !is_satisfied),
        asks_nothing,
        violation: answer.violation.as_ref().map(|violation| FirstViolation {
            formula: violation.formula.clone(),
            sample: violation.sample as u64,
            time: violation.time.map(Number),
            robustness: violation.robustness.into(),
        }),
        cuts_windows: answer.cuts_windows,
        reason: None,
    }
}

fn notes(followed: &[Followed<'_>], samples: usize, follow: &Follow) {
    if follow.missing() > 0 {
        output::message(&format!("note: {} missing in a log", plural(follow.missing() as u64, "value")));
    }
    if followed.iter().any(|found| found.known.cuts_windows) {
        output::message(&format!(
            "note: a window extends past the end of the trace, which has {}; it is cut there, as in RTAMT; samples after the \
             end could change the value (log.strict-horizon uses whole windows only)",
            plural(samples as u64, "sample")
        ));
    }
}
