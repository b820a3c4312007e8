//! `mishandle run`: a grid of runs in a folder.

use crate::cart_pole;
use std::process::Stdio;
use std::time::Duration;

use crate::bench::{Bench, signal, text, without_run};
use mishandle::store::RunFile;
use serde_json::Value;

const CAMPAIGN: &str = "target = 'toy/sphere-2d'\nseed = [1, 2]\n[falsify]\nsearch = ['random', 'nelder-mead']\ntrials = 2\n\
                        budget = 30\n[evaluate]\nepisodes = 20\n";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("campaign.toml", CAMPAIGN);
    bench
}

#[test]
fn the_runs_of_a_campaign_have_the_rows_of_single_runs() {
    let bench = bench();
    let printed = bench.check("run campaign.toml --out runs/all", 1);
    let single = "falsify toy/sphere-2d --seed 2 --search nelder-mead --trials 2 --budget 30 -k falsify.isolate=false --out single.sqlite";
    bench.check(single, 1);
    let digest = |path| RunFile::open(bench.path(path)).unwrap().content_digest().unwrap();
    assert_eq!(digest("runs/all/2_nelder-mead_falsify.sqlite"), digest("single.sqlite"));
    let rows = |kind| printed.lines().filter(|line| line.contains(kind)).count();
    assert_eq!((rows("_falsify"), rows("_evaluate")), (4, 2), "{printed}");
}

#[test]
fn a_resumed_campaign_prints_the_same_results_and_needs_all_its_files() {
    let bench = bench();
    let whole = bench.check("run campaign.toml --out all --json", 1);
    assert_eq!(bench.check("run --resume all --json", 1), whole);
    let document: Value = serde_json::from_str(&whole).unwrap();
    assert_eq!(document["is_complete"], true);
    assert_eq!(document["runs"].as_array().unwrap().len(), 6);
    let path = bench.path("all/2_evaluate.sqlite");
    std::fs::copy(bench.path("all/1_evaluate.sqlite"), &path).unwrap();
    bench.refuses(
        "run --resume all",
        &["2_evaluate.sqlite does not belong to the run `2_evaluate`", "the file was replaced"],
    );
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink(bench.path("all/1_evaluate.sqlite"), &path).unwrap();
    for command in ["run --resume all", "report all --out pages"] {
        bench.refuses(command, &["2_evaluate.sqlite does not belong", "it is a symbolic link"]);
    }
    std::fs::remove_file(&path).unwrap();
    bench.refuses("run --resume all", &["is not the folder of a campaign", "2_evaluate.sqlite"]);
    // A link to any file of the user, whose content must not be printed.
    bench.write("secret", "password: hunter2");
    std::fs::remove_file(bench.path("all/campaign.toml")).unwrap();
    std::os::unix::fs::symlink(bench.path("secret"), bench.path("all/campaign.toml")).unwrap();
    bench.refuses("run --resume all", &["campaign.toml: it is a symbolic link; put a copy in its place"]);
    assert!(!String::from_utf8_lossy(&bench.run("run --resume all").stderr).contains("hunter2"));
}

#[test]
fn mistakes_are_reported_before_the_folder_is_created() {
    let bench = bench();
    for (campaign, message) in [
        ("target = ['toy/sphere-2d', 'toy/sfere']\n[falsify]\n", "there is no target `toy/sfere`"),
        ("target = 'toy/sphere-2d'\n[falsify]\nformula = ['success', 'succes']\n", "`succes`"),
        ("target = 'toy/sphere-2d'\n[falsify]\nserch = 'random'\n", "did you mean `falsify.search`?"),
        ("target = 'toy/sphere-2d'\n", "[falsify]"),
        ("target = 'ball-balancing'\ncontroller = ['ppo', 'expert']\n[harden]\n", "the expert"),
        ("target = 'ball-balancing'\ncontroller = 'ppo'\n[harden]\nrounds = [1, 0]\n", "harden.rounds"),
        (
            "target = 'ball-balancing'\n[[requirement]]\nname = 'a'\n",
            "check TARGET --requirements wrong.toml",
        ),
        (
            "target = 'ball-balancing'\ncontroller = 'ppo'\n[harden]\n[screening]\n",
            "the question of a screening",
        ),
    ] {
        bench.write("wrong.toml", campaign);
        bench.refuses("run wrong.toml --out wrong", &["wrong.toml", message]);
        assert!(!bench.path("wrong").exists());
    }
    bench.refuses("run missing.toml", &["missing.toml"]);
    bench.refuses("run --resume .", &["is not the folder of a campaign"]);
    bench.check("run campaign.toml --out all", 1);
    bench.refuses("run campaign.toml --out all", &["all exists already", "--resume"]);
}

