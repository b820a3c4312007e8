//! Many trials of one search against one system, advanced together.

use std::ops::ControlFlow;

use mishandle_rollout::{DEFAULT_BATCH_SIZE, Episode, Request, Seed, Space, System};
use mishandle_search::{Search, SearchError};

use crate::{CampaignOutcome, FalsificationError, Trial, TrialEnd, TrialOutcome};

/// How large a campaign is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CampaignSettings {
    /// Number of trials, at least 1.
    pub trials: u32,
    /// Simulations a trial may spend, at least 1.
    pub budget: u32,
    /// Seed of the run.
    pub seed: Seed,
    /// Simulations that are asked for at once, at least 1.
    pub batch: usize,
}

impl Default for CampaignSettings {
    /// The paper's 30 trials of 300 simulations.
    fn default() -> Self {
        CampaignSettings { trials: 30, budget: 300, seed: Seed(0), batch: DEFAULT_BATCH_SIZE }
    }
}

impl CampaignSettings {
    /// The seed of trial `number`, counted from 1.
    pub fn trial_seed(&self, number: u32) -> Seed {
        self.seed.child(u64::from(number) - 1)
    }
}

/// Makes the search of a trial from its seed.
pub type SearchFactory<'a> = dyn Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a;

/// What one batch of simulations gave.
#[derive(Clone, Copy, Debug)]
pub struct CampaignBatch<'a> {
    /// The episodes that belong to their trials; those of one trial are in order.
    pub episodes: &'a [Episode],
    /// The trials that ended with this batch, and how.
    pub ended: &'a [(u32, TrialEnd)],
}

impl CampaignBatch<'_> {
    /// Simulations of the budgets of the trials that ended with this batch that they did not spend.
    pub fn unspent(&self, budget: u32) -> u64 {
        let last = |trial: &u32| {
            let own = self.episodes.iter().map(|episode| &episode.request).filter(|own| own.trial == *trial);
            own.map(|request| request.number).max().unwrap_or(budget)
        };
        self.ended.iter().map(|(trial, _)| u64::from(budget - last(trial))).sum()
    }
}

/// Trials of one search against one system.
///
/// They advance in lockstep: a batch holds the next simulation of every open trial, those with the lowest numbers if
/// there are more than rows in a batch, and several of each if there are fewer and the search can say them in advance.
/// Simulations of a batch that come after a violation in their trial are no part of it: they are counted as surplus and
/// dropped. So each trial makes the same simulations that it would make alone and one by one, whatever the size of the
/// batches; only the order in which simulations of different trials come depends on it.
///
/// Memory holds the outcome of every trial and the searches of those that are open in a batch, no simulations.
pub struct Campaign<'a> {
    settings: CampaignSettings,
    space: Space,
    make: Box<SearchFactory<'a>>,
    slots: Vec<Slot>,
    /// All slots before this one have ended.
    first_open: usize,
    surplus: u64,
}

enum Slot {
    Waiting,
    Open(Box<Trial>),
    Ended(TrialOutcome),
}

