//! What a controller was trained on, as one hash.

use std::fmt::Write;

use mishandle_controllers::bytes_hash;
use mishandle_rollout::{Environment, Sample, Seed, Stream};

use crate::definition::{Preset, Reward, Task};
use crate::document::compose;
use crate::environment::{TaskEnvironment, TaskError};

/// Starts that are looked at.
const STARTS: u64 = 4;

/// Control steps from each of them: few, so that what is chaotic has no time to grow.
const STEPS: u64 = 30;

/// Control steps that an action lasts: long enough for the arm to get somewhere.
const ACTION_STEPS: u64 = 10;

/// Decimals that count. What differs below may be another compiler's rounding.
const DECIMALS: f64 = 1e5;

/// Hash of all that a controller of `task` learns from: the physics, the starts, what is observed, the reward, and when an
/// episode ends. The formulas are not in it: they judge a controller, and another judge makes no other controller.
///
/// It is taken of what the task states (the scene without comments and colors, the box, the layout, the reward's terms and
/// the rule of termination in words), and of what the environment does in a few control steps of fixed actions, rounded:
/// so a change of code shows too. What neither shows, such as a slip mended in a rare branch, has to be told in the words
/// of the task, as it should.
///
/// # Errors
/// If the scene does not compile or the task's data do not fit each other.
pub fn task_hash(task: &dyn Task, reward: Reward) -> Result<String, TaskError> {
    let definition = task.definition();
    let environment = TaskEnvironment::new(task, Preset::Paper, reward)?;
    let scene_error = |source| TaskError::Scene { task: definition.name, source };
    let mut text = without_looks(&compose(task).map_err(scene_error)?);
    let mut line = |words: String| text.push_str(&(words + "\n"));
    line(definition.layout().hash());
    line(format!("start noise {}, velocities times {}", definition.start_noise, definition.velocity_scale));
    for axis in definition.initial_box {
        line(format!("{} from {:?} {}", axis.name, axis.paper, axis.unit));
    }
    for term in definition.reward(reward) {
        line(format!("{} = {}", term.name, term.meaning));
    }
    line(format!("{:?}", definition.grip));
    line(definition.termination.to_string());
    line(behavior(&environment));
    Ok(bytes_hash(text.as_bytes()))
}

/// What a task states of itself under a preset: scene, robot's start, layout, initial box, axes, formulas, as text.
pub(crate) fn stated(task: &dyn Task, preset: Preset) -> Result<String, TaskError> {
    let definition = task.definition();
    let xml = compose(task).map_err(|source| TaskError::Scene { task: definition.name, source })?;
    let starts: Vec<_> = definition.initial_box.iter().map(|axis| (axis.name, axis.bounds(preset))).collect();
    let signals: Vec<_> = definition.signals.iter().map(|signal| signal.name).collect();
    Ok(format!(
        "{}{}\nstart {:?} noise {} velocities times {} grip {:?}\n{starts:?}\n{signals:?}\n{:?}\n{:?}\n",
        without_looks(&xml),
        definition.layout().hash(),
        definition.start,
        definition.start_noise,
        definition.velocity_scale,
        definition.grip,
        definition.variations,
        definition.formulas(preset),
    ))
}

