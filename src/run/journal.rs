//! The simulations of a run as a system: recorded ones are answered from the run file, new ones are
//! simulated and recorded.
//!
//! A question asks its simulations one after the other, and what it asks next depends only on the
//! answers. So a run is continued by asking again from the beginning: [`JournalSystem`] and
//! [`JournalScreening`] answer at once as long as the answers are recorded. A record that is not
//! the requested one is an error, never an answer.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell, RefCell};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mishandle_rollout::{
    Episode, Request, RolloutError, Screen, ScreenedEpisode, Space, Steerable, SteeredEpisode, Steering,
    System,
};
use mishandle_stl::is_violated;
use mishandle_store::{
    MAX_TRIALS, RunFile, RunKind, RunWriter, ScreenedChunk, Simulation, TrialRecord, TrialStatus,
    TrialSummary, requests_digest,
};

use crate::error::{Compared, MishandleError, other_request};
use crate::resolve::ResolvedPlan;
use crate::run::first_simulations::FirstSimulations;
use crate::run::{rows, screened_columns};

/// Largest number of traces that a run keeps if it does not [keep all](keeps_all_traces) of its
/// failures. More traces would fill the disk: a million screened simulations have 10,000 failures
/// if one of a hundred fails.
const TRACES: usize = 1000;

/// Returns whether the run of a plan keeps the traces of all its failures.
pub(crate) fn keeps_all_traces(resolved: &ResolvedPlan) -> bool {
    matches!(resolved.plan.kind(), RunKind::Evaluate | RunKind::Falsify) && resolved.plan.screening.is_none()
}

/// A run file that is read, or read and continued.
enum File<'a> {
    Read(&'a RunFile),
    Write(Box<RefCell<RunWriter>>),
}

/// Why a journal ended its question.
enum End {
    /// This is the request that was looked for.
    Found(Request),
    /// The question asked something that is not recorded, and this journal simulates nothing.
    NotRecorded,
    Failed(MishandleError),
}

/// The record of a question that is asked.
pub(crate) struct Journal<'a> {
    resolved: &'a ResolvedPlan,
    file: File<'a>,
    started: RefCell<BTreeSet<u32>>,
    /// Number of the last recorded simulation of a trial. Later ones need no look-up.
    last: RefCell<BTreeMap<u32, u32>>,
    traces: Cell<usize>,
    chunks: Cell<u32>,
    /// Number of simulations and chunks that the run file answered.
    answered: Arc<AtomicU64>,
    /// Number of simulations that the question asked and got.
    asked: Cell<u64>,
    /// Trial and number of the simulation that is looked for.
    sought: Option<(u32, u32)>,
    end: RefCell<Option<End>>,
    /// The first simulations of a search; `None` if the question does not stop after failures.
    first: Option<RefCell<FirstSimulations>>,
    /// The engine that proposes simulations, until the question takes it.
    engine: RefCell<Option<Box<dyn Screen>>>,
    /// A run of another space, which has the control arm already.
    known_arm: Option<RunFile>,
}

impl<'a> Journal<'a> {
    /// Continues a run. A run without simulations begins.
    pub(crate) fn new(resolved: &'a ResolvedPlan, run: RunWriter) -> Result<Journal<'a>, MishandleError> {
        let trials = run.file().trials()?.into_iter().chain(run.file().derived_trials()?);
        let started = trials.map(|trial| trial.trial.number).collect();
        let traces = if keeps_all_traces(resolved) { 0 } else { run.file().stored_traces()?.len() };
        // With screening, a device meets the failures first.
        let stops = resolved.plan.kind() != RunKind::Evaluate && resolved.plan.screening.is_none();
        Ok(Journal {
            traces: Cell::new(traces),
            first: stops.then(RefCell::default),
            ..Journal::of(resolved, File::Write(Box::new(run.into())), started)
        })
    }

    /// Lets the first simulations fail, all of them.
    pub(crate) fn with_failing_starts(self) -> Journal<'a> {
        Journal { first: None, ..self }
    }

