//! `mishandle train`: output files, interruption, resumption, early stopping.

use mishandle::controllers::ControllerFile;
use mishandle::train::{Curve, CurveRow};
use serde_json::Value;

use crate::bench::{Bench, SMALL, signal, text};
use crate::training::{ENDLESS, TRAIN, bench, count_lines, curve, start, wait_until};

/// Writes the page of a curve and returns it.
fn curve_page(bench: &Bench, curve: &str) -> String {
    bench.check(&format!("report {curve} --out page.html --force"), 0);
    std::fs::read_to_string(bench.path("page.html")).unwrap()
}

/// Returns the rows of a curve without times.
fn without_times(curve: Curve) -> Vec<CurveRow> {
    let timeless = |row| CurveRow { wall_clock_secs: 0.0, time_shares: Default::default(), ..row };
    curve.rows.into_iter().map(timeless).collect()
}

/// Returns the results in the JSON document of a training run, without times and paths.
fn results(document: &Value) -> Vec<&Value> {
    let keys = ["environment_steps", "best_environment_steps", "success_rate", "stopped_early"];
    keys.iter().chain(&["strict_success_rate", "controller_hash"]).map(|key| &document[key]).collect()
}

#[test]
fn an_interrupted_training_can_be_resumed_and_its_files_are_locked() {
    let bench = bench();
    let outputs = "--out a.safetensors --csv a.csv --tensorboard board";
    let child = start(&bench, &format!("{TRAIN} {ENDLESS} {outputs}"));
    wait_until("two rows", || count_lines(&bench.path("a.csv")) > 2);
    bench
        .refuses(&format!("{TRAIN} --out a.safetensors"), &["another training run is writing a.safetensors"]);
    let other = format!("{TRAIN} --out b.safetensors --csv a.csv --resume");
    bench.refuses(&other, &["another training run is writing a.csv", "choose another --csv"]);
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    let resume = err.lines().find_map(|line| line.strip_prefix("Resume with: mishandle ")).unwrap();
    assert!(resume.ends_with(&format!("--seed 7 {outputs} --resume")), "{resume}");
    assert!(bench.path("a.safetensors.checkpoint").exists() && !bench.path("a.safetensors.lock").exists());
    assert!(!bench.path("a.csv.lock").exists());
    // Fewer steps than completed are an error; an iteration has 256 steps, and --steps is rounded
    // up to whole iterations.
    let done = 256 * (count_lines(&bench.path("a.csv")) - 1);
    let to = |steps: usize| bench.run(&resume.replace(ENDLESS, &format!("--steps {steps}")));
    let err = text(&to(done - 256).stderr);
    assert!(err.contains(&format!("already ran {done} environment steps")), "{err}");
    let finished = to(done - 1);
    let err = text(&finished.stderr);
    assert_eq!(finished.status.code(), Some(0), "{err}");
    let rounded = format!("--steps {} was rounded up", done - 1);
    assert!(err.contains(&rounded) && err.contains("nothing left to do"), "{err}");
}

#[test]
fn a_resumed_training_writes_the_same_controllers_and_curve() {
    let bench = bench();
    let train = |name: &str, flags: &str| {
        bench.json(&format!("{TRAIN} --json --out {name}.safetensors --csv {name}.csv {flags}"), 0)
    };
    let whole = train("whole", "");
    train("halved", "--steps 1024");
    let halved = train("halved", "--resume");
    assert_eq!(results(&whole), results(&halved));
    assert_eq!((&whole["environment_steps"], &whole["environments"]), (&2048.into(), &16.into()));
    for (key, path) in
        [("best", "whole.safetensors"), ("last", "whole.last.safetensors"), ("csv", "whole.csv")]
    {
        assert_eq!(whole[key], path);
    }
    let rows = without_times(curve(&bench, "whole.csv"));
    assert_eq!(without_times(curve(&bench, "halved.csv")), rows);
    let iterations: Vec<u64> = rows.iter().map(|row| row.iteration).collect();
    assert_eq!(iterations, [1, 2, 3, 4, 5, 6, 7, 8]);
    let validated = rows.iter().filter(|row| row.validation.is_some()).map(|row| row.iteration);
    assert_eq!(validated.collect::<Vec<_>>(), [4, 8]);
    // The wall-clock time includes the first run.
    let clock: Vec<f64> = curve(&bench, "halved.csv").rows.iter().map(|row| row.wall_clock_secs).collect();
    assert!(clock.is_sorted(), "{clock:?}");
    for ending in ["safetensors", "last.safetensors"] {
        let load = |name: &str| ControllerFile::load(&bench.path(&format!("{name}.{ending}"))).unwrap();
        assert_eq!(load("whole").policy.hash(), load("halved").policy.hash());
        assert_eq!(load("whole").header.training.validation, load("halved").header.training.validation);
    }
}

