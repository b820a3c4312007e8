//! Hardening: phases that continue after an interruption, and three sets of seeds.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::Plan;
use mishandle::controllers::ControllerFile;
use mishandle::counterexample::{Counterexample, suite_files};
use mishandle::harden::{
    FinalRun, HardenProgress, build_differences, final_runs, finished, harden, harden_folder, resume,
};
use mishandle::plan::{AxisSetting, HardenPlan};
use mishandle::resolve::recorded_plan;
use mishandle::results::{Choice, Key, Remedy};
use mishandle::run::Opening;
use mishandle::store::{IfExists, RunFile, RunWriter};

use crate::hardening::{few, in_parts, without_paths};

/// A hardening of few simulations. Its training settings differ from those of the shipped
/// controller in the number of environments only, so that it takes few steps.
fn plan(folder: &Path) -> Plan {
    let shipped = ControllerFile::load(Path::new("controllers/point-reaching/ppo.safetensors")).unwrap();
    let mut settings: toml::Table = shipped.header.training.settings.parse().unwrap();
    settings.insert("rollout_steps".to_string(), 8.into());
    settings["episodes"].as_table_mut().unwrap().insert("environments".to_string(), 16.into());
    settings["run"].as_table_mut().unwrap().insert("validation_episodes".to_string(), 2.into());
    settings["run"].as_table_mut().unwrap().insert("validation_interval".to_string(), 2.into());
    let file = folder.join("settings.toml");
    std::fs::write(&file, settings.to_string()).unwrap();
    let table = HardenPlan {
        rounds: 2,
        settings: Some(file.to_string_lossy().into_owned()),
        validation: 6,
        episodes: 6,
        ..few()
    };
    let mut plan = Plan { space: "starts+delay".to_string(), ..Plan::new("point-reaching", "ppo") };
    plan.axes.insert("action_delay".to_string(), AxisSetting::Range([1.0, 3.0]));
    Plan { seed: 5, harden: Some(table), ..plan }
}

fn run_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(run_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "sqlite") {
            files.push(path);
        }
    }
    files
}

/// The seeds of all simulations, and the scenarios of those that are not corners, as bits.
fn rows(files: &[PathBuf]) -> (BTreeSet<u64>, BTreeSet<Vec<u64>>) {
    let mut seeds = BTreeSet::new();
    let mut scenarios = BTreeSet::new();
    for file in files {
        for simulation in RunFile::open(file).unwrap().simulations() {
            let simulation = simulation.unwrap();
            seeds.insert(simulation.seed);
            // Trial 2 of an evaluation has the corners, which are the same points everywhere.
            if simulation.trial != 2 {
                scenarios.insert(simulation.scenario.iter().flatten().map(|x| x.to_bits()).collect());
            }
        }
    }
    (seeds, scenarios)
}

