//! Records of a robot that a file describes: what changed is named, and its files can move.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::campaign::{campaign_runs, create_campaign};
use mishandle::counterexample::{Counterexample, regress};
use mishandle::inspect::compare;
use mishandle::plan::{EvaluatePlan, FalsifyPlan};
use mishandle::portable::copy_target;
use mishandle::replay::replay;
use mishandle::resolve::Moved;
use mishandle::results::{Key, Remedy};
use mishandle::run::{Engine, Opening, create_run};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};

/// A pendulum that hangs down. Its file is in a folder of its own, and includes another one.
const MODEL: &str = r#"<mujoco><option timestep="0.005"/><worldbody><body name="rod">
  <joint name="pivot" type="hinge" axis="0 1 0" damping="0.01"/><include file="bob.xml"/></body></worldbody>
  <actuator><motor name="motor" joint="pivot" ctrlrange="-1 1"/></actuator></mujoco>"#;

const BOB: &str = r#"<mujoco><geom name="bob" size="0.05" pos="0 0 -0.5" mass="0.4"/></mujoco>"#;

const TARGET: &str = r#"
format = 1
name = "pendulum"
model.file = "parts/pendulum.xml"
control = { period = 0.02, steps = 30 }
start = { pivot = "push" }
observation.angle = "qpos('pivot')"
policy = { expression = "-0.1 * angle", action = "action" }
signals.swing = { value = "abs(qpos('pivot')[0])", unit = "rad" }
axes = { push = { range = [-0.4, 0.4], unit = "rad" } }
formulas.small = "always(swing <= 0.3)"
"#;

/// Writes the robot and returns the path of its target file.
fn robot(folder: &Path) -> PathBuf {
    std::fs::create_dir_all(folder.join("parts")).unwrap();
    std::fs::write(folder.join("parts/pendulum.xml"), MODEL).unwrap();
    std::fs::write(folder.join("parts/bob.xml"), BOB).unwrap();
    std::fs::write(folder.join("pendulum.toml"), TARGET).unwrap();
    folder.join("pendulum.toml")
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from));
    std::fs::write(path, text.replace(from, to)).unwrap();
}

fn plan(target: &Path) -> Plan {
    let falsify = FalsifyPlan { trials: 1, budget: 30, batch: 4, ..FalsifyPlan::default() };
    Plan { falsify: Some(falsify), ..Plan::new(target.to_str().unwrap(), "") }
}

