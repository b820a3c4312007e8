//! Measures the overhead of falsification over stepping and inference, and the speedup of a second
//! core.
//!
//! Run it with `cargo bench -p mishandle --bench campaign`. Each number is the minimum of several
//! interleaved repetitions. The ratios are more reliable than the times.

#![allow(clippy::print_stdout)]

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use mishandle::plan::FalsifyPlan;
use mishandle::resolve::task_target;
use mishandle::rollout::{Environment, Request, Sample, Seed};
use mishandle::run::Engine;
use mishandle::store::RunWriter;
use mishandle::tasks::{TaskEnvironment, TaskTarget};
use mishandle::{Plan, ResolvedPlan};

const REPETITIONS: usize = 5;
const SIMULATIONS: u32 = 320;

fn main() {
    println!(
        "{:<16} {:<8} {:>16} {:>16} {:>7} {:>12}",
        "task", "policy", "stepping alone", "falsification", "ratio", "two cores"
    );
    for task in mishandle::tasks::TASKS {
        let name = task.definition().name;
        let controller = mishandle::shipped::shipped_controllers(task.definition())[0].clone();
        let mut plan = Plan::new(name, &controller);
        // This formula always holds, so every trial spends its whole budget.
        plan.falsify = Some(FalsifyPlan {
            formula: Some(format!("{} < 1e9", task.definition().signals[0].name)),
            trials: 16,
            budget: SIMULATIONS / 16,
            ..FalsifyPlan::default()
        });
        let resolved = ResolvedPlan::new(&plan).expect("the plan is valid");
        let target = task_target(&plan).expect("the plan is valid");
        let environment = target
            .environment(&resolved.space, &resolved.specification)
            .expect("the space belongs to the task");
        let one = pool(1);
        let two = pool(2);
        let mut alone = Duration::MAX;
        let mut whole = Duration::MAX;
        let mut both = Duration::MAX;
        for _ in 0..REPETITIONS {
            alone = alone.min(one.install(|| stepping(&target, &environment)));
            whole = whole.min(one.install(|| falsification(&resolved)));
            both = both.min(two.install(|| falsification(&resolved)));
        }
        let each = |time: Duration| 1e3 * time.as_secs_f64() / f64::from(SIMULATIONS);
        println!(
            "{name:<16} {controller:<8} {:>13.2} ms {:>13.2} ms {:>7.3} {:>11.2}x",
            each(alone),
            each(whole),
            whole.as_secs_f64() / alone.as_secs_f64(),
            whole.as_secs_f64() / both.as_secs_f64()
        );
    }
    println!(
        "\ntime per simulation of 300 control steps on one thread: stepping and inference of 16 rows together; falsification \
         with search,\nnoise, formulas and storage of every simulation; and the speedup of falsification on two threads"
    );
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads are available")
}

/// Steps and infers as many simulations as the falsification, 16 together.
fn stepping(target: &TaskTarget, environment: &TaskEnvironment) -> Duration {
    const ROWS: usize = 16;
    let mut worker = environment.worker();
    let mut controller = target.controller().worker();
    let state_size = environment.state_size();
    let observation_size = environment.observation_size();
    let action_size = environment.action_size();
    let mut state = vec![0.0; ROWS * state_size];
    let mut memory = vec![0.0; ROWS * target.controller().state_size()];
    let mut observation = vec![0.0; ROWS * observation_size];
    let mut output = vec![0.0_f32; ROWS * action_size];
    let mut action = vec![0.0; action_size];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let requests: Vec<Request> = (0..u64::from(SIMULATIONS))
        .map(|i| Request::new(environment.space().sample(Seed(1), i), Seed(1).child(i)))
        .collect();
    let start = Instant::now();
    for requests in requests.chunks(ROWS) {
        for (row, request) in requests.iter().enumerate() {
            let sample = Sample {
                observation: &mut observation[row * observation_size..][..observation_size],
                signals: &mut signals,
                rewards: &mut rewards,
            };
            worker.reset(
                &request.scenario,
                request.seed,
                &mut state[row * state_size..][..state_size],
                sample,
            );
        }
        controller.reset(&mut memory, Seed(0));
        for _ in 0..environment.episode_steps() {
            controller.act(ROWS, &observation, &mut memory, &mut output);
            for row in 0..requests.len() {
                for (action, output) in action.iter_mut().zip(&output[row * action_size..]) {
                    *action = f64::from(output.clamp(-1.0, 1.0));
                }
                let sample = Sample {
                    observation: &mut observation[row * observation_size..][..observation_size],
                    signals: &mut signals,
                    rewards: &mut rewards,
                };
                worker.step(&action, &mut state[row * state_size..][..state_size], sample);
            }
        }
    }
    start.elapsed()
}

fn falsification(resolved: &ResolvedPlan) -> Duration {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("run.sqlite");
    let run: RunWriter = mishandle::run::create_run(resolved, Some(&path)).expect("the run can be written");
    let start = Instant::now();
    let found = mishandle::run::ask(resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(()));
    let elapsed = start.elapsed();
    assert_eq!(found.expect("the falsification succeeds").simulations(), u64::from(SIMULATIONS));
    elapsed
}
