//! Mistakes in a user's task are errors that name the task and the field, before any episode runs.

#![allow(clippy::unwrap_used)]

use std::borrow::Cow;
use std::error::Error;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_tasks::{
    BoxAxis, Definition, Panda, Preset, Quantity, Reward, Scene, Task, TaskEnvironment, TaskFormulas,
    Variations, add, one, task, three,
};
use mishandle_world::{Model, Rows, World, WorldError};

/// How many numbers the functions of [`Wrong`]'s scene write.
#[derive(Clone, Copy)]
struct Written {
    signals: usize,
    observe: usize,
    reward: usize,
    place: usize,
}

/// Ball balancing with a mistake in it.
struct Wrong {
    definition: &'static Definition,
    scene: String,
    written: Written,
}

impl Task for Wrong {
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
        Ok(Box::new(self.written))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        task("ball-balancing").unwrap().expert()
    }
}

/// Writes beyond the end of a row that is too short, as a scene would.
fn write(count: usize, out: &mut [f64]) {
    (0..count).for_each(|i| out[i] = i as f64);
}

impl Scene for Written {
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

    fn lost(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}

const FORMULAS: TaskFormulas =
    TaskFormulas { success: "a > 0", strict: "a > 0", safe: "a > 0", completion: "a > 0" };
const RIGHT: Written = Written { signals: 2, observe: 4, reward: 1, place: 1 };

fn kept<T>(list: Vec<T>) -> &'static [T] {
    list.leak()
}

/// A definition without a mistake: two signals, four observed numbers, one reward term, one axis.
fn right() -> Definition {
    Definition {
        name: "wrong-task",
        variant_of: None,
        held: None,
        signals: kept(vec![one("a", "m", ""), one("b", "m", "")]),
        observation: kept(vec![three("place", "m", ""), one("speed", "m/s", "")]),
        original_reward: kept(vec![one("near", "", "")]),
        shaped_reward: kept(vec![one("near", "", "")]),
        initial_box: kept(vec![BoxAxis {
            name: "x",
            unit: "m",
            paper: [0.0, 1.0],
            code: [0.0, 1.0],
            sets: "",
        }]),
        paper: FORMULAS,
        code: FORMULAS,
        variations: Variations::NONE,
        ..*task("point-reaching").unwrap().definition()
    }
}

fn environment(change: impl FnOnce(&mut Definition), scene: &str, written: Written) -> Result<(), String> {
    let mut definition = right();
    change(&mut definition);
    let wrong = Wrong { definition: Box::leak(Box::new(definition)), scene: scene.to_string(), written };
    TaskEnvironment::new(&wrong, Preset::Paper, Reward::Shaped).map(drop).map_err(|error| {
        let source = error.source().map(|source| format!(": {source}"));
        format!("{error}{}", source.unwrap_or_default())
    })
}

#[test]
fn a_task_without_a_mistake_is_built() {
    assert_eq!(environment(|_| (), "", RIGHT), Ok(()));
}

#[test]
fn mistakes_in_the_definition_name_task_and_field() {
    type Change = fn(&mut Definition);
    let cases: [(&str, Change, &str); 16] = [
        ("name", |d| d.name = "my task", "expected letters"),
        ("n_substeps", |d| d.n_substeps = 0, "expected at least 1, found 0"),
        ("start", |d| d.start[3] = f64::NAN, "expected finite numbers"),
        ("start_noise", |d| d.start_noise = -0.1, "found -0.1"),
        ("velocity_scale", |d| d.velocity_scale = 0.0, "found 0"),
        (
            "signals",
            |d| d.signals = kept(vec![one("a", "", ""), one("a", "", "")]),
            "two entries have the name `a`",
        ),
        ("signals", |d| d.signals = kept(vec![one("a b", "", "")]), "formulas cannot contain the name `a b`"),
        ("signals", |d| d.signals = kept(vec![three("a", "", "")]), "`a` has size 3; expected 1"),
        (
            "observation",
            |d| d.observation = kept(vec![one("speed", "", ""), three("speed", "", "")]),
            "`speed`",
        ),
        (
            "observation",
            |d| d.observation = kept(vec![one("joint_velocities", "", "")]),
            "`joint_velocities`",
        ),
        (
            "observation",
            |d| d.observation = kept(vec![Quantity { name: "z", unit: "", size: 0, meaning: "" }]),
            "`z` has size 0",
        ),
        ("original_reward", |d| d.original_reward = kept(vec![one("n", "", ""), one("n", "", "")]), "`n`"),
        ("shaped_reward", |d| d.shaped_reward = kept(vec![three("n", "", "")]), "`n` has size 3"),
        (
            "initial_box",
            |d| d.initial_box = kept(vec![right().initial_box[0]; 2]),
            "two entries have the name `x`",
        ),
        ("safe", |d| d.paper.safe = "c > 0", "there is no signal `c`; there are: a, b"),
        ("strict", |d| d.code.strict = "a >", "`a >`"),
    ];
    for (field, change, problem) in cases {
        let said = environment(change, "", RIGHT).unwrap_err();
        let name = if field == "name" { "my task" } else { "wrong-task" };
        assert!(said.starts_with(&format!("task {name}, field `{field}`: ")), "{said}");
        assert!(said.contains(problem), "{said}");
    }
}