fn run(plan: &Plan, path: &Path) -> RunFile {
    let resolved = ResolvedPlan::new(plan).unwrap();
    let writer = create_run(&resolved, Some(path)).unwrap();
    mishandle::run::ask(&resolved, writer, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    RunFile::open(path).unwrap()
}

/// Returns the number of the counterexample.
fn counterexample(run: &RunFile) -> u32 {
    let failing = run.simulations().map(Result::unwrap).find(mishandle_store::Simulation::is_violated);
    failing.unwrap().number
}

#[test]
fn a_changed_file_of_a_run_is_named() {
    let home = tempfile::tempdir().unwrap();
    let target = robot(home.path());
    let run = run(&plan(&target), &home.path().join("run.sqlite"));
    let number = counterexample(&run);
    assert!(replay(&run, 1, number, None).unwrap().differences.is_empty());
    let error = || replay(&run, 1, number, None).err().unwrap().to_string();
    // The included file belongs to the model.
    edit(&home.path().join("parts/bob.xml"), "0.4", "0.5");
    assert!(error().starts_with("the model `pendulum.xml` changed since the run: restore it"), "{}", error());
    edit(&target, "-0.1", "-0.2");
    let both = "the target file `pendulum.toml` and the model `pendulum.xml` changed since the run";
    assert!(error().starts_with(both), "{}", error());
    edit(&home.path().join("parts/bob.xml"), "0.5\"/>", "0.4\"/>");
    assert!(error().starts_with("the target file `pendulum.toml` changed since the run"), "{}", error());
    // What the plan names is gone.
    edit(&target, "formulas.small", "formulas.tiny");
    edit(&target, "push", "shove");
    assert!(error().contains("pendulum.toml` changed") || error().contains("restore it"), "{}", error());
    robot(home.path());
    assert!(replay(&run, 1, number, None).unwrap().differences.is_empty());
}

#[test]
fn a_moved_folder_is_found_by_its_new_path() {
    let home = tempfile::tempdir().unwrap();
    let target = robot(&home.path().join("old"));
    let run = run(&plan(&target), &home.path().join("run.sqlite"));
    let number = counterexample(&run);
    std::fs::rename(home.path().join("old"), home.path().join("new")).unwrap();
    let error = replay(&run, 1, number, None).err().unwrap();
    assert_eq!(error.remedies().iter().flat_map(Remedy::keys).next(), Some(Key::MOVED_TARGET), "{error}");
    let moved =
        |path: &Path| replay(&run, 1, number, Moved { target: path.to_str(), controller: None }).unwrap();
    let moved_to = home.path().join("new/pendulum.toml");
    assert!(moved(&moved_to).differences.is_empty());
    // Another name of the file does not make another robot.
    std::fs::rename(&moved_to, home.path().join("new/p.toml")).unwrap();
    assert!(moved(&home.path().join("new/p.toml")).differences.is_empty());
}

#[test]
fn a_target_that_is_no_file_has_no_new_path() {
    let home = tempfile::tempdir().unwrap();
    let falsify = FalsifyPlan { trials: 1, budget: 50, ..FalsifyPlan::default() };
    let run = run(
        &Plan { falsify: Some(falsify), ..Plan::new("toy/sphere-2d", "") },
        &home.path().join("run.sqlite"),
    );
    let moved = Moved { target: Some("x.toml"), controller: None };
    let error = mishandle::resolve::recorded_plan(run.header(), moved).unwrap_err();
    assert!(error.to_string().ends_with("is not a file, so it has no new path"), "{error}");
    assert_eq!(error.remedies(), [Remedy::Unset(Key::MOVED_TARGET)]);
}

#[test]
fn the_files_of_a_counterexample_stand_beside_it() {
    let home = tempfile::tempdir().unwrap();
    let target = robot(&home.path().join("robot"));
    let plan = plan(&target);
    let run = run(&plan, &home.path().join("run.sqlite"));
    let known = Counterexample::from_run(&run, 1, counterexample(&run)).unwrap();
    let json = known.to_json();
    assert!(!json.contains(home.path().to_str().unwrap()), "{json}");
    let folder = home.path().join("suite");
    let mut copied = copy_target(&plan, &folder).unwrap();
    copied.sort();
    let expected = ["parts/bob.xml", "parts/pendulum.xml", "pendulum.toml"].map(|name| folder.join(name));
    assert_eq!(copied, expected);
    // Nothing is needed of the original.
    std::fs::remove_dir_all(home.path().join("robot")).unwrap();
    let read = Counterexample::from_json(&json).unwrap();
    let replayed = read.replay(&read.resolve(&folder, None).unwrap()).unwrap();
    assert!(replayed.differences.is_empty(), "{:?}", replayed.differences);
    let tested = regress(&read, &folder, None, 0, |_| ControlFlow::Continue(())).unwrap();
    assert_eq!(tested.has_other_target, Some(false));
    // A second counterexample has the same files, but not those of another robot.
    let again = Plan::new(folder.join("pendulum.toml").to_str().unwrap(), "");
    assert_eq!(copy_target(&again, &folder).unwrap(), Vec::<PathBuf>::new());
    let other = robot(&home.path().join("other"));
    edit(&home.path().join("other/parts/bob.xml"), "0.05", "0.04");
    let error = copy_target(&Plan::new(other.to_str().unwrap(), ""), &folder).unwrap_err();
    assert!(error.to_string().contains("exists already and has another content"), "{error}");
    edit(&folder.join("parts/bob.xml"), "0.4", "0.41");
    assert!(read.resolve(&folder, None).unwrap_err().to_string().contains("the model `pendulum.xml`"));
}

#[test]
fn a_counterexample_names_no_file_outside_its_folder() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("suite");
    let target = robot(&folder);
    let run = run(&plan(&target), &home.path().join("run.sqlite"));
    let known = Counterexample::from_run(&run, 1, counterexample(&run)).unwrap();
    let json = known.to_json();
    for file in ["/etc/robot.toml", "../pendulum.toml", "./parts/pendulum.toml", "./pendulum.xml", "./.."] {
        let changed = json.replace("./pendulum.toml", file);
        let error = Counterexample::from_json(&changed).unwrap_err().to_string();
        assert!(error.contains("must be ./NAME.toml"), "{file}: {error}");
    }
    let by_name = json.replace("\"pendulum\"", "\"/etc/robot.toml\"");
    let by_name = by_name.replace(",\n    \"file\": \"./pendulum.toml\"", "");
    assert!(Counterexample::from_json(&by_name).unwrap_err().to_string().contains("must be ./NAME.toml"));
    // The target file leads out of the folder.
    std::fs::rename(folder.join("parts"), home.path().join("parts")).unwrap();
    edit(&target, "parts/pendulum.xml", "../parts/pendulum.xml");
    let error = |expected: &str| {
        let error = known.resolve(&folder, None).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("line 4"), "{error}");
    };
    error("is outside the folder of the target file");
    let absolute = home.path().join("parts/pendulum.xml");
    edit(&target, "../parts/pendulum.xml", absolute.to_str().unwrap());
    error("is outside the folder of the target file");
    edit(&target, absolute.to_str().unwrap(), "parts/pendulum.xml\"\nmodel.allow_outside = true #");
    error("`allow_outside` is not possible here");
    edit(&target, "\"\nmodel.allow_outside = true #", "");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(home.path().join("parts"), folder.join("parts")).unwrap();
        error("is outside the folder of the target file");
        let error = copy_target(&plan(&target), &home.path().join("copy")).unwrap_err();
        assert!(error.to_string().contains("is outside the folder of the target file"), "{error}");
    }
}