/// A document without comments, colors and indentation.
fn without_looks(xml: &str) -> String {
    let mut rest = xml;
    let mut text = String::new();
    while let Some((before, after)) = rest.split_once("<!--") {
        text.push_str(before);
        rest = after.split_once("-->").map_or("", |(_, after)| after);
    }
    text.push_str(rest);
    while let Some(start) = text.find(" rgba=\"") {
        let value = start + " rgba=\"".len();
        let end = text[value..].find('"').map_or(text.len(), |length| value + length + 1);
        text.replace_range(start..end, "");
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ") + "\n"
}

/// Observations, rewards and endings of a few control steps, as rounded whole numbers.
fn behavior(environment: &TaskEnvironment) -> String {
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut action = vec![0.0; environment.action_size()];
    let mut seen = String::new();
    for start in 0..STARTS {
        let seed = Seed(start);
        let mut sample =
            Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        worker.reset(&environment.space().sample(seed, start), seed, &mut state, sample);
        for step in 0..STEPS {
            for (joint, action) in (0..).zip(&mut action) {
                *action = 2.0 * seed.uniform(Stream::ActionNoise, step / ACTION_STEPS, joint) - 1.0;
            }
            sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
            let status = worker.step(&action, &mut state, sample);
            let numbers = observation.iter().map(|x| f64::from(*x)).chain(rewards.iter().copied());
            for number in numbers {
                let _ = write!(seen, "{} ", (number * DECIMALS).round() as i64);
            }
            let _ = writeln!(seen, "{status:?}");
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::sync::Arc;

    use mishandle_rollout::Controller;
    use mishandle_world::{Model, WorldError};

    use super::*;
    use crate::{Definition, Panda, Scene, TASKS, task};

    #[test]
    fn tasks_and_rewards_differ_and_a_hash_repeats() {
        let hash = |task: &dyn Task, reward| task_hash(task, reward).unwrap();
        let mut all: Vec<String> = TASKS.iter().map(|task| hash(*task, Reward::Shaped)).collect();
        let reaching = task("point-reaching").unwrap();
        assert_eq!(hash(reaching, Reward::Shaped), all[0]);
        all.push(hash(reaching, Reward::Original));
        let count = all.len();
        all.sort();
        all.dedup();
        assert_eq!(all.len(), count);
    }

    /// A task with another definition, and with text put before its scene.
    struct Changed {
        base: &'static dyn Task,
        definition: &'static Definition,
        scene: &'static str,
    }

    impl Task for Changed {
        fn definition(&self) -> &'static Definition {
            self.definition
        }

        fn scene(&self) -> Cow<'static, str> {
            format!("{}{}", self.scene, self.base.scene()).into()
        }

        fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
            self.base.bind(model, panda)
        }

        fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
            self.base.expert()
        }
    }

    #[track_caller]
    fn check(scene: &'static str, change: impl Fn(&mut Definition), is_other: bool) {
        let base = task("point-reaching").unwrap();
        let mut definition = *base.definition();
        change(&mut definition);
        let changed = Changed { base, definition: Box::leak(Box::new(definition)), scene };
        let hash = |task: &dyn Task| task_hash(task, Reward::Shaped).unwrap();
        assert_eq!(hash(&changed) != hash(base), is_other);
    }

    #[test]
    fn what_is_learned_from_counts_and_what_judges_does_not() {
        check("", |_| {}, false);
        check("", |definition| definition.paper.success = definition.paper.strict, false);
        check("", |definition| definition.summary = "another", false);
        check("<!-- a word -->", |_| {}, false);
        check("", |definition| definition.n_substeps *= 2, true);
        check("", |definition| definition.start_noise += 0.01, true);
        check("", |definition| definition.start[0] += 0.01, true);
        check("", |definition| definition.velocity_scale *= 2.0, true);
        let reversed = |definition: &Definition| {
            definition.original_reward.iter().rev().copied().collect::<Vec<_>>().leak()
        };
        check("", |definition| definition.original_reward = reversed(definition), false);
        check("<option gravity=\"0 0 -9.80\"/>", |_| {}, true);
    }

    #[test]
    fn comments_colors_and_indentation_are_left_out_and_nothing_else() {
        let plain = "<geom size=\"1\"/> <geom mass=\"2\"/>\n";
        let told = "<geom size=\"1\" rgba=\"1 0 0 1\"/>\n  <!-- heavy -->\n  <geom mass=\"2\"/>";
        assert_eq!(without_looks(told), plain);
        assert_eq!(without_looks(plain), plain);
    }
}
