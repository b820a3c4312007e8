//! The system of a simulator: batches of simulations on all threads, with a process for each.

use std::sync::Arc;

use crate::process::Failure;
use mishandle_rollout::{
    Controller, Disturbance, EarlyStop, Episode, EpisodeEnd, Interface, Noise, PerThread, Request,
    RolloutError, Scenario, Space, Specification, SpecificationMonitor, System,
};
use mishandle_stl::Trace;
use rayon::prelude::*;

use crate::answer::{Answer, AskedKind, End, kept};
use crate::hello::Mode;
use crate::question::ScenarioWriter;
use crate::simulator::{NoProcess, Simulator};
use crate::steps::ControlledWorker;
use crate::worker::SimulatorProcess;

/// The policy that Mishandle runs in the loop of a simulator, with noise and disturbances.
#[derive(Clone)]
pub(crate) struct Controlled {
    pub controller: Arc<dyn Controller>,
    pub noise: Noise,
    pub disturbances: Vec<Disturbance>,
}

/// A simulator with a space and a specification.
pub(crate) struct ProcessSystem {
    pub(crate) simulator: Arc<Simulator>,
    pub(crate) controlled: Option<Controlled>,
    /// The disturbances between simulator and policy; none without a policy.
    pub(crate) interface: Interface,
    pub(crate) names: Arc<[String]>,
    pub(crate) writer: ScenarioWriter,
    space: Space,
    specification: Specification,
    workers: PerThread<Worker>,
}

/// Buffers of one thread.
struct Worker {
    pub monitor: SpecificationMonitor,
    /// In the mode `step`.
    pub stop: EarlyStop,
    /// In the mode `step`.
    pub controlled: Option<ControlledWorker>,
}

/// A simulation that has ended.
pub(crate) struct Ran {
    pub trace: Trace,
    pub end: EpisodeEnd,
    pub reason: String,
}

impl Ran {
    pub(crate) fn without_trace(system: &ProcessSystem, end: EpisodeEnd, reason: String) -> Ran {
        Ran { trace: Trace::new(system.names.clone()), end, reason }
    }
}

impl ProcessSystem {
    pub(crate) fn new(
        simulator: Arc<Simulator>,
        controlled: Option<Controlled>,
        space: &Space,
        specification: &Specification,
    ) -> Result<ProcessSystem, RolloutError> {
        let description = simulator.description();
        let is_own = |name: &str| description.axes.iter().any(|own| own.name == name);
        let own = space.axes().iter().filter(|axis| is_own(&axis.name)).cloned().collect();
        let own = Space::new(space.name(), own)?;
        let disturbances = controlled.as_ref().map_or(&[][..], |controlled| &controlled.disturbances);
        let actions = controlled.as_ref().map_or(0, |controlled| controlled.controller.action_size());
        let of_controller = controlled.as_ref().map_or(&[][..], |controlled| controlled.controller.signals());
        let signals = description.signals.iter().chain(of_controller);
        let names: Arc<[String]> = signals.map(|signal| signal.name.clone()).collect();
        SpecificationMonitor::new(specification, &names, description.control_dt)?;
        Ok(ProcessSystem {
            interface: Interface::around(&own, space, disturbances, actions)?,
            writer: ScenarioWriter::new(&description.axes, &own),
            names,
            space: space.clone(),
            specification: specification.clone(),
            controlled,
            simulator,
            workers: PerThread::new(),
        })
    }

    fn worker(&self) -> Result<Worker, RolloutError> {
        let control_dt = self.simulator.description().control_dt;
        Ok(Worker {
            monitor: SpecificationMonitor::new(&self.specification, &self.names, control_dt)?,
            stop: EarlyStop::new(&self.specification, &self.names, control_dt, self.samples())?,
            controlled: self.controlled.as_ref().map(ControlledWorker::new),
        })
    }

    /// Returns the number of samples of a whole trace.
    pub(crate) fn samples(&self) -> usize {
        self.simulator.description().steps + 1
    }

