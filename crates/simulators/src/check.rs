//! The protocol as a test suite: questions to a simulator whose right answers are known.

use std::time::{Duration, Instant};

use crate::process::{Failure, Program};
use mishandle_results::{ProtocolCheck, ProtocolFinding};
use mishandle_rollout::{AxisValues, ControlLoop, RolloutError, Scenario, Seed, Space};
use mishandle_text::first_and_last_line;

use crate::answer::{Answer, AskedKind, End};
use crate::description::Description;
use crate::hello::Mode;
use crate::question::{ScenarioWriter, write_numbers};
use crate::simulator::{NoProcess, Simulator};
use crate::worker::SimulatorProcess;

/// Seeds of the questions.
const SEEDS: [Seed; 2] = [Seed(1), Seed(u64::MAX)];

/// Largest number of axes whose bounds are simulated one by one.
const MAX_AXES: usize = 20;

/// Number of simulations of the nominal scenario that are timed.
const TIMED: usize = 5;

/// Time that a program has to end after its input is closed: more than a busy machine needs.
const CLOSING: Duration = Duration::from_secs(2);

/// Time in which output after an answer is noticed.
const PAUSE: Duration = Duration::from_millis(100);

/// Talks to a simulator, and reports what it does that the protocol does not allow, each with a way
/// out.
pub fn check(program: Program, time_limit: Option<Duration>) -> ProtocolCheck {
    let command = crate::program::command_text(&program);
    let start = Instant::now();
    let mut found = ProtocolCheck {
        command,
        name: None,
        passed: false,
        checks: Vec::new(),
        start_seconds: None,
        simulation_seconds: None,
        step_seconds: None,
    };
    match Simulator::start(program, time_limit) {
        Ok(simulator) => {
            found.start_seconds = Some(start.elapsed().as_secs_f64());
            found.name = Some(simulator.description().name.clone());
            if let Err(error) = Checker::new(&simulator, &mut found).map(|mut checker| checker.run()) {
                let finding = error.to_string();
                found.checks.push(ProtocolFinding { check: "hello".to_string(), passed: false, finding });
            }
        }
        Err(error) => {
            let source = std::error::Error::source(&error).map(|source| format!(": {source}"));
            let finding = format!("{error}{}", source.unwrap_or_default());
            found.checks.push(ProtocolFinding { check: "hello".to_string(), passed: false, finding });
        }
    }
    found.passed = found.checks.iter().all(|check| check.passed);
    found
}

/// All that a simulation answered.
#[derive(Clone, Debug, PartialEq)]
struct Recorded {
    /// Bits of all numbers, in order.
    bits: Vec<u64>,
    error: Option<String>,
    end: Option<End>,
    /// Name of the first signal that is not finite, and its sample.
    invalid: Option<(String, usize)>,
    /// Number of control steps, and their time.
    steps: (u32, Duration),
}

impl Recorded {
    /// Returns whether two simulations answered the same.
    fn agrees(&self, other: &Recorded) -> bool {
        (&self.bits, &self.error, self.end) == (&other.bits, &other.error, other.end)
    }
}

struct Checker<'a> {
    simulator: &'a Simulator,
    found: &'a mut ProtocolCheck,
    space: Space,
    writer: ScenarioWriter,
    names: Vec<String>,
    /// The process that answers; `None` after a failure.
    process: Option<SimulatorProcess>,
}

