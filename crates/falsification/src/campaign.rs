//! Many trials of one search against one system, advanced together.

use std::ops::ControlFlow;

use mishandle_rollout::{End, Episode, InitialBox, Request, Seed, System};
use mishandle_search::{Search, SearchError};

use crate::trial::robustness_of;
use crate::{Asked, FalsificationError, Outcome, Trial, TrialEnd, TrialOutcome};

/// How large a campaign is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Number of trials, at least 1.
    pub trials: u32,
    /// Simulations a trial may spend, at least 1.
    pub budget: u32,
    /// Seed of the run; trial t, counted from 0, has the seed `seed.child(t)`.
    pub seed: Seed,
}

/// Makes the search of a trial from its seed.
pub type MakeSearch<'a> = dyn Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a;

/// A simulation that a campaign has made. Initial configuration, seed, verdict, end, steps and trace are the episode's.
#[derive(Clone, Copy, Debug)]
pub struct Simulation<'a> {
    /// Number of its trial, from 0.
    pub trial: u32,
    /// Seed of its trial.
    pub trial_seed: Seed,
    /// Its number in the trial, from 1.
    pub number: u32,
    /// The search's point of \[0,1\]^d.
    pub unit_point: &'a [f64],
    /// Robustness of the requirement; `None` if it diverged or is undecided, which the search is told as +∞.
    pub robustness: Option<f64>,
    /// How it went.
    pub episode: &'a Episode,
    /// How the trial ended, if this was its last simulation.
    pub trial_end: Option<TrialEnd>,
}

/// A simulation as it was recorded, to resume a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recorded<'a> {
    /// Number of its trial, from 0.
    pub trial: u32,
    /// Its number in the trial, from 1.
    pub number: u32,
    /// The search's point of \[0,1\]^d.
    pub unit_point: &'a [f64],
    /// Initial configuration.
    pub initial_configuration: &'a [f64],
    /// Key of everything random in it.
    pub seed: Seed,
    /// Robustness of the requirement, `None` if it diverged or was stopped undecided.
    pub robustness: Option<f64>,
    /// How it ended.
    pub end: End,
}

/// Trials of one search against one system.
///
/// They advance in lockstep: a batch of the system holds the next simulation of every open trial, those with the
/// lowest numbers if there are more than rows in a batch, and several of each if there are fewer and the search can say
/// them in advance. What comes after a violation in its trial is thrown away unseen. So each trial makes the very
/// simulations that it would make alone and one by one, whatever the size of the batches; only the order in which
/// simulations of different trials come depends on it.
///
/// Memory holds the outcome of every trial and the searches of those that are open in a batch, no simulations.
pub struct Campaign<'a> {
    settings: Settings,
    initial_box: InitialBox,
    make: Box<MakeSearch<'a>>,
    slots: Vec<Slot>,
    /// All slots before this one have ended.
    first_open: usize,
}

enum Slot {
    Waiting,
    Open(Box<Trial>),
    Ended(TrialOutcome),
}

