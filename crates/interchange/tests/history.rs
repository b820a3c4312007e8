//! Models that get the last observations and images.

use crate::graph::{Of, bytes, integer, integers, node, node_with, typed, value};
use mishandle_controllers::{Entry, Layout};
use mishandle_interchange::{Interface, OnnxPolicy};
use mishandle_rollout::{Controller, Seed};

/// An observation of three joints and two numbers of an object.
fn layout(action: usize) -> Layout {
    let entry = |name: &str, size| Entry { name: name.into(), unit: String::new(), size };
    Layout { observation: vec![entry("joints", 3), entry("object", 2)], action: vec![entry("x", action)] }
}

fn load(parts: &[Vec<u8>], side: &str, action: usize) -> Result<OnnxPolicy, String> {
    let graph = [parts.concat(), value(12, "a", &[1, action as i64])].concat();
    let model = [integer(1, 8), bytes(7, &graph), bytes(8, &integer(2, 13))].concat();
    let interface = Interface::from_json(side).map_err(|error| error.to_string())?;
    OnnxPolicy::from_bytes(&model, Some(interface), &["test"], &layout(action)).map_err(|e| e.to_string())
}

/// A model whose action is its whole input, converted to 32-bit numbers.
fn copy(input: &[u8], is_bytes: bool, action: usize, side: &str) -> Result<OnnxPolicy, String> {
    let mut parts = vec![input.to_vec(), integers("s", &[1, action as i64])];
    let from = if is_bytes { "f" } else { "i" };
    if is_bytes {
        parts.push(node_with("Cast", &["i"], &["f"], &[("to", Of::Number(1))]));
    }
    parts.push(node("Reshape", &[from, "s"], &["a"]));
    load(&parts, side, action)
}

/// Returns the actions of an episode, one for each observation and image.
fn episode(policy: &OnnxPolicy, observations: &[[f32; 5]], images: &[Vec<u8>]) -> Vec<Vec<f32>> {
    let mut worker = policy.worker();
    let mut state = vec![7.0; policy.state_size()];
    worker.reset(&mut state, Seed(0));
    let act = |(step, observation): (usize, &[f32; 5])| {
        if let Some(image) = images.get(step) {
            worker.look(1, image);
        }
        let mut action = vec![0.0; policy.action_size()];
        worker.act(1, observation, &mut state, &mut action);
        action
    };
    observations.iter().enumerate().map(act).collect()
}

fn observations(count: usize) -> Vec<[f32; 5]> {
    (0..count).map(|step| std::array::from_fn(|i| (10 * (step + 1) + i) as f32)).collect()
}

fn image(bytes: usize, seed: usize) -> Vec<u8> {
    (0..bytes)
        .map(|i| (127.5 * (1.0 + (1.7 * (i + 31 * seed) as f32 + (i * i) as f32).sin())) as u8)
        .collect()
}

/// Returns the last `length` entries up to `step`, the oldest first.
fn last<T: Clone>(entries: &[T], step: usize, length: usize, before: &T) -> Vec<T> {
    let at =
        |back: usize| step.checked_sub(back).map_or_else(|| before.clone(), |step| entries[step].clone());
    (0..length).rev().map(at).collect()
}

