//! Many trials of one search against one system, run together.

use std::ops::ControlFlow;
use std::rc::Rc;

use mishandle_rollout::{DEFAULT_BATCH_SIZE, Episode, Request, Seed, Space, System};
use mishandle_search::{Search, SearchError};

use crate::{FalsificationError, FalsificationOutcome, KeepGoing, SearchFactory, Trial, TrialOutcome};

/// Size and seed of a falsification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FalsificationSettings {
    /// Number of trials, at least 1.
    pub trials: u32,
    /// Maximum number of simulations per trial, at least 1.
    pub budget: u32,
    /// Random seed of the falsification.
    pub seed: Seed,
    /// Number of simulations per batch. 0 counts as 1.
    pub batch: usize,
    /// Random seed of every simulation; `None` gives each one a seed of its own.
    pub fixed_seed: Option<Seed>,
    /// Whether simulations end as soon as the search does not need the rest.
    pub early_stopping: bool,
}

impl Default for FalsificationSettings {
    /// Returns the settings of the paper: 30 trials with 300 simulations each.
    fn default() -> Self {
        FalsificationSettings {
            trials: 30,
            budget: 300,
            seed: Seed(0),
            batch: DEFAULT_BATCH_SIZE,
            fixed_seed: None,
            early_stopping: false,
        }
    }
}

impl FalsificationSettings {
    /// Returns the seed of trial `number`, counted from 1.
    pub fn trial_seed(&self, number: u32) -> Seed {
        trial_seed(self.seed, number)
    }

    /// Returns the random seed of a simulation of a trial, both counted from 1.
    pub(crate) fn simulation_seed(&self, trial: u32, number: u32) -> Seed {
        self.fixed_seed.unwrap_or_else(|| self.own_seed(trial, number))
    }

    /// Returns a seed that no other simulation has.
    pub(crate) fn own_seed(&self, trial: u32, number: u32) -> Seed {
        self.trial_seed(trial).child(u64::from(number))
    }
}

/// Returns the seed of trial `number`, counted from 1, of a falsification with the random seed
/// `seed`.
pub fn trial_seed(seed: Seed, number: u32) -> Seed {
    seed.child(u64::from(number) - 1)
}

/// The results of one batch of simulations.
#[derive(Clone, Copy, Debug)]
pub struct FalsificationBatch<'a> {
    /// The episodes of the batch without surplus. The episodes of a trial are in order.
    pub episodes: &'a [Episode],
    /// Outcomes of the trials that ended in this batch.
    pub ended: &'a [TrialOutcome],
}

impl FalsificationBatch<'_> {
    /// Returns the number of unspent simulations of the trials that ended in this batch.
    pub fn unspent(&self, budget: u32) -> u64 {
        self.ended.iter().map(|trial| u64::from(budget - trial.simulations)).sum()
    }
}

/// Trials of one search against one system.
///
/// The trials run in lockstep. A batch contains the next simulation of every running trial. If
/// there are more trials than simulations in a batch, it contains the trials with the lowest
/// numbers. If there are fewer, it contains several simulations of each trial, as far as the search
/// can propose them in advance. Simulations that follow the end of their trial in the same batch,
/// or of its search, are counted as surplus and dropped. So each trial has the same simulations as
/// if it ran alone, for any batch size. Only the order of simulations of different trials depends
/// on the batch size.
///
/// Memory contains the outcome of every trial and the searches of the running trials, but no
/// simulations.
pub struct Falsification<'a> {
    pub(crate) settings: FalsificationSettings,
    space: Space,
    make: Rc<SearchFactory<'a>>,
    pub(crate) keep_going: Option<KeepGoing<'a>>,
    slots: Vec<Slot<'a>>,
    /// All trials before this index have ended.
    first_running: usize,
    surplus: u64,
}

/// A simulation that was requested.
pub(crate) trait Simulated {
    fn request(&self) -> &Request;

    /// Reports the simulation to its trial.
    fn report_to(&self, trial: &mut Trial<'_>) -> Result<(), FalsificationError>;
}

impl Simulated for Episode {
    fn request(&self) -> &Request {
        &self.request
    }

    fn report_to(&self, trial: &mut Trial<'_>) -> Result<(), FalsificationError> {
        trial.tell(self)
    }
}

enum Slot<'a> {
    NotStarted,
    Running(Box<Trial<'a>>),
    Ended(TrialOutcome),
}

impl<'a> Falsification<'a> {
    /// Makes a falsification over `space`. `make` makes the search of a trial from its seed.
    ///
    /// # Errors
    /// [`FalsificationError::Empty`] if the number of trials or the budget is 0.
    pub fn new(
        settings: FalsificationSettings,
        space: &Space,
        make: impl Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a,
    ) -> Result<Falsification<'a>, FalsificationError> {
        for (what, number) in [("trials", settings.trials), ("simulations per trial", settings.budget)] {
            if number == 0 {
                return Err(FalsificationError::Empty { what });
            }
        }
        Ok(Falsification {
            settings,
            space: space.clone(),
            make: Rc::new(make),
            keep_going: None,
            slots: (0..settings.trials).map(|_| Slot::NotStarted).collect(),
            first_running: 0,
            surplus: 0,
        })
    }

