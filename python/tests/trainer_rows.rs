//! Writes the results of training episodes under fixed actions, for comparison with the Python
//! module: the first observations, then rewards, episode ends, final observations and observations
//! of every control step, as bytes.
//!
//! `trainer_rows TASK ENVIRONMENTS SEED TIME_LIMIT STEPS`

use std::io::{Write, stdout};
use std::sync::Arc;

use mishandle::rollout::{Environment, Seed};
use mishandle::tasks::{Preset, Reward, TaskEnvironment};
use mishandle::training::{Boundary, EpisodeSettings, Episodes, ScenarioSettings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments[i].parse::<usize>();
    let environments = number(1)?;
    let seed = number(2)?;
    let time_limit = number(3)?;
    let steps = number(4)?;
    let task = mishandle::resolve::task(&arguments[0])?;
    let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped)?);
    let size = environment.action_size();
    let settings = EpisodeSettings {
        environments,
        time_limit: Some(time_limit),
        staggered: true,
        action_noise: 0.25,
        ..EpisodeSettings::default()
    };
    let mut episodes =
        Episodes::of_training(&environment, &settings, &ScenarioSettings::default(), Seed(seed as u64))?;
    let mut bytes = Vec::new();
    let floats = |bytes: &mut Vec<u8>, numbers: &[f32]| {
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    };
    floats(&mut bytes, episodes.observations());
    for step in 0..steps {
        // From -1.25 to 1.25 in steps of an eighth, which is exact.
        let actions: Vec<f32> =
            (0..environments * size).map(|i| ((step * 5 + i * 7) % 21) as f32 / 8.0 - 1.25).collect();
        episodes.step(&actions)?;
        bytes.extend(episodes.rewards().iter().flat_map(|reward| reward.to_le_bytes()));
        for end in [Boundary::Terminated, Boundary::Truncated] {
            bytes.extend(episodes.boundaries().iter().map(|boundary| u8::from(*boundary == end)));
        }
        floats(&mut bytes, episodes.final_observations());
        floats(&mut bytes, episodes.observations());
    }
    Ok(stdout().write_all(&bytes)?)
}