#[test]
fn a_model_gets_the_last_observations_the_oldest_first() {
    let all = observations(7);
    for length in [1, 2, 4] {
        for (padding, before) in
            [("", [0.0; 5]), (r#", "padding": "zeros""#, [0.0; 5]), (r#", "padding": "first""#, all[0])]
        {
            let side = format!(r#"{{"history": {length}{padding}}}"#);
            let input = value(11, "i", &[1, length as i64, 5]);
            let found = episode(&copy(&input, false, 5 * length, &side).unwrap(), &all, &[]);
            for (step, found) in found.iter().enumerate() {
                assert_eq!(*found, last(&all, step, length, &before).concat(), "{side} {step}");
            }
            // The parts that the policy gets, in its order.
            let side = format!(r#"{{"history": {length}{padding}, "parts": ["object", "joints"]}}"#);
            let found = episode(&copy(&input, false, 5 * length, &side).unwrap(), &all, &[]);
            let moved = |[a, b, c, d, e]: [f32; 5]| [d, e, a, b, c];
            let expected = last(&all, 6, length, &before).into_iter().map(moved).collect::<Vec<_>>();
            assert_eq!(found[6], expected.concat(), "{side}");
        }
    }
}

#[test]
fn a_model_gets_the_last_images_with_each_order_of_channels_and_each_type() {
    let height = 4;
    let width = 7;
    let steps = 6;
    let size = 3 * height * width;
    let images: Vec<Vec<u8>> = (0..steps).map(|step| image(size, step)).collect();
    let all = observations(steps);
    for length in [1, 2, 3] {
        for (name, before) in [("zeros", vec![0; size]), ("first", images[0].clone())] {
            for (channels_first, kind) in [(true, 1), (true, 2), (false, 1), (false, 2)] {
                let shape = if channels_first {
                    [1, length as i64, 3, height as i64, width as i64]
                } else {
                    [1, length as i64, height as i64, width as i64, 3]
                };
                let side =
                    format!(r#"{{"images": [["i", "over"]], "history": {length}, "padding": "{name}"}}"#);
                let policy = copy(&typed(11, "i", &shape, kind), kind == 2, size * length, &side).unwrap();
                assert_eq!(policy.sees().len(), 1);
                assert_eq!((policy.sees()[0].width, policy.sees()[0].height), (width, height));
                let ordered = |rgb: Vec<u8>| -> Vec<u8> {
                    let place = |i: usize| i % (height * width) * 3 + i / (height * width);
                    if channels_first { (0..size).map(|i| rgb[place(i)]).collect() } else { rgb }
                };
                for (step, found) in episode(&policy, &all, &images).into_iter().enumerate() {
                    let expected = last(&images, step, length, &before).into_iter().flat_map(ordered);
                    let scale = if kind == 2 { 1.0 } else { 255.0 };
                    let expected: Vec<f32> = expected.map(|byte| f32::from(byte) / scale).collect();
                    assert_eq!(found, expected, "{side} {shape:?} {kind} {step}");
                }
            }
        }
    }
}

/// A policy of the last three images of one camera, the present one of another, the present joints
/// and chunks of two actions, whose actions are all that it gets.
fn mixed(chunk: &str) -> OnnxPolicy {
    let image = 48;
    let action = 3 * 48 + 48 + 3;
    let parts = [
        value(11, "o", &[1, 3]),
        value(11, "i", &[1, 3, 4, 4, 3]),
        value(11, "j", &[1, 4, 4, 3]),
        integers("si", &[1, 1, 3 * image]),
        integers("sj", &[1, 1, image]),
        integers("so", &[1, 1, 3]),
        node("Reshape", &["i", "si"], &["fi"]),
        node("Reshape", &["j", "sj"], &["fj"]),
        node("Reshape", &["o", "so"], &["fo"]),
        node_with("Concat", &["fi", "fj", "fo"], &["all"], &[("axis", Of::Number(2))]),
        node("Neg", &["all"], &["other"]),
        node_with("Concat", &["all", "other"], &["a"], &[("axis", Of::Number(1))]),
    ];
    let side = format!(
        r#"{{"parts": ["joints"], "images": [["i", "over"], ["j", "wrist"]], "history": 3, "chunk": {chunk}}}"#
    );
    load(&parts, &side, action as usize).unwrap()
}

#[test]
fn the_history_moves_on_while_a_chunk_is_played() {
    let all = observations(9);
    let images = (0..9).map(|step| image(96, step)).collect::<Vec<_>>();
    let found = episode(&mixed(r#"{"execute": 2}"#), &all, &images);
    for (step, found) in found.iter().enumerate() {
        let asked = step - step % 2;
        let over: Vec<Vec<u8>> = images.iter().map(|both| both[..48].to_vec()).collect();
        let seen = [last(&over, asked, 3, &vec![0; 48]).concat(), images[asked][48..].to_vec()].concat();
        let seen = seen.into_iter().map(|byte| f32::from(byte) / 255.0);
        let sign = if step % 2 == 0 { 1.0 } else { -1.0 };
        let expected: Vec<f32> = seen.chain(all[asked][..3].iter().copied()).map(|x| sign * x).collect();
        assert_eq!(*found, expected, "{step}");
    }
}

#[test]
fn a_row_with_a_history_depends_neither_on_the_batch_nor_on_episodes_before() {
    for chunk in [r#"{"execute": 2}"#, r#"{"ensemble": 0.5}"#] {
        let policy = mixed(chunk);
        let size = policy.state_size();
        let actions = policy.action_size();
        let rows = 3;
        let steps = 6;
        let all: Vec<Vec<[f32; 5]>> =
            (0..rows).map(|row| observations(steps + row)[row..].to_vec()).collect();
        let images: Vec<Vec<Vec<u8>>> =
            (0..rows).map(|row| (0..steps).map(|step| image(96, 7 * row + step)).collect()).collect();
        let mut worker = policy.worker();
        let mut states = vec![7.0; rows * size];
        for _ in 0..2 {
            states.chunks_mut(size).for_each(|state| worker.reset(state, Seed(0)));
            let mut found = vec![Vec::new(); rows];
            for step in 0..steps {
                let seen: Vec<u8> = images.iter().flat_map(|row| row[step].clone()).collect();
                let observed: Vec<f32> = all.iter().flat_map(|row| row[step]).collect();
                let mut batch = vec![0.0; rows * actions];
                worker.look(rows, &seen);
                worker.act(rows, &observed, &mut states, &mut batch);
                batch.chunks(actions).zip(&mut found).for_each(|(action, row)| row.push(action.to_vec()));
            }
            for row in 0..rows {
                assert_eq!(found[row], episode(&policy, &all[row], &images[row]), "{chunk}, row {row}");
            }
        }
    }
}

#[test]
fn a_history_that_does_not_fit_is_an_error() {
    let vector = |shape: &[i64], side: &str| copy(&value(11, "i", shape), false, 20, side).unwrap_err();
    for (shape, side, words) in [
        (&[1, 4, 5][..], "{}", "has the shape [1, 4, 5]"),
        (&[1, 4, 5], r#"{"history": 3}"#, "has the shape [1, 4, 5]"),
        (&[4, 5], r#"{"history": 4}"#, "has the shape [4, 5]"),
        (&[1, 5], r#"{"history": 4}"#, "`history` is 4, but no input has the shape [N, 4, …]"),
        (&[1, 5], r#"{"history": 0}"#, "`history` is 0; expected the number of observations, at least 1"),
        (&[1, 5], r#"{"history": -1}"#, "invalid value: integer `-1`"),
        (&[1, 4, 5], r#"{"padding": "first"}"#, "has the shape [1, 4, 5]"),
        (&[1, 5], r#"{"padding": "first"}"#, "`padding` needs `history`"),
        (
            &[1, 4, 5],
            r#"{"history": 4, "padding": "last"}"#,
            "unknown variant `last`, expected `zeros` or `first`",
        ),
        (
            &[1, 40_000, 5],
            r#"{"history": 40000}"#,
            "its state has more than 65536 numbers, with what it remembers",
        ),
    ] {
        let found = vector(shape, side);
        assert!(found.contains(words), "{shape:?} {side}: {found}");
    }
    let seeing = |shape: &[i64], side: &str| copy(&value(11, "i", shape), false, 20, side).unwrap_err();
    for (length, words) in
        [("2", "the image `i` has the shape [1, 3, 4, 4, 3]"), ("4611686018427387904", "[1, 3, 4, 4, 3]")]
    {
        let side = format!(r#"{{"images": [["i", "over"]], "history": {length}}}"#);
        let found = seeing(&[1, 3, 4, 4, 3], &side);
        assert!(found.contains(words), "{found}");
    }
    let many = r#"{"images": [["i", "over"]], "history": 100}"#;
    let found = seeing(&[1, 100, 256, 256, 3], many);
    assert!(found.contains("its state has more than 65536 numbers"), "{found}");
}