#[test]
fn a_campaign_and_a_comparison_know_the_files() {
    let home = tempfile::tempdir().unwrap();
    let target = robot(home.path());
    let text = format!("target = {target:?}\nseed = [1, 2]\n[evaluate]\nepisodes = 3\n");
    let folder = home.path().join("campaign");
    create_campaign(&text, &folder).unwrap();
    for run in campaign_runs(&folder).unwrap() {
        run.resume(Opening::default()).unwrap();
    }
    let evaluation = |name: &str| {
        let evaluate = EvaluatePlan { episodes: 4, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluate), ..Plan::new(target.to_str().unwrap(), "") };
        run(&plan, &home.path().join(name))
    };
    let before = evaluation("a.sqlite");
    assert!(compare(&before, &evaluation("b.sqlite"), |_| String::new()).unwrap().differences.is_empty());
    edit(&home.path().join("parts/bob.xml"), "0.4", "0.5");
    let differences = compare(&before, &evaluation("c.sqlite"), |_| String::new()).unwrap().differences;
    assert!(differences.len() == 1 && differences[0].starts_with("hash of the model"), "{differences:?}");
}

/// A cart-pole whose nominal start is its equilibrium: masses and friction change nothing there.
const CART: &str = r#"<mujoco><option timestep="0.005"/><worldbody>
  <body name="cart"><joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
    <geom type="box" size="0.15 0.1 0.06" mass="1"/>
    <body name="pole"><joint name="hinge" axis="0 1 0" damping="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/></body></body></worldbody>
  <actuator><motor name="force" joint="slide" ctrlrange="-20 20"/></actuator></mujoco>"#;

const BALANCED: &str = r#"
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 30 }
start = { hinge = "tilt" }
observation.state = "[*qpos('.*'), *qvel('.*')]"
policy = { expression = "dot([1, 25, 2, 4], state)", action = "action" }
signals.angle = "abs(qpos('hinge')[0])"
formulas.upright = "always(angle <= 0.5)"

[axes]
tilt = { range = [-0.3, 0.3], unit = "rad" }
pole = { kind = "model", range = [0.5, 4], scale = "body_mass('pole')" }
friction = { kind = "model", range = [0, 1], add = "dof_frictionloss('slide')" }
"#;

#[test]
fn an_axis_that_has_no_effect_in_an_equilibrium_has_one_elsewhere() {
    let home = tempfile::tempdir().unwrap();
    let target = home.path().join("cartpole.toml");
    std::fs::write(home.path().join("cartpole.xml"), CART).unwrap();
    std::fs::write(&target, BALANCED).unwrap();
    let found = run(&plan(&target), &home.path().join("run.sqlite"));
    assert_eq!(found.header().preflight, Vec::<String>::new());
    // Without a tilted start, no other axis changes anything.
    edit(&target, "tilt = {", "tilt = { kind = \"command\",");
    edit(&target, "hinge = \"tilt\"", "hinge = \"0 * tilt\"");
    let found = run(&plan(&target), &home.path().join("still.sqlite"));
    let names: Vec<&str> = found
        .header()
        .preflight
        .iter()
        .filter(|found| found.contains("changes no trace"))
        .map(|found| &found[..11])
        .collect();
    assert_eq!(names, ["axis `tilt`", "axis `pole`", "axis `frict"]);
}

#[test]
fn an_axis_of_a_symmetric_robot_has_an_effect() {
    let home = tempfile::tempdir().unwrap();
    let target = robot(home.path());
    // Both bounds of the push give the same swing, but its nominal value gives none.
    let found = run(&plan(&target), &home.path().join("run.sqlite"));
    assert_eq!(found.header().preflight, Vec::<String>::new());
    // A misspelled parameter has none at any value.
    edit(&target, "axes = {", "constants = { unused = \"0 * push\" }\naxes = {");
    edit(&target, "pivot = \"push\"", "pivot = \"0.1\"");
    let found = run(&plan(&target), &home.path().join("idle.sqlite"));
    let warning = "axis `push` changes no trace at the probed points: all signals are equal at its lowest, nominal and highest value";
    assert!(
        found.header().preflight.iter().any(|found| found.starts_with(warning)),
        "{:?}",
        found.header().preflight
    );
}
