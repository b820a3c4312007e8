//! Records the controls of every physics step, so that another program can replay them in MuJoCo
//! and measure the physics.
//!
//! `cargo run --release -p mishandle-studies --example record_controls -- TASK CONTROLLER EPISODES
//! SEED FOLDER [SUBSTEPS]`. CONTROLLER is `expert` or a controller file. The starts are drawn
//! uniformly from the initial box; the corners of the box come first if SEED is 0.
//!
//! The folder receives `model.xml`, `header.json` and `controls.f64`: for each episode MuJoCo's
//! integration state (mjSTATE_INTEGRATION) at the start, and then for each physics step the
//! controls and 1 while the hand still holds the object, otherwise 0.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program for developers")]

use std::fs;
use std::path::Path;
use std::sync::Arc;

use mishandle::controllers::ControllerFile;
use mishandle::rollout::{
    Controller, Environment, Sample, Scenario, Seed, SpecificationMonitor, Stream, Verdict,
};
use mishandle::stl::{Formula, Trace};
use mishandle::tasks::{EPISODE_STEPS, JOINTS, Panda, Preset, Reward, TaskEnvironment, compose, task};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, controller, episodes, seed, folder, substeps @ ..] = &arguments[..] else {
        panic!("usage: record_controls TASK CONTROLLER EPISODES SEED FOLDER [SUBSTEPS]");
    };
    let task = task(name).unwrap();
    let substeps = substeps.first().map_or(task.definition().n_substeps, |n| n.parse().unwrap());
    let environment =
        TaskEnvironment::with_substeps(task, Preset::Paper, Reward::Shaped, substeps).unwrap().with_manner();
    let policy: Arc<dyn Controller> = match controller.as_str() {
        "expert" => task.expert().unwrap(),
        path => Arc::new(ControllerFile::load(Path::new(path)).unwrap().policy),
    };
    let environment = environment.with_further_parts(policy.further_parts()).unwrap();
    let episodes: u64 = episodes.parse().unwrap();
    let seed: u64 = seed.parse().unwrap();
    let folder = Path::new(folder);
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("model.xml"), compose(task).unwrap()).unwrap();
    let mut recorder = Recorder::new(environment, policy);
    let mut verdicts = Vec::new();
    for episode in 0..episodes {
        verdicts
            .push(recorder.record(&start(&recorder.environment, episode, seed), Seed(seed).child(episode)));
    }
    let count = |which: fn(&Verdict) -> bool| verdicts.iter().filter(|v| which(v)).count();
    let success = count(Verdict::is_success);
    let strict = count(Verdict::is_strict_success);
    let careful = count(Verdict::is_careful_success);
    let bytes: Vec<u8> = recorder.numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    fs::write(folder.join("controls.f64"), bytes).unwrap();
    let header = format!(
        "{{\"task\": \"{name}\", \"episodes\": {episodes}, \"substeps\": {substeps}, \"state\": {}, \"controls\": {JOINTS}, \
         \"steps\": {EPISODE_STEPS}, \"success\": {success}, \"strict\": {strict}}}\n",
        recorder.environment.model().state_size()
    );
    fs::write(folder.join("header.json"), header).unwrap();
    println!(
        "{name} {controller} substeps {substeps}: success {success}, strict {strict}, careful {careful} of {episodes}"
    );
    let failed = |which: fn(&Verdict) -> bool| {
        let failed = verdicts.iter().enumerate().filter(|(_, verdict)| !which(verdict));
        failed.map(|(episode, _)| episode.to_string()).collect::<Vec<_>>().join(" ")
    };
    println!("  not successful: {}", failed(Verdict::is_success));
    println!("  not strict: {}", failed(Verdict::is_strict_success));
    println!("  not careful: {}", failed(Verdict::is_careful_success));
}

/// Returns the start of an episode.
fn start(environment: &TaskEnvironment, episode: u64, seed: u64) -> Scenario {
    let dimension = environment.space().dimension();
    let corners = if seed == 0 { 1 << dimension } else { 0 };
    let u: Vec<f64> = if episode < corners {
        (0..dimension).map(|axis| f64::from(u8::from(episode >> axis & 1 == 1))).collect()
    } else {
        (0..dimension)
            .map(|axis| Seed(seed).child(episode).uniform(Stream::InitialConfiguration, 0, axis as u32))
            .collect()
    };
    environment.space().at(&u)
}

struct Recorder {
    environment: TaskEnvironment,
    policy: Arc<dyn Controller>,
    monitor: SpecificationMonitor,
    numbers: Vec<f64>,
}

impl Recorder {
    fn new(environment: TaskEnvironment, policy: Arc<dyn Controller>) -> Recorder {
        let formulas = environment.definition().formulas(Preset::Paper);
        let mut specification = formulas.specification().unwrap();
        specification.careful = formulas.careful().map(|text| Formula::parse(&text).unwrap());
        let monitor =
            SpecificationMonitor::new(&specification, environment.signals(), environment.control_dt())
                .unwrap();
        Recorder { environment, policy, monitor, numbers: Vec::new() }
    }

    /// Records one episode.
    fn record(&mut self, scenario: &Scenario, seed: Seed) -> Verdict {
        let environment = &self.environment;
        let mut worker = environment.worker();
        let mut controller = self.policy.worker();
        let mut memory = vec![0.0; self.policy.state_size()];
        controller.reset(&mut memory, seed);
        let mut state = vec![0.0; environment.state_size()];
        let mut observation = vec![0.0; environment.observation_size()];
        let mut signals = vec![0.0; environment.signals().len()];
        let mut rewards = vec![0.0; environment.reward_terms().len()];
        let mut trace = Trace::with_capacity(environment.signals().clone(), EPISODE_STEPS + 1);
        let mut world = environment.model().world();
        let panda = Panda::new(environment.model()).unwrap();
        let physics = environment.model().state_size();
        let substeps = (1.0 / 60.0 / environment.model().timestep()).round() as usize;
        let mut action = [0.0_f32; JOINTS];
        macro_rules! sample {
            () => {
                Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards }
            };
        }
        worker.reset(scenario, seed, &mut state, sample!());
        trace.push(&signals);
        self.numbers.extend_from_slice(&state[..physics]);
        world.set_state(&state[..physics]);
        for _ in 0..EPISODE_STEPS {
            controller.act(1, &observation, &mut memory, &mut action);
            let clipped = action.map(|a| f64::from(a.clamp(-1.0, 1.0)));
            let _ = worker.step(&clipped, &mut state, sample!());
            trace.push(&signals);
            let targets = &state[physics..][..JOINTS];
            let mut after = environment.model().world();
            after.set_state(&state[..physics]);
            let holds = after.active().iter().all(|on| *on);
            if !holds {
                world.switch_all(false);
            }
            for _ in 0..substeps {
                panda.step(targets, &mut world);
                self.numbers.extend_from_slice(&world.ctrl()[..JOINTS]);
                self.numbers.push(f64::from(u8::from(holds)));
            }
        }
        let mut end = vec![0.0; physics];
        world.read_state(&mut end);
        assert_eq!(end, state[..physics], "the recorded controls give another episode");
        self.monitor.verdict(&trace, trace.len()).unwrap()
    }
}
