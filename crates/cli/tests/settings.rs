//! Settings files, dry runs and `mishandle show` of controllers.

use crate::bench::{Bench, SMALL, text};

const TRAIN: &str = "train point-reaching --settings ppo.toml";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("ppo.toml", SMALL);
    bench
}

fn names(bench: &Bench) -> Vec<String> {
    let entries = std::fs::read_dir(bench.path(".")).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn errors_name_file_line_and_table_and_suggest_a_fix() {
    let bench = Bench::new();
    for (settings, expected) in [
        ("gama = 0.9", &["ppo has no setting `gama`", "hint: did you mean `gamma`?"][..]),
        ("basse = \"best\"", &["ppo has no setting `basse`", "hint: did you mean `base`?"]),
        ("hidden = [8]", &["hint: did you mean `policy.hidden` or `critic.hidden`?"]),
        ("[run]\ntotal_step = 9", &["line 2: ", "`run.total_step`", "hint: did you mean `run.total_steps`?"]),
        (
            "entropy_reduction = \"summ\"",
            &["`entropy_reduction` must be \"sum\" or \"mean\"", "hint: did you mean `sum`?"],
        ),
        (
            "[policy]\nhidden = 64",
            &["line 2: the setting `policy.hidden` must be a list of up to 100 whole numbers"],
        ),
        ("base = \"skrl\"", &["settings base of ppo", "hint: did you mean `skrl-0.10`?"]),
    ] {
        bench.write("a.toml", settings);
        bench.refuses(
            "train point-reaching --settings a.toml",
            &[&["error: a.toml: line "], expected].concat(),
        );
    }
    assert_eq!(names(&bench), ["a.toml"]);
}

#[test]
fn a_dry_run_prints_every_setting_and_creates_no_files() {
    let bench = bench();
    let dry = |more: &str| bench.check(&format!("{TRAIN} --dry-run {more}"), 0);
    let out = dry("--seed 3 --out a/b.safetensors --csv c/d.csv --tensorboard board --steps 1e4");
    for line in [
        "# task point-reaching, algorithm ppo, reward shaped, seed 3",
        "# 10000 environment steps, to a/b.safetensors",
        "# stop_success: not set",
        // From the file, from a flag, and a default.
        "rollout_steps = 16",
        "total_steps = 10000",
        "gae_lambda = 0.95",
        "[policy]",
    ] {
        assert!(out.lines().any(|found| found == line), "missing line `{line}`:\n{out}");
    }
    // The output is a settings file with the same settings, and the task hash does not depend on
    // them.
    bench.write("all.toml", &out);
    let facts = |arguments: &str| bench.json(&format!("train {arguments} --dry-run --json"), 0);
    let given = facts("point-reaching --settings ppo.toml --steps 1e4");
    let again = facts("point-reaching --settings all.toml");
    assert_eq!((&again["settings"], &again["task_hash"]), (&given["settings"], &given["task_hash"]));
    let original = facts("point-reaching --settings ppo.toml -k train.reward=original");
    assert_ne!(original["task_hash"], given["task_hash"]);
    bench.refuses(&format!("{TRAIN} --dry-run --algorithm sad"), &["did you mean `sac`?"]);
    // A variant has the settings of its base task.
    assert_eq!(facts("cloth-placing-7x7")["settings"], facts("cloth-placing")["settings"]);
    assert_eq!(names(&bench), ["all.toml", "ppo.toml"]);
}

#[test]
fn a_dry_run_fails_with_the_error_of_the_training() {
    let bench = bench();
    bench.check(&format!("{TRAIN} --out a.safetensors --csv a.csv --tensorboard board"), 0);
    let before = names(&bench);
    for flags in [
        "--out a.safetensors",
        "--out ppo.toml/a.safetensors",
        "--out /proc/none/a.safetensors",
        "--out b.safetensors --csv a.csv",
        "--out b.safetensors --csv ppo.toml/a.csv",
        "--out b.safetensors --csv b.last.safetensors",
        "--out b.safetensors --tensorboard board",
        "--out b.safetensors --tensorboard ppo.toml",
        "--out b.safetensors --resume",
        "--out a.safetensors --resume --seed 9",
        "--out a.safetensors --resume --algorithm trpo --settings best",
        "--out a.safetensors --resume --csv ppo.toml",
    ] {
        let error = |more: &str| text(&bench.run(&format!("{TRAIN} {flags} {more}")).stderr);
        let dry_error = error("--dry-run");
        assert!(dry_error.starts_with("error: "), "{flags}: {dry_error}");
        // The operating system reports different errors for folders and files.
        let without_cause = |error: String| match error.rsplit_once(": ") {
            Some((path, cause)) if cause.contains("(os error") => path.to_string(),
            _ => error,
        };
        assert_eq!(without_cause(dry_error), without_cause(error("")), "{flags}");
        assert_eq!(names(&bench), before, "{flags}");
    }
    bench
        .check(&format!("{TRAIN} --out a.safetensors --csv a.csv --tensorboard board --resume --dry-run"), 0);
    assert_eq!(names(&bench), before);
}

#[test]
fn a_training_with_a_linear_schedule_cannot_resume_with_another_length() {
    let bench = bench();
    bench.write("linear.toml", &format!("learning_rate_schedule = \"linear\"\n{SMALL}"));
    bench.check("train point-reaching --settings linear.toml --out a.safetensors", 0);
    let resume = "train point-reaching --settings linear.toml --out a.safetensors --resume --steps";
    for steps in ["4096", "512"] {
        let expected =
            format!("`run.total_steps` = 2048 cannot resume with {steps}: `learning_rate_schedule");
        bench.refuses(&format!("{resume} {steps}"), &[&expected]);
    }
    bench.check(&format!("{resume} 2048"), 0);
}

#[test]
fn controller_shows_how_a_controller_was_trained() {
    let bench = bench();
    bench.check(&format!("{TRAIN} --seed 5 --out a.safetensors"), 0);
    let facts = bench.json("show a.safetensors --json", 0);
    for (key, value) in [
        ("task", "point-reaching"),
        ("algorithm", "ppo"),
        ("seed", "5"),
        ("reward", "shaped"),
        ("command", "mishandle train point-reaching --algorithm ppo --settings ppo.toml --seed 5"),
    ] {
        assert_eq!(facts[key], value);
    }
    let dry = bench.json(&format!("{TRAIN} --dry-run --json --out b.safetensors"), 0);
    for key in ["settings", "task_hash", "layout_hash"] {
        assert_eq!(facts[key], dry[key], "{key}");
    }
    assert_eq!(facts["validation"]["episodes"], 4);
    let page = bench.check("show a.safetensors", 0);
    let settings = facts["settings"].as_str().unwrap().trim_end();
    assert!(page.contains("mishandle train point-reaching") && page.contains(settings), "{page}");
    assert_eq!(bench.json("show point-reaching/ppo --json", 0)["task"], "point-reaching");
    for (name, parts) in [
        ("ppo.toml", &["ppo.toml"][..]),
        ("none.safetensors", &["none.safetensors: No such file", "a controller is the path of a file"]),
        ("checkpoints/best", &["is checkpoints/best", "a file that exists"]),
        ("ppo", &["run file or folder ppo", "TASK/NAME", "point-reaching/ppo"]),
        ("point-reaching/expert", &["the expert is part of the task", "has no file"]),
        ("point-reaching/pppo", &["no controller file `pppo`", "did you mean `ppo`?"]),
        ("point-reachin/ppo", &["no task `point-reachin`", "did you mean `point-reaching`?"]),
    ] {
        bench.refuses(&format!("show {name}"), parts);
    }
}