#[test]
#[ignore = "long"]
fn an_interrupted_hardening_continues_to_the_same_result_and_its_sets_are_disjoint() {
    let home = tempfile::tempdir().unwrap();
    let plan = plan(home.path());
    let out = home.path().join("whole.safetensors");
    let mut phases = Vec::new();
    let whole = harden(&plan, &out, None, &mut |progress| {
        if phases.last() != Some(&progress.phase) {
            phases.push(progress.phase.clone());
        }
        ControlFlow::Continue(())
    });
    let whole = whole.unwrap().unwrap();
    for part in ["round 0: validation", "round 1: search", "round 1: training", "final, before"] {
        assert!(phases.iter().any(|phase| phase.starts_with(part)), "{part}: {phases:?}");
    }
    assert_eq!(whole.before, "ppo");
    assert!(whole.rounds[0].failures > 0, "delays of up to 3 control steps break this controller");
    assert_eq!(whole.rounds[0].environment_steps, 512);
    assert_eq!(out.exists(), whole.after.is_some());

    // A second one stops at the first report of each phase.
    let other = home.path().join("parts.safetensors");
    let found = in_parts(|is_first, watch| {
        if is_first {
            harden(&plan, &other, None, watch).unwrap()
        } else {
            resume(&harden_folder(&other), Opening::default(), None, watch).unwrap()
        }
    });
    assert_eq!(without_paths(found), without_paths(whole.clone()));

    // Both have the same regression suite: the failure modes of the round, minimized.
    let suite = |out: &Path| -> Vec<(String, String)> {
        let files = suite_files(&harden_folder(out).join("round-1").join("failures")).unwrap();
        let text = |file: &PathBuf| std::fs::read_to_string(file).unwrap();
        files
            .iter()
            .map(|file| (file.file_name().unwrap().to_string_lossy().into_owned(), text(file)))
            .collect()
    };
    assert!(!suite(&out).is_empty());
    assert!(harden_folder(&out).join("round-1/failures/before.safetensors").exists());
    for (name, text) in suite(&out) {
        let known = Counterexample::from_json(&text).unwrap();
        let from = known.minimized_from.clone().unwrap();
        assert!(known.expected.robustness < 0.0, "{name}");
        let smaller = known.scenario.iter().zip(&from.scenario).all(|(axis, worst)| {
            let distance = |value: f64| (value - axis.nominal.unwrap()).abs();
            distance(axis.value.unwrap()) <= distance(worst.unwrap())
        });
        assert!(smaller, "{name}: {:?} from {:?}", known.scenario, from.scenario);
        let resolved = known.resolve(Path::new("."), Some("point-reaching/ppo")).unwrap();
        assert!(known.replay(&resolved).unwrap().episode.is_violated(), "{name}");
    }
    assert_eq!(suite(&out).len(), suite(&other).len());

    // A finished one is read again without a simulation.
    let mut no_simulation = |progress: &HardenProgress| panic!("{progress:?}");
    let again = resume(&harden_folder(&out), Opening::default(), None, &mut no_simulation).unwrap();
    assert_eq!(again.unwrap(), whole);
    // Also elsewhere: the paths are those of the folder that is read.
    let copy = home.path().join("copy.harden");
    std::fs::create_dir(&copy).unwrap();
    for file in ["harden.toml", "before.safetensors", "settings.toml", "result.json"] {
        std::fs::copy(harden_folder(&out).join(file), copy.join(file)).unwrap();
    }
    let read = resume(&copy, Opening::default(), None, &mut no_simulation).unwrap().unwrap();
    let path = |path: &Path| path.to_string_lossy().into_owned();
    assert_eq!((&read.folder, read.after.is_some()), (&path(&copy), whole.after.is_some()));
    assert!(read.after.is_none_or(|after| after == path(&copy.with_extension("safetensors"))));
    assert!(!copy.with_extension("safetensors").exists());
    // A damaged or hostile result is an error, never another hardening.
    let result = copy.join("result.json");
    let nested = "[".repeat(200);
    for text in ["", "{", "[]", "{\"schema\": 1}", "null", &nested] {
        std::fs::write(&result, text).unwrap();
        let error = finished(&copy).unwrap_err().to_string();
        assert!(error.contains("result.json"), "{text:?}: {error}");
    }
    // So is one of another version, which says how to go on.
    let text = std::fs::read_to_string(harden_folder(&out).join("result.json")).unwrap();
    let mut older: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).unwrap();
    older.remove("worse");
    std::fs::write(&result, serde_json::to_string(&older).unwrap()).unwrap();
    let error = finished(&copy).unwrap_err();
    for part in ["result.json is not", "of this version", "`worse`"] {
        assert!(error.to_string().contains(part), "{part}: {error}");
    }
    let [Remedy::Advice(advice), Remedy::Another(Key::OUT)] = &error.remedies()[..] else {
        panic!("{:?}", error.remedies());
    };
    assert!(advice.starts_with("delete the file"), "{advice}");
    std::fs::File::create(&result).unwrap().set_len(5 << 20).unwrap();
    assert!(finished(&copy).unwrap_err().to_string().contains("result.json"));
    std::fs::remove_file(&result).unwrap();
    assert_eq!(finished(&copy).unwrap(), None);
    // Nothing in the folder is another file of the user.
    #[cfg(unix)]
    for link in ["result.json", "final"] {
        std::os::unix::fs::symlink(harden_folder(&out).join(link), copy.join(link)).unwrap();
        let error = finished(&copy).unwrap_err().with_causes();
        assert!(error.contains(&format!("{link}: it is a symbolic link")), "{error}");
        std::fs::remove_file(copy.join(link)).unwrap();
    }

    let files = run_files(&harden_folder(&out));
    let of = |is: &dyn Fn(&str) -> bool| -> Vec<PathBuf> {
        let name =
            |path: &PathBuf| path.strip_prefix(harden_folder(&out)).unwrap().to_string_lossy().into_owned();
        files.iter().filter(|path| is(&name(path))).cloned().collect()
    };
    let sets = [
        rows(&of(&|name| name.contains("search-") && name.starts_with("round"))),
        rows(&of(&|name| name.contains("validation"))),
        rows(&of(&|name| name.starts_with("final"))),
    ];
    for (index, (seeds, scenarios)) in sets.iter().enumerate() {
        assert!(!seeds.is_empty() && !scenarios.is_empty(), "set {index}");
        for (other_seeds, other_scenarios) in &sets[..index] {
            assert!(seeds.is_disjoint(other_seeds), "seeds of set {index}");
            assert!(scenarios.is_disjoint(other_scenarios), "scenarios of set {index}");
        }
    }
    // Training draws given scenarios of the searches only.
    let archive = std::fs::read_to_string(harden_folder(&out).join("round-1/failures/archive.csv")).unwrap();
    assert_eq!(archive.lines().next().unwrap().split(',').next(), Some("weight"));

    // The final runs name the controllers of a folder that was moved.
    let moved = home.path().join("moved.harden");
    std::fs::rename(harden_folder(&out), &moved).unwrap();
    let runs = final_runs(&moved, &whole);
    assert_eq!(runs.len(), 1 + usize::from(whole.after.is_some()));
    for FinalRun { run, controller } in runs {
        let run = RunFile::open(&run).unwrap();
        assert!(recorded_plan(run.header(), None).is_err(), "the path in the run");
        recorded_plan(run.header(), Some(path(&controller).as_str())).unwrap();
    }
}