impl<'a> Campaign<'a> {
    /// A campaign before its first simulation, over `space`, with a search from `make` for each trial.
    ///
    /// # Errors
    /// [`FalsificationError::Empty`] without trials or budget.
    pub fn new(
        settings: CampaignSettings,
        space: &Space,
        make: impl Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a,
    ) -> Result<Campaign<'a>, FalsificationError> {
        for (what, number) in [("trials", settings.trials), ("simulations a trial", settings.budget)] {
            if number == 0 {
                return Err(FalsificationError::Empty { what });
            }
        }
        Ok(Campaign {
            settings,
            space: space.clone(),
            make: Box::new(make),
            slots: (0..settings.trials).map(|_| Slot::Waiting).collect(),
            first_open: 0,
            surplus: 0,
        })
    }

    /// Takes a recorded simulation as made, before the campaign runs. Those of one trial have to come in order; trials
    /// may take turns in any way.
    ///
    /// The trial's search is asked and told again, which costs no simulation. After replaying all records, those of ended
    /// trials too, a campaign gives the same records and the same outcome as an uninterrupted one. With a larger budget
    /// than before, trials that had spent theirs go on.
    ///
    /// # Errors
    /// [`FalsificationError::OtherBuild`] if point, scenario and seed are not, bit for bit, what the trial asks for;
    /// [`FalsificationError::UnknownTrial`], [`FalsificationError::OutOfOrder`] or [`FalsificationError::PastTheEnd`] if
    /// the record cannot be this campaign's.
    pub fn replay(&mut self, recorded: &Episode) -> Result<(), FalsificationError> {
        let Request { trial, number, .. } = recorded.request;
        if !(1..=self.settings.trials).contains(&trial) {
            return Err(FalsificationError::UnknownTrial { trial, number, trials: self.settings.trials });
        }
        let index = trial as usize - 1;
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
        if !is_same(&asked, &recorded.request) {
            let describe = |request: &Request| {
                let Request { unit_point, scenario, seed, .. } = request;
                format!("at {unit_point:?}, with scenario {:?} and seed {}", scenario.values(), seed.0)
            };
            return Err(FalsificationError::OtherBuild {
                trial,
                number,
                recorded: describe(&recorded.request),
                asked: describe(&asked),
            });
        }
        self.tell(recorded).map(drop)
    }

    /// Runs the trials to their ends against `system`, which has the campaign's space.
    ///
    /// `on_batch` is given the simulations of each batch before the next one starts, so that they can be stored in one
    /// transaction. If it breaks, the campaign pauses there: nothing simulated is lost, and another call goes on.
    ///
    /// # Errors
    /// What the system, a search or `on_batch` cannot do. The campaign cannot be run on after an error, but a new one
    /// can be resumed from what was recorded.
    pub fn run<E: From<FalsificationError>>(
        &mut self,
        system: &mut dyn System,
        mut on_batch: impl FnMut(&CampaignBatch<'_>) -> Result<ControlFlow<()>, E>,
    ) -> Result<CampaignOutcome, E> {
        loop {
            let requests = self.next_batch(self.settings.batch.max(1))?;
            if requests.is_empty() {
                break;
            }
            let episodes = system.rollout(&requests).map_err(FalsificationError::from)?;
            let (asked, given) = (requests.len(), episodes.len());
            if asked != given {
                return Err(FalsificationError::Episodes { asked, given }.into());
            }
            let mut ended = Vec::new();
            let episodes = self.receive(episodes, &mut ended)?;
            if on_batch(&CampaignBatch { episodes: &episodes, ended: &ended })?.is_break() {
                break;
            }
        }
        Ok(self.outcome())
    }

    /// What was found so far.
    pub fn outcome(&self) -> CampaignOutcome {
        let outcome = |slot: &Slot| match slot {
            Slot::Waiting => None,
            Slot::Open(trial) => Some(trial.outcome().clone()),
            Slot::Ended(outcome) => Some(outcome.clone()),
        };
        let trials = self.slots.iter().filter_map(outcome).collect();
        CampaignOutcome { surplus: self.surplus, ..CampaignOutcome::new(trials, self.settings.budget) }
    }

    /// The next simulations, trial by trial, at most `batch_size`; none once all trials have ended.
    fn next_batch(&mut self, batch_size: usize) -> Result<Vec<Request>, FalsificationError> {
        let mut batch = Vec::with_capacity(batch_size);
        while batch.is_empty() {
            let open = self.open_slots(batch_size);
            if open.is_empty() {
                break;
            }
            let (share, rest) = (batch_size / open.len(), batch_size % open.len());
            for (place, &index) in open.iter().enumerate() {
                batch.extend(self.ask(index, share + usize::from(place < rest))?);
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

    /// Tells the searches, drops what comes after the end of its trial, and adds the trials that end to `ended`.
    fn receive(
        &mut self,
        episodes: Vec<Episode>,
        ended: &mut Vec<(u32, TrialEnd)>,
    ) -> Result<Vec<Episode>, FalsificationError> {
        let mut kept = Vec::with_capacity(episodes.len());
        for episode in episodes {
            let trial = episode.request.trial;
            if matches!(self.slots[trial as usize - 1], Slot::Ended(_)) {
                self.surplus += 1;
                continue;
            }
            ended.extend(self.tell(&episode)?.map(|end| (trial, end)));
            kept.push(episode);
        }
        Ok(kept)
    }

    /// Asks a trial, which begins if it has not yet.
    fn ask(&mut self, index: usize, n: usize) -> Result<Vec<Request>, FalsificationError> {
        if matches!(self.slots[index], Slot::Waiting) {
            self.slots[index] = Slot::Open(Box::new(self.begin(index as u32 + 1)?));
        }
        let Slot::Open(trial) = &mut self.slots[index] else {
            return Ok(Vec::new());
        };
        let asked = trial.ask(n)?;
        self.close_if_ended(index);
        Ok(asked)
    }

    fn begin(&self, number: u32) -> Result<Trial, FalsificationError> {
        let seed = self.settings.trial_seed(number);
        let search = (self.make)(Trial::search_seed(seed))?;
        let (found, wanted) = (search.dimension(), self.space.dimension());
        if found != wanted {
            return Err(FalsificationError::Dimension { search: search.name(), found, wanted });
        }
        Ok(Trial::new(number, seed, self.settings.budget, search, self.space.clone()))
    }

    /// Tells an open trial and says how that ended it, if it did.
    fn tell(&mut self, episode: &Episode) -> Result<Option<TrialEnd>, FalsificationError> {
        let index = episode.request.trial as usize - 1;
        if let Slot::Open(trial) = &mut self.slots[index] {
            trial.tell(episode)?;
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

/// Whether both ask for the same simulation, to the bit.
fn is_same(a: &Request, b: &Request) -> bool {
    let bits = |point: &[f64]| point.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    a.seed == b.seed && bits(&a.unit_point) == bits(&b.unit_point) && a.scenario.is_same(&b.scenario)
}
