//! A controller that returns an infinite action for some initial states.

use crate::bench;
use std::path::Path;

use crate::bench::{Bench, text, unwrapped};
use mishandle::controllers::{ControllerFile, Policy};
use serde_json::Value;

/// Index of the target's y coordinate in the observation of point-reaching.
const TARGET_Y: usize = 19;

/// Writes a controller of point-reaching whose first action is infinite if the target's y
/// coordinate is more than 0.05 m above `center`, and otherwise finite.
fn write_controller(path: &Path, center: f64) {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../../controllers/point-reaching/ppo.safetensors");
    let mut file = ControllerFile::load(Path::new(shipped)).unwrap();
    let inputs = file.header.layout.observation_size();
    let mut network = file.policy.network().clone();
    let sizes = network.sizes().to_vec();
    network.update(|parameters| {
        parameters.fill(0.0);
        // One neuron per layer passes x = (y - center) / 0.01, clipped to [-5, 5], on to the first
        // output. The output is 0.8e38 x for positive x and at least -0.8e38 otherwise, so it
        // overflows for x > 4.25.
        let mut layer_start = 0;
        for (layer, size) in sizes.windows(2).enumerate() {
            let input = if layer == 0 { TARGET_Y } else { 0 };
            parameters[layer_start + input] = if layer + 2 == sizes.len() { 0.8e38 } else { 1.0 };
            layer_start += (size[0] + 1) * size[1];
        }
    });
    let mut mean = vec![0.0; inputs];
    mean[TARGET_Y] = center;
    let log_std = file.policy.log_std().to_vec();
    file.policy = Policy::new(mean, vec![1e-4; inputs], network, log_std).unwrap();
    file.save(path).unwrap();
}

fn count(document: &Value, key: &str) -> u64 {
    document[key].as_u64().unwrap()
}

#[test]
fn an_infinite_action_ends_its_simulation_and_not_the_run() {
    let bench = Bench::new();
    write_controller(&bench.path("bad.safetensors"), 0.1);
    let evaluate = "evaluate point-reaching --controller bad.safetensors --seed 4 --json";
    let whole = bench.json(&format!("{evaluate} --episodes 40 --out a.sqlite"), 0);
    let invalid = count(&whole, "invalid");
    // 31 % of the box has a target with y above 0.15 m.
    assert!((4..24).contains(&invalid), "{invalid}");
    assert_eq!((count(&whole, "diverged"), count(&whole, "undecided")), (0, 0));
    assert_eq!(whole["success_rate"]["n"], 40);
    assert_eq!(whole["dangerous_behavior_rate"]["n"].as_u64().unwrap(), 40 - invalid);

    // So do the four corners with the larger y.
    for point in whole["corners"]["points"].as_array().unwrap() {
        let ends_early = point["scenario"]["target_y"].as_f64().unwrap() > 0.15;
        assert_eq!((count(point, "n"), count(point, "invalid")), (1, u64::from(ends_early)), "{point}");
        assert_eq!((count(point, "diverged"), count(point, "undecided")), (0, 0));
    }
    let text = bench.check("evaluate --resume a.sqlite --verbose", 0);
    assert!(text.contains("\n         4 simulations ended in a value that is not finite at ("), "{text}");

    // Resuming reads the rows of the invalid simulations, and replaying one gives the same end.
    let resumed = bench.json("evaluate --resume a.sqlite --json", 0);
    assert_eq!(bench::without_run(resumed), bench::without_run(whole));
    let run = mishandle::store::RunFile::open(bench.path("a.sqlite")).unwrap();
    let ends: Vec<(u32, String)> = run
        .trial_simulations(1)
        .map(|simulation| simulation.unwrap())
        .filter(|simulation| simulation.robustness.is_none())
        .map(|simulation| (simulation.number, format!("{:?}", simulation.end)))
        .collect();
    assert_eq!(ends.len() as u64, invalid);
    assert!(ends.iter().all(|(_, end)| end == "InvalidAction { step: 1, index: 0 }"), "{ends:?}");
    let replay = bench.json(&format!("replay a.sqlite --simulation {} --json", ends[0].0), 0);
    assert_eq!(replay["same"], true);
}

#[test]
fn an_infinite_action_is_not_a_counterexample() {
    let bench = Bench::new();
    write_controller(&bench.path("bad.safetensors"), 0.1);
    let falsify = "falsify point-reaching --controller bad.safetensors --seed 2 --trials 2 --json";
    // The arm is shorter than 9 m, so every simulation with a verdict satisfies this formula.
    let formula = "--formula 'always(finger_target_distance <= 9)'";
    let output = bench.run(&format!("{falsify} {formula} --budget 20 --out a.sqlite"));
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{err}");
    let found: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let trials = found["trials"].as_array().unwrap();
    let invalid: u64 = trials.iter().map(|trial| count(trial, "invalid")).sum();
    assert!((1..40).contains(&invalid), "{invalid}");
    assert!(trials.iter().all(|trial| count(trial, "simulations") == 20 && trial["falsified"] == false));
    assert!(err.contains("returned an action that is not finite in control step 1 (index 0)"), "{err}");
}

#[test]
fn a_campaign_without_any_verdict_is_an_error() {
    let bench = Bench::new();
    write_controller(&bench.path("bad.safetensors"), -9.0);
    let falsify = "falsify point-reaching --controller bad.safetensors --trials 2 --budget 3 --out a.sqlite";
    let output = bench.run(falsify);
    let out = text(&output.stdout);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{err}");
    assert!(
        unwrapped(&out).starts_with(
            "NO VERDICT none of 6 simulations has a verdict: 6 ended in a value that is not finite"
        ),
        "{out}"
    );
    assert!(err.contains("no simulation has a verdict"), "{err}");
    let evaluate = "evaluate point-reaching --controller bad.safetensors --episodes 2 --out b.sqlite";
    let output = bench.run(evaluate);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("no simulation has a verdict"));
    let replay = bench.check("replay b.sqlite --simulation 1", 0);
    assert!(replay.contains("returned an action that is not finite in control step 1 (index 0)"), "{replay}");
}
