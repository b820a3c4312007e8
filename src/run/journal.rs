//! The simulations of a run as a system: recorded ones are answered from the run file, new ones are
//! simulated and recorded.
//!
//! A question asks its simulations one after the other, and what it asks next depends only on the
//! answers. So a run is continued by asking again from the beginning: [`JournalSystem`] and
//! [`JournalScreening`] answer at once as long as the answers are recorded. A record that is not
//! the requested one is an error, never an answer.

use mishandle_stl::is_violated;
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mishandle_rollout::{
    Episode, Request, RolloutError, Screen, ScreenedEpisode, Space, Steerable, SteeredEpisode, Steering,
    System,
};
use mishandle_store::{
    RunFile, RunWriter, ScreenedChunk, Simulation, TrialRecord, TrialStatus, TrialSummary, requests_digest,
};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::first_simulations::FirstSimulations;
use crate::run::{outcomes, record};

/// Largest number of traces that a run keeps besides those of a falsification. More traces would
/// fill the disk: a million screened simulations have 10,000 failures if one of a hundred fails.
const TRACES: usize = 1000;

/// A run file that is read, or read and continued.
enum File<'a> {
    Read(&'a RunFile),
    Write(Box<RefCell<RunWriter>>),
}

/// The record of a question that is asked.
pub(crate) struct Journal<'a> {
    resolved: &'a ResolvedPlan,
    file: File<'a>,
    started: RefCell<BTreeSet<u32>>,
    traces: Cell<usize>,
    chunks: Cell<u32>,
    /// Number of simulations and chunks that the run file answered.
    answered: Arc<AtomicU64>,
    missing: Cell<bool>,
    /// Number of simulations that the question asked and got.
    asked: Cell<u64>,
    /// Trial and number of the simulation that is looked for, and its request once it is asked.
    sought: Option<(u32, u32)>,
    found: RefCell<Option<Request>>,
    /// The first simulations of a search; `None` if the question does not stop after failures.
    first: Option<RefCell<FirstSimulations>>,
    /// Why the question ended, if it is an error of this journal.
    error: RefCell<Option<MishandleError>>,
}

