//! Simulators as short Python scripts.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use mishandle_rollout::{
    Component, Controller, Episode, Noise, Request, RolloutError, Scenario, Seed, Specification, System,
    Target,
};
use mishandle_simulators::{ProgramPolicy, ProgramSettings, Simulator, SimulatorError, program, target};
use mishandle_stl::Formula;

/// A tank: the level follows inflow and outflow. Five control steps of 0.5 s.
const HELLO: &str = r#"
import json, os, signal, subprocess, sys, time
HELLO = {"protocol": 1, "name": "tank", "control_dt": 0.5, "steps": 5,
  "axes": [{"name": "level", "unit": "m", "low": 0.0, "high": 8.0, "nominal": 1.0, "kind": "start"},
           {"name": "inflow", "low": 0, "high": 2, "nominal": 0, "values": "integer"}],
  "signals": [{"name": "level", "unit": "m"}, {"name": "inflow"}],
  "formulas": [{"name": "low", "text": "always(level <= 4)"}]}
POLICY = {"observation": [{"name": "level", "unit": "m"}], "action": [{"name": "valve"}], "action_limit": 1.0}
"#;

/// Reads questions and answers with `simulate`, `reset` and `step`.
const LOOP: &str = r#"
def trace(q):
    level, inflow = q["scenario"]["level"], q["scenario"]["inflow"]
    return {"level": [level + k * inflow for k in range(6)], "inflow": [inflow] * 6}
def simulate(q): return {"trace": trace(q)}
def answer(q):
    global scenario, level
    if q["type"] == "hello": return HELLO
    if q["type"] == "simulate": return simulate(q)
    if q["type"] == "reset": scenario, level = q["scenario"], q["scenario"]["level"]
    elif q["type"] == "step": level += scenario["inflow"] - (q["action"][0] if "action" in q else 0)
    else: return {"error": "unknown type"}
    sample = {"signals": [level, scenario["inflow"]]}
    return {**sample, "observation": [level]} if "policy" in HELLO else sample
def write(q, a): print(json.dumps({"id": q["id"], **a}), flush=True)
"#;

const MAIN: &str = r#"
for line in sys.stdin:
    q = json.loads(line)
    write(q, answer(q))
"#;

/// Writes the script of a tank, in which `changes` replaces functions, and returns its folder.
pub fn folder(changes: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let script = format!("{HELLO}{LOOP}{changes}\n{MAIN}");
    std::fs::write(folder.path().join("sim.py"), script).expect("a script");
    folder
}

pub fn simulator(folder: &Path, limit: f64) -> Result<Simulator, SimulatorError> {
    let program = program("python3 sim.py", folder.to_path_buf()).expect("a command");
    Simulator::start(program, Some(Duration::from_secs_f64(limit)))
}

/// Returns the target of a tank without a policy.
pub fn tank(folder: &Path, limit: f64) -> Target {
    let simulator = simulator(folder, limit).expect("a simulator");
    target(Arc::new(simulator), None, Noise::default()).expect("a target")
}

/// Returns the target of a tank with a policy that is a program: a script that sets `action`.
pub fn controlled(folder: &Path, action: &str) -> Target {
    let (policy, component) = policy(folder, action);
    controlled_by(folder, policy, component)
}

/// Returns the target of a tank with a controller.
pub fn controlled_by(folder: &Path, controller: Arc<dyn Controller>, component: Component) -> Target {
    let simulator = Arc::new(simulator(folder, 5.0).expect("a simulator"));
    target(simulator, Some((controller, vec![component])), Noise::default()).expect("a target")
}

/// Returns a policy that is a program: a script that sets `action`.
pub fn policy(folder: &Path, action: &str) -> (Arc<dyn Controller>, Component) {
    let script = format!(
        "import json, sys\nfor line in sys.stdin:\n    q = json.loads(line)\n    level = q['observation'][0]\n    {action}\n    \
         print(json.dumps({{'id': q['id'], 'action': [action]}}), flush=True)\n"
    );
    std::fs::write(folder.join("policy.py"), script).expect("a script");
    let words = ["python3", "policy.py"].map(String::from).to_vec();
    let settings = ProgramSettings { words, time_limit: Duration::from_secs(5), state: 0 };
    let policy = ProgramPolicy::new(settings, folder, [1, 1], 0.5);
    let component = Component {
        role: "controller".into(),
        name: "policy".into(),
        hash: policy.hash().expect("a hash"),
        file_hash: String::new(),
    };
    (Arc::new(policy), component)
}

pub fn system(target: &Target, space: &str) -> Box<dyn System> {
    let requirement = Formula::parse(&target.formulas[0].text).expect("a formula");
    let specification = Specification::from_formulas(&target.formulas, requirement).expect("formulas");
    target.system(&target.space(space).expect("a space"), &specification).expect("a system")
}

/// Simulates levels with an inflow of 0.
pub fn levels(target: &Target, levels: &[f64]) -> Result<Vec<Episode>, RolloutError> {
    let requests: Vec<Request> =
        levels.iter().map(|level| Request::new(Scenario::from([*level, 0.0]), Seed(7))).collect();
    system(target, "scenarios").rollout(&requests)
}