#[test]
fn an_axis_with_bounds_out_of_order_is_named() {
    let axis = BoxAxis { name: "x", unit: "m", paper: [0.0, 1.0], code: [1.0, 0.0], sets: "" };
    let said = environment(|d| d.initial_box = kept(vec![axis]), "", RIGHT).unwrap_err();
    assert!(said.contains("field `initial_box`: axis `x` has bounds [1.0, 0.0]"), "{said}");
}

#[test]
fn too_few_and_too_many_numbers_are_found_before_an_episode() {
    for (written, field, problem) in [
        (Written { signals: 1, ..RIGHT }, "signals", "`Scene::signals` does not write number 1 of 2 (`b`)"),
        (Written { signals: 3, ..RIGHT }, "signals", "`Scene::signals` panics with 2 numbers: index out of"),
        (Written { observe: 2, ..RIGHT }, "observation", "does not write number 2 of 4 (`place`)"),
        (Written { observe: 3, ..RIGHT }, "observation", "does not write number 3 of 4 (`speed`)"),
        (Written { observe: 5, ..RIGHT }, "observation", "`Scene::observe` panics with 4 numbers"),
        (Written { reward: 0, ..RIGHT }, "original_reward", "does not write number 0 of 1 (`near`)"),
        (Written { reward: 2, ..RIGHT }, "original_reward", "`Scene::reward` panics with 1 numbers"),
        (Written { place: 2, ..RIGHT }, "initial_box", "`Scene::place` panics with 1 numbers"),
    ] {
        let said = environment(|_| (), "", written).unwrap_err();
        assert!(said.starts_with(&format!("task wrong-task, field `{field}`: ")), "{said}");
        assert!(said.contains(problem), "{said}");
    }
}

#[test]
fn errors_in_the_scene_have_its_file_and_line() {
    let scene = |line: &str| format!("<!-- one -->\n<worldbody>\n  {line}\n</worldbody>\n");
    for (line, problem) in [
        // The parser refuses the first two, the compiler the third.
        ("<geom type=\"box\" siez=\"1 1 1\"/>", "unrecognized attribute: 'siez'"),
        ("<goem type=\"box\"/>", "unrecognized element"),
        ("<body><freejoint/></body>", "mass and inertia"),
    ] {
        let said = environment(|_| (), &scene(line), RIGHT).unwrap_err();
        assert!(said.starts_with("task wrong-task: MuJoCo cannot compile the model: "), "{said}");
        assert!(said.contains("my_task/scene.xml:3") && said.contains(problem), "{said}");
        assert!(said.ends_with(&format!(": `{line}`")), "{said}");
    }
}

#[test]
fn a_task_is_added_once_and_under_a_name_of_its_own() {
    let new = |change: fn(&mut Definition)| -> &'static dyn Task {
        let mut definition = right();
        change(&mut definition);
        let definition = Box::leak(Box::new(definition));
        Box::leak(Box::new(Wrong { definition, scene: String::new(), written: RIGHT }))
    };
    let said = |change| add(new(change)).unwrap_err().to_string();
    let taken = "field `name`: another task has the same name";
    assert_eq!(said(|d| d.name = "ball-pushing"), format!("task ball-pushing, {taken}"));
    assert_eq!(
        said(|d| d.variant_of = Some("x")),
        "task wrong-task, field `variant_of`: there is no task `x`"
    );
    assert_eq!(
        said(|d| d.n_substeps = 0),
        "task wrong-task, field `n_substeps`: expected at least 1, found 0"
    );
    add(new(|_| ())).unwrap();
    assert_eq!(said(|_| ()), format!("task wrong-task, {taken}"));
}
