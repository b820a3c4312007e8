//! Mistakes in a user's task are errors that name the task and the field before the first episode.

use std::borrow::Cow;
use std::error::Error;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_tasks::{
    BoxAxis, Definition, Panda, Preset, Quantity, Reward, Scene, Task, TaskEnvironment, TaskFormulas,
    Variations, add, scalar, task, vector3,
};
use mishandle_world::{Model, Rows, World, WorldError};

/// A scene whose functions write these numbers of values.
#[derive(Clone, Copy)]
struct WriteCounts {
    signals: usize,
    observe: usize,
    reward: usize,
    place: usize,
}

/// A task with a mistake.
struct InvalidTask {
    definition: &'static Definition,
    scene: String,
    counts: WriteCounts,
}

impl Task for InvalidTask {
    fn definition(&self) -> &'static Definition {
        self.definition
    }

    fn scene(&self) -> Cow<'static, str> {
        self.scene.clone().into()
    }

    fn scene_file(&self) -> &'static str {
        "my_task/scene.xml"
    }

    fn bind(&self, _model: &Model, _panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(self.counts))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        task("ball-balancing").unwrap().expert()
    }
}

/// Writes `count` numbers and panics if the buffer is shorter, like a scene.
fn write(count: usize, out: &mut [f64]) {
    (0..count).for_each(|i| out[i] = i as f64);
}

impl Scene for WriteCounts {
    fn place(&self, x0: &[f64], _world: &mut World) {
        assert!(x0.iter().sum::<f64>() + x0[self.place - 1] < 10.0);
    }

    fn signals(&self, _rows: &Rows<'_>, out: &mut [f64]) {
        write(self.signals, out);
    }

    fn observe(&self, _rows: &Rows<'_>, out: &mut [f64]) {
        write(self.observe, out);
    }

    fn reward(&self, _: Reward, _: &Rows<'_>, _: &[f64], _: &[f64], out: &mut [f64]) {
        write(self.reward, out);
    }

    fn is_terminal(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}

const FORMULAS: TaskFormulas =
    TaskFormulas { success: "a > 0", strict: "a > 0", careful: None, safe: "a > 0", completion: "a > 0" };
const VALID: WriteCounts = WriteCounts { signals: 2, observe: 4, reward: 1, place: 1 };

fn leak<T>(list: Vec<T>) -> &'static [T] {
    list.leak()
}

/// Returns a valid definition with two signals, four observed numbers, one reward term and one
/// axis.
fn valid_definition() -> Definition {
    Definition {
        name: "wrong-task",
        variant_of: None,
        held: None,
        signals: leak(vec![scalar("a", "m", ""), scalar("b", "m", "")]),
        observation: leak(vec![vector3("place", "m", ""), scalar("speed", "m/s", "")]),
        original_reward: leak(vec![scalar("near", "", "")]),
        shaped_reward: leak(vec![scalar("near", "", "")]),
        initial_box: leak(vec![BoxAxis {
            name: "x",
            unit: "m",
            paper: [0.0, 1.0],
            code: [0.0, 1.0],
            meaning: "",
        }]),
        paper: FORMULAS,
        code: FORMULAS,
        variations: Variations::NONE,
        ..*task("point-reaching").unwrap().definition()
    }
}

fn environment(change: impl FnOnce(&mut Definition), scene: &str, counts: WriteCounts) -> Result<(), String> {
    let mut definition = valid_definition();
    change(&mut definition);
    let task = InvalidTask { definition: Box::leak(Box::new(definition)), scene: scene.to_string(), counts };
    TaskEnvironment::new(&task, Preset::Paper, Reward::Shaped).map(drop).map_err(|error| {
        let source = error.source().map(|source| format!(": {source}"));
        format!("{error}{}", source.unwrap_or_default())
    })
}

#[test]
fn a_valid_task_has_an_environment() {
    assert_eq!(environment(|_| (), "", VALID), Ok(()));
}

#[test]
fn mistakes_in_the_definition_name_task_and_field() {
    type Change = fn(&mut Definition);
    let cases: [(&str, Change, &str); 18] = [
        ("name", |d| d.name = "my task", "expected letters"),
        ("n_substeps", |d| d.n_substeps = 0, "expected at least 1, found 0"),
        ("start", |d| d.start[3] = f64::NAN, "expected finite numbers"),
        ("start_noise", |d| d.start_noise = -0.1, "found -0.1"),
        ("velocity_scale", |d| d.velocity_scale = 0.0, "found 0"),
        (
            "signals",
            |d| d.signals = leak(vec![scalar("a", "", ""), scalar("a", "", "")]),
            "two entries have the name `a`",
        ),
        (
            "signals",
            |d| d.signals = leak(vec![scalar("a b", "", "")]),
            "formulas cannot contain the name `a b`",
        ),
        ("signals", |d| d.signals = leak(vec![vector3("a", "", "")]), "`a` has size 3; expected 1"),
        (
            "observation",
            |d| d.observation = leak(vec![scalar("speed", "", ""), vector3("speed", "", "")]),
            "`speed`",
        ),
        (
            "observation",
            |d| d.observation = leak(vec![scalar("joint_velocities", "", "")]),
            "`joint_velocities`",
        ),
        (
            "observation",
            |d| d.observation = leak(vec![Quantity { name: "z", unit: "", size: 0, meaning: "" }]),
            "`z` has size 0",
        ),
        (
            "original_reward",
            |d| d.original_reward = leak(vec![scalar("n", "", ""), scalar("n", "", "")]),
            "`n`",
        ),
        ("shaped_reward", |d| d.shaped_reward = leak(vec![vector3("n", "", "")]), "`n` has size 3"),
        (
            "initial_box",
            |d| d.initial_box = leak(vec![valid_definition().initial_box[0]; 2]),
            "two entries have the name `x`",
        ),
        (
            "signals",
            |d| d.signals = leak(vec![scalar("tool_speed", "", "")]),
            "the name of a signal of every task",
        ),
        ("careful", |d| d.code.careful = Some(&["tool_sped < 1"]), "there is no signal `tool_sped`"),
        ("safe", |d| d.paper.safe = "c > 0", "there is no signal `c`; available signals: a, b"),
        ("strict", |d| d.code.strict = "a >", "`a >`"),
    ];
    for (field, change, problem) in cases {
        let error = environment(change, "", VALID).unwrap_err();
        let name = if field == "name" { "my task" } else { "wrong-task" };
        assert!(error.starts_with(&format!("task {name}, field `{field}`: ")), "{error}");
        assert!(error.contains(problem), "{error}");
    }
}

