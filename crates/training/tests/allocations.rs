//! Sampling a batch and computing the losses of SAC, the most complex ones, allocate memory only
//! the first time. A control step with delays and faults allocates none once its delays are full.
#![allow(clippy::unwrap_used)]

#[path = "../../stl/tests/allocation_counter/mod.rs"]
mod allocation_counter;
mod line;
mod toy;

use allocation_counter::ALLOCATIONS;
use line::Line;
use mishandle_network::{Activation, Mlp, Normalizer};
use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{Axis, Environment, ScenarioBatches, Seed, Space, Stream, TrainingScenarios, delays};
use mishandle_training::replay_buffer::{ReplayBuffer, Sampling, TransitionBatch};
use mishandle_training::sac::{Actor, CriticLoss, CriticScratch, Distribution, PolicyLoss, PolicyScratch};
use mishandle_training::{Boundary, EpisodeSettings, Episodes, ScenarioSettings};

fn network(inputs: usize, outputs: usize) -> Mlp<f32> {
    Mlp::new(&[inputs, 16, outputs], Activation::Elu, Activation::Identity).unwrap().with_layer_norm()
}

#[test]
fn later_updates_allocate_no_memory() {
    let mut replay = ReplayBuffer::new(1000, 2, 2, 1);
    let settings = EpisodeSettings { environments: 2, staggered: false, ..EpisodeSettings::default() };
    let scenarios = ScenarioSettings::default();
    let mut episodes = Episodes::new(&Line::new(0.0), &settings, &scenarios, Seed(0)).unwrap();
    for _ in 0..20 {
        let observations = episodes.observations().to_vec();
        episodes.step(&[0.5, 0.25]).unwrap();
        replay.push(&observations, &[0.5, 0.25], &episodes);
    }
    let actor = network(2, 2);
    let critics = [network(3, 1), network(3, 1)];
    let targets = [network(3, 1), network(3, 1)];
    let normalizer = Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap();
    let sampling = Sampling { n_steps: 3, gamma: 0.9, reward_scale: 1.0, replacement: true };
    let mut batch = TransitionBatch::default();
    let mut noise = vec![0.0; 64];
    let mut critic_scratch = CriticScratch::default();
    let mut policy_scratch = PolicyScratch::default();
    let mut critics_gradient = vec![0.0; 2 * critics[0].parameter_count()];
    let mut actor_gradient = vec![0.0; actor.parameter_count()];
    let mut update = |index: u64| {
        let before = ALLOCATIONS.get();
        replay.sample(&sampling, Seed(1), index, 64, &normalizer, &mut batch);
        Seed(2).normals(Stream::Policy, index, &mut noise);
        let temperature = 0.1;
        let critics = [&critics[0], &critics[1]];
        let target_critics = [&targets[0], &targets[1]];
        let actor = Actor { distribution: Distribution::Squashed, network: &actor, log_std: &[] };
        let loss = CriticLoss { batch: &batch, noise: &noise, temperature, actor, critics, target_critics };
        loss.add_gradient(0..64, &mut critic_scratch, &mut critics_gradient);
        let loss = PolicyLoss { batch: &batch, noise: &noise, temperature, actor, critics };
        loss.add_gradient(0..64, &mut policy_scratch, &mut actor_gradient);
        ALLOCATIONS.get() - before
    };
    assert!(update(0) > 0, "the first update allocates memory");
    assert_eq!(update(1) + update(2), 0);
}

#[test]
fn a_control_step_with_disturbances_allocates_no_memory() {
    let mut disturbances = delays();
    let site = FaultSite {
        side: Side::Sensing,
        name: "fault".to_string(),
        number: 0,
        channels: vec![Channel { name: "both".to_string(), entries: vec![0, 1] }],
        ranges: vec![[-1.0, 1.0]; 2],
        has_numbers: false,
        control_dt: 0.1,
        episode_steps: 40,
    };
    disturbances.extend(site.disturbances());
    let line = Line::new(0.0);
    let axes = line.space().axes().iter().chain(disturbances.iter().map(|known| &known.axis));
    let space = Space::new("all", axes.cloned().collect::<Vec<Axis>>()).unwrap();
    let scenarios = TrainingScenarios { space, disturbances, given: Vec::new(), mixture: Vec::new() };
    let settings = EpisodeSettings { environments: 8, staggered: false, ..EpisodeSettings::default() };
    let settings = EpisodeSettings { action_noise: 0.1, ..settings };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let counts = pool.install(|| {
        let batches = ScenarioBatches::new(line, scenarios);
        let mut episodes = Episodes::new(&batches, &settings, &ScenarioSettings::default(), Seed(0)).unwrap();
        let mut step = || {
            let before = ALLOCATIONS.get();
            episodes.step(&[0.1; 8]).unwrap();
            let ends = episodes.boundaries().iter().any(|boundary| *boundary != Boundary::Running);
            (!ends).then(|| ALLOCATIONS.get() - before)
        };
        // The longest age of an observation is 3 + 3 + 5 control steps, a new one replaces the
        // oldest. Resets allocate.
        (0..39).map(|_| step()).skip(12).collect::<Vec<_>>()
    });
    assert!(counts.iter().flatten().count() > 15 && counts.iter().flatten().all(|n| *n == 0), "{counts:?}");
}
