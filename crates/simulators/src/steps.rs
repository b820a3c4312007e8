//! Simulations that Mishandle steps, with a policy, noise and disturbances between its answers.

use crate::process::Failure;
use mishandle_rollout::{ActiveInterface, ControllerWorker, EarlyStop, EpisodeEnd, Request, Scenario};
use mishandle_stl::Trace;

use crate::answer::{Answer, AskedKind, End};
use crate::question::write_numbers;
use crate::system::{Controlled, ProcessSystem, Ran};
use crate::worker::SimulatorProcess;

/// The policy of one thread, with the buffers of a control step.
pub(crate) struct ControlledWorker {
    controller: Box<dyn ControllerWorker>,
    state: Vec<f64>,
    /// Signals of the controller.
    signals: Vec<f64>,
    observation: Vec<f32>,
    output: Vec<f32>,
    action: Vec<f64>,
    draws: Vec<f64>,
    /// Output and state after the last control step in which no fault paused the policy.
    held: Option<(Vec<f32>, Vec<f64>)>,
}

impl ControlledWorker {
    pub(crate) fn new(controlled: &Controlled) -> ControlledWorker {
        let controller = &controlled.controller;
        let observations = controller.observation_size();
        let actions = controller.action_size();
        ControlledWorker {
            controller: controller.worker(),
            state: vec![0.0; controller.state_size()],
            signals: vec![0.0; controller.signals().len()],
            observation: vec![0.0; observations],
            output: vec![0.0; actions],
            action: vec![0.0; actions],
            draws: vec![0.0; observations.max(actions)],
            held: None,
        }
    }

    fn start(&mut self, request: &Request, active: Option<&ActiveInterface>) {
        self.controller.reset(&mut self.state, request.seed);
        let can_pause = active.is_some_and(ActiveInterface::has_pause);
        self.held = can_pause.then(|| (vec![0.0; self.output.len()], self.state.clone()));
    }

    /// Shows the controller the signals of a sample, and adds its own to them.
    fn complete_sample(&mut self, signals: &mut Vec<f64>) {
        if self.signals.is_empty() {
            return;
        }
        self.controller.signals(&self.state, &mut self.signals);
        self.controller.see_signals(&mut self.state, signals);
        signals.extend_from_slice(&self.signals);
    }

    /// Computes the action of a control step from the observation before it. Returns how an invalid
    /// observation or action, or a policy that failed, ends the simulation.
    fn act(
        &mut self,
        controlled: &Controlled,
        action_limit: f64,
        mut active: Option<&mut ActiveInterface>,
        request: &Request,
        step: usize,
        observation: &[f64],
    ) -> Result<(), (EpisodeEnd, String)> {
        self.observation.iter_mut().zip(observation).for_each(|(to, from)| *to = *from as f32);
        if let Some(index) = self.observation.iter().position(|number| !number.is_finite()) {
            return Err((EpisodeEnd::InvalidObservation { step, index }, String::new()));
        }
        let draws = &mut self.draws[..observation.len()];
        controlled.noise.on_observation(request.seed, step as u64, &mut self.observation, draws);
        if let Some(active) = &mut active {
            active.observe(step, &mut self.observation);
        }
        self.controller.act(1, &self.observation, &mut self.state, &mut self.output);
        let in_step = step + 1;
        if let Some(failure) = self.controller.failure(0) {
            return Err((failure.end(in_step), failure.reason.clone()));
        }
        if let (Some((output, state)), Some(active)) = (&mut self.held, &active) {
            if active.is_paused(step) {
                self.output.copy_from_slice(output);
                self.state.copy_from_slice(state);
            } else {
                output.copy_from_slice(&self.output);
                state.copy_from_slice(&self.state);
            }
        }
        if let Some(index) = self.output.iter().position(|number| !number.is_finite()) {
            return Err((EpisodeEnd::InvalidAction { step: in_step, index }, String::new()));
        }
        let clipped = self.output.iter().map(|number| f64::from(*number).clamp(-action_limit, action_limit));
        self.action.iter_mut().zip(clipped).for_each(|(to, from)| *to = from);
        let draws = &mut self.draws[..self.action.len()];
        ActiveInterface::command(active, controlled.noise, request.seed, step, &mut self.action, draws);
        match self.action.iter().position(|number| !number.is_finite()) {
            Some(index) => Err((EpisodeEnd::InvalidAction { step: in_step, index }, String::new())),
            None => Ok(()),
        }
    }
}