    /// Lets an engine propose the simulations.
    pub(crate) fn with_engine(self, engine: Option<Box<dyn Screen>>) -> Journal<'a> {
        Journal { engine: engine.into(), ..self }
    }

    /// Uses the simulations of a control arm in `other` that are those of this arm, instead of
    /// repeating them.
    pub(crate) fn with_known_arm(self, other: Option<RunFile>) -> Journal<'a> {
        Journal { known_arm: other, ..self }
    }

    /// Asks the question of a run again, without simulating anything, up to simulation `number` of
    /// `trial`.
    pub(crate) fn until(resolved: &'a ResolvedPlan, run: &'a RunFile, sought: (u32, u32)) -> Journal<'a> {
        Journal { sought: Some(sought), ..Journal::again(resolved, run) }
    }

    /// Asks the question of a run again, without simulating anything.
    pub(crate) fn again(resolved: &'a ResolvedPlan, run: &'a RunFile) -> Journal<'a> {
        Journal::of(resolved, File::Read(run), BTreeSet::new())
    }

    fn of(resolved: &'a ResolvedPlan, file: File<'a>, started: BTreeSet<u32>) -> Journal<'a> {
        Journal {
            resolved,
            file,
            started: started.into(),
            last: RefCell::default(),
            traces: Cell::new(0),
            chunks: Cell::new(0),
            answered: Arc::default(),
            asked: Cell::new(0),
            sought: None,
            end: RefCell::new(None),
            first: None,
            engine: RefCell::new(None),
            known_arm: None,
        }
    }

    /// Returns the plan of the question.
    pub(crate) fn resolved(&self) -> &'a ResolvedPlan {
        self.resolved
    }

    /// Returns the run that has the control arm already.
    pub(crate) fn known_arm(&self) -> Option<&RunFile> {
        self.known_arm.as_ref()
    }

    /// Returns whether this journal simulates and records nothing.
    pub(crate) fn is_read_only(&self) -> bool {
        matches!(self.file, File::Read(_))
    }

    /// Returns the path of the run file.
    pub(crate) fn path(&self) -> PathBuf {
        self.read(|run| run.path().to_path_buf())
    }

    /// Reads the run file.
    pub(crate) fn read<T>(&self, with: impl FnOnce(&RunFile) -> T) -> T {
        match &self.file {
            File::Read(run) => with(run),
            File::Write(run) => with(run.borrow().file()),
        }
    }

    /// Returns the system whose simulations are recorded. With `numbering`, they are numbered in
    /// the order in which they are asked; otherwise a request has its own numbers.
    ///
    /// The target's own system is made when a simulation needs it.
    pub(crate) fn system(&self, numbering: Option<Numbering>) -> JournalSystem<'_> {
        JournalSystem { journal: self, system: OnceCell::new(), numbering, is_deferred: false }
    }

    /// Returns the target's own system for a question that [keeps](Self::keep) its simulations
    /// itself.
    pub(crate) fn deferred(&self) -> JournalSystem<'_> {
        JournalSystem { is_deferred: true, ..self.system(None) }
    }

    /// Returns a screening whose outcomes are recorded. Without an engine it answers recorded
    /// requests only.
    pub(crate) fn screening(&self) -> JournalScreening<'_> {
        JournalScreening { journal: self, engine: self.engine.take() }
    }

    /// Calls `each` with the recorded simulations of the question in order, those that derive from
    /// trial `derived` at the end. The failures of a trial that keeps going have their traces.
    pub(crate) fn rows(
        &self,
        derived: Option<u32>,
        mut each: impl FnMut(&Episode) -> Result<(), MishandleError>,
    ) -> Result<(), MishandleError> {
        let needs_traces = self.resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going);
        self.read(|run| {
            let derived = derived.map(|trial| run.derived_simulations(trial));
            for row in run.simulations().chain(derived.into_iter().flatten()) {
                let row = with_needed_trace(run, row?, needs_traces)?;
                let episode = rows::episode(&row, self.resolved)?;
                each(&episode)?;
                if let Some(first) = &self.first {
                    first.borrow_mut().add(&episode);
                }
            }
            self.first.as_ref().map_or(Ok(()), |first| first.borrow().check(self.resolved, run))
        })
    }

    /// Starts these trials, before they have simulations.
    pub(crate) fn start(&self, trials: impl IntoIterator<Item = u32>) -> Result<(), MishandleError> {
        let File::Write(run) = &self.file else { return Ok(()) };
        trials.into_iter().try_for_each(|trial| self.start_trial(&mut run.borrow_mut(), trial))
    }

    fn start_trial(&self, run: &mut RunWriter, trial: u32) -> Result<(), MishandleError> {
        if self.started.borrow_mut().insert(trial) {
            run.start_trial(trial, self.resolved.trial_seed(trial))?;
        }
        Ok(())
    }

    /// Returns whether a trial is in the run file.
    pub(crate) fn is_started(&self, trial: u32) -> bool {
        self.started.borrow().contains(&trial)
    }

    /// Records simulations in one transaction, then the ends of trials, and checks whether the
    /// first simulations of a search all fail.
    pub(crate) fn keep(
        &self,
        episodes: &[Episode],
        ended: &[(u32, TrialStatus)],
    ) -> Result<(), MishandleError> {
        let File::Write(run) = &self.file else { return Ok(()) };
        let mut writer = run.borrow_mut();
        let rows = self.new_rows(&mut writer, episodes)?;
        writer.record(&rows)?;
        self.end_trials(&mut writer, ended)?;
        drop(writer);
        self.check_first(episodes.iter())
    }

    /// Records rows of another run.
    pub(crate) fn copy(&self, rows: &[Simulation]) -> Result<(), MishandleError> {
        let File::Write(run) = &self.file else { return Ok(()) };
        Ok(run.borrow_mut().record(rows)?)
    }

    fn end_trials(&self, run: &mut RunWriter, ended: &[(u32, TrialStatus)]) -> Result<(), MishandleError> {
        for (trial, status) in ended {
            self.start_trial(run, *trial)?;
            if run.file().trial(*trial)?.status == TrialStatus::Running {
                run.end_trial(*trial, *status)?;
            }
        }
        Ok(())
    }

    /// Adds simulations to the first ones of a search, which stops if all of them fail.
    fn check_first<'e>(&self, episodes: impl Iterator<Item = &'e Episode>) -> Result<(), MishandleError> {
        let Some(first) = &self.first else { return Ok(()) };
        let mut first = first.borrow_mut();
        episodes.for_each(|episode| first.add(episode));
        self.read(|run| first.check(self.resolved, run))
    }

    /// Returns the result of a question, or the error of this journal that ended it.
    pub(crate) fn result<T, E>(&self, result: Result<T, E>) -> Result<T, MishandleError>
    where
        MishandleError: From<E>,
    {
        match self.end.take() {
            Some(End::Failed(error)) => Err(error),
            end => {
                self.end.replace(end);
                Ok(result?)
            }
        }
    }

    /// Returns the request that is looked for, if it is among these.
    fn sought_in<'r>(&self, requests: &'r [Request]) -> Option<&'r Request> {
        let sought = self.sought?;
        requests.iter().find(|request| (request.trial, request.number) == sought)
    }

    /// Keeps why the question ends, and returns the error that ends it.
    fn end(&self, end: End) -> RolloutError {
        self.end.borrow_mut().get_or_insert(end);
        RolloutError::Ended
    }

    fn fail(&self, error: impl Into<MishandleError>) -> RolloutError {
        self.end(End::Failed(error.into()))
    }

    /// Counts the simulations that a question asked, and checks whether its first ones all fail.
    /// Simulations that derive from others are not those of the question.
    fn answer<'e>(
        &self,
        requests: &[Request],
        episodes: impl Iterator<Item = &'e Episode>,
    ) -> Result<(), RolloutError> {
        let own = requests.iter().filter(|request| request.trial <= MAX_TRIALS).count() as u64;
        self.asked.set(self.asked.get() + own);
        let own = episodes.filter(|episode| episode.request.trial <= MAX_TRIALS);
        self.check_first(own).map_err(|error| self.fail(error))
    }

    /// Returns the request that was looked for; `None` if the question did not ask it.
    pub(crate) fn found(&self) -> Option<Request> {
        match self.end.take() {
            Some(End::Found(request)) => Some(request),
            _ => None,
        }
    }

    /// Sets the status of trials that have ended. A trial none of whose simulations had to be
    /// confirmed is recorded without one.
    pub(crate) fn set_ended(&self, ended: &[(u32, TrialStatus)]) -> Result<(), MishandleError> {
        let File::Write(run) = &self.file else { return Ok(()) };
        self.end_trials(&mut run.borrow_mut(), ended)
    }

    /// Closes the file.
    pub(crate) fn close(self) -> Result<(), MishandleError> {
        let File::Write(run) = self.file else { return Ok(()) };
        Ok(run.into_inner().close()?)
    }

    /// Compares the trials of the file, and of a complete question the number of its simulations,
    /// with what was asked. Nobody else would notice rows that no question asks.
    pub(crate) fn check(
        &self,
        ended: &[(u32, TrialStatus)],
        is_complete: bool,
    ) -> Result<(), MishandleError> {
        let mut differences = Vec::new();
        for TrialSummary { trial, .. } in self.read(RunFile::trials)? {
            let TrialRecord { number, seed, status } = trial;
            let planned = self.resolved.trial_seed(number);
            if seed != planned {
                differences.push(format!("seed of trial {number}: recorded {seed}, expected {planned}"));
            }
            let found = ended.iter().find(|(trial, _)| *trial == number).map(|(_, status)| *status);
            let expected = found.unwrap_or(TrialStatus::Running);
            if found.is_none() && is_complete {
                differences.push(format!("trial {number}: the question has no such trial"));
            } else if status != TrialStatus::Running && status != expected {
                differences
                    .push(format!("status of trial {number}: recorded {status:?}, expected {expected:?}"));
            }
        }
        let recorded = self.read(RunFile::counts)?.simulations;
        let asked = self.asked.get();
        if is_complete && recorded != asked {
            differences.push(format!("number of simulations: recorded {recorded}, expected {asked}"));
        }
        if differences.is_empty() {
            Ok(())
        } else {
            Err(MishandleError::differs(Compared::Plan, differences))
        }
    }

    /// Returns the number of simulations and chunks that the run file answered, which grows.
    pub(crate) fn answered(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.answered)
    }

    /// Returns whether the question asked something that is not recorded, and this journal
    /// simulates nothing.
    pub(crate) fn is_missing(&self) -> bool {
        matches!(*self.end.borrow(), Some(End::NotRecorded))
    }

    /// Returns whether a request follows the last recorded simulation of its trial.
    fn is_new(&self, request: &Request) -> Result<bool, MishandleError> {
        let mut last = self.last.borrow_mut();
        let last = match last.entry(request.trial) {
            Entry::Occupied(last) => *last.get(),
            Entry::Vacant(place) => {
                *place.insert(self.read(|run| run.last_simulation_number(request.trial))?)
            }
        };
        Ok(request.number > last)
    }

    /// Returns the recorded answer of a request; `None` if it is not recorded.
    fn recorded(&self, request: &Request) -> Result<Option<Episode>, MishandleError> {
        if self.is_new(request)? {
            return Ok(None);
        }
        let Some(simulation) = self.read(|run| run.recorded(request.trial, request.number))? else {
            return Ok(None);
        };
        let episode = rows::episode(&simulation, self.resolved)?;
        let recorded = &episode.request;
        let bits = |point: &[f64]| point.iter().map(|u| u.to_bits()).collect::<Vec<_>>();
        let is_same = recorded.seed == request.seed
            && recorded.scenario.is_same(&request.scenario)
            && recorded.stop_threshold.map(f64::to_bits) == request.stop_threshold.map(f64::to_bits)
            && bits(&recorded.unit_point) == bits(&request.unit_point);
        self.answered.fetch_add(u64::from(is_same), Ordering::Relaxed);
        if is_same {
            Ok(Some(Episode { request: request.clone(), ..episode }))
        } else {
            Err(other_request("simulation", request.number))
        }
    }

    /// Returns the recorded answer of a steered request, whose scenario has the values that the
    /// proposal chose; `None` if it is not recorded.
    fn recorded_steered(&self, request: &Request) -> Result<Option<SteeredEpisode>, MishandleError> {
        let Some(simulation) = self.read(|run| run.recorded(request.trial, request.number))? else {
            return Ok(None);
        };
        let memory = self.read(|run| run.memory(request.trial, request.number))?;
        let chosen = rows::request(&simulation, false).scenario;
        let request = Request { scenario: chosen, ..request.clone() };
        match (self.recorded(&request)?, memory) {
            (Some(episode), Some(memory)) => Ok(Some(SteeredEpisode { episode, memory })),
            _ => Err(other_request("simulation", request.number)),
        }
    }

    /// Records new simulations in one transaction, and returns them as they are read again: without
    /// their traces.
    fn record(&self, episodes: &[Episode]) -> Result<Vec<Episode>, MishandleError> {
        let File::Write(run) = &self.file else { return Ok(Vec::new()) };
        let mut run = run.borrow_mut();
        let rows = self.new_rows(&mut run, episodes)?;
        run.record(&rows)?;
        self.read_again(rows, episodes)
    }

    /// Records new steered simulations as [`record`](Self::record) does.
    fn record_steered(&self, steered: Vec<SteeredEpisode>) -> Result<Vec<SteeredEpisode>, MishandleError> {
        let File::Write(run) = &self.file else { return Ok(Vec::new()) };
        let mut run = run.borrow_mut();
        let (episodes, memories): (Vec<Episode>, Vec<Vec<f64>>) =
            steered.into_iter().map(|steered| (steered.episode, steered.memory)).unzip();
        let rows = self.new_rows(&mut run, &episodes)?;
        let rows: Vec<(Simulation, Vec<f64>)> = rows.into_iter().zip(memories).collect();
        run.record_steered(&rows)?;
        let (rows, memories): (Vec<Simulation>, Vec<Vec<f64>>) = rows.into_iter().unzip();
        let episodes = self.read_again(rows, &episodes)?;
        Ok(episodes
            .into_iter()
            .zip(memories)
            .map(|(episode, memory)| SteeredEpisode { episode, memory })
            .collect())
    }

    /// Returns the rows of new simulations, and starts their trials.
    fn new_rows(&self, run: &mut RunWriter, episodes: &[Episode]) -> Result<Vec<Simulation>, MishandleError> {
        for Request { trial, number, .. } in episodes.iter().map(|episode| &episode.request) {
            self.start_trial(run, *trial)?;
            if let Some(last) = self.last.borrow_mut().get_mut(trial) {
                *last = (*last).max(*number);
            }
        }
        let limit = if keeps_all_traces(self.resolved) { usize::MAX } else { TRACES };
        let mut traces = self.traces.get();
        let rows = episodes
            .iter()
            .map(|episode| {
                let row = rows::row(episode, self.resolved);
                traces += usize::from(row.trace.is_some());
                Simulation { trace: row.trace.filter(|_| traces <= limit), ..row }
            })
            .collect();
        self.traces.set(traces);
        Ok(rows)
    }

    /// Returns recorded simulations as they are read again: without their traces.
    fn read_again(
        &self,
        rows: Vec<Simulation>,
        episodes: &[Episode],
    ) -> Result<Vec<Episode>, MishandleError> {
        let answer = |(row, episode): (Simulation, &Episode)| {
            let read = rows::episode(&Simulation { trace: None, ..row }, self.resolved)?;
            Ok(Episode { request: episode.request.clone(), ..read })
        };
        rows.into_iter().zip(episodes).map(answer).collect()
    }
}

