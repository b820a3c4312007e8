//! Batches and the losses of SAC, which are those with the most parts, allocate nothing after the first time.
#![allow(unsafe_code)] // a global allocator that counts cannot be written without
#![allow(clippy::unwrap_used)]

mod line;
mod toy;

use std::alloc::{GlobalAlloc, Layout, System as Allocator};
use std::cell::Cell;

use line::Line;
use mishandle_network::{Activation, Mlp, Normalizer};
use mishandle_rollout::{Seed, Stream};
use mishandle_training::replay::{Batch, Replay, Sampling};
use mishandle_training::sac::{Actor, CriticLoss, CriticScratch, Distribution, PolicyLoss, PolicyScratch};
use mishandle_training::{EpisodeSettings, Episodes};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { Allocator.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { Allocator.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn network(inputs: usize, outputs: usize) -> Mlp<f32> {
    Mlp::new(&[inputs, 16, outputs], Activation::Elu, Activation::Identity).unwrap().with_layer_norm()
}

#[test]
fn an_update_allocates_nothing() {
    let mut replay = Replay::new(1000, 2, 2, 1);
    let settings = EpisodeSettings { environments: 2, staggered: false, ..EpisodeSettings::default() };
    let mut episodes = Episodes::new(&Line::new(0.0), &settings, Seed(0)).unwrap();
    for _ in 0..20 {
        let seen = episodes.observations().to_vec();
        episodes.step(&[0.5, 0.25]).unwrap();
        replay.push(&seen, &[0.5, 0.25], &episodes);
    }
    let (actor, critics, targets) =
        (network(2, 2), [network(3, 1), network(3, 1)], [network(3, 1), network(3, 1)]);
    let normalizer = Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap();
    let sampling = Sampling { n_steps: 3, gamma: 0.9, reward_scale: 1.0, replacement: true };
    let (mut batch, mut draws) = (Batch::default(), vec![0.0; 64]);
    let (mut critic_scratch, mut policy_scratch) = (CriticScratch::default(), PolicyScratch::default());
    let mut by_critics = vec![0.0; 2 * critics[0].parameter_count()];
    let mut by_actor = vec![0.0; actor.parameter_count()];
    let mut update = |index: u64| {
        let before = ALLOCATIONS.with(Cell::get);
        replay.sample(&sampling, (Seed(1), index), 64, &normalizer, &mut batch);
        Seed(2).normals(Stream::Policy, index, &mut draws);
        let (temperature, critics) = (0.1, [&critics[0], &critics[1]]);
        let target_critics = [&targets[0], &targets[1]];
        let actor = Actor { distribution: Distribution::Squashed, network: &actor, log_std: &[] };
        let loss = CriticLoss { batch: &batch, draws: &draws, temperature, actor, critics, target_critics };
        loss.add_gradient(0..64, &mut critic_scratch, &mut by_critics);
        let loss = PolicyLoss { batch: &batch, draws: &draws, temperature, actor, critics };
        loss.add_gradient(0..64, &mut policy_scratch, &mut by_actor);
        ALLOCATIONS.with(Cell::get) - before
    };
    assert!(update(0) > 0, "the counter counts");
    assert_eq!(update(1) + update(2), 0);
}