impl<'a> Checker<'a> {
    fn new(simulator: &'a Simulator, found: &'a mut ProtocolCheck) -> Result<Checker<'a>, RolloutError> {
        let description = simulator.description();
        let names = description.signals.iter().map(|signal| signal.name.clone()).collect();
        let space = Space::new("all", description.axes.clone())?;
        let writer = ScenarioWriter::new(&description.axes, &space);
        Ok(Checker { simulator, found, space, writer, names, process: None })
    }

    fn description(&self) -> &'a Description {
        self.simulator.description()
    }

    /// Reports a check that passed, or the problems that it found.
    fn report(&mut self, check: &str, passed: &str, problems: &[String]) {
        let is_passed = problems.is_empty();
        // The standard error of a program that crashed is long.
        let problems: Vec<String> = problems.iter().map(|problem| first_and_last_line(problem)).collect();
        let finding = if is_passed { passed.to_string() } else { problems.join("; ") };
        self.found.checks.push(ProtocolFinding { check: check.to_string(), passed: is_passed, finding });
    }

    fn run(&mut self) {
        self.hello();
        let nominal = self.space.nominal();
        let Some(first) = self.nominal(&nominal) else { return };
        self.corners();
        if self.description().is_deterministic {
            self.repeat(&nominal, &first);
            self.order(&nominal, &first);
        } else {
            let finding = "not compared, because the simulator says that it is not deterministic";
            self.report("repeat", finding, &[]);
        }
        self.seeds(&nominal, &first);
        self.unknown(&nominal);
        self.another_process(&nominal, &first);
        self.output(&nominal);
        self.end();
    }

    fn hello(&mut self) {
        let Description { name, axes, signals, formulas, steps, control_dt, mode, .. } = self.description();
        let mode = if *mode == Mode::Trace { "trace" } else { "step" };
        let passed = format!(
            "{name}, mode {mode}: {steps} control steps of {control_dt} s; number of axes {}, of signals {}, of formulas {}",
            axes.len(),
            signals.len(),
            formulas.len()
        );
        let without =
            "it has no formula; state one in `formulas`, or give one with each question".to_string();
        let problems = if formulas.is_empty() { vec![without] } else { Vec::new() };
        self.report("hello", &passed, &problems);
    }

    /// Returns the process that answers, or starts another one.
    fn process(&mut self) -> Result<&mut SimulatorProcess, String> {
        let started = match self.process.take() {
            Some(process) => process,
            None => self.simulator.take().map_err(|why| match why {
                NoProcess::Failed(failure) => failure.to_string(),
                NoProcess::Ends(error) => error.to_string(),
            })?,
        };
        Ok(self.process.insert(started))
    }

    /// Simulates a scenario; an error says how the process failed.
    fn simulate(&mut self, scenario: &Scenario, seed: Seed) -> Result<Recorded, String> {
        self.process()?;
        let Some(mut process) = self.process.take() else {
            return Err("there is no process".to_string());
        };
        let recorded = self.ask(&mut process, scenario, seed);
        if recorded.is_ok() {
            self.process = Some(process);
        }
        recorded.map_err(|failure| failure.to_string())
    }

    fn ask(
        &self,
        process: &mut SimulatorProcess,
        scenario: &Scenario,
        seed: Seed,
    ) -> Result<Recorded, Failure> {
        let Description { mode, policy, time_limit, steps, .. } = self.description();
        let mut recorded =
            Recorded { bits: Vec::new(), error: None, end: None, invalid: None, steps: (0, Duration::ZERO) };
        let write = |line: &mut String| self.writer.write(line, seed, scenario);
        if *mode == Mode::Trace {
            let asked = AskedKind::Trace { samples: steps + 1 };
            let answer = process.ask("simulate", write, &self.names, asked, *time_limit)?;
            let columns = answer.trace.iter().flatten().zip(&self.names);
            recorded.invalid = columns
                .filter_map(|(column, name)| {
                    Some((column.iter().position(|value| !value.is_finite())?, name.clone()))
                })
                .min()
                .map(|(sample, name)| (name, sample));
            self.add(&mut recorded, &answer, 0);
            return Ok(recorded);
        }
        let sizes = policy.as_ref().map(ControlLoop::sizes);
        let asked = AskedKind::Sample { observation: sizes.map(|[observed, _]| observed) };
        let answer = process.ask("reset", write, &self.names, asked, *time_limit)?;
        self.add(&mut recorded, &answer, 0);
        let action = vec![0.0; sizes.map_or(0, |[_, actions]| actions)];
        let start = Instant::now();
        for step in 1..=*steps {
            if recorded.end.is_some() || recorded.error.is_some() {
                break;
            }
            let write = |line: &mut String| {
                if !action.is_empty() {
                    line.push_str(",\"action\":");
                    write_numbers(line, &action);
                }
            };
            let answer = process.ask("step", write, &self.names, asked, *time_limit)?;
            self.add(&mut recorded, &answer, step);
            recorded.steps.0 += 1;
        }
        recorded.steps.1 = start.elapsed();
        Ok(recorded)
    }

    /// Adds the numbers of an answer.
    fn add(&self, recorded: &mut Recorded, answer: &Answer, sample: usize) {
        let lists = answer.trace.iter().flatten().chain(&answer.signals).chain(&answer.observation);
        recorded.bits.extend(lists.flatten().map(|number| number.to_bits()));
        (recorded.end, recorded.error) = (answer.end, answer.error.clone());
        let invalid = answer.signals.iter().flatten().position(|value| !value.is_finite());
        if let (None, Some(index)) = (&recorded.invalid, invalid) {
            recorded.invalid = Some((self.names[index].clone(), sample));
        }
    }

    /// Simulates the nominal scenario, whose answer the other checks compare.
    fn nominal(&mut self, nominal: &Scenario) -> Option<Recorded> {
        let mut times = Vec::new();
        let mut last = None;
        for _ in 0..TIMED {
            let start = Instant::now();
            match self.simulate(nominal, SEEDS[0]) {
                Ok(recorded) => last = Some(recorded),
                Err(failure) => {
                    self.report("nominal", "", &[failure]);
                    return None;
                }
            }
            times.push(start.elapsed().as_secs_f64());
            if times.iter().sum::<f64>() > 10.0 {
                break;
            }
        }
        times.sort_by(f64::total_cmp);
        self.found.simulation_seconds = times.get(times.len() / 2).copied();
        let recorded = last?;
        let (steps, time) = recorded.steps;
        if steps > 0 {
            self.found.step_seconds = Some(time.as_secs_f64() / f64::from(steps));
        }
        let mut problems = Vec::new();
        if let Some(error) = &recorded.error {
            problems.push(format!("it answers the nominal scenario with the error `{error}`"));
        }
        if recorded.end == Some(End::Invalid) {
            problems.push("it cannot start from the nominal scenario; choose another `nominal`".to_string());
        }
        if let Some((name, sample)) = &recorded.invalid {
            problems.push(format!(
                "the signal `{name}` is null at sample {sample} of the nominal scenario, so that no formula that reads it has a \
                 verdict"
            ));
        }
        self.report("nominal", "it simulates the nominal scenario", &problems);
        Some(recorded)
    }

    /// Simulates the bounds of each axis, and of all together.
    fn corners(&mut self) {
        let axes = self.space.axes().to_vec();
        let nominal = self.space.nominal();
        let at = |index: usize, high: bool| {
            let axis = &axes[index];
            Some(if high { axis.high } else { axis.low })
        };
        let values = |change: &dyn Fn(usize) -> Option<f64>| {
            Scenario::new((0..axes.len()).map(|index| change(index).or(nominal.get(index))).collect())
        };
        let mut scenarios: Vec<(String, Scenario)> = Vec::new();
        for high in [false, true] {
            let side = if high { "highest" } else { "lowest" };
            for (index, axis) in axes.iter().enumerate().take(MAX_AXES) {
                let value = match (&axis.values, at(index, high)) {
                    (AxisValues::Categorical(names), Some(value)) => names[value as usize].clone(),
                    (_, value) => value.unwrap_or_default().to_string(),
                };
                let scenario = values(&|other| at(index, high).filter(|_| other == index));
                scenarios.push((format!("{} = {value}", axis.name), scenario));
            }
            scenarios.push((format!("the {side} value of every axis"), values(&|index| at(index, high))));
        }
        let mut problems = Vec::new();
        let count = scenarios.len();
        for (name, scenario) in scenarios {
            let problem = match self.simulate(&scenario, SEEDS[0]) {
                Err(failure) => Some(failure),
                Ok(Recorded { error: Some(error), .. }) => Some(format!(
                    "the error `{error}`; narrow the axis, or answer with `\"end\": \"invalid\"` where no simulation can start"
                )),
                Ok(Recorded { invalid: Some((signal, sample)), end: None, .. }) => Some(format!(
                    "null for `{signal}` at sample {sample}; narrow the axis, or answer with `\"end\": \"diverged\"`"
                )),
                Ok(_) => None,
            };
            problems.extend(problem.map(|problem| format!("at {name}: {problem}")));
        }
        problems.truncate(3);
        self.report(
            "corners",
            &format!("it simulates {count} scenarios at the bounds of its axes"),
            &problems,
        );
    }

    /// Compares a simulation with an earlier one of the same question.
    fn compare(&mut self, scenario: &Scenario, seed: Seed, first: &Recorded, problem: &str) -> Vec<String> {
        match self.simulate(scenario, seed) {
            Err(failure) => vec![failure],
            Ok(again) if again.agrees(first) => Vec::new(),
            Ok(_) => vec![problem.to_string()],
        }
    }

    fn repeat(&mut self, nominal: &Scenario, first: &Recorded) {
        let problem = "the same question has another answer the second time; say `\"deterministic\": false`, or let \
                       random numbers follow from the seed";
        let problems = self.compare(nominal, SEEDS[0], first, problem);
        self.report("repeat", "equal questions have equal answers", &problems);
    }

    fn order(&mut self, nominal: &Scenario, first: &Recorded) {
        let other = self.space.at(&vec![0.75; self.space.axes().len()]);
        let between = self.simulate(&other, SEEDS[1]).err();
        let problem = "a scenario has another answer after a simulation of another one: something is left of the simulation \
                       before; initialize all of the state at each question";
        let problems = match between {
            Some(failure) => vec![failure],
            None => self.compare(nominal, SEEDS[0], first, problem),
        };
        self.report("order", "an answer does not depend on the questions before", &problems);
    }

    fn seeds(&mut self, nominal: &Scenario, first: &Recorded) {
        let description = self.description();
        let is_seeded = description.depends_on_seed;
        let is_deterministic = description.is_deterministic;
        if !is_deterministic {
            return;
        }
        let other = match self.simulate(nominal, SEEDS[1]) {
            Ok(other) => other,
            Err(failure) => return self.report("seeds", "", &[failure]),
        };
        let mut problems = Vec::new();
        match (is_seeded, other.agrees(first)) {
            (true, true) => problems
                .push("two seeds have the same answer; say `\"seeded\": false`, or use the seed".to_string()),
            (false, false) => {
                problems.push("two seeds have different answers; say `\"seeded\": true`".to_string());
            }
            _ => {}
        }
        let problem = "a seed has another answer after that of another seed: its random numbers depend on earlier ones; make \
                       a generator from the seed at each question";
        problems.extend(self.compare(nominal, SEEDS[0], first, problem));
        self.report("seeds", "the answer depends on the seed as declared", &problems);
    }

    fn unknown(&mut self, nominal: &Scenario) {
        let limit = self.description().time_limit;
        let asked = match self.process() {
            Ok(process) => process.ask_unknown(limit).map_err(|failure| failure.to_string()),
            Err(problem) => Err(problem),
        };
        let mut problems = Vec::new();
        match asked {
            Err(failure) => {
                self.process = None;
                problems.push(format!("a question of an unknown type ends the program: {failure}"));
            }
            Ok((id, text)) => {
                #[derive(serde::Deserialize)]
                struct Refused {
                    id: u64,
                    #[serde(rename = "error")]
                    _error: String,
                }
                if !serde_json::from_str::<Refused>(&text).is_ok_and(|refused| refused.id == id) {
                    let text: String = text.chars().take(100).collect();
                    problems.push(format!("it answers a question of an unknown type with `{text}`"));
                }
            }
        }
        if !problems.is_empty() {
            problems.push(
                "answer with {\"id\": N, \"error\": \"unknown type\"}, for later versions of the protocol"
                    .to_string(),
            );
        }
        problems.extend(self.simulate(nominal, SEEDS[0]).err());
        self.report("unknown", "it answers a question of an unknown type with an error", &problems);
    }

    fn another_process(&mut self, nominal: &Scenario, first: &Recorded) {
        let kept = self.process.take();
        let problems = match self.simulator.start_another() {
            Err(NoProcess::Failed(failure)) => vec![failure.to_string()],
            Err(NoProcess::Ends(error)) => vec![error.to_string()],
            Ok(process) => {
                self.process = Some(process);
                let problem = "a second process has another answer; nothing but scenario and seed may decide it, such as the \
                               time, files that it writes, or the number of threads";
                if self.description().is_deterministic {
                    self.compare(nominal, SEEDS[0], first, problem)
                } else {
                    self.simulate(nominal, SEEDS[0]).err().into_iter().collect()
                }
            }
        };
        if kept.is_some() {
            self.process = kept;
        }
        self.report("process", "a second process has the same description and answer", &problems);
    }

    fn output(&mut self, nominal: &Scenario) {
        let mut problems: Vec<String> = self.simulate(nominal, SEEDS[0]).err().into_iter().collect();
        std::thread::sleep(PAUSE);
        if !problems.is_empty() || self.process.as_mut().is_some_and(SimulatorProcess::has_unread) {
            problems.push(
                "it writes to its standard output after an answer; print messages to the standard error"
                    .to_string(),
            );
        }
        self.report("output", "nothing but answers is on its standard output", &problems);
    }

    fn end(&mut self) {
        let Ok(_) = self.process() else { return };
        let Some(process) = self.process.take() else { return };
        let problems = if process.into_peer().close(CLOSING) {
            Vec::new()
        } else {
            vec![
                "it still runs 2 s after its standard input was closed, and is killed; end the loop at the end of the input"
                    .to_string(),
            ]
        };
        self.report("end", "it ends when its standard input is closed", &problems);
    }
}
