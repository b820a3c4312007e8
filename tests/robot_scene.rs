//! Robots that a file describes: states for pictures, and full records.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::inspect::EventKind;
use mishandle::plan::EvaluatePlan;
use mishandle::rollout::{Request, Scenario, Seed};
use mishandle::run::{Engine, ask};
use mishandle::store::{RunFile, TraceColumn};
use mishandle::world::Model;
use mishandle::{Plan, ResolvedPlan};

/// A cart of 2 kg with a lid, a cube of 0.5 kg on the ground, and a wall in the way of the cart.
/// The paint has no mass and touches nothing.
const MODEL: &str = r#"<mujoco>
  <option gravity="0 0 -10" timestep="0.01"/>
  <worldbody>
    <geom type="plane" size="4 4 0.1"/>
    <body name="cart" pos="0 0 0.3">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.1 0.1 0.1" mass="1.5"/>
      <geom type="sphere" size="0.15" contype="0" conaffinity="0" mass="0" rgba="1 0 0 1"/>
      <body name="lid" pos="0 0 0.15">
        <joint name="hinge" axis="0 0 1"/>
        <geom type="box" size="0.1 0.1 0.05" mass="0.5"/>
      </body>
    </body>
    <body name="cube" pos="0 1 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="0.5"/></body>
    <body name="wall" pos="1 0 0.3"><geom type="box" size="0.1 0.5 0.1"/></body>
  </worldbody>
  <actuator><motor name="force" joint="slide" gear="2"/></actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "cart"
model.file = "cart.xml"
control = { period = 0.02, steps = 60 }
start = { slide = "place" }
observation.place = "qpos('slide')"

[policy]
expression = "3 + 0 * place"
actions = 1
action = "action"

[signals]
place = { value = "qpos('slide')[0]", unit = "m" }

[axes]
place = { range = [-0.2, 0.2], unit = "m" }
cart = { kind = "model", range = [0.5, 4], scale = "body_mass('cart')" }

[formulas]
free = "always(place <= 0.5)"
"#;

fn file(folder: &Path) -> PathBuf {
    std::fs::write(folder.join("cart.xml"), MODEL).unwrap();
    let path = folder.join("cart.toml");
    std::fs::write(&path, FILE).unwrap();
    path
}

fn plan(folder: &Path) -> Plan {
    Plan { space: "starts+dynamics".to_string(), ..Plan::new(file(folder).to_str().unwrap(), "") }
}

fn full_trace(resolved: &ResolvedPlan, [place, mass_scale]: [f64; 2]) -> Vec<TraceColumn> {
    let request = Request::new(Scenario::from([place, mass_scale].as_slice()), Seed(0));
    let episode = resolved.system().unwrap().rollout(&[request]).unwrap().remove(0);
    let columns = mishandle::picture::full_trace(resolved, &episode).unwrap();
    assert!(columns.iter().all(|column| column.values.len() == episode.trace.len()));
    columns
}

fn column<'a>(columns: &'a [TraceColumn], name: &str) -> &'a TraceColumn {
    columns.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("no {name}"))
}

