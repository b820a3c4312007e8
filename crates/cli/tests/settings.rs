//! The settings of a training as a user meets them.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::{Bench, SMALL, text};
use mishandle::training::Config;

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
fn a_mistake_is_told_by_file_line_and_table_with_what_was_meant() {
    let bench = Bench::new();
    for (settings, told) in [
        ("gama = 0.9", &["ppo has no setting `gama`", "hint: did you mean `gamma`?"][..]),
        ("presset = \"best\"", &["ppo has no setting `presset`", "hint: did you mean `preset`?"]),
        ("hidden = [8]", &["hint: did you mean `policy.hidden` or `critic.hidden`?"]),
        ("[run]\ntotal_step = 9", &["line 2: ", "`run.total_step`", "hint: did you mean `run.total_steps`?"]),
        ("entropy = \"summ\"", &["`entropy` must be \"sum\" or \"mean\"", "hint: did you mean `sum`?"]),
        ("[policy]\nhidden = 64", &["line 2: the setting `policy.hidden` must be a list of whole numbers"]),
        ("preset = \"skrl\"", &["settings preset of ppo", "hint: did you mean `skrl-0.10`?"]),
    ] {
        bench.write("a.toml", settings);
        bench.refuses("train point-reaching --settings a.toml", &[&["error: a.toml: line "], told].concat());
    }
    assert_eq!(names(&bench), ["a.toml"]);
}

#[test]
fn a_dry_run_lists_every_setting_and_leaves_no_trace() {
    let bench = bench();
    let dry = |more: &str| bench.check(&format!("{TRAIN} --dry-run {more}"), 0);
    let out = dry("--seed 3 --out a/b.safetensors --csv c/d.csv --tensorboard board --steps 1e4");
    for line in [
        "# task point-reaching, algorithm ppo, reward shaped, seed 3",
        "# 10000 environment steps, to a/b.safetensors",
        "# stop_success: not set",
        "total_steps = 10000",
        "[policy]",
    ] {
        assert!(out.lines().any(|found| found == line), "it does not say `{line}`:\n{out}");
    }
    // It is a settings file itself, of the same settings.
    let again = Config::from_toml("ppo", &out).unwrap().unwrap();
    assert_eq!(bench.json(&format!("{TRAIN} --dry-run --json --steps 1e4"), 0)["settings"], again.to_toml());
    assert_eq!(names(&bench), ["ppo.toml"]);
}

#[test]
fn a_dry_run_is_refused_as_the_training_would_be() {
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
        let told = error("--dry-run");
        assert!(told.starts_with("error: "), "{flags}: {told}");
        // A folder that cannot be made has another reason than a file that cannot be.
        let known = |told: String| match told.rsplit_once(": ") {
            Some((place, reason)) if reason.contains("(os error") => place.to_string(),
            _ => told,
        };
        assert_eq!(known(told), known(error("")), "{flags}");
        assert_eq!(names(&bench), before, "{flags}");
    }
    bench
        .check(&format!("{TRAIN} --out a.safetensors --csv a.csv --tensorboard board --resume --dry-run"), 0);
    assert_eq!(names(&bench), before);
}

#[test]
fn a_training_that_hangs_on_its_length_goes_on_with_no_other() {
    let bench = bench();
    bench.write("linear.toml", &format!("learning_rate_schedule = \"linear\"\n{SMALL}"));
    bench.check("train point-reaching --settings linear.toml --out a.safetensors", 0);
    let resume = "train point-reaching --settings linear.toml --out a.safetensors --resume --steps";
    for steps in ["4096", "512"] {
        let told = format!("`run.total_steps` = 2048 cannot go on with {steps}: `learning_rate_schedule");
        bench.refuses(&format!("{resume} {steps}"), &[&told]);
    }
    bench.check(&format!("{resume} 2048"), 0);
}

#[test]
fn what_does_not_fit_into_memory_is_refused_before_it_is_taken() {
    let bench = Bench::new();
    for (algorithm, settings, told) in [
        ("ppo", "rollout_steps = 1_000_000_000", "for rollout_steps and episodes.environments"),
        ("trpo", "episodes.environments = 10_000_000_000", "for episodes.environments"),
        ("sac", "replay.capacity = 9_000_000_000_000", "for replay.capacity"),
        ("td3", "policy.hidden = [1_000_000, 1_000_000]", "for policy.hidden and critic.hidden"),
        ("ddpg", "run.validation_episodes = 100_000_000_000", "for run.validation_episodes"),
    ] {
        bench.write("a.toml", settings);
        for flag in ["", "--dry-run"] {
            let train = format!("train point-reaching --algorithm {algorithm} --settings a.toml {flag}");
            bench.refuses(&train, &["the training run needs at least ", " GB of memory, ", told]);
        }
    }
    assert_eq!(names(&bench), ["a.toml"]);
}

#[test]
fn counts_are_taken_as_people_write_them() {
    let bench = bench();
    for (steps, total) in [("1e4", 10_000), ("100_000", 100_000), ("2.5e3", 2500), ("300", 300)] {
        let told = bench.json(&format!("{TRAIN} --dry-run --json --steps {steps}"), 0);
        assert_eq!(told["environment_steps"], total, "{steps}");
    }
    for (steps, why) in [
        ("1.5", "the value is not an integer"),
        ("1e-3", "the value is not an integer"),
        ("-3", "the value is negative"),
    ] {
        bench.refuses(&format!("{TRAIN} --dry-run --steps {steps}"), &[why, "--steps", "1_000_000 or 1e6"]);
    }
    assert_eq!(bench.json(&format!("{TRAIN} --dry-run --json --seed 1e3"), 0)["seed"], "1000");
    let evaluate = "evaluate point-reaching --controller expert --episodes 1e1 --json";
    assert_eq!(bench.json(evaluate, 0)["success_rate"]["n"], 10);
}

#[test]
fn a_controller_tells_how_it_was_trained() {
    let bench = bench();
    bench.check(&format!("{TRAIN} --seed 5 --out a.safetensors"), 0);
    let told = bench.json("controller a.safetensors --json", 0);
    for (key, value) in [
        ("task", "point-reaching"),
        ("algorithm", "ppo"),
        ("seed", "5"),
        ("reward", "shaped"),
        ("command", "mishandle train point-reaching --algorithm ppo --settings ppo.toml --seed 5"),
    ] {
        assert_eq!(told[key], value);
    }
    let dry = bench.json(&format!("{TRAIN} --dry-run --json --out b.safetensors"), 0);
    for key in ["settings", "task_hash", "layout_hash"] {
        assert_eq!(told[key], dry[key], "{key}");
    }
    assert_eq!(told["validation"]["episodes"], 4);
    let page = bench.check("controller a.safetensors", 0);
    let settings = told["settings"].as_str().unwrap().trim_end();
    assert!(page.contains("mishandle train point-reaching") && page.contains(settings), "{page}");
    assert_eq!(bench.json("controller point-reaching/ppo --json", 0)["task"], "point-reaching");
    for (name, parts) in [
        ("ppo.toml", &["ppo.toml"][..]),
        ("none.safetensors", &["none.safetensors: No such file"]),
        ("ppo", &["is ppo", "TASK/NAME", "point-reaching/ppo"]),
        ("point-reaching/expert", &["the expert is part of the task", "has no file"]),
        ("point-reaching/pppo", &["no controller file `pppo`", "did you mean `ppo`?"]),
        ("point-reachin/ppo", &["no task `point-reachin`", "did you mean `point-reaching`?"]),
    ] {
        bench.refuses(&format!("controller {name}"), parts);
    }
}