#[test]
fn another_build_of_an_unfinished_hardening_is_a_difference() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("out.safetensors");
    assert_eq!(harden(&plan(home.path()), &out, None, &mut |_| ControlFlow::Break(())).unwrap(), None);
    let folder = harden_folder(&out);
    assert!(build_differences(&folder).unwrap().is_empty());
    let path = run_files(&folder).remove(0);
    let mut header = RunFile::open(&path).unwrap().header().clone();
    header.build.git_commit = "c0ffee".to_string();
    RunWriter::create(&path, &header, IfExists::Replace).unwrap().close().unwrap();
    let found = build_differences(&folder).unwrap();
    assert!(found.len() == 1 && found[0].contains("c0ffee"), "{found:?}");
}

#[test]
fn a_space_of_starts_has_no_margin_and_a_controller_that_does_not_fail_there_needs_nothing() {
    let home = tempfile::tempdir().unwrap();
    let plan = Plan { space: "starts".to_string(), axes: Default::default(), ..plan(home.path()) };
    let plan = Plan { target: "ball-balancing".to_string(), ..plan };
    let out = home.path().join("out.safetensors");
    let found = harden(&plan, &out, None, &mut |_| ControlFlow::Continue(())).unwrap().unwrap();
    assert!(found.verdict.starts_with("Nothing to fix"), "{}", found.verdict);
    assert!(found.margin.is_empty() && found.rounds.len() == 1 && found.rounds[0].failures == 0);
    assert!(found.after.is_none() && !out.exists());
    assert!(found.failure_probability[0].high.unwrap() < 0.1);
}

#[test]
fn mistakes_are_errors_before_anything_is_written() {
    let home = tempfile::tempdir().unwrap();
    let good = plan(home.path());
    let out = home.path().join("out.safetensors");
    let table = |change: &dyn Fn(&mut HardenPlan)| {
        let mut table = good.harden.clone().unwrap();
        change(&mut table);
        Plan { harden: Some(table), ..good.clone() }
    };
    for (plan, part) in [
        (Plan { harden: None, ..good.clone() }, "harden"),
        (Plan { controller: "expert".to_string(), ..good.clone() }, "the expert"),
        (Plan { controller: "nobody".to_string(), ..good.clone() }, "nobody"),
        (Plan { controller: String::new(), ..good.clone() }, "needs a controller"),
        (Plan { target: "toy/sphere-2d".to_string(), ..good.clone() }, "toy/sphere-2d"),
        (Plan { space: "delays".to_string(), ..good.clone() }, "delays"),
        (table(&|table| table.archive = 0.9), "harden.archive"),
        (table(&|table| table.nominal = f64::NAN), "harden.nominal"),
        (table(&|table| table.rounds = 0), "harden.rounds"),
        (table(&|table| table.risk = 3), "harden.risk"),
        (table(&|table| table.searches = vec!["bayes".to_string()]), "bayes"),
        (table(&|table| table.allow = vec!["space".to_string()]), "space"),
        (table(&|table| table.device = "tpu".to_string()), "tpu"),
        (table(&|table| table.device = "gpu".to_string()), "NoDevice"),
        (table(&|table| table.settings = Some("missing.toml".to_string())), "missing.toml"),
    ] {
        let error = harden(&plan, &out, None, &mut |_| ControlFlow::Continue(())).unwrap_err();
        let error = format!("{error:?} {error}");
        assert!(error.contains(part), "{part}: {error}");
        assert!(!out.exists() && !harden_folder(&out).exists(), "{part}");
    }
    let other = home.path().join("out.harden");
    let error = harden(&good, &other, None, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(error.contains(".safetensors") && !other.exists(), "{error}");
    std::fs::write(&out, "").unwrap();
    let error = harden(&good, &out, None, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert_eq!(error.remedies(), [Remedy::Another(Key::OUT), Remedy::set(Key::RESUME, Choice::On)]);
    let error = resume(home.path(), Opening::default(), None, &mut |_| ControlFlow::Continue(()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("harden.toml"), "{error}");
}