impl<'a> Campaign<'a> {
    /// A campaign that has not begun, over `initial_box`, with a search from `make` for each trial.
    ///
    /// # Errors
    /// [`FalsificationError::Empty`] without trials or budget.
    pub fn new(
        settings: Settings,
        initial_box: &InitialBox,
        make: impl Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a,
    ) -> Result<Campaign<'a>, FalsificationError> {
        for (what, number) in [("trials", settings.trials), ("simulations a trial", settings.budget)] {
            if number == 0 {
                return Err(FalsificationError::Empty { what });
            }
        }
        Ok(Campaign {
            settings,
            initial_box: initial_box.clone(),
            make: Box::new(make),
            slots: (0..settings.trials).map(|_| Slot::Waiting).collect(),
            first_open: 0,
        })
    }

    /// Takes a recorded simulation as made, before the campaign runs. Those of one trial have to come in order; trials
    /// may take turns in any way.
    ///
    /// The trial's search is asked and told again, which costs no simulation. A campaign into which everything
    /// recorded was fed, of ended trials too, goes on to the records and the outcome of one that was never
    /// interrupted. With a larger budget than before, trials that had spent theirs go on.
    ///
    /// # Errors
    /// [`FalsificationError::OtherBuild`] if point, initial configuration and seed are not, bit for bit, what the trial
    /// asks for; [`FalsificationError::UnknownTrial`], [`FalsificationError::OutOfOrder`] or
    /// [`FalsificationError::PastTheEnd`] if the record cannot be this campaign's.
    pub fn replay(&mut self, recorded: &Recorded<'_>) -> Result<(), FalsificationError> {
        let Recorded { trial, number, .. } = *recorded;
        if trial >= self.settings.trials {
            return Err(FalsificationError::UnknownTrial { trial, number, trials: self.settings.trials });
        }
        let index = trial as usize;
        let done = match &self.slots[index] {
            Slot::Waiting => 0,
            Slot::Open(trial) => trial.outcome().simulations,
            Slot::Ended(outcome) => {
                return Err(FalsificationError::PastTheEnd { trial, number, last: outcome.simulations });
            }
        };
        if number != done + 1 {
            return Err(FalsificationError::OutOfOrder { trial, found: number, wanted: done + 1 });
        }
        let Some(asked) = self.ask(index, 1)?.pop() else {
            return Err(FalsificationError::PastTheEnd { trial, number, last: done });
        };
        let x0 = self.initial_box.at(&asked.unit_point);
        let same = same_bits(&asked.unit_point, recorded.unit_point)
            && same_bits(&x0, recorded.initial_configuration)
            && asked.seed == recorded.seed;
        if !same {
            let describe =
                |u: &[f64], x0: &[f64], seed: Seed| format!("at {u:?}, from {x0:?} with seed {}", seed.0);
            return Err(FalsificationError::OtherBuild {
                trial,
                number,
                recorded: describe(recorded.unit_point, recorded.initial_configuration, recorded.seed),
                asked: describe(&asked.unit_point, &x0, asked.seed),
            });
        }
        self.tell(index, &asked, &x0, recorded.robustness, recorded.end).map(drop)
    }

    /// Runs the trials to their ends against `system`, which has the campaign's box.
    ///
    /// `on_batch` is given the simulations of each batch before the next one starts, so that they can be stored in one
    /// transaction; those of one trial come in order. If it breaks, the campaign pauses there: nothing simulated is
    /// lost, and another call goes on.
    ///
    /// # Errors
    /// What the system, a search or `on_batch` cannot do. The campaign cannot be run on after an error, but a new one
    /// can be resumed from what was recorded.
    pub fn run<E: From<FalsificationError>>(
        &mut self,
        system: &mut dyn System,
        mut on_batch: impl FnMut(&[Simulation<'_>]) -> Result<ControlFlow<()>, E>,
    ) -> Result<Outcome, E> {
        let batch_size = system.batch_size().max(1);
        loop {
            let batch = self.next_batch(batch_size)?;
            if batch.is_empty() {
                break;
            }
            let episodes = self.rollout(system, &batch)?;
            let simulations = self.receive(&batch, &episodes)?;
            if on_batch(&simulations)?.is_break() {
                break;
            }
        }
        Ok(self.outcome())
    }

    /// What was found so far.
    pub fn outcome(&self) -> Outcome {
        let outcome = |slot: &Slot| match slot {
            Slot::Waiting => None,
            Slot::Open(trial) => Some(trial.outcome().clone()),
            Slot::Ended(outcome) => Some(outcome.clone()),
        };
        Outcome::new(self.slots.iter().filter_map(outcome).collect(), self.settings.budget)
    }

    /// The next simulations, trial by trial, at most `batch_size`; none once all trials have ended.
    fn next_batch(&mut self, batch_size: usize) -> Result<Vec<(usize, Asked)>, FalsificationError> {
        let mut batch = Vec::with_capacity(batch_size);
        while batch.is_empty() {
            let open = self.open_slots(batch_size);
            if open.is_empty() {
                break;
            }
            let (share, rest) = (batch_size / open.len(), batch_size % open.len());
            for (place, &index) in open.iter().enumerate() {
                let asked = self.ask(index, share + usize::from(place < rest))?;
                batch.extend(asked.into_iter().map(|asked| (index, asked)));
            }
        }
        Ok(batch)
    }

    /// The first slots that have not ended, at most `n`.
    fn open_slots(&mut self, n: usize) -> Vec<usize> {
        let ended = |slot: &Slot| matches!(slot, Slot::Ended(_));
        self.first_open += self.slots[self.first_open..].iter().take_while(|slot| ended(slot)).count();
        (self.first_open..self.slots.len()).filter(|&index| !ended(&self.slots[index])).take(n).collect()
    }

    fn rollout(
        &self,
        system: &mut dyn System,
        batch: &[(usize, Asked)],
    ) -> Result<Vec<Episode>, FalsificationError> {
        let request =
            |asked: &Asked| Request { x0: self.initial_box.at(&asked.unit_point), seed: asked.seed };
        let requests: Vec<Request> = batch.iter().map(|(_, asked)| request(asked)).collect();
        let episodes = system.rollout(&requests)?;
        if episodes.len() != requests.len() {
            return Err(FalsificationError::Episodes { asked: requests.len(), given: episodes.len() });
        }
        Ok(episodes)
    }

    /// Tells the searches, and leaves out what comes after the end of its trial.
    fn receive<'b>(
        &mut self,
        batch: &'b [(usize, Asked)],
        episodes: &'b [Episode],
    ) -> Result<Vec<Simulation<'b>>, FalsificationError> {
        let mut simulations = Vec::with_capacity(batch.len());
        for ((index, asked), episode) in batch.iter().zip(episodes) {
            if matches!(self.slots[*index], Slot::Ended(_)) {
                continue;
            }
            let robustness = robustness_of(episode);
            simulations.push(Simulation {
                trial: *index as u32,
                trial_seed: self.trial_seed(*index),
                number: asked.number,
                unit_point: &asked.unit_point,
                robustness,
                episode,
                trial_end: self.tell(*index, asked, &episode.x0, robustness, episode.end)?,
            });
        }
        Ok(simulations)
    }

    fn trial_seed(&self, index: usize) -> Seed {
        self.settings.seed.child(index as u64)
    }

    /// Asks a trial, which begins if it has not yet.
    fn ask(&mut self, index: usize, n: usize) -> Result<Vec<Asked>, FalsificationError> {
        if matches!(self.slots[index], Slot::Waiting) {
            self.slots[index] = Slot::Open(Box::new(self.begin(index)?));
        }
        let Slot::Open(trial) = &mut self.slots[index] else {
            return Ok(Vec::new());
        };
        let asked = trial.ask(n)?;
        self.close_if_ended(index);
        Ok(asked)
    }

    fn begin(&self, index: usize) -> Result<Trial, FalsificationError> {
        let seed = self.trial_seed(index);
        let search = (self.make)(Trial::search_seed(seed))?;
        let (found, wanted) = (search.dimension(), self.initial_box.dimension());
        if found != wanted {
            return Err(FalsificationError::Dimension { search: search.name(), found, wanted });
        }
        Ok(Trial::new(index as u32, seed, self.settings.budget, search))
    }

    /// Tells an open trial and says how that ended it, if it did.
    fn tell(
        &mut self,
        index: usize,
        asked: &Asked,
        x0: &[f64],
        robustness: Option<f64>,
        end: End,
    ) -> Result<Option<TrialEnd>, FalsificationError> {
        if let Slot::Open(trial) = &mut self.slots[index] {
            trial.tell(asked, x0, robustness, end)?;
        }
        Ok(self.close_if_ended(index))
    }

    /// Keeps of an ended trial its outcome only.
    fn close_if_ended(&mut self, index: usize) -> Option<TrialEnd> {
        let Slot::Open(trial) = &self.slots[index] else {
            return None;
        };
        let outcome = trial.outcome();
        let end = outcome.end;
        if end.is_some() {
            self.slots[index] = Slot::Ended(outcome.clone());
        }
        end
    }
}

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
