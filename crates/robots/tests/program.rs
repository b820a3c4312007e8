//! Policies that are programs: a cart-pole that Python balances.

use std::path::Path;
use std::sync::Arc;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    Component, Controller, Episode, EpisodeEnd, Noise, Request, Scenario, Seed, Specification,
};
use mishandle_stl::Formula;

const MODEL: &str = r#"<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
      <geom type="box" size="0.15 0.1 0.06" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.002"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide" ctrlrange="-20 20" ctrllimited="true"/></actuator>
</mujoco>"#;

/// The file without the keys of its policy.
const FILE: &str = r#"
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 60 }
start = { hinge = "tilt" }
observation = { angle = "qpos('hinge')", rate = "qvel('hinge')" }
signals.angle = "qpos('hinge')"
axes.tilt = { range = [-0.3, 0.3], unit = "rad" }
formulas.upright = "always(angle <= 0.5)"
policy.action = "action"
"#;

/// Reads a question, sets `angle` and `rate`, runs the lines, and answers with `action` and
/// `state`.
fn program(lines: &str) -> String {
    let mut text = String::from(
        "import json, sys, time\nfor line in sys.stdin:\n    q = json.loads(line)\n    angle, rate = q['observation']\n    state = q.get('state', [])\n",
    );
    for line in lines.lines() {
        text.push_str(&format!("    {line}\n"));
    }
    text.push_str("    print(json.dumps({'id': q['id'], 'action': action, 'state': state}), flush=True)\n");
    text
}

fn read(folder: &Path, policy: &str, script: &str) -> RobotFile {
    std::fs::write(folder.join("cartpole.xml"), MODEL).unwrap();
    std::fs::write(folder.join("policy.py"), script).unwrap();
    let path = folder.join("cartpole.toml");
    std::fs::write(&path, format!("{FILE}{policy}\n")).unwrap();
    RobotFile::read(&path).unwrap()
}

fn policy(file: &RobotFile) -> Arc<dyn Controller> {
    match file.policy() {
        RobotPolicy::Program(program) => program.clone(),
        RobotPolicy::Expression(expression) => expression.clone(),
        _ => panic!("another policy"),
    }
}

fn episodes(file: &RobotFile, tilts: &[f64]) -> Vec<Episode> {
    simulate(file, "always(angle <= 0.5)", tilts, None)
}

/// Simulates these starts. With a threshold, simulations may stop early.
fn simulate(file: &RobotFile, formula: &str, tilts: &[f64], stop_threshold: Option<f64>) -> Vec<Episode> {
    let component = Component {
        role: "controller".into(),
        name: "test".into(),
        hash: "test".into(),
        file_hash: String::new(),
    };
    let target = file.target(policy(file), vec![component], Noise::default()).unwrap();
    let space = target.space("starts").unwrap();
    let formula = Formula::parse(formula).unwrap();
    let specification = Specification::from_formulas(&target.formulas, formula).unwrap();
    let mut system = target.system(&space, &specification).unwrap();
    let request = |(tilt, seed): (&f64, u64)| Request {
        stop_threshold,
        ..Request::new(Scenario::from([*tilt].as_slice()), Seed(seed))
    };
    let requests: Vec<Request> = tilts.iter().zip(7..).map(request).collect();
    system.rollout(&requests).unwrap()
}

const PYTHON: &str = "policy.process = [\"python3\", \"policy.py\"]";

#[test]
fn a_program_gives_the_bits_of_the_same_expression() {
    let folder = tempfile::tempdir().unwrap();
    let expression = read(folder.path(), "policy.expression = \"25 * angle + 4 * rate\"", "");
    let expected = episodes(&expression, &[0.1, -0.3, 0.25]);
    let program = read(folder.path(), PYTHON, &program("action = [25 * angle + 4 * rate]"));
    let found = episodes(&program, &[0.1, -0.3, 0.25]);
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(expected.end, EpisodeEnd::Completed);
        assert_eq!(found.end, expected.end);
        assert_eq!(found.trace, expected.trace);
    }
}