impl<'a> Journal<'a> {
    /// Continues a run. A run without simulations begins.
    pub(crate) fn new(resolved: &'a ResolvedPlan, run: RunWriter) -> Result<Journal<'a>, MishandleError> {
        let trials = run.file().trials()?.into_iter().chain(run.file().derived_trials()?);
        let started = trials.map(|trial| trial.trial.number).collect();
        let traces = run.file().stored_traces()?.len();
        Ok(Journal {
            traces: Cell::new(traces),
            ..Journal::of(resolved, File::Write(Box::new(run.into())), started)
        })
    }

    /// Continues a search, which stops if its first simulations all fail.
    pub(crate) fn of_search(
        resolved: &'a ResolvedPlan,
        run: RunWriter,
    ) -> Result<Journal<'a>, MishandleError> {
        Ok(Journal { first: Some(RefCell::default()), ..Journal::new(resolved, run)? })
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
            traces: Cell::new(0),
            chunks: Cell::new(0),
            answered: Arc::default(),
            missing: Cell::new(false),
            asked: Cell::new(0),
            sought: None,
            found: RefCell::new(None),
            first: None,
            error: RefCell::new(None),
        }
    }

    /// Returns the system whose simulations are recorded. With `numbering`, they are numbered in
    /// the order in which they are asked; otherwise a request has its own numbers.
    pub(crate) fn system(&self, numbering: Option<Numbering>) -> Result<JournalSystem<'_>, MishandleError> {
        let system = match self.file {
            File::Read(_) => None,
            File::Write(_) => Some(self.resolved.system()?),
        };
        Ok(JournalSystem { journal: self, system, numbering })
    }

    /// Returns a screening whose outcomes are recorded. Without an engine it answers recorded
    /// requests only.
    pub(crate) fn screening(&self, engine: Option<Box<dyn Screen + 'a>>) -> JournalScreening<'_, 'a> {
        JournalScreening { journal: self, engine }
    }

    /// Returns the result of a question, or the error of this journal that ended it.
    pub(crate) fn result<T, E>(&self, result: Result<T, E>) -> Result<T, MishandleError>
    where
        MishandleError: From<E>,
    {
        match self.error.take() {
            Some(error) => Err(error),
            None => Ok(result?),
        }
    }

    /// Returns the request that is looked for, if it is among these.
    fn sought_in<'r>(&self, requests: &'r [Request]) -> Option<&'r Request> {
        let sought = self.sought?;
        requests.iter().find(|request| (request.trial, request.number) == sought)
    }

    /// Keeps the request that was looked for, and returns the error that ends the question.
    fn find(&self, request: Request) -> RolloutError {
        *self.found.borrow_mut() = Some(request);
        RolloutError::System("the simulation is found".to_string())
    }

    /// Counts the simulations that a question asked, and checks whether its first ones all fail.
    fn answer<'e>(
        &self,
        asked: usize,
        episodes: impl Iterator<Item = &'e Episode>,
    ) -> Result<(), RolloutError> {
        self.asked.set(self.asked.get() + asked as u64);
        if let Some(first) = &self.first {
            let mut first = first.borrow_mut();
            episodes.for_each(|episode| first.add(episode));
            let checked = self.read(|run| first.check(self.resolved, run));
            checked.map_err(|error| self.fail(error))?;
        }
        Ok(())
    }

    /// Returns the request that was looked for; `None` if the question did not ask it.
    pub(crate) fn found(&self) -> Option<Request> {
        self.found.take()
    }

    /// Sets the status of trials that have ended, and closes the file. A trial none of whose
    /// simulations had to be confirmed is recorded without one.
    pub(crate) fn close(
        self,
        ended: impl IntoIterator<Item = (u32, TrialStatus)>,
    ) -> Result<(), MishandleError> {
        let File::Write(run) = self.file else { return Ok(()) };
        let mut run = run.into_inner();
        let mut started = self.started.into_inner();
        for (trial, status) in ended {
            if started.insert(trial) {
                run.start_trial(trial, self.resolved.trial_seed(trial))?;
            }
            if run.file().trial(trial)?.status == TrialStatus::Running {
                run.end_trial(trial, status)?;
            }
        }
        Ok(run.close()?)
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
        if differences.is_empty() { Ok(()) } else { Err(MishandleError::RunMismatch { differences }) }
    }

    /// Returns the number of simulations and chunks that the run file answered, which grows.
    pub(crate) fn answered(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.answered)
    }

    /// Returns whether the question asked something that is not recorded, and this journal
    /// simulates nothing.
    pub(crate) fn is_missing(&self) -> bool {
        self.missing.get()
    }

    /// Returns the error of a question whose answer is not recorded.
    fn not_recorded(&self) -> RolloutError {
        self.missing.set(true);
        RolloutError::System("the run file does not have this simulation".to_string())
    }

    /// Returns the plan of the question.
    pub(crate) fn resolved(&self) -> &'a ResolvedPlan {
        self.resolved
    }

    fn read<T>(&self, with: impl FnOnce(&RunFile) -> T) -> T {
        match &self.file {
            File::Read(run) => with(run),
            File::Write(run) => with(run.borrow().file()),
        }
    }

    /// Keeps an error of this journal and returns one that ends the question.
    fn fail(&self, error: impl Into<MishandleError>) -> RolloutError {
        let error = error.into();
        let text = error.to_string();
        self.error.borrow_mut().get_or_insert(error);
        RolloutError::System(text)
    }

    /// Returns the recorded answer of a request; `None` if it is not recorded.
    fn recorded(&self, request: &Request) -> Result<Option<Episode>, MishandleError> {
        let Some(simulation) = self.read(|run| run.recorded(request.trial, request.number))? else {
            return Ok(None);
        };
        let episode = record::episode(&simulation, self.resolved)?;
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
            Err(MishandleError::SimulationMismatch { number: request.number })
        }
    }

    /// Returns the recorded answer of a steered request, whose scenario has the values that the
    /// proposal chose; `None` if it is not recorded.
    fn recorded_steered(&self, request: &Request) -> Result<Option<SteeredEpisode>, MishandleError> {
        let Some(simulation) = self.read(|run| run.recorded(request.trial, request.number))? else {
            return Ok(None);
        };
        let memory = self.read(|run| run.memory(request.trial, request.number))?;
        let chosen = record::request(&simulation, false).scenario;
        let request = Request { scenario: chosen, ..request.clone() };
        match (self.recorded(&request)?, memory) {
            (Some(episode), Some(memory)) => Ok(Some(SteeredEpisode { episode, memory })),
            _ => Err(MishandleError::SimulationMismatch { number: request.number }),
        }
    }

    /// Records new simulations in one transaction, and returns them as they are read again: without
    /// their traces.
    fn record(&self, episodes: &[Episode]) -> Result<Vec<Episode>, MishandleError> {
        let File::Write(run) = &self.file else { return Ok(Vec::new()) };
        let mut run = run.borrow_mut();
        let rows = self.rows(&mut run, episodes)?;
        run.record(&rows)?;
        self.read_again(rows, episodes)
    }

    /// Records new steered simulations as [`record`](Self::record) does.
    fn record_steered(&self, steered: Vec<SteeredEpisode>) -> Result<Vec<SteeredEpisode>, MishandleError> {
        let File::Write(run) = &self.file else { return Ok(Vec::new()) };
        let mut run = run.borrow_mut();
        let (episodes, memories): (Vec<Episode>, Vec<Vec<f64>>) =
            steered.into_iter().map(|steered| (steered.episode, steered.memory)).unzip();
        let rows = self.rows(&mut run, &episodes)?;
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
    fn rows(&self, run: &mut RunWriter, episodes: &[Episode]) -> Result<Vec<Simulation>, MishandleError> {
        for Request { trial, .. } in episodes.iter().map(|episode| &episode.request) {
            if self.started.borrow_mut().insert(*trial) {
                run.start_trial(*trial, self.resolved.trial_seed(*trial))?;
            }
        }
        let mut traces = self.traces.get();
        let rows = episodes
            .iter()
            .map(|episode| {
                let row = record::record(episode, self.resolved);
                traces += usize::from(row.trace.is_some());
                Simulation { trace: row.trace.filter(|_| traces <= TRACES), ..row }
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
            let read = record::episode(&Simulation { trace: None, ..row }, self.resolved)?;
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
    system: Option<Box<dyn System>>,
    numbering: Option<Numbering>,
}

impl System for JournalSystem<'_> {
    fn space(&self) -> &Space {
        &self.journal.resolved.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let journal = self.journal;
        let requests: Vec<Request> = requests.iter().map(|request| self.numbered(request)).collect();
        if let Some(request) = journal.sought_in(&requests) {
            return Err(journal.find(request.clone()));
        }
        let mut answers = Vec::with_capacity(requests.len());
        for request in &requests {
            answers.push(journal.recorded(request).map_err(|error| journal.fail(error))?);
        }
        let new: Vec<Request> = requests
            .iter()
            .zip(&answers)
            .filter(|(_, answer)| answer.is_none())
            .map(|(request, _)| request.clone())
            .collect();
        let mut simulated = Vec::new().into_iter();
        if !new.is_empty() {
            let Some(system) = &mut self.system else {
                return Err(journal.not_recorded());
            };
            let episodes = system.rollout(&new)?;
            simulated = journal.record(&episodes).map_err(|error| journal.fail(error))?.into_iter();
        }
        // A system that returns too few episodes is reported by the question.
        let episodes: Vec<Episode> =
            answers.into_iter().map_while(|answer| answer.or_else(|| simulated.next())).collect();
        journal.answer(requests.len(), episodes.iter())?;
        Ok(episodes)
    }

    fn steerable(&self) -> Option<Steerable> {
        match &self.system {
            Some(system) => system.steerable(),
            // A run that is only read needs to know it as well.
            None => self.journal.resolved.system().ok()?.steerable(),
        }
    }

    fn rollout_steered(
        &mut self,
        requests: &[Request],
        steering: &dyn Steering,
    ) -> Result<Vec<SteeredEpisode>, RolloutError> {
        let journal = self.journal;
        let requests: Vec<Request> = requests.iter().map(|request| self.numbered(request)).collect();
        if let Some(request) = journal.sought_in(&requests) {
            // What the question asks is completed by what the proposal chose.
            let recorded = journal.recorded_steered(request).map_err(|error| journal.fail(error))?;
            return Err(match recorded {
                Some(SteeredEpisode { episode, .. }) => journal.find(episode.request),
                None => journal.not_recorded(),
            });
        }
        let mut answers = Vec::with_capacity(requests.len());
        for request in &requests {
            answers.push(journal.recorded_steered(request).map_err(|error| journal.fail(error))?);
        }
        let is_new = |(_, answer): &(&Request, &Option<SteeredEpisode>)| answer.is_none();
        let new: Vec<Request> =
            requests.iter().zip(&answers).filter(is_new).map(|(request, _)| request.clone()).collect();
        let mut simulated = Vec::new().into_iter();
        if !new.is_empty() {
            let Some(system) = &mut self.system else {
                return Err(journal.not_recorded());
            };
            let steered = system.rollout_steered(&new, steering)?;
            simulated = journal.record_steered(steered).map_err(|error| journal.fail(error))?.into_iter();
        }
        let steered: Vec<SteeredEpisode> =
            answers.into_iter().map_while(|answer| answer.or_else(|| simulated.next())).collect();
        journal.answer(requests.len(), steered.iter().map(|steered| &steered.episode))?;
        Ok(steered)
    }
}

impl JournalSystem<'_> {
    fn numbered(&mut self, request: &Request) -> Request {
        let Some(Numbering { trial, last }) = &mut self.numbering else { return request.clone() };
        *last += 1;
        Request { trial: *trial, number: *last, ..request.clone() }
    }
}

/// A screening whose outcomes are recorded: see [`Journal::screening`].
pub(crate) struct JournalScreening<'a, 'e> {
    journal: &'a Journal<'a>,
    engine: Option<Box<dyn Screen + 'e>>,
}

impl Screen for JournalScreening<'_, '_> {
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
        let columns = outcomes::columns(journal.resolved.stored_parts);
        let recorded = journal.read(|run| run.screened_chunk(number, columns));
        if let Some(chunk) = recorded.map_err(|error| journal.fail(error))? {
            let outcomes = outcomes::decode(&chunk.outcomes);
            if chunk.requests != digest || outcomes.len() != requests.len() {
                return Err(journal.fail(MishandleError::ScreeningMismatch { number }));
            }
            journal.answered.fetch_add(1, Ordering::Relaxed);
            return Ok(outcomes.into_iter().map(Some).collect());
        }
        let Some(engine) = &mut self.engine else {
            return Err(journal.not_recorded());
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
                outcomes: outcomes::encode(&complete, journal.resolved.stored_parts),
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
        let first = journal.system(numbering()).unwrap().rollout(&asked[..2]).unwrap();
        journal.close([]).unwrap();
        let journal = Journal::new(&resolved, RunWriter::resume(&path).unwrap()).unwrap();
        let all = journal.system(numbering()).unwrap().rollout(&asked).unwrap();
        let rho = |episodes: &[Episode]| episodes.iter().map(Episode::robustness).collect::<Vec<_>>();
        assert_eq!(rho(&first), rho(&all[..2]));
        assert_eq!(rho(&all), rho(&resolved.system().unwrap().rollout(&asked).unwrap()));
        journal.close([(1, TrialStatus::BudgetSpent)]).unwrap();
        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.last_simulation_number(1).unwrap(), 3);
        // The third simulation is what the question asks third.
        let journal = Journal::until(&resolved, &run, (1, 3));
        let mut system = journal.system(numbering()).unwrap();
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
        journal.system(numbering()).unwrap().rollout(&[request(0.1, 1)]).unwrap();
        for other in [request(0.1, 2), request(0.2, 1)] {
            let result = journal.system(numbering()).unwrap().rollout(&[other]);
            let error = journal.result(result).unwrap_err();
            assert!(matches!(error, MishandleError::SimulationMismatch { number: 1 }), "{error}");
        }
    }
}