/// Numbers of simulations in the order in which they are asked.
pub(crate) struct Numbering {
    pub(crate) trial: u32,
    /// Number of the last simulation.
    pub(crate) last: u32,
}

/// A system whose simulations are recorded: see [`Journal::system`].
pub(crate) struct JournalSystem<'a> {
    journal: &'a Journal<'a>,
    system: OnceCell<Box<dyn System>>,
    numbering: Option<Numbering>,
    /// Whether the question keeps its simulations itself.
    is_deferred: bool,
}

impl System for JournalSystem<'_> {
    fn space(&self) -> &Space {
        &self.journal.resolved.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        if self.is_deferred {
            return self.made()?.rollout(requests);
        }
        let journal = self.journal;
        let requests = self.numbered(requests);
        if let Some(request) = journal.sought_in(&requests) {
            return Err(journal.end(End::Found(request.clone())));
        }
        let mut answers = Vec::with_capacity(requests.len());
        for request in requests.iter() {
            answers.push(journal.recorded(request).map_err(|error| journal.fail(error))?);
        }
        let new = without_answer(&requests, &answers);
        let mut simulated = Vec::new().into_iter();
        if !new.is_empty() {
            let episodes = self.made()?.rollout(&new)?;
            // The question reports a system that returns another number of them.
            simulated = if episodes.len() == new.len() {
                journal.record(&episodes).map_err(|error| journal.fail(error))?.into_iter()
            } else {
                episodes.into_iter()
            };
        }
        let episodes: Vec<Episode> =
            answers.into_iter().map_while(|answer| answer.or_else(|| simulated.next())).collect();
        journal.answer(&requests, episodes.iter())?;
        Ok(episodes)
    }

    fn steerable(&self) -> Option<Steerable> {
        // A run that is only read needs to know it as well.
        match self.system.get() {
            Some(system) => system.steerable(),
            None => {
                let system = self.journal.resolved.system().ok()?;
                self.system.get_or_init(|| system).steerable()
            }
        }
    }

    fn rollout_steered(
        &mut self,
        requests: &[Request],
        steering: &dyn Steering,
    ) -> Result<Vec<SteeredEpisode>, RolloutError> {
        let journal = self.journal;
        let requests = self.numbered(requests);
        if let Some(request) = journal.sought_in(&requests) {
            // What the question asks is completed by what the proposal chose.
            let recorded = journal.recorded_steered(request).map_err(|error| journal.fail(error))?;
            return Err(journal.end(match recorded {
                Some(SteeredEpisode { episode, .. }) => End::Found(episode.request),
                None => End::NotRecorded,
            }));
        }
        let mut answers = Vec::with_capacity(requests.len());
        for request in requests.iter() {
            answers.push(journal.recorded_steered(request).map_err(|error| journal.fail(error))?);
        }
        let new = without_answer(&requests, &answers);
        let mut simulated = Vec::new().into_iter();
        if !new.is_empty() {
            let steered = self.made()?.rollout_steered(&new, steering)?;
            simulated = if steered.len() == new.len() {
                journal.record_steered(steered).map_err(|error| journal.fail(error))?.into_iter()
            } else {
                steered.into_iter()
            };
        }
        let steered: Vec<SteeredEpisode> =
            answers.into_iter().map_while(|answer| answer.or_else(|| simulated.next())).collect();
        journal.answer(&requests, steered.iter().map(|steered| &steered.episode))?;
        Ok(steered)
    }
}

