//! Policies that are programs: each observation is a line of JSON to a program, and its answer is
//! the action.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use crate::process::{Failure, Peer, Program};
use mishandle_rollout::{Controller, ControllerFailure, ControllerWorker, Seed};
use serde::Deserialize;

use crate::SimulatorError;
use crate::answer::kept;
use crate::program::{command_text, program_hash, word_files};
use crate::words::in_words;

/// Numbers of the state before what the program remembers: the number of control steps, and both
/// halves of the seed.
const OWN_STATE: usize = 3;

/// A policy that is a program. Its answer follows from its question alone: what it remembers is a
/// part of both, so that it may answer for several simulations in turn.
pub struct ProgramPolicy {
    program: Arc<Program>,
    time_limit: Duration,
    control_dt: f64,
    observation_size: usize,
    action_size: usize,
    remembered: usize,
}

/// Answer of a program.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    id: u64,
    action: Vec<Option<f64>>,
    #[serde(default)]
    state: Vec<f64>,
}

/// Settings of a policy that is a program, as a file states them.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramSettings {
    /// The program and its arguments.
    pub words: Vec<String>,
    /// Time limit of an answer.
    pub time_limit: Duration,
    /// Length of what the program remembers.
    pub state: usize,
}

impl ProgramPolicy {
    /// Makes the policy of a program in this folder, for an observation and an action of these
    /// sizes.
    pub fn new(
        settings: ProgramSettings,
        folder: &Path,
        [observation_size, action_size]: [usize; 2],
        control_dt: f64,
    ) -> ProgramPolicy {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        ProgramPolicy {
            program: Arc::new(Program { words: settings.words, folder: folder.to_path_buf() }),
            time_limit: settings.time_limit,
            control_dt,
            observation_size,
            action_size,
            remembered: settings.state,
        }
    }

    /// Returns the command as a user would type it.
    pub fn command(&self) -> String {
        command_text(&self.program)
    }

    /// Returns the words of the command that are files in its folder: its code.
    pub fn files(&self) -> Vec<PathBuf> {
        word_files(&self.program)
    }

    /// Returns the hash of the command and of its files.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn hash(&self) -> Result<String, SimulatorError> {
        program_hash(&self.program, "", &self.files())
    }

    /// Starts the program and asks it twice for the action of an observation of zeros: its answer
    /// must have the right size, and depend on the question alone.
    ///
    /// # Errors
    /// If it cannot be started, or one answer is wrong or differs from the other.
    pub fn check(&self) -> Result<(), SimulatorError> {
        let error = |problem: String| SimulatorError::Policy { command: self.command(), problem };
        let mut worker = Worker::new(self);
        let mut state = vec![0.0; self.state_size()];
        worker.reset(&mut state, Seed(0));
        let observation = vec![0.0; self.observation_size];
        let mut ask = || {
            let mut state = state.clone();
            let mut action = vec![0.0; self.action_size];
            let answered = worker.ask(&observation, &mut state, &mut action);
            answered.map(|()| (state, action)).map_err(|why| error(why.to_string()))
        };
        let first = ask()?;
        let second = ask()?;
        if format!("{first:?}") == format!("{second:?}") {
            Ok(())
        } else {
            Err(error(format!(
                "it answers the same question with {:?} and then {:?}; a program answers from its question alone: what it \
                 remembers is the list `state` of its answer, and random numbers follow from `seed` and `time`",
                first.1, second.1
            )))
        }
    }
}

impl Controller for ProgramPolicy {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn action_size(&self) -> usize {
        self.action_size
    }

    fn state_size(&self) -> usize {
        OWN_STATE + self.remembered
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Worker::new(self))
    }
}

struct Worker {
    program: Arc<Program>,
    time_limit: Duration,
    control_dt: f64,
    /// The running program; started with the first question, and again after a failure.
    peer: Option<Peer>,
    /// Number of the last question.
    id: u64,
    line: String,
    failures: Vec<Option<ControllerFailure>>,
    action_size: usize,
}

