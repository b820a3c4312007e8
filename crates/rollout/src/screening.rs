//! Episodes that another physics engine simulates, many at a time. They propose; they are not
//! evidence.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use mishandle_stl::{Trace, is_violated};

use crate::lane::{Lane, LaneRows, Progress, ROWS};
use crate::{
    EpisodeEnd, PerThread, Request, Rollout, RolloutError, Sample, Scenario, Seed, StepStatus, Verdict,
};

/// Number of rows of a group of a [`ScenarioBatch`].
pub const GROUP_ROWS: usize = ROWS;

/// An environment whose rows start at given scenarios and are stepped together.
///
/// A control step is a [visit](Self::visit) of all rows, which reads their samples and sets their
/// actions, and then the physics, which may run on another device between
/// [`start_step`](Self::start_step) and [`finish_step`](Self::finish_step).
pub trait ScenarioBatch: Send {
    /// Returns the number of rows.
    fn rows(&self) -> usize;

    /// Calls `visit` once for each group of [`GROUP_ROWS`] adjacent rows, with the index of the
    /// group, on all threads of the current rayon pool. The last group may be smaller.
    fn visit(&mut self, visit: &(dyn Fn(usize, &mut dyn ScenarioRows) + Sync));

    /// Begins the physics of one control step of all rows.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn start_step(&mut self) -> Result<(), RolloutError>;

    /// Waits for the end of the physics.
    ///
    /// # Errors
    /// If the batch fails as a whole. The failure of one row is its status.
    fn finish_step(&mut self) -> Result<(), RolloutError>;
}

/// A group of adjacent rows of a [`ScenarioBatch`] that one thread handles. Its rows count from 0.
pub trait ScenarioRows {
    /// Starts an episode in a row, writes its first sample, and returns its status.
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, sample: Sample<'_>) -> StepStatus;

    /// Writes the sample of a row after a control step, without rewards, and returns its status. If
    /// the engine has not simulated the step, the sample is meaningless.
    fn sample(&mut self, row: usize, observation: &mut [f32], signals: &mut [f64]) -> BatchStatus;

    /// Sets the action of a row in the next control step. It is not clipped. While an action is
    /// delayed, none has arrived before the first one: see
    /// [`step_before_actions`](crate::EnvironmentWorker::step_before_actions).
    fn command(&mut self, row: usize, action: &[f64], has_arrived: bool);
}

/// Status of a row after a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchStatus {
    /// The engine simulated the step.
    Step(StepStatus),
    /// The engine had too little memory for all contacts or constraints of the row.
    Overflow,
}

/// The outcome of one simulation by another physics engine.
///
/// It has no trace and is not an [`Episode`](crate::Episode), so it can enter neither a run file
/// nor a verdict. The same request, simulated by the target's system, gives the episode that
/// counts.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedEpisode {
    /// How the simulation ended. An overflow counts as crashed.
    pub end: EpisodeEnd,
    /// Values of the formulas; undecided if the end yields no verdict.
    pub verdict: Verdict,
    /// Whether the engine had too little memory for the row.
    pub has_overflowed: bool,
}

impl ScreenedEpisode {
    /// Returns whether the simulation violates the requirement.
    pub fn is_violated(&self) -> bool {
        self.robustness().is_some_and(is_violated)
    }

    /// Returns the robustness of the requirement; `None` if the simulation has no verdict.
    pub fn robustness(&self) -> Option<f64> {
        self.end.has_verdict().then_some(self.verdict.robustness).flatten()
    }
}

