//! `policy.std_floor`: the smallest standard deviation by which a policy divides its observations.

use crate::keeper::Keeper;
use crate::line::Line;
use mishandle_controllers::Policy;
use mishandle_rollout::Seed;
use mishandle_training::{AlgorithmSettings, Checkpoint, Origin};

fn train(algorithm: &str, policy: &str, resume: Option<&Checkpoint>, stops: bool) -> (Policy, Checkpoint) {
    let own = match algorithm {
        "ppo" => "rollout_steps = 12\nminibatch_size = 48",
        "trpo" => "rollout_steps = 12",
        _ => "steps_per_iteration = 12\nreplay = { warmup_steps = 50, batch_size = 32 }",
    };
    let text = format!(
        "run.total_steps = 600\nepisodes.environments = 8\npolicy = {{ hidden = [8]{policy} }}\n\
         critic.hidden = [8]\n{own}"
    );
    let settings = AlgorithmSettings::from_toml(algorithm, &text).unwrap().unwrap();
    let mut keeper = Keeper { stop_after: stops.then_some(1), ..Keeper::default() };
    let result = settings
        .train(&Line::new(0.05), Seed(5), resume.map_or(Origin::New, Origin::Checkpoint), &mut keeper)
        .unwrap();
    (result.last, keeper.checkpoint.unwrap())
}

#[test]
fn every_algorithm_keeps_the_floor_and_its_absence_keeps_the_bits() {
    for algorithm in ["ppo", "trpo", "sac", "td3", "ddpg"] {
        // Points on a line are between -1.5 and 1.5, so their standard deviation is below 1.
        let (floored, _) = train(algorithm, ", std_floor = 1.0", None, false);
        assert_eq!(floored.variance(), [1.0, 1.0], "{algorithm}");
        let (plain, _) = train(algorithm, "", None, false);
        assert!(plain.variance().iter().all(|variance| *variance < 1.0), "{algorithm}");
        for same in [", std_floor = 0.0", ", std_floor = 1e-6"] {
            assert_eq!(train(algorithm, same, None, false).0.hash(), plain.hash(), "{algorithm}{same}");
        }
        let (_, checkpoint) = train(algorithm, ", std_floor = 1.0", None, true);
        let (resumed, _) = train(algorithm, ", std_floor = 1.0", Some(&checkpoint), false);
        assert_eq!(resumed.hash(), floored.hash(), "{algorithm}");
        // Without normalization there is nothing to bound.
        let (raw, _) = train(algorithm, ", normalize_observations = false, std_floor = 1.0", None, false);
        assert_eq!((raw.mean(), raw.variance()), (&[0.0; 2][..], &[1.0; 2][..]), "{algorithm}");
    }
}