    /// Lets trials continue after their first violation: see [`Trial::keep_going`].
    pub fn keep_going(mut self, settings: KeepGoing<'a>) -> Falsification<'a> {
        self.keep_going = Some(settings);
        self
    }

    /// Replays a recorded simulation before the falsification runs. The records of a trial must be
    /// in order; records of different trials may be interleaved.
    ///
    /// The search of the trial proposes the point and observes the result again, without a
    /// simulation. After replaying all records, including those of ended trials, a falsification
    /// gives the same result as an uninterrupted one. With a larger budget, trials that had spent
    /// their budget continue.
    ///
    /// # Errors
    /// - [`FalsificationError::RecordMismatch`] if the point, scenario or seed differs in any bit
    ///   from the request of the trial.
    /// - [`FalsificationError::UnknownTrial`], [`FalsificationError::OutOfOrder`] or
    ///   [`FalsificationError::AfterTrialEnd`] if the record does not belong to this falsification.
    /// - [`FalsificationError::NoTrace`] if the trials [keep going](Self::keep_going) and the
    ///   record of a violation has no trace.
    pub fn replay(&mut self, recorded: &Episode) -> Result<(), FalsificationError> {
        let Request { trial, number, .. } = recorded.request;
        if !(1..=self.settings.trials).contains(&trial) {
            return Err(FalsificationError::UnknownTrial { trial, number, trials: self.settings.trials });
        }
        let index = trial as usize - 1;
        let done = match &self.slots[index] {
            Slot::NotStarted => 0,
            Slot::Running(trial) => trial.outcome().simulations,
            Slot::Ended(outcome) => {
                return Err(FalsificationError::AfterTrialEnd { trial, number, last: outcome.simulations });
            }
        };
        if number != done + 1 {
            return Err(FalsificationError::OutOfOrder { trial, found: number, expected: done + 1 });
        }
        let Some(expected) = self.ask(index, 1)?.pop() else {
            return Err(FalsificationError::AfterTrialEnd { trial, number, last: done });
        };
        if !is_same(&expected, &recorded.request) {
            let describe = |request: &Request| {
                let Request { unit_point, scenario, seed, stop_threshold, .. } = request;
                let stop = stop_threshold.map_or(String::new(), |rho| format!(" and stop threshold {rho:?}"));
                format!("at {unit_point:?}, with scenario {:?}, seed {}{stop}", scenario.values(), seed.0)
            };
            return Err(FalsificationError::RecordMismatch {
                trial,
                number,
                recorded: describe(&recorded.request),
                expected: describe(&expected),
            });
        }
        self.tell(recorded).map(drop)
    }

    /// Runs all trials to their ends against `system`, which must have the falsification's space.
    ///
    /// `on_batch` receives the simulations of each batch before the next batch starts, so that it
    /// can store them in one transaction. If it breaks, the falsification pauses without losing a
    /// simulation, and another call continues it.
    ///
    /// # Errors
    /// If the system, a search or `on_batch` fails, or a complete episode leaves the formula
    /// undecided. After an error the falsification cannot continue; a new falsification can replay
    /// the records.
    pub fn run<E: From<FalsificationError>>(
        &mut self,
        system: &mut dyn System,
        mut on_batch: impl FnMut(&FalsificationBatch<'_>) -> Result<ControlFlow<()>, E>,
    ) -> Result<FalsificationOutcome, E> {
        loop {
            let requests = self.next_batch(self.settings.batch.max(1))?;
            if requests.is_empty() {
                break;
            }
            let episodes = system.rollout(&requests).map_err(FalsificationError::from)?;
            let requested = requests.len();
            let returned = episodes.len();
            if requested != returned {
                return Err(FalsificationError::EpisodeCount { requested, returned }.into());
            }
            let mut ended = Vec::new();
            let episodes = self.receive(episodes, &mut ended)?;
            if on_batch(&FalsificationBatch { episodes: &episodes, ended: &ended })?.is_break() {
                break;
            }
        }
        Ok(self.outcome())
    }

    /// Ends trial `number` if its search has no further simulation. The falsification must not run
    /// afterwards.
    ///
    /// # Errors
    /// If the search fails.
    pub fn settle(&mut self, number: u32) -> Result<(), FalsificationError> {
        let index = (number as usize).wrapping_sub(1);
        if matches!(self.slots.get(index), Some(Slot::Running(_))) {
            self.ask(index, 1)?;
        }
        Ok(())
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> FalsificationOutcome {
        let outcome = |slot: &Slot<'_>| match slot {
            Slot::NotStarted => None,
            Slot::Running(trial) => Some(trial.outcome().clone()),
            Slot::Ended(outcome) => Some(outcome.clone()),
        };
        let trials = self.slots.iter().filter_map(outcome).collect();
        FalsificationOutcome {
            surplus: self.surplus,
            ..FalsificationOutcome::new(trials, self.settings.budget)
        }
    }

    /// Returns the next simulations, ordered by trial, at most `batch_size`. The list is empty if
    /// all trials have ended.
    pub(crate) fn next_batch(&mut self, batch_size: usize) -> Result<Vec<Request>, FalsificationError> {
        let mut batch = Vec::with_capacity(batch_size);
        while batch.is_empty() {
            let running = self.running_slots(batch_size);
            if running.is_empty() {
                break;
            }
            let quotient = batch_size / running.len();
            let remainder = batch_size % running.len();
            for (position, &index) in running.iter().enumerate() {
                batch.extend(self.ask(index, quotient + usize::from(position < remainder))?);
            }
        }
        Ok(batch)
    }

    /// Returns the indices of the first trials that have not ended, at most `n`.
    fn running_slots(&mut self, n: usize) -> Vec<usize> {
        let ended = |slot: &Slot<'_>| matches!(slot, Slot::Ended(_));
        self.first_running += self.slots[self.first_running..].iter().take_while(|slot| ended(slot)).count();
        (self.first_running..self.slots.len()).filter(|&index| !ended(&self.slots[index])).take(n).collect()
    }

    /// Reports the simulations to the searches, drops the surplus, and adds the trials that end to
    /// `ended`.
    pub(crate) fn receive<S: Simulated>(
        &mut self,
        simulations: Vec<S>,
        ended: &mut Vec<TrialOutcome>,
    ) -> Result<Vec<S>, FalsificationError> {
        let mut kept = Vec::with_capacity(simulations.len());
        for simulation in simulations {
            let is_surplus = match &self.slots[simulation.request().trial as usize - 1] {
                Slot::Running(trial) => trial.is_stale(),
                Slot::NotStarted | Slot::Ended(_) => true,
            };
            if is_surplus {
                self.surplus += 1;
                continue;
            }
            ended.extend(self.tell(&simulation)?);
            kept.push(simulation);
        }
        Ok(kept)
    }

    /// Returns the next requests of a trial and starts it if necessary.
    fn ask(&mut self, index: usize, n: usize) -> Result<Vec<Request>, FalsificationError> {
        if matches!(self.slots[index], Slot::NotStarted) {
            self.slots[index] = Slot::Running(Box::new(self.start_trial(index as u32 + 1)?));
        }
        let Slot::Running(trial) = &mut self.slots[index] else {
            return Ok(Vec::new());
        };
        let requests = trial.ask(n)?;
        self.close_if_ended(index);
        Ok(requests)
    }

    fn start_trial(&self, number: u32) -> Result<Trial<'a>, FalsificationError> {
        let trial = Trial::new(number, &self.settings, self.space.clone(), Rc::clone(&self.make))?;
        Ok(match &self.keep_going {
            Some(settings) => trial.keep_going(settings.clone()),
            None => trial,
        })
    }

    /// Reports a simulation to its running trial and returns the outcome of the trial if this
    /// simulation ended it.
    fn tell(&mut self, simulation: &impl Simulated) -> Result<Option<TrialOutcome>, FalsificationError> {
        let index = simulation.request().trial as usize - 1;
        if let Slot::Running(trial) = &mut self.slots[index] {
            simulation.report_to(trial)?;
        }
        Ok(self.close_if_ended(index))
    }

    /// Replaces an ended trial by its outcome and returns the outcome.
    fn close_if_ended(&mut self, index: usize) -> Option<TrialOutcome> {
        let Slot::Running(trial) = &self.slots[index] else {
            return None;
        };
        let outcome = trial.outcome().clone();
        outcome.end?;
        self.slots[index] = Slot::Ended(outcome.clone());
        Some(outcome)
    }
}

/// Returns whether both requests have the same bits.
fn is_same(a: &Request, b: &Request) -> bool {
    let bits = |point: &[f64]| point.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let stop = |request: &Request| request.stop_threshold.map(f64::to_bits);
    a.seed == b.seed
        && stop(a) == stop(b)
        && bits(&a.unit_point) == bits(&b.unit_point)
        && a.scenario.is_same(&b.scenario)
}
