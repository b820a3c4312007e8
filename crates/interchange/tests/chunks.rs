//! Models that predict several actions ahead, against the definition of what is played.

use crate::graph::{bytes, integer, integers, node, value, weights};
use mishandle_controllers::{Entry, Layout};
use mishandle_interchange::{Interface, OnnxPolicy};
use mishandle_rollout::{Controller, Seed};

fn layout() -> Layout {
    let entry = |size| vec![Entry { name: "x".into(), unit: String::new(), size }];
    Layout { observation: entry(2), action: entry(2) }
}

/// Numbers that look random, from -1 to 1.
fn numbers(count: usize, seed: usize) -> Vec<f32> {
    (0..count).map(|i| (1.7 * (i + 31 * seed) as f32 + (i * i) as f32).sin()).collect()
}

/// A model of two observations that counts its runs in `runs` and predicts `length` actions of two
/// numbers: a linear map of the observation, 100 times the runs before added to each.
fn model(length: usize) -> Vec<u8> {
    let graph = [
        value(11, "o", &[1, 2]),
        value(11, "runs", &[1, 1]),
        weights("w", &[2, 2 * length as i64], &numbers(4 * length, 1)),
        weights("one", &[1], &[1.0]),
        weights("hundred", &[1], &[100.0]),
        integers("s", &[1, length as i64, 2]),
        node("MatMul", &["o", "w"], &["y"]),
        node("Mul", &["runs", "hundred"], &["many"]),
        node("Add", &["y", "many"], &["z"]),
        node("Reshape", &["z", "s"], &["a"]),
        node("Add", &["runs", "one"], &["next"]),
        value(12, "a", &[1, length as i64, 2]),
        value(12, "next", &[1, 1]),
    ];
    [integer(1, 8), bytes(7, &graph.concat()), bytes(8, &integer(2, 13))].concat()
}

fn load(length: usize, chunk: &str) -> Result<OnnxPolicy, String> {
    let side = format!(r#"{{"state": [["runs", "next"]], "action": "a"{chunk}}}"#);
    let interface = Interface::from_json(&side).map_err(|error| error.to_string())?;
    OnnxPolicy::from_bytes(&model(length), Some(interface), &["test"], &layout()).map_err(|e| e.to_string())
}

/// Returns the actions of an episode of one row with these observations.
fn episode(policy: &OnnxPolicy, observations: &[f32]) -> Vec<f32> {
    let mut worker = policy.worker();
    let mut state = vec![7.0; policy.state_size()];
    worker.reset(&mut state, Seed(0));
    let mut actions = vec![0.0; observations.len()];
    for (observation, action) in observations.chunks(2).zip(actions.chunks_mut(2)) {
        worker.act(1, observation, &mut state, action);
    }
    actions
}

/// Returns what the model predicts in each run with one of these observations, without a plan.
fn chunks(length: usize, observations: &[f32]) -> Vec<Vec<f32>> {
    let matrix = numbers(4 * length, 1);
    let chunk = |(run, o): (usize, &[f32])| {
        let column = |j: usize| o[0] * matrix[j] + o[1] * matrix[2 * length + j];
        (0..2 * length).map(|j| column(j) + 100.0 * run as f32).collect()
    };
    observations.chunks(2).enumerate().map(chunk).collect()
}

fn assert_near(found: &[f32], expected: &[f64], what: &str) {
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let difference = (f64::from(*found) - expected).abs();
        assert!(difference < 1e-5 * expected.abs().max(1.0), "{what}, {index}: {found} {expected}");
    }
}

