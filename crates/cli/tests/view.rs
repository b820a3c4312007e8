//! `mishandle render --view`: the states that MuJoCo's viewer gets, with a package in its place.

use std::fs;
use std::os::unix::fs::PermissionsExt;

use crate::bench::{Bench, text};
use mishandle::picture::recorded_scene;
use mishandle::resolve::Moved;

/// A package `mujoco` that writes each state that is shown, and closes after one loop.
const MUJOCO: &str = "
import os, sys, types
class mjtState: mjSTATE_INTEGRATION = 1
class MjModel:
    @staticmethod
    def from_xml_string(xml, assets):
        assert '<mujoco' in xml
        return MjModel()
class MjData:
    def __init__(self, model): pass
shown = []
def mj_stateSize(model, kind): return int(os.environ['STATE_SIZE'])
def mj_setState(model, data, row, kind): shown.append(row)
def mj_forward(model, data): pass
class Viewer:
    def __init__(self, keys): self.keys = keys
    def __enter__(self): return self
    def __exit__(self, *error):
        with open(os.environ['SHOWN'], 'w') as file:
            file.writelines(' '.join(map(repr, row)) + '\\n' for row in shown)
    def is_running(self): return len(shown) < int(os.environ['SAMPLES'])
    def lock(self):
        import contextlib
        return contextlib.nullcontext()
    def sync(self): pass
viewer = types.ModuleType('mujoco.viewer')
viewer.launch_passive = lambda model, data, key_callback, **options: Viewer(key_callback)
sys.modules['mujoco.viewer'] = viewer
";

#[test]
fn the_viewer_gets_the_recorded_states_in_order() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller ppo --episodes 1 --out run.sqlite", 0);
    let path = bench.path("run.sqlite");
    let scene = recorded_scene(&path, None, Some(1), Moved::default(), false).unwrap();
    let states = &scene.episodes[0].states;
    fs::create_dir(bench.path("packages")).unwrap();
    fs::create_dir(bench.path("packages/mujoco")).unwrap();
    bench.write("packages/mujoco/__init__.py", MUJOCO);
    let mut view = bench.command("render run.sqlite --view --simulation 1 --speed 100");
    view.env("PYTHONPATH", bench.path("packages")).env("SHOWN", bench.path("shown.txt"));
    view.env("SAMPLES", states.len().to_string()).env("STATE_SIZE", states[0].len().to_string());
    let output = view.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let shown = fs::read_to_string(bench.path("shown.txt")).unwrap();
    let number = |word: &str| word.parse::<f64>().unwrap();
    let shown: Vec<Vec<f64>> = shown.lines().map(|line| line.split(' ').map(number).collect()).collect();
    assert_eq!(&shown, states);
}

#[test]
fn without_the_package_or_a_scene_one_line_says_what_to_do() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --trials 1 --budget 30 --out run.sqlite", 1);
    bench.write("no-mujoco", "#!/bin/sh\nexit 1\n");
    fs::set_permissions(bench.path("no-mujoco"), fs::Permissions::from_mode(0o755)).unwrap();
    for python in ["./no-mujoco", "./missing"] {
        bench.refuses(
            &format!("render run.sqlite --view -k render.python={python}"),
            &["-m pip install mujoco==3.17.0"],
        );
    }
    bench.write("python", "#!/bin/sh\nexit 0\n");
    fs::set_permissions(bench.path("python"), fs::Permissions::from_mode(0o755)).unwrap();
    bench.refuses("render run.sqlite --view -k render.python=./python", &["toy/sphere-2d", "have no scene"]);
}
