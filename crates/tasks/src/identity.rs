//! Hashes that identify tasks and targets.
//!
//! Run files and controller files store these hashes. The hashed texts must therefore never depend
//! on the names of types, fields or functions, only on what the task defines.

use std::fmt::Write;

use mishandle_controllers::bytes_hash;
use mishandle_rollout::{Environment, Identity, Noise, Sample, Seed, Stream};

use crate::definition::{GripperMode, Preset, Reward, Task, TaskFormulas, Variations};
use crate::document::compose;
use crate::environment::{TaskEnvironment, TaskError};

/// Number of initial states of [`behavior`].
const STARTS: u64 = 4;

/// Control steps from each initial state. There are few, so that chaotic motion cannot amplify
/// rounding errors.
const STEPS: u64 = 30;

/// Control steps with the same action, so that the arm moves a visible distance.
const ACTION_STEPS: u64 = 10;

/// Reciprocal of the resolution of the hashed numbers. Smaller differences may be rounding errors
/// of another compiler.
const DECIMALS: f64 = 1e5;

/// Returns the hash of everything that determines the training of a controller of `task`: physics,
/// initial states, observation, reward and termination.
///
/// The formulas are not hashed, because they only evaluate a controller.
///
/// The hash covers the definition of the task (scene without comments and colors, initial box,
/// layout, reward terms and termination rule as text) and the rounded behavior of the environment
/// over a few control steps, so that it also covers changes of the code. It does not cover a
/// changed branch that these steps do not reach; such a change must be described in the texts of
/// the task.
///
/// # Errors
/// If the scene does not compile or the definition is inconsistent.
pub fn task_hash(task: &dyn Task, reward: Reward) -> Result<String, TaskError> {
    let definition = task.definition();
    let environment = TaskEnvironment::new(task, Preset::Paper, reward)?;
    let scene_error = |source| TaskError::Scene { task: definition.name, source };
    let mut text = without_appearance(&compose(task).map_err(scene_error)?);
    let mut line = |content: String| text.push_str(&(content + "\n"));
    line(definition.layout().hash());
    line(format!("start noise {}, velocities times {}", definition.start_noise, definition.velocity_scale));
    for axis in definition.initial_box {
        line(format!("{} from {:?} {}", axis.name, axis.paper, axis.unit));
    }
    for term in definition.reward(reward) {
        line(format!("{} = {}", term.name, term.meaning));
    }
    line(gripper_text(definition.grip));
    line(definition.termination.to_string());
    line(behavior(&environment));
    Ok(bytes_hash(text.as_bytes()))
}

/// Returns the identity of a task as a target, under a preset, with a controller of this hash and
/// noise.
///
/// # Errors
/// If the scene does not compile.
pub fn target_identity(
    task: &dyn Task,
    preset: Preset,
    controller_hash: &str,
    noise: Noise,
) -> Result<Identity, TaskError> {
    let Noise { action_std, observation_std } = noise;
    let text = format!(
        "{}controller {controller_hash}\naction noise {action_std}\nobservation noise {observation_std}\n",
        definition_text(task, preset)?,
    );
    Ok(Identity::new("task", task.definition().name, &text))
}

/// Returns the definition of a task under a preset as text: scene, initial pose, layout, initial
/// box, axes and formulas.
///
/// # Errors
/// If the scene does not compile.
fn definition_text(task: &dyn Task, preset: Preset) -> Result<String, TaskError> {
    let definition = task.definition();
    let xml = compose(task).map_err(|source| TaskError::Scene { task: definition.name, source })?;
    let starts: Vec<_> = definition.initial_box.iter().map(|axis| (axis.name, axis.bounds(preset))).collect();
    let signals: Vec<_> = definition.signals.iter().map(|signal| signal.name).collect();
    Ok(format!(
        "{}{}\nstart {:?} noise {} velocities times {} grip {}\n{starts:?}\n{signals:?}\n{}\n{}\n",
        without_appearance(&xml),
        definition.layout().hash(),
        definition.start,
        definition.start_noise,
        definition.velocity_scale,
        gripper_text(definition.grip),
        variations_text(&definition.variations),
        formulas_text(definition.formulas(preset)),
    ))
}