#[test]
fn an_object_that_the_scene_lacks_is_an_error() {
    let error = environment(|d| d.object = Some("cup"), "", VALID).unwrap_err();
    assert!(error.starts_with("task wrong-task") && error.contains("`cup`"), "{error}");
}

#[test]
fn bounds_out_of_order_are_an_error_with_the_name_of_the_axis() {
    let axis = BoxAxis { name: "x", unit: "m", paper: [0.0, 1.0], code: [1.0, 0.0], meaning: "" };
    let error = environment(|d| d.initial_box = leak(vec![axis]), "", VALID).unwrap_err();
    assert!(error.contains("field `initial_box`: axis `x` has bounds [1.0, 0.0]"), "{error}");
}

#[test]
fn a_scene_that_writes_too_few_or_too_many_numbers_is_an_error() {
    for (counts, field, problem) in [
        (
            WriteCounts { signals: 1, ..VALID },
            "signals",
            "`Scene::signals` does not write number 1 of 2 (`b`)",
        ),
        (
            WriteCounts { signals: 3, ..VALID },
            "signals",
            "`Scene::signals` panics with 2 numbers: index out of",
        ),
        (WriteCounts { observe: 2, ..VALID }, "observation", "does not write number 2 of 4 (`place`)"),
        (WriteCounts { observe: 3, ..VALID }, "observation", "does not write number 3 of 4 (`speed`)"),
        (WriteCounts { observe: 5, ..VALID }, "observation", "`Scene::observe` panics with 4 numbers"),
        (WriteCounts { reward: 0, ..VALID }, "original_reward", "does not write number 0 of 1 (`near`)"),
        (WriteCounts { reward: 2, ..VALID }, "original_reward", "`Scene::reward` panics with 1 numbers"),
        (WriteCounts { place: 2, ..VALID }, "initial_box", "`Scene::place` panics with 1 numbers"),
    ] {
        let error = environment(|_| (), "", counts).unwrap_err();
        assert!(error.starts_with(&format!("task wrong-task, field `{field}`: ")), "{error}");
        assert!(error.contains(problem), "{error}");
    }
}

#[test]
fn errors_in_the_scene_contain_its_file_and_line() {
    let scene = |line: &str| format!("<!-- one -->\n<worldbody>\n  {line}\n</worldbody>\n");
    for (line, problem) in [
        // The first two are errors of the parser, the third one is an error of the compiler.
        ("<geom type=\"box\" siez=\"1 1 1\"/>", "unrecognized attribute: 'siez'"),
        ("<goem type=\"box\"/>", "unrecognized element"),
        ("<body><freejoint/></body>", "mass and inertia"),
    ] {
        let error = environment(|_| (), &scene(line), VALID).unwrap_err();
        assert!(error.starts_with("task wrong-task: MuJoCo cannot compile the model: "), "{error}");
        assert!(error.contains("my_task/scene.xml:3") && error.contains(problem), "{error}");
        assert!(error.ends_with(&format!(": `{line}`")), "{error}");
    }
}

#[test]
fn a_task_with_a_known_name_cannot_be_added() {
    let new = |change: fn(&mut Definition)| -> &'static dyn Task {
        let mut definition = valid_definition();
        change(&mut definition);
        let definition = Box::leak(Box::new(definition));
        Box::leak(Box::new(InvalidTask { definition, scene: String::new(), counts: VALID }))
    };
    let error = |change| add(new(change)).unwrap_err().to_string();
    let taken = "field `name`: another task has the same name";
    assert_eq!(error(|d| d.name = "ball-pushing"), format!("task ball-pushing, {taken}"));
    assert_eq!(
        error(|d| d.variant_of = Some("x")),
        "task wrong-task, field `variant_of`: there is no task `x`"
    );
    assert_eq!(
        error(|d| d.n_substeps = 0),
        "task wrong-task, field `n_substeps`: expected at least 1, found 0"
    );
    add(new(|_| ())).unwrap();
    assert_eq!(error(|_| ()), format!("task wrong-task, {taken}"));
}