impl Worker {
    fn new(policy: &ProgramPolicy) -> Worker {
        Worker {
            program: policy.program.clone(),
            time_limit: policy.time_limit,
            control_dt: policy.control_dt,
            peer: None,
            id: 0,
            line: String::new(),
            failures: Vec::new(),
            action_size: policy.action_size,
        }
    }

    /// Asks for the action of one observation.
    fn ask(&mut self, observation: &[f32], state: &mut [f64], action: &mut [f32]) -> Result<(), Failure> {
        let (own, remembered) = state.split_at_mut(OWN_STATE);
        self.id += 1;
        self.line.clear();
        let seed = ((own[1] as u64) << 32) | own[2] as u64;
        let time = own[0] * self.control_dt;
        let _ =
            write!(self.line, "{{\"id\":{},\"seed\":\"{seed}\",\"time\":{time},\"observation\":", self.id);
        write_numbers(&mut self.line, observation.iter().map(|number| f64::from(*number)));
        if !remembered.is_empty() {
            self.line.push_str(",\"state\":");
            write_numbers(&mut self.line, remembered.iter().copied());
        }
        self.line.push('}');
        let peer = match &mut self.peer {
            Some(peer) => peer,
            none => none.insert(Peer::start(&self.program)?),
        };
        let answered = peer.ask(&self.line, self.time_limit).and_then(|text| {
            let answer = read(&text, self.id, action.len(), remembered.len());
            answer.map_err(|what| Failure::Malformed { what, stderr: peer.stderr() })
        });
        match answered {
            Ok(answer) => {
                for (out, number) in action.iter_mut().zip(answer.action) {
                    *out = number.map_or(f32::NAN, |number| number as f32);
                }
                remembered.copy_from_slice(&answer.state);
                own[0] += 1.0;
                Ok(())
            }
            Err(failure) => {
                // A new program: an old answer is never read.
                self.peer = None;
                Err(failure)
            }
        }
    }
}

/// Reads an answer and checks its sizes.
fn read(text: &str, id: u64, actions: usize, remembered: usize) -> Result<Answer, String> {
    let answer: Answer = serde_json::from_str(text).map_err(|error| {
        let start: String = text.chars().take(200).collect();
        format!(
            "`{start}`, which is not an answer such as {{\"id\": 1, \"action\": [0.5]}}: {}",
            in_words(&error)
        )
    })?;
    if answer.id != id {
        return Err(format!("the answer to question {} instead of {id}", answer.id));
    }
    for (name, found, expected) in
        [("action", answer.action.len(), actions), ("state", answer.state.len(), remembered)]
    {
        if found != expected {
            return Err(format!("a list `{name}` of {found} numbers instead of {expected}"));
        }
    }
    Ok(answer)
}

/// Writes a list of numbers; JSON has no NaN and no infinities, so these are `null`.
fn write_numbers(line: &mut String, numbers: impl Iterator<Item = f64>) {
    line.push('[');
    for (index, number) in numbers.enumerate() {
        if index > 0 {
            line.push(',');
        }
        let _ = if number.is_finite() { write!(line, "{number}") } else { write!(line, "null") };
    }
    line.push(']');
}

impl ControllerWorker for Worker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        state.fill(0.0);
        state[1] = (seed.0 >> 32) as f64;
        state[2] = (seed.0 & u64::from(u32::MAX)) as f64;
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        self.failures.clear();
        let size = observations.len() / rows.max(1);
        let state_size = states.len() / rows.max(1);
        for row in 0..rows {
            let action = &mut actions[row * self.action_size..][..self.action_size];
            let state = &mut states[row * state_size..][..state_size];
            // A simulation that failed has ended; its program is not started again for it.
            let failure = if state[0].is_nan() {
                Some(ControllerFailure { is_timeout: false, reason: String::new() })
            } else {
                self.ask(&observations[row * size..][..size], state, action).err().map(|why| {
                    let is_timeout = matches!(why, Failure::TimedOut { .. });
                    ControllerFailure { is_timeout, reason: kept(&format!("policy: {why}")) }
                })
            };
            if failure.is_some() {
                state[0] = f64::NAN;
                action.fill(0.0);
            }
            self.failures.push(failure);
        }
    }

    fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        self.failures.get(row)?.as_ref()
    }
}