/// Two hardenings of few simulations, whose training takes longer than a signal.
const HARDENINGS: &str = "target = 'cartpole.toml'\ncontroller = './start.safetensors'\nspace = 'starts+delay'\nseed = [5, 6]\n[axes]\n\
                          action_delay = [1, 3]\n[harden]\nrounds = 1\nsteps = 40960\nsettings = 'settings.toml'\n\
                          searches = ['random']\nbudget = 8\nvalidation = 4\nepisodes = 4\nrisk = 100\nmargin = 10\n";

/// Training settings with which an iteration takes few steps.
pub const SETTINGS: &str = "rollout_steps = 8\nepisodes.environments = 16\nrun.validation_episodes = 2\nrun.validation_interval = 2\n\
                        policy = { hidden = [64, 64], activation = 'elu' }\n";

/// Runs a command, sends it a signal when a path exists, and returns its exit code and stderr.
fn stopped(bench: &Bench, arguments: &str, path: &str, name: &str) -> (Option<i32>, String) {
    let mut command = bench.command(arguments);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    while !bench.path(path).exists() {
        if child.try_wait().unwrap().is_some() {
            panic!("{arguments} ended without {path}: {}", text(&child.wait_with_output().unwrap().stderr));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&child, name);
    let output = child.wait_with_output().unwrap();
    (output.status.code(), text(&output.stderr))
}

#[test]
fn hardenings_of_a_campaign_continue_after_a_kill_and_have_rows_in_table_document_and_pages() {
    let bench = Bench::new();
    bench.write("hardenings.toml", HARDENINGS);
    bench.write("settings.toml", SETTINGS);
    cart_pole::write(&bench.path(""), |text| text);
    bench.check("train cartpole.toml --settings settings.toml --steps 512 --out start.safetensors", 0);
    let whole = bench.run("run hardenings.toml --out whole -k engine.jobs=2 --json");
    let document: Value = serde_json::from_str(&text(&whole.stdout)).unwrap();
    let runs = document["runs"].as_array().unwrap();
    assert_eq!((runs.len(), &runs[0]["kind"], &document["is_complete"]), (2, &"harden".into(), &true.into()));
    let accepted: Vec<bool> = runs.iter().map(|run| !run["result"]["after"].is_null()).collect();
    let code = i32::from(accepted.contains(&false));
    assert_eq!(whole.status.code(), Some(code));
    for (run, accepted) in runs.iter().zip(accepted) {
        let name = run["name"].as_str().unwrap();
        assert!(bench.path(&format!("whole/{name}.harden/result.json")).exists());
        assert_eq!(bench.path(&format!("whole/{name}.safetensors")).exists(), accepted);
        assert!(run["result"]["worse"].is_array());
    }
    // The settings of a hardening are those of its start.
    bench.write("settings.toml", "nonsense");
    let table = bench.check("run --resume whole", code);
    bench.check("report whole --out pages -k report.simulations=false", 0);
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows[0][..3], ["run", "accepted", "failures"]);
    assert_eq!([rows[1][0], rows[2][0]], ["5", "6"]);
    let index = std::fs::read_to_string(bench.path("pages/index.html")).unwrap();
    assert!(
        index.contains("of 2 hardenings accepted a controller.") && index.contains("href=\"runs/5.html\"")
    );
    let page = std::fs::read_to_string(bench.path("pages/runs/6.html")).unwrap();
    assert!(page.contains("Before and after") && page.contains("href=\"../index.html\""));

    bench.write("settings.toml", SETTINGS);
    let (code_of_kill, _) =
        stopped(&bench, "run hardenings.toml --out parts", "parts/5.harden/round-1/settings.toml", "KILL");
    assert_eq!(code_of_kill, None);
    // As after a kill between the start of the curve and the first checkpoint.
    let round = bench.path("parts/5.harden/round-1");
    for entry in std::fs::read_dir(&round).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|extension| extension == "checkpoint") {
            std::fs::remove_file(entry).unwrap();
        }
    }
    std::fs::write(round.join("curve.csv"), "").unwrap();
    let (code_of_stop, said) =
        stopped(&bench, "run --resume parts", "parts/6.harden/round-1/settings.toml", "INT");
    assert_eq!(code_of_stop, Some(130), "{said}");
    assert!(said.contains("1 of 2 runs finished") && said.contains("run --resume parts"), "{said}");
    let resumed = bench.check("run --resume parts --json", code);
    assert_eq!(resumed.replace("parts", "whole"), text(&whole.stdout));

    let changed = HARDENINGS.replace("budget = 8", "budget = 9");
    std::fs::write(bench.path("whole/campaign.toml"), changed).unwrap();
    bench.refuses("run --resume whole", &["5.harden does not belong to the run `5`", "its plan"]);
    std::fs::remove_dir_all(bench.path("parts/6.harden")).unwrap();
    bench.refuses("run --resume parts", &["is not the folder of a campaign", "6.harden"]);
    std::os::unix::fs::symlink(bench.path("whole/6.harden"), bench.path("parts/6.harden")).unwrap();
    for command in ["run --resume parts", "report parts --out other"] {
        bench.refuses(command, &["6.harden does not belong to the run `6`: it is a symbolic link"]);
    }
}

