//! Hardening with a trainer of the user: a script that hands out finished controllers.

use crate::cart_pole;
use std::collections::BTreeSet;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::controllers::{ControllerFile, Header, Policy, TrainingRecord};
use mishandle::harden::{HardenProgress, harden, harden_folder, is_hardening, resume, resume_plan};
use mishandle::interchange::onnx_bytes;
use mishandle::network::{Activation, Mlp};
use mishandle::plan::{AxisSetting, HardenPlan};
use mishandle::resolve::robot_file;
use mishandle::results::Hardening;
use mishandle::run::Opening;
use mishandle::{MishandleError, Plan};
use sha2::{Digest, Sha256};

use crate::hardening::{few, in_parts, without_paths};

/// Reads its arguments, notes them, and does what the file `task` says.
const SCRIPT: &str = r#"
echo "$@" >> calls
while [ $# -gt 0 ]; do
    case $1 in --controller) controller=$2 ;; --out) out=$2 ;; esac
    shift 2
done
echo "reading"
trap 'echo stopped >> stopped; exit 1' TERM
case $(cat task) in
    better) echo "epoch 1"; sleep 0.5; cp better.onnx "$out" ;;
    same) cp "$controller" "$out" ;;
    fail) echo "out of memory" >&2; exit 3 ;;
    nothing) echo "done already" ;;
    garbage) echo "no model" > "$out" ;;
    other) cp other.onnx "$out" ;;
esac
"#;

/// Returns a linear policy of the cart: the weights of the position and angle and of their speeds.
fn linear(robot: &Path, weights: [f32; 4]) -> Vec<u8> {
    let robot = robot_file(&Plan::new(&robot.to_string_lossy(), "")).unwrap();
    let mut network = Mlp::new(&[4, 1], Activation::Elu, Activation::Identity).unwrap();
    network.update(|parameters| parameters[..4].copy_from_slice(&weights));
    let policy = Policy::new(vec![0.0; 4], vec![1.0; 4], network, vec![0.0]).unwrap();
    let header = Header {
        task: robot.name().to_string(),
        algorithm: "none".to_string(),
        preset: String::new(),
        reward: String::new(),
        layout: robot.layout(),
        action_interface: None,
        task_hash: String::new(),
        training: TrainingRecord::default(),
    };
    onnx_bytes(&ControllerFile { header, policy }, "test")
}

/// A folder with the script, a controller of a pole on a cart that delays break, one that they do
/// not break, and one of a task.
struct Bench {
    home: tempfile::TempDir,
}

impl Bench {
    fn new(task: &str) -> Bench {
        Bench::with(task, |text| text)
    }