#[test]
fn a_full_trace_of_a_robot_has_its_joints_actuators_bodies_and_contacts() {
    let folder = tempfile::tempdir().unwrap();
    let resolved = ResolvedPlan::new(&plan(folder.path())).unwrap();
    let columns = full_trace(&resolved, [0.1, 1.0]);
    let of_cube = |prefix: &str| -> Vec<String> {
        let suffixes: &[&str] = match prefix {
            "q" => &["x", "y", "z", "qw", "qx", "qy", "qz"],
            _ => &["x", "y", "z", "wx", "wy", "wz"],
        };
        suffixes.iter().map(|suffix| format!("{prefix}_cube_{suffix}")).collect()
    };
    let names = |text: &str| -> Vec<String> { text.split(' ').map(String::from).collect() };
    let expected: Vec<String> = [
        names("q_slide q_hinge"),
        of_cube("q"),
        names("dq_slide dq_hinge"),
        of_cube("dq"),
        names("control_force force_force"),
        ["cart", "lid", "cube", "wall"]
            .iter()
            .flat_map(|b| ["x", "y", "z"].map(|a| format!("{a}_{b}")))
            .collect(),
        names("action_1"),
        // A lid never touches its cart: MuJoCo ignores contacts of a body with its parent.
        names(
            "contact_ground_cart contact_ground_lid contact_ground_cube contact_cart_cube contact_cart_wall",
        ),
        names("contact_lid_cube contact_lid_wall contact_cube_wall contact_largest"),
    ]
    .concat();
    let found: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(found, expected);
    let values = |name: &str| -> Vec<Option<f64>> { column(&columns, name).values.clone() };
    // The last action has no control step after it.
    let actions = values("action_1");
    assert_eq!((actions[0], actions[59], actions[60]), (Some(3.0), Some(3.0), None));
    // The first state is before the first control.
    let controls = values("control_force");
    let forces = values("force_force");
    assert_eq!(
        (controls[0], controls[1], forces[0], forces[1]),
        (Some(0.0), Some(3.0), Some(0.0), Some(3.0))
    );
    // 6 N on 2 kg. In physics step k, the velocity grows by a h and the position by k a h h.
    let a = 3.0;
    let h = 0.01;
    for sample in 0..10 {
        let steps = 2.0 * sample as f64;
        let place = 0.1 + a * h * h * steps * (steps + 1.0) / 2.0;
        assert!((values("q_slide")[sample].unwrap() - place).abs() < 1e-9);
        assert!((values("dq_slide")[sample].unwrap() - a * h * steps).abs() < 1e-9);
        assert!((values("x_cart")[sample].unwrap() - place).abs() < 1e-9);
        assert!((values("z_lid")[sample].unwrap() - 0.45).abs() < 1e-9);
    }
    // The ground carries the cube, and finally the wall stops the cart.
    assert!((values("contact_ground_cube")[40].unwrap() - 5.0).abs() < 1e-2);
    assert_eq!((values("contact_cart_wall")[0], values("contact_cart_cube")[60]), (Some(0.0), Some(0.0)));
    assert!(values("contact_cart_wall").iter().any(|force| force.unwrap() > 5.0));
    assert_eq!(column(&columns, "x_cart").unit, "m");
    // The cart of 1.5 kg becomes one of 3 kg: 6 N on 3.5 kg.
    let heavy = full_trace(&resolved, [0.1, 2.0]);
    assert!((column(&heavy, "dq_slide").values[1].unwrap() - 6.0 / 3.5 * 0.02).abs() < 1e-9);
}

#[test]
fn states_of_a_robot_fit_its_model_with_visual_elements() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let evaluate = EvaluatePlan { episodes: 2, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), ..plan(folder.path()) };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let run = RunFile::open(&path).unwrap();
    let (replayed, trajectory) = mishandle::picture::replay_states(&run, 1, 2, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new());
    assert_eq!(trajectory.states.len(), replayed.episode.trace.len());
    let (event, pair) = trajectory.first_contact().unwrap().unwrap();
    assert_eq!((event.kind, pair.as_str()), (EventKind::Contact, "contact_cart_wall"));

    let picture = mishandle::resolve::recorded_picture(run.header()).unwrap();
    let drawn = Model::from_xml_with_assets(&picture.document, &picture.assets).unwrap();
    assert_eq!(drawn.count(mishandle::world::ElementKind::Geom), 6, "the paint is there");
    let mut world = drawn.world();
    for (state, place) in trajectory.states.iter().zip(replayed.episode.trace.column(0)) {
        world.set_state(state);
        assert_eq!(world.qpos()[0].to_bits(), place.to_bits());
    }
}

#[test]
fn the_start_of_a_robot_has_one_value_per_axis_of_its_starts() {
    let folder = tempfile::tempdir().unwrap();
    let file = file(folder.path());
    let place = |x0: Option<&[f64]>| -> Result<f64, String> {
        let trajectory = mishandle::picture::initial_state(file.to_str().unwrap(), x0)
            .map_err(|error| error.with_causes())?;
        let mut world = Model::from_xml(MODEL).unwrap().world();
        world.set_state(&trajectory.states[0]);
        Ok(world.qpos()[0])
    };
    assert_eq!((place(None), place(Some(&[-0.15]))), (Ok(0.0), Ok(-0.15)));
    assert!(place(Some(&[0.1, 0.2])).unwrap_err().contains("2"));
    assert!(place(Some(&[f64::NAN])).unwrap_err().contains("place"));
}

#[test]
fn a_start_that_diverges_while_it_settles_has_no_picture_and_an_invalid_one_has() {
    let folder = tempfile::tempdir().unwrap();
    let picture = |start: &str, hold: &str| {
        let path = file(folder.path());
        let text = FILE
            .replace("slide = \"place\"", start)
            .replace("actions = 1", &format!("actions = 1\nhold = \"{hold}\""));
        std::fs::write(&path, text).unwrap();
        let made = mishandle::picture::initial_state(path.to_str().unwrap(), None);
        made.map(|trajectory| trajectory.states.len()).map_err(|error| error.to_string())
    };
    let invalid = "slide = \"0.1\", settle = 0.1, invalid = \"1\"";
    assert_eq!(picture(invalid, "0"), Ok(1));
    let error = picture("slide = \"0.1\", settle = 1", "1e9 * qvel('slide') + 1").err().unwrap();
    assert!(error.contains("one whose physics diverges"), "{error}");
}
