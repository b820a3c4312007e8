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
    whole: Demand,
    /// The operands of its `and`; empty without one.
    parts: Vec<Demand>,
    /// Why it is satisfied and asks nothing.
    asks_nothing: Option<String>,
    /// The last answer that was printed.
    known: Answer,
}

/// A formula that is followed.
struct Demand {
    watch: Watch,
    /// The formula where it asks nothing, without an implication `None`.
    vacuous: Option<Watch>,
    /// Whether the first sample alone satisfies it.
    is_by_first: bool,
}

impl Demand {
    fn push(&mut self, next: Next, samples: usize, follow: &Follow) -> Result<(), LogError> {
        let push = |watch: &mut Watch| match next {
            Next::Sample => watch.push(follow.sample(), follow.time()),
            _ => watch.finish(),
        };
        // An error of this formula is its own.
        self.vacuous.take_if(|watch| push(watch).is_err());
        let pushed = push(&mut self.watch);
        self.is_by_first |= samples == 1 && next == Next::Sample && holds(&self.watch);
        pushed
    }

    /// Returns why it is satisfied and asks nothing.
    fn vacuity(&self) -> Option<Vacuity> {
        if self.watch.answer(0).bounds.low == f64::INFINITY {
            Some(Vacuity::NoSample)
        } else if self.is_by_first {
            Some(Vacuity::FirstSample)
        } else {
            self.vacuous.as_ref().is_some_and(holds).then_some(Vacuity::Premise)
        }
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
        let demand = |formula: &Formula| {
            let vacuous = formula.vacuous().and_then(|formula| watch(formula).ok());
            Ok::<_, LogError>(Demand { watch: watch(formula.clone())?, vacuous, is_by_first: false })
        };
        let mut parts = requirement.formula.demands();
        if parts.len() < 2 {
            parts.clear();
        }
        match demand(&requirement.formula) {
            Ok(whole) => followed.push(Followed {
                requirement,
                whole,
                parts: parts.iter().filter_map(|part| demand(part).ok()).collect(),
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
            let Followed { requirement, whole, parts, asks_nothing, known } = &mut followed[index];
            if known.verdict.is_some() {
                index += 1;
                continue;
            }
            for part in parts.iter_mut() {
                // A part that is decided stays so.
                let _ = part.push(next, samples, &follow);
            }
            if let Err(error) = whole.push(next, samples, &follow) {
                if count == 1 {
                    return Err(error.into());
                }
                no_verdict(name, requirement, error, samples, &follow)?;
                without += 1;
                followed.remove(index);
                continue;
            }
            index += 1;
            let answer = whole.watch.answer(0);
            let event = match answer.verdict {
                Some(_) => event,
                None if asked.bounds && answer.bounds != known.bounds => MonitorEvent::Bounds,
                None => continue,
            };
            known.clone_from(answer);
            let all =
                |parts: &[Demand]| !parts.is_empty() && parts.iter().all(|part| part.vacuity().is_some());
            let vacuity = (answer.verdict == Some(true))
                .then(|| whole.vacuity().or_else(|| all(parts).then_some(Vacuity::Parts)))
                .flatten();
            *asks_nothing = match requirement.certainty.filter(|_| answer.verdict == Some(true)) {
                Some(reason) => Some(reason.to_string()),
                None => vacuity.map(|found| found.reason(&requirement.formula)),
            };
            output::json_line(&change(event, requirement, answer, asks_nothing.clone(), samples, &follow))?;
        }
        let is_violated = |found: &Followed<'_>| {
            found.requirement.severity != Severity::Warning && found.known.verdict == Some(false)
        };
        let fails = followed.iter().any(is_violated);
        let is_decided = followed.iter().all(|found| found.known.verdict.is_some());
        if is_decided || next == Next::End || (fails && !asked.keep_going) {
            notes(&followed, samples, &follow);
            let names: Vec<String> = followed.iter().map(|found| name_of(found.requirement)).collect();
            let answers = followed.iter().zip(&names).map(|(found, requirement)| LogAnswer {
                requirement,
                severity: found.requirement.severity,
                asks_nothing: found.asks_nothing.as_deref(),
            });
            let status = log_question::status(fails, answers);
            return log_question::conclude(status, Without::requirements(without), 1);
        }
        if interrupt::requested() {
            for found in followed.iter().filter(|found| found.known.verdict.is_none()) {
                let answer = found.whole.watch.answer(0);
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