#[test]
fn a_simulation_stops_as_soon_as_its_threshold_allows() {
    let folder = tempfile::tempdir().unwrap();
    let questions = folder.path().join("questions");
    let lines = format!("open({questions:?}, 'a').write('.')\naction = [25 * angle + 4 * rate]");
    let file = read(folder.path(), PYTHON, &program(&lines));
    let count = || std::fs::read(&questions).map_or(0, |questions| questions.len());
    // The first sample decides the one, and sample 25 the other, which is checked after step 30.
    for (formula, steps) in [("eventually(angle >= 0.05)", 10), ("eventually[0:25](angle >= 1)", 30)] {
        let before = count();
        let whole = simulate(&file, formula, &[0.1], None).remove(0);
        assert_eq!((whole.end, whole.steps, count() - before), (EpisodeEnd::Completed, 60, 60));
        let before = count();
        let stopped = simulate(&file, formula, &[0.1], Some(0.0)).remove(0);
        let end = EpisodeEnd::Stopped { step: steps };
        assert_eq!((stopped.end, stopped.steps, count() - before), (end, steps, steps));
        assert_eq!(stopped.is_violated(), whole.is_violated(), "{formula}");
        assert_eq!(stopped.trace.column(0), &whole.trace.column(0)[..=steps]);
    }
}

#[test]
fn what_a_program_remembers_belongs_to_its_simulation() {
    let folder = tempfile::tempdir().unwrap();
    // A filtered rate, and the time since the start.
    let lines = "state = [0.5 * state[0] + 0.5 * rate, state[1] + 1]\naction = [25 * angle + 4 * state[0]]\nassert \
                 abs(q['time'] - 0.02 * (state[1] - 1)) < 1e-9";
    let file = read(folder.path(), &format!("{PYTHON}\npolicy.state = 2"), &program(lines));
    let together = episodes(&file, &[0.1, -0.3, 0.25]);
    for (episode, tilt) in together.iter().zip([0.1, -0.3, 0.25]) {
        assert_eq!(episode.end, EpisodeEnd::Completed);
        let alone = episodes(&file, &[tilt]).remove(0);
        assert_eq!(alone.trace, episode.trace);
    }
}

#[test]
fn failures_of_a_program_are_typed_ends_without_a_verdict() {
    let folder = tempfile::tempdir().unwrap();
    // From the second start on, in the sixth control step.
    let cases = [
        ("sys.exit('broken')", EpisodeEnd::Crashed { step: 6 }),
        ("print('not an answer', flush=True)", EpisodeEnd::Crashed { step: 6 }),
        ("q['id'] -= 1", EpisodeEnd::Crashed { step: 6 }),
        ("action = action + [0]", EpisodeEnd::Crashed { step: 6 }),
        ("time.sleep(60)", EpisodeEnd::TimedOut { step: 6 }),
        ("action = [None]", EpisodeEnd::InvalidAction { step: 6, index: 0 }),
    ];
    for (mistake, end) in cases {
        let lines = format!(
            "action = [25 * angle + 4 * rate]\nif q['seed'] == '8' and q['time'] > 0.09:\n    {mistake}"
        );
        let keys = format!("{PYTHON}\npolicy.time_limit = 1.5");
        let file = read(folder.path(), &keys, &program(&lines));
        let found = episodes(&file, &[0.1, 0.2, 0.3]);
        assert_eq!(found[1].end, end, "{mistake}");
        assert_eq!(found[1].verdict.robustness, None, "{mistake}");
        for other in [0, 2] {
            assert_eq!(found[other].end, EpisodeEnd::Completed, "{mistake}");
        }
    }
}

#[test]
fn a_program_that_remembers_by_itself_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let check = |script: &str| {
        let file = read(folder.path(), PYTHON, script);
        let RobotPolicy::Program(program) = file.policy() else { panic!("another policy") };
        program.check().map_err(|error| error.to_string())
    };
    let counts = "import json, sys\nfor count, line in enumerate(sys.stdin):\n    print(json.dumps({'id': json.loads(line)['id'], 'action': [count]}), flush=True)\n";
    let error = check(counts).expect_err("the answers differ");
    assert!(error.contains("what it remembers is the list `state`"), "{error}");
    let error = check("import nothing_of_this_name\n").expect_err("it ends");
    assert!(error.contains("nothing_of_this_name"), "{error}");
    check(&program("action = [angle]")).expect("a good program");
}

#[test]
fn the_hash_covers_the_code_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let hash = |script: &str| {
        let file = read(folder.path(), PYTHON, script);
        let RobotPolicy::Program(program) = file.policy() else { panic!("another policy") };
        program.hash().unwrap()
    };
    assert_eq!(hash("a"), hash("a"));
    assert_ne!(hash("a"), hash("b"));
}