fn gripper_text(mode: GripperMode) -> String {
    match mode {
        GripperMode::Fixed(opening) => format!("Fixed({opening:?})"),
        GripperMode::Scene(rule) => format!("Scene({rule:?})"),
    }
}

fn variations_text(variations: &Variations) -> String {
    // Axes that were added later do not change an episode without them, so they are not hashed.
    let Variations { friction, masses, push, jump, sizes: _, thrown: _ } = variations;
    format!("Variations {{ friction: {friction:?}, masses: {masses:?}, push: {push:?}, jump: {jump:?} }}")
}

fn formulas_text(formulas: &TaskFormulas) -> String {
    let TaskFormulas { success, strict, careful: _, safe, completion } = formulas;
    let careful = formulas.careful().unwrap_or_default();
    format!(
        "Formulas {{ success: {success:?}, strict: {strict:?}, careful: {careful:?}, safe: {safe:?}, \
         completion: {completion:?} }}"
    )
}

/// Returns a document without comments, colors and indentation.
fn without_appearance(xml: &str) -> String {
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

/// Returns the observations, rewards and statuses of a few control steps under fixed actions, as
/// rounded integers.
fn behavior(environment: &TaskEnvironment) -> String {
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut action = vec![0.0; environment.action_size()];
    let mut text = String::new();
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
                let _ = write!(text, "{} ", (number * DECIMALS).round() as i64);
            }
            let _ = writeln!(text, "{status:?}");
        }
    }
    text
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
    fn every_task_and_reward_has_its_own_reproducible_hash() {
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

    #[test]
    fn hashed_texts_do_not_depend_on_names_of_types() {
        let text = definition_text(task("ball-pushing").unwrap(), Preset::Paper).unwrap();
        let expected = "grip Fixed(0.015)\n\
            [(\"ball_x\", [0.4, 0.6]), (\"ball_y\", [-0.1, 0.1])]\n\
            [\"ball_hole_distance\", \"ball_hole_horizontal_distance\", \"ball_height\", \"ball_speed\", \
            \"finger_ball_distance\"]\n\
            Variations { friction: true, masses: [\"ball\"], push: Some((\"ball\", 0.1)), jump: None }\n\
            Formulas { success: \"eventually[0:300](ball_hole_distance <= 0.3)\", \
            strict: \"eventually[0:270](always[0:30](ball_hole_horizontal_distance <= 0.15 and ball_height <= 0.36))\", \
            careful: \"CAREFUL\", safe: \"ball_hole_distance <= 0.5\", completion: \"always[0:4](ball_hole_distance <= 0.3)\" }\n";
        let careful = task("ball-pushing").unwrap().definition().paper.careful().unwrap();
        assert!(text.ends_with(&expected.replace("CAREFUL", &careful)), "{text}");
        assert_eq!(gripper_text(GripperMode::Scene("a \"rule\"")), r#"Scene("a \"rule\"")"#);
    }

    /// A task with another definition, and with a prefix of its scene.
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
    fn check(scene: &'static str, change: impl Fn(&mut Definition), changes_hash: bool) {
        let base = task("point-reaching").unwrap();
        let mut definition = *base.definition();
        change(&mut definition);
        let changed = Changed { base, definition: Box::leak(Box::new(definition)), scene };
        let hash = |task: &dyn Task| task_hash(task, Reward::Shaped).unwrap();
        assert_eq!(hash(&changed) != hash(base), changes_hash);
    }

    #[test]
    fn the_hash_covers_training_but_not_evaluation() {
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
    fn comments_colors_and_indentation_are_removed() {
        let plain = "<geom size=\"1\"/> <geom mass=\"2\"/>\n";
        let decorated = "<geom size=\"1\" rgba=\"1 0 0 1\"/>\n  <!-- heavy -->\n  <geom mass=\"2\"/>";
        assert_eq!(without_appearance(decorated), plain);
        assert_eq!(without_appearance(plain), plain);
    }
}
