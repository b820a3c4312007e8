//! Times of forward and backward passes, Jacobian-vector products and updates:
//! `cargo bench -p mishandle-network`.
#![allow(clippy::print_stdout)]

use std::hint::black_box;
use std::time::Instant;

use mishandle_network::{Activation, Adam, CHUNK_ROWS, ChunkPool, Mlp, Workspace};

/// Returns the minimum time of a run in seconds.
fn min_time(runs: usize, mut run: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// Takes one step of Adam on the mean of (y − 1)² / 2.
fn update(
    network: &mut Mlp<f32>,
    inputs: &[f32],
    pool: &mut ChunkPool<f32, (Workspace<f32>, Vec<f32>)>,
    gradient: &mut [f32],
    adam: &mut Adam<f32>,
) {
    let columns = network.input_size();
    let rows = inputs.len() / columns;
    let shared = &*network;
    pool.sum(rows, gradient, |chunk, (workspace, error), gradient| {
        let outputs = shared.forward(&inputs[chunk.start * columns..chunk.end * columns], workspace);
        error.clear();
        error.extend(outputs.iter().map(|y| (y - 1.0) / rows as f32));
        shared.backward(error, workspace, Some(gradient), None);
    });
    network.update(|parameters| adam.step(parameters, gradient));
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    for sizes in [&[30, 256, 128, 64, 9][..], &[30, 64, 64, 9], &[30, 512, 256, 128, 9], &[39, 256, 256, 1]] {
        let mut network = Mlp::<f32>::new(sizes, Activation::Elu, Activation::Identity)?;
        network.initialize_uniform(&mut uniform);
        println!("{sizes:?} ELU, {} parameters", network.parameter_count());
        let inputs: Vec<f32> = (0..4096 * sizes[0]).map(|_| (uniform() * 4.0 - 2.0) as f32).collect();
        let mut workspace = Workspace::default();
        for rows in [1, 4, 16, 64, 256] {
            let inputs = &inputs[..rows * sizes[0]];
            let time = min_time(2000, || {
                black_box(network.forward(black_box(inputs), &mut workspace));
            });
            println!("  forward, {rows:4} rows: {:8.2} us", time * 1e6);
        }
        let count = network.parameter_count();
        let mut gradient = vec![0.0; count];
        let mut adam = Adam::new(count, 1e-4);
        for threads in [1, rayon::current_num_threads()] {
            let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let mut pool = ChunkPool::<f32, (Workspace<f32>, Vec<f32>)>::new(CHUNK_ROWS);
            let time = min_time(100, || {
                threads.install(|| update(&mut network, &inputs, &mut pool, &mut gradient, &mut adam));
            });
            println!("  update, 4096 rows, {} threads: {:7.2} ms", threads.current_num_threads(), time * 1e3);
        }
        let part = &inputs[..CHUNK_ROWS * sizes[0]];
        let error = vec![1.0; CHUNK_ROWS * network.output_size()];
        let direction = vec![1.0; count];
        network.forward(part, &mut workspace);
        let backward = min_time(200, || network.backward(&error, &mut workspace, Some(&mut gradient), None));
        let tangent = min_time(200, || {
            black_box(network.tangent(Some(&direction), None, &mut workspace));
        });
        let step = min_time(200, || network.update(|parameters| adam.step(parameters, &gradient)));
        println!("  backward and tangent, {CHUNK_ROWS} rows: {:.1}, {:.1} us", backward * 1e6, tangent * 1e6);
        println!("  Adam's step and packing: {:.1} us", step * 1e6);
    }
    Ok(())
}