impl JournalSystem<'_> {
    /// Returns the target's own system, which is made now if it was not needed before.
    fn made(&mut self) -> Result<&mut dyn System, RolloutError> {
        if self.journal.is_read_only() {
            return Err(self.journal.end(End::NotRecorded));
        }
        if self.system.get().is_none() {
            let system = self.journal.resolved.system().map_err(|error| self.journal.fail(error))?;
            self.system = system.into();
        }
        match self.system.get_mut() {
            Some(system) => Ok(&mut **system),
            None => Err(RolloutError::Ended),
        }
    }

    fn numbered<'r>(&mut self, requests: &'r [Request]) -> Cow<'r, [Request]> {
        let Some(Numbering { trial, last }) = &mut self.numbering else { return requests.into() };
        let number = |request: &Request| {
            *last += 1;
            Request { trial: *trial, number: *last, ..request.clone() }
        };
        requests.iter().map(number).collect()
    }
}

/// Returns the requests without an answer.
fn without_answer<'r, T>(requests: &'r [Request], answers: &[Option<T>]) -> Cow<'r, [Request]> {
    if answers.iter().all(Option::is_none) {
        return requests.into();
    }
    let new = requests.iter().zip(answers).filter(|(_, answer)| answer.is_none());
    new.map(|(request, _)| request.clone()).collect()
}