#[test]
fn a_plan_of_one_question_is_asked_as_by_its_command() {
    let bench = Bench::new();
    bench.write(
        "plan.toml",
        "target = 'toy/sphere-2d'\nseed = 3\n[falsify]\nsearch = 'random'\ntrials = 2\nbudget = 30\n[engine]\ndurable = true\n",
    );
    let document = |command: &str| {
        let output = bench.run(command);
        let found = serde_json::from_slice(&output.stdout);
        without_run(found.unwrap_or_else(|_| panic!("{}", text(&output.stderr))))
    };
    let asked = document("run plan.toml --out a.sqlite --json");
    assert_eq!(asked, document("falsify --plan plan.toml --out b.sqlite --json"));
    let digest = |path| RunFile::open(bench.path(path)).unwrap().content_digest().unwrap();
    assert_eq!(digest("a.sqlite"), digest("b.sqlite"));
    // Keys and flags edit the plan, and a list of values makes a grid.
    let longer = document("run plan.toml -k falsify.trials=3 --seed 4 --out c.sqlite --json");
    assert_eq!(longer["trials"].as_array().unwrap().len(), 3);
    bench.run("run plan.toml -k 'seed=[4, 5]' -k falsify.trials=3 --out grid");
    assert!(bench.path("grid/5.sqlite").exists());
    bench.run("run plan.toml -k falsify.trials=3 -k falsify.isolate=false --seed 4 --out d.sqlite");
    assert_eq!(digest("grid/4.sqlite"), digest("d.sqlite"));
    bench.refuses("run plan.toml -k falsify.budget=many", &["`falsify.budget` is many"]);
    bench.refuses("run --resume grid -k falsify.budget=3", &["part of the question"]);
    bench.refuses("run --resume a.sqlite", &["resume it with: mishandle falsify --resume a.sqlite"]);
    bench.write("unsafe.toml", "target = 'toy/sphere-2d'\n[falsify]\n[engine]\nany-build = true\n");
    bench.refuses("run unsafe.toml", &["`engine.any-build`", "typed by a person"]);
}

#[test]
fn a_target_file_is_searched_for_failures() {
    let bench = Bench::new();
    cart_pole::write(&bench.path(""), |text| text);
    bench.write("settings.toml", SETTINGS);
    bench.check("train cartpole.toml --settings settings.toml --steps 512 --out start.safetensors", 0);
    let start = "cartpole.toml --controller ./start.safetensors";
    let flags = "-k falsify.trials=1 -k falsify.budget=5 -k falsify.search=random --json";
    let run = |command: &str| {
        let output = bench.run(command);
        let found: Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)));
        (output.status.code(), found["trials"].clone())
    };
    let asked = run(&format!("run {start} {flags} --out a.sqlite"));
    assert_eq!(
        asked,
        run(&format!("falsify {start} --trials 1 --budget 5 --search random --json --out b.sqlite"))
    );
    bench.refuses("run cartpole.toml --out runs -k guard=x", &["there is no key `guard`"]);
}

#[test]
fn jobs_change_no_row() {
    let bench = Bench::new();
    bench.write("grid.toml", "target = 'toy/sphere-2d'\nseed = [1, 2, 3]\n[falsify]\nsearch = ['random', 'nelder-mead']\ntrials = 2\nbudget = 30\n");
    bench.check("run grid.toml --out one", 1);
    bench.check("run grid.toml --out three -k engine.jobs=3", 1);
    bench.check("report three --out pages -k report.simulations=false", 0);
    for name in ["1_random", "2_random", "3_nelder-mead"] {
        let digest = |folder| {
            RunFile::open(bench.path(&format!("{folder}/{name}.sqlite"))).unwrap().content_digest().unwrap()
        };
        assert_eq!(digest("one"), digest("three"), "{name}");
    }
    let page = std::fs::read_to_string(bench.path("pages/statistics.md")).unwrap();
    let pairs = page.lines().filter(|line| line.contains("`random`, `nelder-mead`"));
    assert_eq!(pairs.count(), 3, "each seed has a test of both searches: {page}");
}

#[test]
fn the_starts_of_an_evaluation_are_the_first_ones_of_a_longer_one() {
    let bench = Bench::new();
    let rows = |episodes: u32| {
        let flags = "evaluate point-reaching --controller expert --action-noise 0.5 --seed 0";
        bench.check(&format!("{flags} --episodes {episodes} --out {episodes}.sqlite"), 0);
        let run = RunFile::open(bench.path(&format!("{episodes}.sqlite"))).unwrap();
        let rows = run.trial_simulations(1).map(|row| row.unwrap());
        rows.map(|row| (row.number, row.seed, row.scenario, row.robustness)).collect::<Vec<_>>()
    };
    let short = rows(5);
    let long = rows(25);
    assert_eq!((short.len(), long.len()), (5, 25));
    assert_eq!(short[..], long[..5]);
}