impl ProcessSystem {
    /// Resets and steps a simulation. A failure has the control step in which it happened.
    pub(crate) fn steps(
        &self,
        request: &Request,
        scenario: &Scenario,
        stop: &mut EarlyStop,
        mut worker: Option<&mut ControlledWorker>,
        process: &mut SimulatorProcess,
    ) -> Result<Ran, (Failure, usize)> {
        let description = self.simulator.description();
        let has_effects = self.interface.has_effects();
        let mut active = has_effects.then(|| self.interface.start(&request.scenario, request.seed));
        let observation = worker.as_ref().map(|worker| worker.observation.len());
        let signals = &self.names[..description.signals.len()];
        let asked = AskedKind::Sample { observation };
        let write = |line: &mut String| self.writer.write(line, request.seed, scenario);
        let mut answer = process
            .ask("reset", write, signals, asked, description.time_limit)
            .map_err(|failure| (failure, 0))?;
        if let Some(worker) = &mut worker {
            worker.start(request, active.as_ref());
        }
        stop.start();
        let mut trace = Trace::new(self.names.clone());
        let mut step = 0;
        loop {
            let ended = end_of(&answer, step);
            let is_last = matches!(ended, Some(EpisodeEnd::Terminated { .. }));
            if let (Some(signals), true) = (&mut answer.signals, ended.is_none() || is_last) {
                if let Some(worker) = &mut worker {
                    worker.complete_sample(signals);
                }
                trace.push(signals);
                if request.stop_threshold.is_some() {
                    stop.push(signals);
                }
            }
            if let Some(end) = ended {
                let reason = answer.error.take().unwrap_or_else(|| std::mem::take(&mut answer.reason));
                return Ok(Ran { trace, end, reason });
            }
            if step == description.steps {
                return Ok(Ran { trace, end: EpisodeEnd::Completed, reason: answer.reason });
            }
            let can_stop = |threshold| request.may_stop_after(step) && stop.can_stop(threshold);
            if step > 0 && request.stop_threshold.is_some_and(can_stop) {
                return Ok(Ran { trace, end: EpisodeEnd::Stopped { step }, reason: String::new() });
            }
            if let (Some(worker), Some(controlled), Some(policy)) =
                (&mut worker, &self.controlled, &description.policy)
            {
                let observed = answer.observation.as_deref().unwrap_or_default();
                let limit = policy.action_limit;
                let acted = worker.act(controlled, limit, active.as_mut(), request, step, observed);
                if let Err((end, reason)) = acted {
                    return Ok(Ran { trace, end, reason });
                }
            }
            let write = |line: &mut String| {
                if let Some(worker) = &worker {
                    line.push_str(",\"action\":");
                    write_numbers(line, &worker.action);
                }
            };
            step += 1;
            answer = process
                .ask("step", write, signals, asked, description.time_limit)
                .map_err(|failure| (failure, step))?;
        }
    }
}

/// Returns how an answer ends its simulation; `None` if it continues.
fn end_of(answer: &Answer, step: usize) -> Option<EpisodeEnd> {
    if answer.error.is_some() {
        return Some(EpisodeEnd::Crashed { step });
    }
    let signals = answer.signals.as_deref().unwrap_or_default();
    let invalid = signals.iter().position(|value| !value.is_finite());
    match (answer.end, invalid) {
        // The mode `trace` cannot say when a simulator finds it out.
        (Some(End::Invalid), _) => Some(EpisodeEnd::InvalidScenario),
        (Some(End::Diverged), _) => Some(EpisodeEnd::Diverged { step }),
        (_, Some(index)) => Some(EpisodeEnd::InvalidSignal { step, index }),
        (Some(End::Terminated), None) => Some(EpisodeEnd::Terminated { step }),
        (None, None) => None,
    }
}