    /// `change` changes the target file.
    fn with(task: &str, change: impl Fn(String) -> String) -> Bench {
        let bench = Bench { home: tempfile::tempdir().unwrap() };
        let robot = cart_pole::write(bench.home.path(), change);
        // Little damping: a delay of one control step more makes the pole swing.
        fs::write(bench.path("stiff.onnx"), linear(&robot, [0.0, 0.1, 6.0, 0.4])).unwrap();
        fs::write(bench.path("better.onnx"), linear(&robot, [0.1, 0.2, 3.0, 0.8])).unwrap();
        let file = ControllerFile::load(Path::new("controllers/point-reaching/ppo.safetensors")).unwrap();
        fs::write(bench.path("other.onnx"), onnx_bytes(&file, "test")).unwrap();
        fs::write(bench.path("train.sh"), SCRIPT).unwrap();
        bench.set_task(task);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_string_lossy().into_owned()
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn set_task(&self, task: &str) {
        fs::write(self.path("task"), task).unwrap();
    }

    fn plan(&self) -> Plan {
        let table =
            HardenPlan { trainer: Some("sh 'train.sh'".to_string()), is_trainer_typed: true, ..few() };
        let plan = Plan::new(&self.name("cartpole.toml"), &self.name("stiff.onnx"));
        let mut plan = Plan { space: "starts+delay".to_string(), ..plan };
        plan.axes.insert("action_delay".to_string(), AxisSetting::Range([0.0, 2.0]));
        plan.axes.insert("observation_delay".to_string(), AxisSetting::Value(2.0));
        let folder = self.home.path().to_string_lossy().into_owned();
        Plan { seed: 5, folder, harden: Some(table), ..plan }
    }
}

fn go_on(_: &HardenProgress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn error(result: Result<Option<Hardening>, MishandleError>) -> String {
    result.unwrap_err().with_causes()
}

#[test]
#[ignore = "long"]
fn a_better_controller_is_accepted_also_after_interruptions() {
    let bench = Bench::new("better");
    let plan = bench.plan();
    let out = bench.path("whole.onnx");
    let mut phases = BTreeSet::new();
    let whole = harden(&plan, &out, None, &mut |progress| {
        phases.insert(progress.phase.clone());
        ControlFlow::Continue(())
    });
    let whole = whole.unwrap().unwrap();
    assert!(phases.contains("round 1: training: epoch 1"), "{phases:?}");
    assert!(whole.verdict.starts_with("Better"), "{}", whole.verdict);
    let better = fs::read(bench.path("better.onnx")).unwrap();
    assert_eq!(fs::read(&out).unwrap(), better);
    assert_eq!(fs::read(harden_folder(&out).join("round-1/controller.onnx")).unwrap(), better);
    assert_eq!(whole.trainer.as_deref(), Some("sh 'train.sh'"));
    let digest = Sha256::digest(&better).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    assert_eq!(whole.rounds[0].file_hash.as_deref(), Some(&digest[..32]));
    assert!(whole.rounds[0].accepted && whole.rounds[0].environment_steps == 0);

    // The arguments are those of the documentation, and the archive is there.
    let calls = bench.text("calls");
    let folder = harden_folder(&out);
    let name = |path: &str| folder.join(path).to_string_lossy().into_owned();
    let words: Vec<&str> = calls.split_whitespace().collect();
    let flags: Vec<&str> = words.iter().step_by(2).copied().collect();
    let expected = [
        "--target",
        "--controller",
        "--archive",
        "--space",
        "--axis",
        "--axis",
        "--seed",
        "--steps",
        "--threads",
        "--out",
    ];
    assert_eq!(flags, expected);
    let value = |flag: &str| words[words.iter().position(|word| *word == flag).unwrap() + 1];
    let last = words[words.iter().rposition(|word| *word == "--axis").unwrap() + 1];
    assert_eq!(last, "observation_delay=2");
    for (flag, expected) in [
        ("--target", bench.name("cartpole.toml")),
        ("--controller", name("before.onnx")),
        ("--archive", name("round-1/failures")),
        ("--space", "starts+delay".to_string()),
        ("--axis", "action_delay=0:2".to_string()),
        ("--steps", "512".to_string()),
        ("--out", name("round-1/controller.onnx")),
    ] {
        assert_eq!(value(flag), expected);
    }
    assert!(value("--seed").parse::<i32>().is_ok_and(|seed| seed >= 0), "{calls}");
    assert!(folder.join("round-1/failures/mode-1.json").exists());
    let table = fs::read_to_string(folder.join("round-1/failures/archive.csv")).unwrap();
    assert!(table.starts_with("weight,") && table.lines().count() > 1, "{table}");
    assert!(fs::read_to_string(folder.join("round-1/training.log")).unwrap().contains("epoch 1"));

    // A second one stops at the first report of each phase, and in the training.
    let other = bench.path("parts.onnx");
    let found = in_parts(|is_first, watch| {
        if is_first {
            harden(&plan, &other, None, watch).unwrap()
        } else {
            resume_plan(&harden_folder(&other), &plan, None, watch).unwrap()
        }
    });
    assert_eq!(without_paths(found), without_paths(whole.clone()));
    assert!(bench.text("stopped").starts_with("stopped"), "an interruption ends the trainer");

    // A finished one needs neither the trainer nor a permission.
    fs::remove_file(bench.path("train.sh")).unwrap();
    let again = resume(&harden_folder(&out), Opening::default(), None, &mut go_on).unwrap();
    assert_eq!(again.unwrap(), whole);
}

#[test]
fn a_trainer_that_fails_is_named_and_called_again_and_the_same_controller_is_no_improvement() {
    let bench = Bench::new("fail");
    let plan = bench.plan();
    let out = bench.path("out.onnx");
    let folder = harden_folder(&out);
    let said = error(harden(&plan, &out, None, &mut go_on));
    for part in
        ["`sh 'train.sh'` failed with exit code 3", "resumed hardening", "training.log: ", "out of memory"]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
    // What is recorded is not simulated again.
    let mut no_simulation = |progress: &HardenProgress| {
        assert!(progress.done == progress.all || progress.phase.contains("training"), "{progress:?}");
        ControlFlow::Continue(())
    };
    for (task, part) in [
        ("nothing", "ended, but there is no file"),
        ("garbage", "controller.onnx cannot be used"),
        ("other", "controller.onnx cannot be used"),
    ] {
        bench.set_task(task);
        let said = error(resume_plan(&folder, &plan, None, &mut no_simulation));
        assert!(said.contains(part) && said.contains("reading"), "{task}: {said}");
        assert!(!said.contains("out of memory"), "that was an earlier call: {said}");
        assert!(!out.exists());
    }
    // The command stands in a file, which may be of others.
    let said = error(resume(&folder, Opening::default(), None, &mut go_on));
    assert!(said.contains("MISHANDLE_ALLOW_PROGRAMS=1") && said.contains("trainer"), "{said}");
    assert_eq!(bench.text("calls").lines().count(), 4);
    bench.set_task("same");
    let found = resume_plan(&folder, &plan, None, &mut go_on).unwrap().unwrap();
    assert!(found.verdict.starts_with("No improvement"), "{}", found.verdict);
    assert!(found.after.is_none() && !found.rounds[0].accepted && !out.exists());
}

#[test]
fn mistakes_are_errors_before_anything_is_written() {
    let bench = Bench::new("better");
    // Only a task has an expert and shipped controllers.
    let controller = bench.name("other.onnx");
    let good = Plan { target: "point-reaching".to_string(), controller, ..bench.plan() };
    let out = bench.path("out.onnx");
    let table = |change: &dyn Fn(&mut HardenPlan)| {
        let mut table = good.harden.clone().unwrap();
        change(&mut table);
        Plan { harden: Some(table), ..good.clone() }
    };
    let command = |command: &str| table(&|table| table.trainer = Some(command.to_string()));
    // The name of a shipped controller does not say its format.
    let target = "point-reaching".to_string();
    let controller = "vision".to_string();
    let seeing = Plan { target, controller, ..table(&|table| table.trainer = None) };
    for (plan, part) in [
        (table(&|table| table.trainer = None), "needs a trainer of yours"),
        (seeing, "needs a trainer of yours"),
        (table(&|table| table.is_trainer_typed = false), "MISHANDLE_ALLOW_PROGRAMS=1"),
        (table(&|table| table.settings = Some("a.toml".to_string())), "harden.settings"),
        (table(&|table| table.device = "gpu".to_string()), "harden.device"),
        (table(&|table| table.archive = 0.5), "harden.archive"),
        (command(" "), "harden.trainer"),
        (command("sh 'train.sh"), "quote"),
        (command("no-such-program train.py"), "no-such-program"),
        (command("./no-such-file"), "./no-such-file"),
        (Plan { controller: "expert".to_string(), ..good.clone() }, "the expert"),
        (Plan { controller: "./none.onnx".to_string(), ..good.clone() }, "none.onnx"),
        (Plan { target: "toy/sphere-2d".to_string(), ..good.clone() }, "toy/sphere-2d"),
    ] {
        let said = error(harden(&plan, &out, None, &mut go_on));
        assert!(said.contains(part), "{part}: {said}");
        assert!(!out.exists() && is_hardening(&harden_folder(&out)).is_none(), "{part}");
    }
    // All controllers of a hardening have one format.
    let said = error(harden(&good, &bench.path("out.safetensors"), None, &mut go_on));
    assert!(said.contains(".onnx"), "{said}");
    let shipped = Plan { controller: "ppo".to_string(), ..good };
    let said = error(harden(&shipped, &out, None, &mut go_on));
    assert!(said.contains(".safetensors"), "{said}");
    assert!(!bench.path("calls").exists());
}

/// In 35 % of the starts or more, simulations end without a verdict: the pole leans where the
/// formula has no value, or the cart is too far away for the engine.
#[test]
#[ignore = "long"]
fn nothing_is_concluded_if_a_region_of_the_final_set_has_no_verdict() {
    let undecided = |text: String| {
        text.replace("always(angle <= 0.3)", "always(angle <= 0.3) and sqrt(0.03 - lean) >= 0").replace(
            "signals.angle",
            "signals.lean = { value = \"qpos('hinge')[0]\", unit = \"rad\" }\nsignals.angle",
        )
    };
    let diverged = |text: String| {
        text.replace("hinge = \"tilt\"", "hinge = \"tilt\", slide = \"where(tilt > 0.03, 1e12, 0)\"")
    };
    for (kind, change) in [("undecided", &undecided as &dyn Fn(String) -> String), ("diverged", &diverged)] {
        let bench = Bench::with("same", change);
        let found = harden(&bench.plan(), &bench.path("out.onnx"), None, &mut go_on).unwrap().unwrap();
        let without = &found.without_verdict;
        assert!(without.share.is_some_and(|share| share > 0.2), "{kind}: {without:?}");
        let ends = without.ends;
        let counted = if kind == "undecided" { ends.undecided } else { ends.diverged };
        assert_eq!((counted, ends.invalid_starts), (ends.total(), 0), "{kind}");
        assert!(without.is_too_large() && found.after.is_none(), "{kind}");
    }
}