#[test]
fn the_first_actions_of_a_chunk_are_played_before_the_model_runs_again() {
    let observations = numbers(2 * 23, 3);
    for (length, execute) in [(1, 1), (5, 1), (5, 2), (5, 3), (5, 5)] {
        let policy = load(length, &format!(r#", "chunk": {{"execute": {execute}}}"#)).unwrap();
        let found = episode(&policy, &observations);
        // The model sees the observations of every `execute`-th step.
        let asked: Vec<f32> = observations.chunks(2).step_by(execute).flatten().copied().collect();
        let chunks = chunks(length, &asked);
        let expected: Vec<f64> = (0..23)
            .flat_map(|step| chunks[step / execute][step % execute * 2..][..2].to_vec())
            .map(f64::from)
            .collect();
        assert_near(&found, &expected, &format!("{length} {execute}"));
    }
}

#[test]
fn an_ensemble_is_the_weighted_mean_of_all_predictions_for_a_step() {
    let observations = numbers(2 * 23, 4);
    for (length, decay) in [(1, 0.01), (2, 0.01), (6, 0.0), (6, 0.5), (6, -0.5), (40, 0.01)] {
        let policy = load(length, &format!(r#", "chunk": {{"ensemble": {decay}}}"#)).unwrap();
        let found = episode(&policy, &observations);
        let chunks = chunks(length, &observations);
        let mean = |step: usize, i: usize| {
            let first = (step + 1).saturating_sub(length);
            let weight = |run: usize| (-decay * (run - first) as f64).exp();
            let predicted = |run: usize| f64::from(chunks[run][2 * (step - run) + i]);
            let sum: f64 = (first..=step).map(|run| weight(run) * predicted(run)).sum();
            sum / (first..=step).map(weight).sum::<f64>()
        };
        let expected: Vec<f64> = (0..46).map(|index| mean(index / 2, index % 2)).collect();
        assert_near(&found, &expected, &format!("{length} {decay}"));
    }
}

#[test]
fn a_row_depends_neither_on_the_batch_nor_on_episodes_before() {
    for chunk in [r#"{"execute": 3}"#, r#"{"ensemble": 0.1}"#] {
        let policy = load(4, &format!(r#", "chunk": {chunk}"#)).unwrap();
        let size = policy.state_size();
        let rows = 3;
        let steps = 11;
        let observations: Vec<Vec<f32>> = (0..rows).map(|row| numbers(2 * steps, row)).collect();
        let mut worker = policy.worker();
        let mut states = vec![7.0; rows * size];
        let mut found = vec![Vec::new(); rows];
        // Row r starts in step r, within the episodes of the others, and again in step 12.
        for step in 0..12 + steps {
            let mut inputs = vec![0.5; 2 * rows];
            for row in 0..rows {
                let start = if step < 12 { row } else { 12 };
                if step == start {
                    worker.reset(&mut states[row * size..][..size], Seed(0));
                    found[row].clear();
                }
                let place = 2 * (step.saturating_sub(start));
                inputs[2 * row..][..2].copy_from_slice(&observations[row][place.min(2 * steps - 2)..][..2]);
            }
            let mut actions = vec![0.0; 2 * rows];
            worker.act(rows, &inputs, &mut states, &mut actions);
            for row in 0..rows {
                found[row].extend_from_slice(&actions[2 * row..][..2]);
            }
            if step + 1 == 12 {
                let alone = episode(&policy, &observations[0]);
                assert_eq!(found[0][..22], alone[..22], "{chunk}");
                assert_eq!(found[1][..22], episode(&policy, &observations[1])[..22], "{chunk}");
            }
        }
        for row in 0..rows {
            assert_eq!(found[row], episode(&policy, &observations[row]), "{chunk}, row {row}");
        }
    }
}

#[test]
fn a_chunk_that_does_not_fit_is_an_error() {
    let message = |length, chunk: &str| load(length, chunk).unwrap_err();
    for (chunk, words) in [
        ("", "`a` has the shape [1, 4, 2], several actions ahead, and nothing says which are played"),
        (r#", "chunk": {"execute": 5}"#, "`execute` is 5, but the output `a` has 4 actions; expected 1 to 4"),
        (r#", "chunk": {"execute": 0}"#, "`execute` is 0, but the output `a` has 4 actions"),
        (r#", "chunk": {"ensemble": -1000}"#, "the weights exp(-m i) of 4 predictions are not finite"),
        (r#", "chunk": {"play": 1}"#, "unknown variant `play`, expected `execute` or `ensemble`"),
        (r#", "chunk": {"execute": 1, "ensemble": 0}"#, "expected"),
    ] {
        let found = message(4, chunk);
        assert!(found.contains(words), "{chunk}: {found}");
    }
    let found = message(40_000, r#", "chunk": {"ensemble": 0.01}"#);
    assert!(found.contains("its state has more than 65536 numbers, with what it remembers"), "{found}");
    // One action is not a chunk.
    let graph = [value(11, "o", &[1, 2]), node("Neg", &["o"], &["a"]), value(12, "a", &[1, 2])].concat();
    let model = [integer(1, 8), bytes(7, &graph), bytes(8, &integer(2, 13))].concat();
    let side = Interface::from_json(r#"{"chunk": {"execute": 1}}"#).unwrap();
    let found = OnnxPolicy::from_bytes(&model, Some(side), &["test"], &layout()).unwrap_err().to_string();
    assert!(found.contains("`a` has the shape [1, 2]; expected [N, k, SIZE]"), "{found}");
}
