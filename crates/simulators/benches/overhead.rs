//! Time of a simulation and of a control step besides that of the simulator: the simulator is this
//! program, which answers at once with numbers that it computed before.
//!
//! `cargo bench -p mishandle-simulators --bench overhead`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measurement")]

#[path = "../../rollout/tests/function_controller/mod.rs"]
mod function_controller;

use std::io::{BufRead, Write};
use std::sync::Arc;
use std::time::Instant;

use function_controller::controller;
use mishandle_rollout::{Component, Noise, Request, Scenario, Seed, Specification, Target};
use mishandle_simulators::process::Program;
use mishandle_simulators::{Simulator, target};
use mishandle_stl::Formula;

const SIGNALS: usize = 5;
const STEPS: usize = 299;
const ROUNDS: usize = 10;

/// Argument of the process that is the simulator.
const ANSWER: &str = "--answer";

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(position) = arguments.iter().position(|argument| argument == ANSWER) {
        answer(&arguments[position + 1]);
        return;
    }
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| {
        let trace = best(&traced(), 500);
        println!("a trace of {} samples x {SIGNALS} signals: {:.3} ms", STEPS + 1, 1e3 * trace);
        let stepped = best(&stepped(), 50) / STEPS as f64;
        println!("a control step of {SIGNALS} signals with a policy: {:.1} us", 1e6 * stepped);
    });
}

/// Answers as a simulator in a mode.
fn answer(mode: &str) {
    let number = |index: usize| format!("{:?}", (index as f64 * 0.37).sin() / 3.0);
    let list = |count| (0..count).map(number).collect::<Vec<_>>().join(",");
    let names: Vec<String> = (0..SIGNALS).map(|index| format!("s{index}")).collect();
    let columns: Vec<String> = names.iter().map(|name| format!("\"{name}\":[{}]", list(STEPS + 1))).collect();
    let trace = format!("\"trace\":{{{}}}", columns.join(","));
    let sample = format!("\"signals\":[{0}],\"observation\":[{0}]", list(SIGNALS));
    let signals: Vec<String> = names.iter().map(|name| format!("{{\"name\":\"{name}\"}}")).collect();
    let policy = match mode {
        "step" => format!(
            ",\"policy\":{{\"observation\":[{{\"name\":\"o\",\"size\":{SIGNALS}}}],\"action\":[{{\"name\":\"a\"}}],\"action_limit\":1}}"
        ),
        _ => String::new(),
    };
    let hello = format!(
        "\"protocol\":1,\"name\":\"bench\",\"control_dt\":0.1,\"steps\":{STEPS},\"axes\":[{{\"name\":\"x\",\"low\":0,\"high\":1,\
         \"nominal\":0}}],\"signals\":[{}],\"formulas\":[{{\"name\":\"f\",\"text\":\"always(s0 <= 0.3 or s1 >= 0)\"}}]{policy}",
        signals.join(",")
    );
    let mut out = std::io::stdout().lock();
    for (line, id) in std::io::stdin().lock().lines().zip(1..) {
        let line = line.unwrap();
        let text = match () {
            () if line.contains("\"hello\"") => &hello,
            () if line.contains("\"simulate\"") => &trace,
            () => &sample,
        };
        writeln!(out, "{{\"id\":{id},{text}}}").unwrap();
        out.flush().unwrap();
    }
}

fn simulator(mode: &str) -> Arc<Simulator> {
    let program = std::env::current_exe().unwrap().to_string_lossy().into_owned();
    let words = vec![program, ANSWER.to_string(), mode.to_string()];
    Arc::new(Simulator::start(Program { words, folder: ".".into() }, None).unwrap())
}

fn traced() -> Target {
    target(simulator("trace"), None, Noise::default()).unwrap()
}

fn stepped() -> Target {
    let component = Component {
        role: "controller".to_string(),
        name: "zero".to_string(),
        hash: String::new(),
        file_hash: String::new(),
    };
    let zero = controller([SIGNALS, 1, 0], |_, _, action| action.fill(0.0));
    target(simulator("step"), Some((zero, vec![component])), Noise::default()).unwrap()
}

/// Returns the time of a simulation, s: the best of several rounds.
fn best(target: &Target, simulations: u64) -> f64 {
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let mut system = target.system(&target.spaces[0], &specification).unwrap();
    let requests: Vec<Request> =
        (0..simulations).map(|seed| Request::new(Scenario::from([0.5]), Seed(seed))).collect();
    let mut round = || {
        let start = Instant::now();
        let episodes = system.rollout(&requests).unwrap();
        assert!(episodes.iter().all(|episode| episode.robustness().is_some()));
        start.elapsed().as_secs_f64() / simulations as f64
    };
    (0..ROUNDS).map(|_| round()).fold(f64::INFINITY, f64::min)
}
