//! Runs all runs of a campaign.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use anyhow::{Context, Result};
use mishandle::campaign::CampaignRun as PlannedRun;
use mishandle::harden::{HardenProgress, HardenUnit};
use mishandle::results::{Answer, CampaignRun};
use mishandle::run::{Device, Engine, OpenRun, Opening};
use mishandle::{MishandleError, RunError};

use super::file::report_build_differences;
use crate::interrupt;
use crate::show::escape;
use crate::show::progress::Bar;

/// The runs of a campaign that have ended.
#[derive(Default)]
pub struct Ended {
    /// Runs with a result.
    pub finished: Vec<CampaignRun>,
    /// Names of searches that stopped because their first simulations all failed, and why.
    pub stopped: Vec<(String, String)>,
}

/// Runs or completes all runs in order, `jobs` at a time. Returns the ended ones, which are fewer
/// if a signal interrupts them. A search that stopped does not stop the other runs.
pub fn run_all(
    runs: &[PlannedRun],
    bar: &Bar,
    opening: Opening,
    jobs: usize,
    gpu: Option<&Device>,
) -> Result<Ended> {
    let progress = Progress::new(runs, bar);
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let stopped: Mutex<Vec<(usize, String, String)>> = Mutex::default();
    let work = || {
        let mut finished = Vec::new();
        while !failed.load(Ordering::Relaxed) && !interrupt::requested() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(run) = runs.get(index) else { break };
            let watch = |step: Step<'_>| {
                progress.report(index, step);
                // A failure ends the other jobs like a signal: what they have done is stored.
                if failed.load(Ordering::Relaxed) {
                    ControlFlow::Break(())
                } else {
                    interrupt::control_flow()
                }
            };
            let result = match run_one(run, runs, opening, gpu, watch) {
                Err(error) if is_stopped(&error) => {
                    if let Ok(mut stopped) = stopped.lock() {
                        stopped.push((index, run.name.clone(), error.to_string()));
                    }
                    continue;
                }
                result => result.with_context(|| format!("run {}", run.name)),
            };
            failed.fetch_or(result.is_err(), Ordering::Relaxed);
            finished.extend(result.transpose().map(|result| (index, result)));
        }
        finished
    };
    let mut finished = match jobs.min(runs.len()) {
        0 | 1 => work(),
        jobs => std::thread::scope(|scope| {
            let workers: Vec<_> = (0..jobs).map(|_| scope.spawn(work)).collect();
            let joined = workers.into_iter().flat_map(|worker| match worker.join() {
                Ok(finished) => finished,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            joined.collect()
        }),
    };
    finished.sort_by_key(|(index, _)| *index);
    let mut stopped = stopped.into_inner().unwrap_or_default();
    stopped.sort_unstable();
    Ok(Ended {
        finished: finished.into_iter().map(|(_, result)| result).collect::<Result<_>>()?,
        stopped: stopped.into_iter().map(|(_, name, why)| (name, why)).collect(),
    })
}

fn is_stopped(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(MishandleError::Run(RunError::NothingRuns { .. })))
}

/// Progress of a run.
#[derive(Clone, Copy)]
enum Step<'a> {
    /// Numbers of finished simulations, and of those that its plan asks for.
    Question(u64, u64),
    /// A phase of a hardening.
    Hardening(&'a HardenProgress),
}

/// Progress of all runs, on one bar.
struct Progress<'a> {
    runs: &'a [PlannedRun],
    bar: &'a Bar,
    /// Number of finished simulations of each run, and of those that its plan or phase asks for.
    counts: Mutex<Vec<(u64, u64)>>,
}

impl Progress<'_> {
    fn new<'a>(runs: &'a [PlannedRun], bar: &'a Bar) -> Progress<'a> {
        Progress { runs, bar, counts: Mutex::new(vec![(0, 0); runs.len()]) }
    }

    fn report(&self, index: usize, step: Step<'_>) {
        let Ok(mut counts) = self.counts.lock() else { return };
        let phase = match step {
            Step::Question(done, planned) => {
                counts[index] = (done, planned);
                String::new()
            }
            // The bar has the simulations of the present phase: nobody knows those of all rounds.
            Step::Hardening(HardenProgress { phase, done, all, unit }) => {
                if *unit == HardenUnit::Simulations {
                    counts[index] = (*done, *all);
                }
                format!(", {}, {done} of {all} {unit}", escape::name(phase))
            }
        };
        self.bar.set_length(counts.iter().map(|(_, planned)| planned).sum());
        self.bar.set_position(counts.iter().map(|(done, _)| done).sum());
        let number = index + 1;
        let all = self.runs.len();
        self.bar.set_note(format!("run {number} of {all}: {}{phase}", self.runs[index].name));
    }
}

/// Runs or completes one run. Returns `None` if it was interrupted.
fn run_one(
    run: &PlannedRun,
    runs: &[PlannedRun],
    opening: Opening,
    gpu: Option<&Device>,
    watch: impl Fn(Step<'_>) -> ControlFlow<()> + Sync,
) -> Result<Option<CampaignRun>> {
    let finished =
        |kind: &str, result| CampaignRun { name: run.name.clone(), kind: kind.to_string(), result };
    if run.is_hardening() {
        if opening.any_build {
            report_build_differences("started", &mishandle::harden::build_differences(&run.path)?);
        }
        let found = run.harden(opening, gpu, &mut |progress| watch(Step::Hardening(progress)))?;
        return Ok(found.map(|found| finished("harden", Answer::Hardening(Box::new(found)))));
    }
    let (file, resolved) = run.resume(opening)?;
    if opening.any_build {
        let differences = mishandle::replay::build_differences(file.file().header(), &resolved);
        report_build_differences("started", &differences);
    }
    let engine = gpu.map_or(Engine::Direct, |gpu| Engine::Screening(&*gpu.worlds));
    let file = OpenRun { writer: file, known_arm: run.known_arm(&resolved, runs) };
    let answer = mishandle::run::ask(&resolved, file, engine, &mut |progress| {
        watch(Step::Question(progress.simulations, progress.max_simulations))
    })?;
    Ok(answer.is_complete().then(|| finished(resolved.plan.kind().name(), answer)))
}
