//! Times of the passes on one thread: `cargo bench -p mishandle-network`.
#![allow(clippy::print_stdout)]

use std::hint::black_box;
use std::time::Instant;

use mishandle_network::{Activation, Adam, CHUNK_ROWS, ChunkPool, Mlp, NetworkError, Workspace};

/// The least time of a run, s.
fn least(runs: usize, mut run: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() -> Result<(), NetworkError> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    // One thread: rayon runs nested work where it is called from.
    for sizes in [&[30, 256, 128, 64, 9][..], &[30, 64, 64, 9], &[30, 512, 256, 128, 9], &[39, 256, 256, 1]] {
        let mut network = Mlp::<f32>::new(sizes, Activation::Elu, Activation::Identity)?;
        network.initialize_uniform(&mut uniform);
        println!("{sizes:?} ELU, {} parameters", network.parameter_count());
        let inputs: Vec<f32> = (0..4096 * sizes[0]).map(|_| (uniform() * 4.0 - 2.0) as f32).collect();
        let mut workspace = Workspace::default();
        for rows in [1, 4, 16, 64, 256] {
            let inputs = &inputs[..rows * sizes[0]];
            let time = least(2000, || {
                black_box(network.forward(black_box(inputs), &mut workspace));
            });
            println!("  forward, {rows:4} rows: {:8.2} us", time * 1e6);
        }
        let mut adam = Adam::new(network.parameter_count(), 1e-4);
        let mut gradient = vec![0.0; network.parameter_count()];
        for rows in [256, 4096] {
            let columns = sizes[0];
            let mut pool = ChunkPool::<f32, Workspace<f32>>::new(CHUNK_ROWS);
            let (mut forward, mut backward, mut step) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
            let whole = least(40, || {
                let network = &network;
                let inputs = &inputs;
                pool.sum(rows, &mut gradient, |rows, workspace, gradient| {
                    let outputs =
                        network.forward(&inputs[rows.start * columns..rows.end * columns], workspace);
                    let error: Vec<f32> = outputs.iter().map(|y| y - 1.0).collect();
                    network.backward(&error, workspace, Some(gradient), None);
                });
            });
            let start = Instant::now();
            network.update(|parameters| adam.step(parameters, &gradient));
            step = step.min(start.elapsed().as_secs_f64());
            let part = &inputs[..CHUNK_ROWS * columns];
            forward = forward.min(least(40, || {
                black_box(network.forward(part, &mut workspace));
            }));
            let error = vec![1.0; CHUNK_ROWS * network.output_size()];
            backward = backward
                .min(least(40, || network.backward(&error, &mut workspace, Some(&mut gradient), None)));
            let direction = gradient.clone();
            let tangent = least(40, || {
                black_box(network.tangent(Some(&direction), None, &mut workspace));
            });
            println!(
                "  gradient, {rows:4} rows: {:8.3} ms; a chunk: forward {:.0} us, backward {:.0} us, tangent {:.0} us; Adam {:.0} us",
                whole * 1e3,
                forward * 1e6,
                backward * 1e6,
                tangent * 1e6,
                step * 1e6
            );
        }
    }
    Ok(())
}