/// Returns a recorded simulation, with its trace if it fails and its failure mode matters to the
/// search.
pub(crate) fn with_needed_trace(
    run: &RunFile,
    recorded: Simulation,
    needs_traces: bool,
) -> Result<Simulation, MishandleError> {
    if needs_traces && recorded.is_violated() {
        return Ok(run.simulation(recorded.trial, recorded.number)?);
    }
    Ok(recorded)
}

/// A screening whose outcomes are recorded: see [`Journal::screening`].
pub(crate) struct JournalScreening<'a> {
    journal: &'a Journal<'a>,
    engine: Option<Box<dyn Screen>>,
}

impl Screen for JournalScreening<'_> {
    fn run(
        &mut self,
        requests: &[Request],
        watch: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Option<ScreenedEpisode>>, RolloutError> {
        let journal = self.journal;
        let number = journal.chunks.get() + 1;
        journal.chunks.set(number);
        let scenarios = requests.iter().map(|request| (request.seed.0, request.scenario.values()));
        let digest = requests_digest(scenarios);
        let columns = screened_columns::columns(journal.resolved.stored_parts);
        let recorded = journal.read(|run| run.screened_chunk(number, columns));
        if let Some(chunk) = recorded.map_err(|error| journal.fail(error))? {
            let outcomes = screened_columns::decode(&chunk.outcomes);
            if chunk.requests != digest || outcomes.len() != requests.len() {
                return Err(journal.fail(other_request("screened chunk", number)));
            }
            journal.answered.fetch_add(1, Ordering::Relaxed);
            return Ok(outcomes.into_iter().map(Some).collect());
        }
        let Some(engine) = &mut self.engine else {
            return Err(journal.end(End::NotRecorded));
        };
        let found = engine.run(requests, watch)?;
        let File::Write(run) = &journal.file else { return Ok(found) };
        // An interrupted chunk is not recorded, because a part of it would be biased towards short
        // simulations.
        if let Some(complete) = found.iter().cloned().collect::<Option<Vec<ScreenedEpisode>>>() {
            let count = |is: fn(Option<f64>) -> bool| {
                complete.iter().filter(|outcome| is(outcome.robustness())).count() as u64
            };
            let chunk = ScreenedChunk {
                number,
                violated: count(|rho| rho.is_some_and(is_violated)),
                without_verdict: count(|rho| rho.is_none()),
                requests: digest,
                outcomes: screened_columns::encode(&complete, journal.resolved.stored_parts),
            };
            run.borrow_mut().record_screened(&chunk).map_err(|error| journal.fail(error))?;
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::{Scenario, Seed};

    use super::*;
    use crate::error::RunError;
    use crate::plan::{Plan, RiskPlan};
    use crate::run::create_run;

    fn plan() -> ResolvedPlan {
        ResolvedPlan::new(&Plan { risk: Some(RiskPlan::default()), ..Plan::new("toy/sphere-2d", "") })
            .unwrap()
    }

    fn request(x: f64, seed: u64) -> Request {
        Request::new(Scenario::from([x, 0.5]), Seed(seed))
    }

    #[test]
    fn recorded_simulations_are_answered_and_new_ones_are_recorded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let resolved = plan();
        let asked = [request(0.1, 1), request(0.2, 2), request(0.3, 3)];
        let numbering = || Some(Numbering { trial: 1, last: 0 });
        let journal = Journal::new(&resolved, create_run(&resolved, Some(&path)).unwrap()).unwrap();
        let first = journal.system(numbering()).rollout(&asked[..2]).unwrap();
        journal.close().unwrap();
        let journal = Journal::new(&resolved, RunWriter::resume(&path).unwrap()).unwrap();
        let all = journal.system(numbering()).rollout(&asked).unwrap();
        let rho = |episodes: &[Episode]| episodes.iter().map(Episode::robustness).collect::<Vec<_>>();
        assert_eq!(rho(&first), rho(&all[..2]));
        assert_eq!(rho(&all), rho(&resolved.system().unwrap().rollout(&asked).unwrap()));
        journal.set_ended(&[(1, TrialStatus::BudgetSpent)]).unwrap();
        journal.close().unwrap();
        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.last_simulation_number(1).unwrap(), 3);
        // The third simulation is what the question asks third.
        let journal = Journal::until(&resolved, &run, (1, 3));
        let mut system = journal.system(numbering());
        assert!(system.rollout(&asked).is_err());
        assert_eq!(journal.found().unwrap().seed, Seed(3));
    }

    #[test]
    fn a_record_of_another_simulation_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let resolved = plan();
        let journal = Journal::new(&resolved, create_run(&resolved, Some(&path)).unwrap()).unwrap();
        let numbering = || Some(Numbering { trial: 1, last: 0 });
        journal.system(numbering()).rollout(&[request(0.1, 1)]).unwrap();
        for other in [request(0.1, 2), request(0.2, 1)] {
            let result = journal.system(numbering()).rollout(&[other]);
            let error = journal.result(result).unwrap_err();
            assert!(
                matches!(error, MishandleError::Run(RunError::OtherRequest { number: 1, .. })),
                "{error}"
            );
        }
    }
}