#[test]
fn a_killed_training_resumes_to_the_same_curve() {
    let bench = bench();
    bench.write("ppo.toml", &format!("{SMALL}run.checkpoint_interval = 10\n"));
    let train = |name: &str| format!("{TRAIN} --steps 25600 --out {name}.safetensors --csv {name}.csv");
    bench.check(&train("whole"), 0);
    let mut child = start(&bench, &train("killed"));
    // After its second checkpoint.
    wait_until("25 rows", || count_lines(&bench.path("killed.csv")) > 25);
    child.kill().unwrap();
    child.wait().unwrap();
    let rows = curve(&bench, "killed.csv").rows.len();
    assert!((25..100).contains(&rows), "it was killed after {rows} iterations");
    bench.check(&format!("{} --resume", train("killed")), 0);
    assert_eq!(without_times(curve(&bench, "killed.csv")), without_times(curve(&bench, "whole.csv")));
    assert_eq!(curve(&bench, "killed.csv").rows.len(), 100);
}

#[test]
fn the_best_and_the_last_controller_can_be_evaluated() {
    let bench = bench();
    // The last iteration is always validated.
    bench.check(&format!("{TRAIN} --out a.safetensors"), 0);
    let load = |name: &str| ControllerFile::load(&bench.path(name)).unwrap().header.training;
    let best = load("a.safetensors");
    let last = load("a.last.safetensors");
    assert!(best.environment_steps <= last.environment_steps && last.environment_steps == 2048);
    assert!(best.validation.is_some() && last.validation.is_some());
    for name in ["a.safetensors", "a.last.safetensors"] {
        let evaluate = format!("evaluate point-reaching --controller {name} --episodes 8 --json");
        assert_eq!(bench.json(&evaluate, 0)["success_rate"]["n"], 8);
    }
    bench.refuses(
        "evaluate ball-balancing --controller a.last.safetensors",
        &["point-reaching", "ball-balancing"],
    );
    // Without a validation, the headers contain none.
    bench.write("ppo.toml", &SMALL.replace("validation_interval = 4", "validation_interval = 1000000"));
    let child = start(&bench, &format!("{TRAIN} {ENDLESS} --out b.safetensors --csv b.csv"));
    wait_until("a row", || count_lines(&bench.path("b.csv")) > 1);
    signal(&child, "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(130));
    assert_eq!(load("b.last.safetensors"), load("b.safetensors"));
    assert!(load("b.last.safetensors").validation.is_none());
}

/// Curve and event file get their first data after the first checkpoint.
#[test]
fn a_training_that_was_killed_in_its_first_iteration_starts_or_continues() {
    let bench = bench();
    let train = format!("{TRAIN} --steps 256");
    let files = |name: &str| format!("--out {name}.safetensors --csv {name}.csv --tensorboard {name}");
    bench.check(&format!("{train} {}", files("whole")), 0);
    let [events] = ["whole"].map(|folder| {
        let entry = std::fs::read_dir(bench.path(folder)).unwrap().next().unwrap().unwrap();
        (entry.file_name(), std::fs::read(entry.path()).unwrap())
    });
    let text = std::fs::read_to_string(bench.path("whole.csv")).unwrap();
    let head = text.find('\n').unwrap() + 1;
    // Before the first checkpoint: each file has a part of its first record.
    for (number, (csv, event)) in
        [(0, 0), (1, 5), (40, 20), (head - 1, 40), (head, 40)].into_iter().enumerate()
    {
        let name = format!("killed-{number}");
        bench.write(&format!("{name}.csv"), &text[..csv]);
        std::fs::create_dir(bench.path(&name)).unwrap();
        std::fs::write(bench.path(&name).join(&events.0), &events.1[..event]).unwrap();
        bench.check(&format!("{train} {}", files(&name)), 0);
        assert_eq!(curve(&bench, &format!("{name}.csv")).rows.len(), 1);
        assert_eq!(std::fs::read_dir(bench.path(&name)).unwrap().count(), 1);
    }
    // After it, and before the row of its iteration.
    bench.write("whole.csv", &text[..head]);
    for name in ["whole.safetensors", "whole.last.safetensors"] {
        std::fs::remove_file(bench.path(name)).unwrap();
    }
    bench.check(&format!("{TRAIN} --steps 512 {} --resume", files("whole")), 0);
    // The program never replaces a file that it did not write.
    bench.write("mine.csv", "a,b");
    bench.refuses(&format!("{train} --out mine.safetensors --csv mine.csv"), &["mine.csv exists already"]);
}

#[test]
fn existing_files_are_never_overwritten() {
    let bench = bench();
    let train = format!("{TRAIN} --steps 256");
    bench.check(&format!("{train} --out a.safetensors --csv a.csv --tensorboard board"), 0);
    for (flags, expected) in [
        (
            "--out none.safetensors --resume",
            "there is no checkpoint none.safetensors.checkpoint to resume from; leave out --resume if",
        ),
        ("--out a.safetensors", "a.safetensors exists already; choose another --out, or pass --resume"),
        ("--out b.safetensors --csv a.csv", "a.csv exists already; choose another --csv, or pass --resume"),
        (
            "--out b.safetensors --tensorboard board",
            "exists already; choose another --tensorboard, or pass --resume",
        ),
        ("--out b.safetensors --csv b.last.safetensors", "b.last.safetensors is the path of both"),
        (
            "--out b.safetensors --csv b.csv --steps 0",
            "'0' for '--steps <N>': the value is too small; expected an integer from 1 to",
        ),
        (
            "--out b.safetensors --csv ppo.toml/b.csv --tensorboard other",
            "cannot write the folder ppo.toml: ",
        ),
        ("--out b.safetensors --csv b.csv --tensorboard ppo.toml", "ppo.toml"),
    ] {
        bench.refuses(&format!("{TRAIN} {flags}"), &[expected]);
    }
    let files = std::fs::read_dir(bench.path(".")).unwrap().map(|entry| entry.unwrap().file_name());
    let of_b = |name: &std::ffi::OsString| name.to_string_lossy().starts_with('b') && name != "board";
    assert_eq!(files.filter(of_b).collect::<Vec<_>>(), [""; 0]);
    std::fs::remove_file(bench.path("a.safetensors")).unwrap();
    bench.refuses(&format!("{train} --out a.safetensors"), &["a.last.safetensors exists already"]);
    // The curve of another training run and an edited curve are errors and stay unchanged.
    bench.check(&format!("{train} --out c.safetensors --csv c.csv").replace("--seed 7", "--seed 8"), 0);
    let text = std::fs::read_to_string(bench.path("c.csv")).unwrap();
    bench.write("edited.csv", &text.replace("\n1,", "\n2,"));
    for (csv, expected) in [
        ("c.csv", "belongs to another training"),
        ("edited.csv", "no row for iteration 1"),
        ("/dev/full", "regular file"),
    ] {
        bench.refuses(
            &format!("{TRAIN} --steps 512 --out a.safetensors --csv {csv} --resume"),
            &[csv, expected],
        );
    }
    assert_eq!(std::fs::read_to_string(bench.path("c.csv")).unwrap(), text);
}

#[test]
fn settings_and_names_are_checked_before_training() {
    let bench = bench();
    bench.write("wrong.toml", "gama = 0.9\n");
    bench.refuses("train point-reaching --settings wrong.toml", &["wrong.toml", "gama"]);
    bench.refuses("train point-reaching --settings missing.toml", &["missing.toml: No such file"]);
    bench.refuses("train point-reaching --space delays", &["no space `delays`", "delay"]);
    bench.refuses("train point-reaching --axis action_delay=0:9", &["action_delay", "from 0 to 3"]);
    bench.refuses("train point-reaching --axis action_delay=1 --axis action_delay=0:1", &["set twice"]);
    let nan = "train point-reaching --space faults-sensing --axis sensor_fault_fill=nan";
    bench.refuses(nan, &["pass --axis sensor_fault_fill=0:1"]);
    bench.write("shares.toml", "scenarios = { nominal = 0.7, corners = 0.4 }");
    bench.refuses("train point-reaching --settings shares.toml", &["shares.toml", "scenarios.corners"]);
    bench.refuses(
        "train point-reaching --settings skrl-0.1",
        &["no settings base `skrl-0.1`", "did you mean `skrl-0.10`?"],
    );
    bench.refuses(
        "train point-reaching --algorithm pppo",
        &["no training algorithm `pppo`", "did you mean `ppo`?"],
    );
    bench.refuses("train point-reaching -k train.reward=best", &["no reward `best`", "shaped"]);
}

#[test]
fn a_plan_and_keys_train_as_flags_do() {
    let bench = bench();
    bench.write(
        "plan.toml",
        "target = 'point-reaching'\nspace = 'delay'\nseed = 7\n[train]\nsettings = 'ppo.toml'\nsteps = 512\n[margin]\n",
    );
    let command = |arguments: &str| {
        let train = format!("train --dry-run --json --out a.safetensors {arguments}");
        bench.json(&train, 0)["command"].as_str().unwrap().to_string()
    };
    let flags = "--algorithm ppo --settings ppo.toml --steps 512 --space delay --seed 7";
    assert_eq!(command("--plan plan.toml"), format!("mishandle train point-reaching {flags}"));
    let keys = "-k space=delay -k seed=7 -k train.settings=ppo.toml -k train.steps=512";
    assert_eq!(command(&format!("point-reaching {keys}")), command("--plan plan.toml"));
    let guard = "-k 'guard.formula=distance >= 0' -k guard.fallback=expert -k guard.privileged=true";
    bench.refuses(&format!("train point-reaching {guard}"), &["training computes no signals"]);
    for (arguments, parts) in [
        ("", ["there is no target", "as an argument"]),
        ("point-reaching --steps 512 -k train.steps=256", ["train.steps is set twice", "--steps"]),
        ("point-reaching -k train.steps=0", ["`train.steps` is 0", "an integer from 1 to 10^12"]),
        ("point-reaching -k harden.steps=3", ["harden.steps is a key of the table harden", "train"]),
    ] {
        bench.refuses(&format!("train {arguments}"), &parts);
    }
}

#[test]
fn a_training_that_reaches_its_target_rates_stops_early() {
    let bench = bench();
    // Every validation reaches the target rates; there is one after every four iterations of 256
    // steps.
    let settings =
        format!("{SMALL}run.stop_success = 0.0\nrun.stop_strict = 0.0\nrun.stop_validations = 3\n");
    bench.write("ppo.toml", &settings);
    let train = format!("{TRAIN} {ENDLESS} --out a.safetensors --csv a.csv");
    let expected =
        "stopped early: success at least 0 % and strict success at least 0 % in 3 consecutive validations";
    let out = bench.check(&train, 0);
    assert!(out.lines().any(|line| line == expected), "{out}");
    assert!(out.starts_with("3072 environment steps in "), "{out}");
    // Resuming a run that stopped early does nothing.
    let resumed = bench.run(&format!("{train} --resume"));
    assert!(text(&resumed.stdout).contains(expected), "{}", text(&resumed.stdout));
    assert!(text(&resumed.stderr).contains("nothing left to do"), "{}", text(&resumed.stderr));
    bench.check(&format!("{train} --resume --tensorboard board"), 0);
    assert_eq!(
        std::fs::read_dir(bench.path("board")).map_or(0, Iterator::count),
        0,
        "a run without iterations writes no event file"
    );
    let document = bench.json(&format!("{train} --resume --json"), 0);
    assert_eq!((&document["stopped_early"], &document["environment_steps"]), (&true.into(), &3072.into()));
    assert_eq!(curve(&bench, "a.csv").rows.len(), 12);
    // A run that is interrupted after its second validation stops after the third one.
    bench.write("ppo.toml", &format!("{settings}run.checkpoint_interval = 1\n"));
    bench.check(&format!("{TRAIN} --steps 2048 --out b.safetensors --csv b.csv"), 0);
    let document =
        bench.json(&format!("{TRAIN} {ENDLESS} --out b.safetensors --csv b.csv --resume --json"), 0);
    assert_eq!((&document["stopped_early"], &document["environment_steps"]), (&true.into(), &3072.into()));
}

#[test]
fn the_page_of_a_curve_says_the_same_training_time_as_train() {
    let bench = bench();
    // One run in which episodes end, and one that is too short.
    for (name, flags) in [("long", "--steps 10240"), ("short", "--steps 256")] {
        let train = format!("{TRAIN} --out {name}.safetensors --csv {name}.csv {flags}");
        let printed = bench.check(&train, 0);
        let said = printed.lines().find(|line| line.contains("training time")).unwrap();
        // The curve does not contain the number of environments.
        let parts: Vec<&str> =
            said.split(", ").filter(|part| !part.ends_with("control steps per environment")).collect();
        let page = curve_page(&bench, &format!("{name}.csv"));
        assert!(page.contains(&format!("<p>{}</p>", parts.join(", "))), "{said}: {page}");
    }
    let out = bench.check(&format!("{TRAIN} --out none.safetensors"), 0);
    assert!(out.contains("no training time: it needs a curve; pass --csv FILE"), "{out}");
}

#[test]
fn a_curve_with_an_incomplete_last_line_is_read_without_it() {
    let bench = bench();
    bench.check(&format!("{TRAIN} --steps 256 --out a.safetensors --csv a.csv"), 0);
    let text_of = std::fs::read_to_string(bench.path("a.csv")).unwrap();
    // The return rises from 1 to 8. Smoothed over three rows (two at the ends) it starts at 1.5, so
    // the tolerance is 0.325: row 8 has 23 / 3 = 7.67, row 9 has 8.
    let row = |i: u64| format!("{i},{},{i},{},,,,,,,,0.001,0,0,1,0,0", 160 * i, i.min(8));
    let header = text_of.lines().next().unwrap();
    let empty_terms = header.split(',').count() - row(1).split(',').count();
    let rows: String = (1..=40).map(|i| format!("{}{}\n", row(i), ",0".repeat(empty_terms))).collect();
    bench.write("b.csv", &format!("{header}\n{rows}41,6560,41"));
    let output = bench.run("report b.csv --out b.html");
    let err = text(&output.stderr);
    assert!(
        err.starts_with("warning: the last line of b.csv is incomplete and was ignored\nwrote b.html"),
        "{err}"
    );
    let page = std::fs::read_to_string(bench.path("b.html")).unwrap();
    for said in [
        "<p>40 iterations, 6400 environment steps in 40 s</p>",
        "<p>training time until the return converged: 1440 environment steps, 9 s</p>",
    ] {
        assert!(page.contains(said), "{said}: {page}");
    }
    bench.write("c.csv", "iteration,b\n1,2\n");
    bench.refuses("report c.csv --out c.html", &["c.csv", "column 2"]);
    bench.write("log.csv", "a,b\n1,2\n");
    bench.refuses("report log.csv --out c.html", &["log.csv is a log, not a run file"]);
    bench.refuses("report b.csv c.csv --out d.html", &["b.csv is a learning curve; name it alone"]);
}

#[test]
fn a_robot_of_a_file_is_trained_and_evaluated_by_its_path() {
    let bench = Bench::new();
    let model = r#"<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02"/></body></worldbody>
        <actuator><motor joint="hinge"/></actuator></mujoco>"#;
    bench.write("pole.xml", model);
    let robot = r#"
        format = 1
        name = "pole"
        model.file = "pole.xml"
        control = { period = 0.02, steps = 20 }
        start = { hinge = "tilt" }
        axes.tilt = { range = [-0.1, 0.1], unit = "rad" }
        observation.state = "[*qpos('hinge'), *qvel('hinge')]"
        policy = { action = "action", limit = 1 }
        signals.angle = "abs(qpos('hinge')[0])"
        rewards.upright = "1 - angle"
        formulas.upright = "always(angle <= 3)"
    "#;
    bench.write("pole.toml", robot);
    bench.write("s.toml", "rollout_steps = 8\nminibatch_size = 8\nepisodes.environments = 4\n");
    let train = "train pole.toml --settings s.toml --steps 64";
    let trained = bench.json(&format!("{train} --out c.safetensors --json"), 0);
    assert_eq!(trained["success_rate"], 1.0);
    bench.check("evaluate pole.toml --controller ./c.safetensors --episodes 4", 0);
    bench.refuses(
        &format!("{train} --out d.safetensors -k train.reward=shaped"),
        &["the reward is shaped", "[rewards]"],
    );
    bench.refuses(&format!("{train} --out d.safetensors -k train.device=gpu"), &["only tasks do"]);
}
