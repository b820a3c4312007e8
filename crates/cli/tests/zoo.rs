//! The controller zoo from outside.

#![allow(clippy::unwrap_used)]

mod bench;

use std::process::Stdio;
use std::time::{Duration, Instant};

use bench::{Bench, SMALL, signal, text};

/// A repository whose PPO training run on one task takes long.
fn repository() -> Bench {
    let bench = Bench::new();
    for folder in ["controllers", "docs/reference", "experiments/training/point-reaching"] {
        std::fs::create_dir_all(bench.path(folder)).unwrap();
    }
    let settings = SMALL.replace("total_steps = 2048", "total_steps = 100_000_000");
    bench.write("experiments/training/point-reaching/ppo.toml", &settings);
    let page = |names: &[&str]| -> String {
        names.iter().map(|name| format!("<!-- figures: {name} -->\n<!-- end of figures -->\n")).collect()
    };
    bench.write("README.md", &page(&["pictures"]));
    bench.write("docs/reference/tasks.md", &page(&["tasks"]));
    let tables = ["summary", "controllers", "noise", "training", "seeds", "further-seeds", "curves"];
    bench.write("controllers/README.md", &page(&tables));
    bench
}

#[test]
fn an_interrupted_training_run_leaves_a_checkpoint_and_exits_with_130() {
    let bench = repository();
    let command = |arguments: &str| {
        let mut command = bench.command(arguments);
        command.env("MISHANDLE_HOME", bench.path("")).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    let child = command("zoo train --only point-reaching/ppo --seeds 1 --jobs 1").spawn().unwrap();
    let checkpoint = bench.path("target/controllers/point-reaching-ppo-s1.safetensors.checkpoint");
    let start = Instant::now();
    while !checkpoint.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint within a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
    let second = text(&command("zoo train --only point-reaching/ppo").output().unwrap().stderr);
    assert!(second.contains("another `mishandle zoo` is running"), "{second}");
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let words = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{words}");
    assert!(words.contains("interrupted after 0 of 1 job;"), "{words}");
    let listed = command("zoo list --only point-reaching/ppo --seeds 1 --json").output().unwrap();
    let document: serde_json::Value = serde_json::from_slice(&listed.stdout).unwrap();
    let entry = &document[0];
    assert_eq!((&entry["state"], &entry["reason"]), (&"interrupted".into(), &"no controller".into()));
    assert!(entry["checkpoint_environment_steps"].as_u64().unwrap() >= 256, "{entry}");
    assert!(
        std::fs::read_to_string(bench.path("docs/reference/tasks.md"))
            .unwrap()
            .contains("| `point-reaching` |")
    );
}

#[test]
fn an_empty_selection_and_an_unknown_subcommand_are_errors() {
    let bench = Bench::new();
    bench.refuses(
        "zoo list --only ball-puhsing",
        &["--only is `ball-puhsing`; it must be TASK or TASK/CONTROLLER", "did you mean `ball-pushing`?"],
    );
    bench.refuses("zoo list --seeds 9", &["no training run of the plan has these --seeds"]);
    for flags in ["", "--json"] {
        bench.refuses(
            &format!("zoo list --only ball-pushing/expert {flags}"),
            &["an expert is not trained", "`mishandle zoo measure --only ball-pushing/expert` measures it"],
        );
    }
    bench.refuses("zoo lst", &["unrecognized subcommand 'lst'", "list"]);
    bench.refuses("zoo train --jobs 0", &["the value is too small; expected an integer from 1 to 1024"]);
}

#[test]
fn every_shipped_controller_of_the_repository_is_listed_with_its_success_rate() {
    let bench = Bench::new();
    let document = bench.json("zoo list --seeds 0 --json", 0);
    let entries = document.as_array().unwrap();
    assert_eq!(entries.len(), 40);
    for entry in entries {
        assert_eq!((&entry["schema"], &entry["has_curve"]), (&1.into(), &true.into()), "{entry}");
        assert!(entry["success_rate"].as_f64().unwrap() > 0.8, "{entry}");
        // Everything that is not done says why.
        assert_eq!(entry["reason"].is_null(), entry["state"] == "done", "{entry}");
    }
}
