//! Results do not depend on the other rows of a batch or on the number of threads, bit for bit.

use crate::reference::{CASES, Random, network};
use mishandle_network::{ChunkPool, Workspace};

fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|number| number.to_bits()).collect()
}

/// Returns rows `first` to `end` of a row-major matrix.
fn rows(numbers: &[f32], columns: usize, first: usize, end: usize) -> &[f32] {
    &numbers[first * columns..end * columns]
}

#[test]
fn a_row_does_not_depend_on_other_rows() {
    const ROWS: usize = 61;
    let mut random = Random(1);
    for case in CASES {
        let network = network::<f32>(case, &mut random);
        let ins = network.input_size();
        let outs = network.output_size();
        let inputs: Vec<f32> = random.normals(ROWS * ins);
        let output_gradient: Vec<f32> = random.normals(ROWS * outs);
        let parameter_direction: Vec<f32> = random.normals(network.parameter_count());
        let input_direction: Vec<f32> = random.normals(ROWS * ins);

        let mut workspace = Workspace::default();
        let mut pass = |first: usize, end: usize| {
            let mut input_gradient = vec![0.0; (end - first) * ins];
            let outputs = network.forward(rows(&inputs, ins, first, end), &mut workspace).to_vec();
            let gradient = rows(&output_gradient, outs, first, end);
            network.backward(gradient, &mut workspace, None, Some(&mut input_gradient));
            let direction = rows(&input_direction, ins, first, end);
            let tangents =
                network.tangent(Some(&parameter_direction), Some(direction), &mut workspace).to_vec();
            [outputs, input_gradient, tangents]
        };
        let whole = pass(0, ROWS);
        // Row counts up to several tiles and a remainder cover every partition of rows into tiles.
        for count in 1..=20 {
            for first in [0, 7, ROWS - count] {
                let part = pass(first, first + count);
                for ((part, whole), columns) in part.iter().zip(&whole).zip([outs, ins, outs]) {
                    let expected = rows(whole, columns, first, first + count);
                    assert_eq!(bits(part), bits(expected), "{case:?}, {count} rows from {first}");
                }
            }
        }
    }
}

#[test]
fn a_used_workspace_gives_the_same_result_as_a_new_one() {
    let mut random = Random(2);
    let network = network::<f32>(CASES[3], &mut random);
    let inputs: Vec<f32> = random.normals(40 * network.input_size());
    let few = &inputs[..3 * network.input_size()];
    let mut used = Workspace::default();
    // NaN left in the memory must have no effect either.
    network.forward(&vec![f32::NAN; inputs.len()], &mut used);
    let after = bits(network.forward(few, &mut used));
    assert_eq!(after, bits(network.forward(few, &mut Workspace::default())));
}

/// Returns the gradient of Σ y² / 2 over a batch, followed by the loss.
fn gradient_with_threads(threads: usize, chunk_rows: usize, batch: usize) -> Vec<u32> {
    let mut random = Random(3);
    let network = network::<f32>(CASES[5], &mut random);
    let columns = network.input_size();
    let inputs: Vec<f32> = random.normals(batch * columns);
    let mut sum = vec![f32::NAN; network.parameter_count() + 1];
    let mut pool = ChunkPool::<f32, Workspace<f32>>::new(chunk_rows);
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    for _ in 0..3 {
        threads.install(|| {
            pool.sum(batch, &mut sum, |chunk, workspace, sum| {
                let outputs =
                    network.forward(rows(&inputs, columns, chunk.start, chunk.end), workspace).to_vec();
                let (loss, gradient) = sum.split_last_mut().expect("not empty");
                *loss += outputs.iter().map(|y| y * y / 2.0).sum::<f32>();
                network.backward(&outputs, workspace, Some(gradient), None);
            });
        });
    }
    bits(&sum)
}

#[test]
fn a_sum_does_not_depend_on_the_number_of_threads() {
    for (chunk_rows, batch) in [(256, 2048), (64, 1000), (7, 100), (256, 5)] {
        let one = gradient_with_threads(1, chunk_rows, batch);
        for threads in [2, 3, 8] {
            assert_eq!(
                gradient_with_threads(threads, chunk_rows, batch),
                one,
                "{threads} threads, {chunk_rows} rows"
            );
        }
    }
}

#[test]
fn the_sum_over_chunks_equals_the_sum_over_rows() {
    // Integers, so that the order of summation does not matter.
    let mut pool = ChunkPool::<f64, ()>::new(10);
    for batch in [0, 1, 9, 10, 11, 105] {
        let mut total = [f64::NAN; 2];
        pool.sum(batch, &mut total, |rows, (), sum| {
            for row in rows {
                sum[0] += 1.0;
                sum[1] += row as f64;
            }
        });
        let rows = batch as f64;
        assert_eq!(total, [rows, rows * (rows - 1.0).max(0.0) / 2.0]);
    }
}

#[test]
fn every_element_of_a_long_vector_is_summed() {
    let mut total = vec![f64::NAN; 10_000];
    ChunkPool::<f64, ()>::new(3).sum(8, &mut total, |rows, (), sum| {
        for (i, number) in sum.iter_mut().enumerate() {
            *number += (i * rows.len()) as f64;
        }
    });
    assert!(total.iter().enumerate().all(|(i, number)| *number == (8 * i) as f64));
}

#[test]
fn mapped_outputs_equal_those_of_one_forward_pass() {
    let mut random = Random(4);
    let network = network::<f32>(CASES[5], &mut random);
    let inputs: Vec<f32> = random.normals(100 * network.input_size());
    let mut outputs = vec![0.0; 100 * network.output_size()];
    let pool = ChunkPool::<f32, Workspace<f32>>::new(16);
    pool.map(100, &mut outputs, |chunk, workspace, share| {
        share.copy_from_slice(
            network.forward(rows(&inputs, network.input_size(), chunk.start, chunk.end), workspace),
        );
    });
    assert_eq!(bits(&outputs), bits(network.forward(&inputs, &mut Workspace::default())));
}