/// Simulates requests in another physics engine than that of the target. [`Screening`] computes
/// them; a run file that is continued answers those that it has recorded.
pub trait Screen {
    /// Simulates all requests and returns their outcomes in the same order.
    ///
    /// `watch` gets the number of finished simulations now and then. If it returns `false`, the
    /// screening ends, and the outcomes of unfinished simulations are `None`.
    ///
    /// # Errors
    /// If a scenario does not belong to the space, or the engine fails as a whole.
    fn run(
        &mut self,
        requests: &[Request],
        watch: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Option<ScreenedEpisode>>, RolloutError>;
}

/// Runs simulations of a controller on batches of another physics engine. While the engine steps
/// one batch, the CPU computes the samples and actions of another one.
pub struct Screening {
    rollout: Rollout,
    flights: Vec<Flight>,
    threads: PerThread<Thread>,
}

impl Screening {
    /// Makes a screening from the system that the engine replaces, and the batches of its
    /// environment.
    pub fn new(rollout: Rollout, batches: Vec<Box<dyn ScenarioBatch>>) -> Screening {
        let flights = batches.into_iter().map(|batch| Flight::new(&rollout, batch)).collect();
        Screening { rollout, flights, threads: PerThread::new() }
    }
}

impl Screen for Screening {
    /// A free row takes the next request at once.
    fn run(
        &mut self,
        requests: &[Request],
        watch: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Option<ScreenedEpisode>>, RolloutError> {
        let Screening { rollout, flights, threads } = self;
        if rollout.eyes.is_some() {
            let what = "the controller sees images, which only simulations on the CPU render";
            return Err(RolloutError::Engine(what.to_string()));
        }
        for request in requests {
            rollout.space.check(&request.scenario)?;
        }
        // With few requests, each batch gets its share, so that one is visited while the other one
        // steps.
        let rows: usize = flights.iter().map(|flight| flight.batch.rows()).sum();
        let share =
            if requests.len() < rows { requests.len().div_ceil(flights.len()) } else { requests.len() };
        flights.iter_mut().for_each(|flight| flight.begin(share));
        let shared = Shared { rollout, requests, next: AtomicUsize::new(0), threads };
        let mut outcomes = vec![None; requests.len()];
        // Inside the pool, because each visit from outside would wait until a thread of the pool
        // wakes up.
        rayon::scope(|_| {
            let result = fly(&shared, flights, &mut outcomes, watch);
            // No batch steps when the next run begins.
            flights.iter_mut().map(Flight::wait).fold(result, Result::and)
        })?;
        Ok(outcomes)
    }
}

/// Runs the batches in turn until no request is left or `watch` returns `false`.
fn fly(
    shared: &Shared<'_>,
    flights: &mut [Flight],
    outcomes: &mut [Option<ScreenedEpisode>],
    watch: &(dyn Fn(usize) -> bool + Sync),
) -> Result<(), RolloutError> {
    let mut done = 0;
    while flights.iter().any(|flight| !flight.is_idle) {
        for flight in flights.iter_mut().filter(|flight| !flight.is_idle) {
            let finished = flight.advance(shared, outcomes)?;
            done += finished;
            if !watch(done) {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// State that all threads of a screening share.
struct Shared<'a> {
    rollout: &'a Rollout,
    requests: &'a [Request],
    /// Index of the next request.
    next: AtomicUsize,
    threads: &'a PerThread<Thread>,
}

impl Shared<'_> {
    /// Returns the index of a request that no row has taken yet, if the batch may take another one.
    fn take(&self, taken: &AtomicUsize, share: usize) -> Option<usize> {
        if taken.fetch_add(1, Ordering::Relaxed) >= share {
            return None;
        }
        let index = self.next.fetch_add(1, Ordering::Relaxed);
        (index < self.requests.len()).then_some(index)
    }
}

/// Buffers and workers of one thread.
struct Thread {
    lane: Lane,
    /// Trace of the episode that is evaluated.
    trace: Trace,
}

impl Thread {
    fn new(rollout: &Rollout) -> Result<Thread, RolloutError> {
        let signals = rollout.signals.clone();
        let samples = rollout.environment.episode_steps() + 1;
        Ok(Thread { lane: Lane::new(rollout)?, trace: Trace::with_capacity(signals, samples) })
    }
}

/// A batch and the simulations in its rows.
struct Flight {
    batch: Box<dyn ScenarioBatch>,
    groups: Vec<Mutex<Group>>,
    /// Number of requests that the batch has tried to take, and the number that it may take.
    taken: AtomicUsize,
    share: usize,
    /// Whether the engine is taking a control step.
    is_stepping: bool,
    /// Whether no row has a simulation, and no request is left.
    is_idle: bool,
}

impl Flight {
    fn new(rollout: &Rollout, batch: Box<dyn ScenarioBatch>) -> Flight {
        let rows = batch.rows();
        let groups = (0..rows)
            .step_by(ROWS)
            .map(|first| Mutex::new(Group::new(rollout, ROWS.min(rows - first))))
            .collect();
        Flight { batch, groups, taken: AtomicUsize::new(0), share: 0, is_stepping: false, is_idle: true }
    }

    /// Prepares the next run, which may take `share` requests. Drops what an interrupted run has
    /// left.
    fn begin(&mut self, share: usize) {
        (self.taken, self.share, self.is_idle) = (AtomicUsize::new(0), share, false);
        for group in &mut self.groups {
            group.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
        }
    }

    /// Waits for the physics of the present control step.
    fn wait(&mut self) -> Result<(), RolloutError> {
        if std::mem::take(&mut self.is_stepping) { self.batch.finish_step() } else { Ok(()) }
    }

    /// Ends the present control step, begins the next one, and moves the outcomes of the
    /// simulations that have ended to their places. Returns their number.
    fn advance(
        &mut self,
        shared: &Shared<'_>,
        outcomes: &mut [Option<ScreenedEpisode>],
    ) -> Result<usize, RolloutError> {
        self.wait()?;
        let groups = &self.groups;
        let failure = Mutex::new(None);
        let take = || shared.take(&self.taken, self.share);
        let [is_running, has_finished] = [AtomicBool::new(false), AtomicBool::new(false)];
        self.batch.visit(&|index, rows| {
            let group = &mut *lock(&groups[index]);
            let make = || Thread::new(shared.rollout);
            if let Err(error) =
                shared.threads.with(make, |thread| group.visit(shared, &take, thread, rows)).flatten()
            {
                lock(&failure).get_or_insert(error);
            }
            set_if(&is_running, group.has_simulations());
            set_if(&has_finished, !group.finished.is_empty());
        });
        if let Some(error) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        self.is_idle = !is_running.into_inner();
        if !self.is_idle {
            self.batch.start_step()?;
            self.is_stepping = true;
        }
        Ok(if has_finished.into_inner() { self.collect(outcomes) } else { 0 })
    }

    /// Moves the new outcomes of all rows to their places and returns their number.
    fn collect(&mut self, outcomes: &mut [Option<ScreenedEpisode>]) -> usize {
        let mut finished = 0;
        for group in &mut self.groups {
            let group = group.get_mut().unwrap_or_else(PoisonError::into_inner);
            finished += group.finished.len();
            for (index, outcome) in group.finished.drain(..) {
                outcomes[index] = Some(outcome);
            }
        }
        finished
    }
}

impl Drop for Flight {
    /// Waits, so that no buffer is freed while the engine uses it, also after a panic.
    fn drop(&mut self) {
        let _ = self.wait();
    }
}

/// Sets a flag without writing to it twice, which would take it from the caches of the other
/// threads.
fn set_if(flag: &AtomicBool, condition: bool) {
    if condition && !flag.load(Ordering::Relaxed) {
        flag.store(true, Ordering::Relaxed);
    }
}

/// Locks, also after a panic, which ends the screening.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The simulations of up to 16 adjacent rows of a batch.
struct Group {
    rows: LaneRows,
    /// Simulation in each row; `None` if the row is idle.
    simulations: Vec<Option<Simulation>>,
    progress: Vec<Progress>,
    history: History,
    finished: Vec<(usize, ScreenedEpisode)>,
}

/// A simulation in a row.
#[derive(Clone, Copy)]
struct Simulation {
    /// Index of its request.
    index: usize,
    /// Visit in which it started.
    start: usize,
    has_overflowed: bool,
}

impl Group {
    fn new(rollout: &Rollout, rows: usize) -> Group {
        let signals = rollout.signals.len();
        let samples = rollout.environment.episode_steps() + 1;
        Group {
            rows: LaneRows::new(rollout),
            simulations: vec![None; rows],
            progress: vec![Progress::IDLE; rows],
            history: History::new(rows, signals, samples),
            finished: Vec::with_capacity(rows),
        }
    }

    /// Makes all rows idle.
    fn clear(&mut self) {
        self.simulations.fill(None);
        self.progress.fill(Progress::IDLE);
        self.finished.clear();
    }

    fn has_simulations(&self) -> bool {
        self.simulations.iter().any(Option::is_some)
    }

    /// Records the samples after a control step, replaces the simulations that have ended by new
    /// ones, and sets the next actions.
    fn visit(
        &mut self,
        shared: &Shared<'_>,
        take: &dyn Fn() -> Option<usize>,
        thread: &mut Thread,
        environment: &mut dyn ScenarioRows,
    ) -> Result<(), RolloutError> {
        for row in 0..self.simulations.len() {
            self.record(shared, thread, environment, row);
            self.finish(shared, thread, row)?;
            if self.simulations[row].is_none()
                && let Some(index) = take()
            {
                self.start(shared, index, thread, environment, row);
            }
        }
        self.act(shared.rollout, &mut thread.lane, environment);
        self.history.visit += 1;
        Ok(())
    }

    /// Starts a request in an idle row.
    fn start(
        &mut self,
        shared: &Shared<'_>,
        index: usize,
        thread: &mut Thread,
        environment: &mut dyn ScenarioRows,
        row: usize,
    ) {
        let request = &shared.requests[index];
        let rollout = shared.rollout;
        let lane = &mut thread.lane;
        let scenario = rollout.environment_scenario(request);
        let status = environment.start(row, &scenario, request.seed, lane.sample(row));
        lane.start(rollout, &mut self.rows, row, request);
        lane.complete_sample(rollout, &mut self.rows, row);
        self.simulations[row] = Some(Simulation { index, start: self.history.visit, has_overflowed: false });
        self.progress[row] = Progress::start(request);
        match lane.end_of_start(status) {
            Some(end) => self.progress[row].end = end,
            None => {
                self.history.write(row, &lane.signals);
                lane.record(&mut self.rows, row, request);
            }
        }
    }

    /// Adds a control step to the simulation in a row.
    fn record(
        &mut self,
        shared: &Shared<'_>,
        thread: &mut Thread,
        environment: &mut dyn ScenarioRows,
        row: usize,
    ) {
        let (Some(simulation), progress) = (&mut self.simulations[row], &mut self.progress[row]) else {
            return;
        };
        if !progress.is_running() {
            return;
        }
        let step = progress.steps + 1;
        let lane = &mut thread.lane;
        let Sample { observation, signals, .. } = lane.sample(row);
        let status = match environment.sample(row, observation, signals) {
            BatchStatus::Step(status) => status,
            BatchStatus::Overflow => {
                simulation.has_overflowed = true;
                progress.end = EpisodeEnd::Crashed { step };
                return;
            }
        };
        lane.complete_sample(shared.rollout, &mut self.rows, row);
        if let Some(end) = lane.end_of_step(status, step) {
            progress.end = end;
            return;
        }
        progress.steps = step;
        self.history.write(row, &lane.signals);
        let request = &shared.requests[simulation.index];
        lane.record(&mut self.rows, row, request);
        if self.rows.can_stop(row, request, step) {
            progress.end = EpisodeEnd::Stopped { step };
        }
    }

    /// Evaluates the simulation in a row, if it has ended, and makes the row idle.
    fn finish(&mut self, shared: &Shared<'_>, thread: &mut Thread, row: usize) -> Result<(), RolloutError> {
        let Some(simulation) = self.simulations[row] else { return Ok(()) };
        let steps = self.progress[row].steps;
        let mut end = self.progress[row].end;
        let is_complete = steps == shared.rollout.environment.episode_steps();
        if self.progress[row].is_running() && !is_complete {
            return Ok(());
        }
        self.simulations[row] = None;
        self.progress[row] = Progress::IDLE;
        if end.has_verdict() {
            self.history.read(row, simulation.start, steps + 1, &mut thread.trace);
        }
        let request = &shared.requests[simulation.index];
        let verdict = thread.lane.finish(shared.rollout, request, &thread.trace, &mut end)?;
        let outcome = ScreenedEpisode { end, verdict, has_overflowed: simulation.has_overflowed };
        self.finished.push((simulation.index, outcome));
        Ok(())
    }

    /// Sets the actions of the next control step.
    fn act(&mut self, rollout: &Rollout, lane: &mut Lane, environment: &mut dyn ScenarioRows) {
        if !self.has_simulations() {
            return;
        }
        lane.act(rollout, &mut self.rows, &mut self.progress);
        for (row, progress) in self.progress.iter().enumerate() {
            if progress.is_running() {
                let has_arrived = lane.action(rollout, &mut self.rows, row, progress);
                environment.command(row, &lane.action, has_arrived);
            }
        }
    }
}

/// Signals of all rows of a group in the last visits. A visit writes one block of memory, whatever
/// the number of signals: a [`Trace`] for each row would touch a page of memory for each row and
/// signal.
struct History {
    /// `[visits, rows, signals]`, in a ring.
    samples: Vec<f64>,
    signals: usize,
    block: usize,
    /// Number of the present visit.
    visit: usize,
}

impl History {
    fn new(rows: usize, signals: usize, visits: usize) -> History {
        let block = rows * signals;
        History { samples: vec![0.0; visits * block], signals, block, visit: 0 }
    }

    /// Returns the place of the first signal of a row in a visit.
    fn place(&self, row: usize, visit: usize) -> usize {
        (visit * self.block) % self.samples.len().max(1) + row * self.signals
    }

    /// Writes the signals of a row in the present visit.
    fn write(&mut self, row: usize, signals: &[f64]) {
        let place = self.place(row, self.visit);
        self.samples[place..][..self.signals].copy_from_slice(signals);
    }

    /// Replaces the samples of `trace` by those of a row in `count` visits from `first` on.
    fn read(&self, row: usize, first: usize, count: usize, trace: &mut Trace) {
        trace.clear();
        for visit in first..first + count {
            trace.push(&self.samples[self.place(row, visit)..][..self.signals]);
        }
    }
}