    fn simulate(&self, request: &Request, worker: &mut Worker) -> Result<Episode, RolloutError> {
        let Ran { trace, mut end, reason } = self.run(request, worker)?;
        let verdict = worker.monitor.judge(request, &trace, self.samples(), &mut end)?;
        Ok(Episode {
            request: request.clone(),
            steps: trace.len().saturating_sub(1),
            end,
            reason,
            verdict,
            total_reward: 0.0,
            trace,
            trace_digest: None,
        })
    }

    /// Simulates with a process. After a failure the process is replaced, so that no later
    /// simulation reads an answer to this one.
    fn run(&self, request: &Request, worker: &mut Worker) -> Result<Ran, RolloutError> {
        let mut process = match self.simulator.take() {
            Ok(process) => process,
            Err(NoProcess::Ends(error)) => return Err(error),
            Err(NoProcess::Failed(failure)) => return Ok(self.failed(&failure, 0)),
        };
        let scenario = self.interface.environment(&request.scenario);
        let ran = match self.simulator.description().mode {
            Mode::Trace => self.trace(request, &scenario, &mut process).map_err(|failure| (failure, 0)),
            Mode::Step => {
                let Worker { stop, controlled, .. } = worker;
                self.steps(request, &scenario, stop, controlled.as_mut(), &mut process)
            }
        };
        Ok(match ran {
            Ok(ran) => {
                self.simulator.give_back(process);
                ran
            }
            Err((failure, step)) => self.failed(&failure, step),
        })
    }

    /// Returns the end of a simulation whose process failed in a control step.
    fn failed(&self, failure: &Failure, step: usize) -> Ran {
        let end = match failure {
            Failure::TimedOut { .. } => EpisodeEnd::TimedOut { step },
            _ => EpisodeEnd::Crashed { step },
        };
        Ran::without_trace(self, end, kept(&failure.to_string()))
    }

    /// Asks for a whole trace.
    fn trace(
        &self,
        request: &Request,
        scenario: &Scenario,
        process: &mut SimulatorProcess,
    ) -> Result<Ran, Failure> {
        let samples = self.samples();
        let limit = self.simulator.description().time_limit;
        let answer = process.ask(
            "simulate",
            |line| self.writer.write(line, request.seed, scenario),
            &self.names,
            AskedKind::Trace { samples },
            limit,
        )?;
        let Answer { error, end, reason, trace: columns, .. } = answer;
        if let Some(error) = error {
            return Ok(Ran::without_trace(self, EpisodeEnd::Crashed { step: 0 }, error));
        }
        let columns = columns.unwrap_or_default();
        let length = columns.first().map_or(0, Vec::len);
        let mut trace = Trace::with_capacity(self.names.clone(), length);
        let mut sample = vec![0.0; self.names.len()];
        let mut invalid = None;
        for step in 0..length {
            sample.iter_mut().zip(&columns).for_each(|(value, column)| *value = column[step]);
            invalid = sample.iter().position(|value| !value.is_finite()).map(|index| (step, index));
            if invalid.is_some() {
                break;
            }
            trace.push(&sample);
        }
        let end = match (end, invalid) {
            (Some(End::Invalid), _) => EpisodeEnd::InvalidScenario,
            (Some(End::Diverged), _) => EpisodeEnd::Diverged { step: trace.len() },
            (_, Some((step, index))) => EpisodeEnd::InvalidSignal { step, index },
            (Some(End::Terminated), None) => EpisodeEnd::Terminated { step: length.saturating_sub(1) },
            (None, None) => EpisodeEnd::Completed,
        };
        Ok(Ran { trace, end, reason })
    }
}

impl System for ProcessSystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        requests.iter().try_for_each(|request| self.space.check(&request.scenario))?;
        let this = &*self;
        // One by one: a thread that is free takes the next simulation, however long the others are.
        let episodes = requests.par_iter().with_max_len(1).map(|request| {
            this.workers.with(|| this.worker(), |worker| this.simulate(request, worker)).flatten()
        });
        episodes.collect()
    }
}
