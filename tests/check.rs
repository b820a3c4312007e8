//! The requirements of a file, checked on targets in closed form.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::Plan;
use mishandle::check::{CheckProgress, CheckSubject, Requirements, check, differences, verified};
use mishandle::counterexample::Counterexample;
use mishandle::plan::CheckSettings;
use mishandle::requirements::{RequirementFile, TEMPLATES};
use mishandle::results::{Check, CheckCell, CheckCounterexample, CheckVerdict, Command};
use mishandle::store::RunFile;
use mishandle::{MishandleError, ResolvedPlan};

/// The point (0.3, -0.4) of [-1, 1]² must be avoided by 0.1: the signal is the distance minus 0.1,
/// so pi * 0.01 / 4 = 0.785 % of the space violate `distance >= 0`.
const TARGET: &str = "toy/sphere-2d";

/// Names commands by their data.
fn words(command: &Command) -> String {
    match command {
        Command::ReplayFile { file, moved } => format!("replay {file} {moved:?}"),
        command => format!("{command:?}"),
    }
}

fn file(requirements: &str) -> RequirementFile {
    RequirementFile::from_toml(requirements).unwrap()
}

fn of_file<'a>(file: &'a RequirementFile, text: &'a str) -> Requirements<'a> {
    Requirements { file, path: Path::new("requirements.toml"), text, words }
}

fn settings() -> CheckSettings {
    CheckSettings { episodes: Some(200), budget: Some(200), batch: 16, ..CheckSettings::default() }
}

fn subject(target: &str, controller: &str, seed: u64) -> CheckSubject {
    CheckSubject { plan: Plan { seed, ..Plan::new(target, controller) }, target: None }
}

fn run(requirements: &str, folder: &Path, seed: u64) -> Check {
    let file = file(requirements);
    let mut watch = |_: &_| ControlFlow::Continue(());
    check(&[subject(TARGET, "", seed)], &of_file(&file, requirements), &settings(), folder, &mut watch)
        .unwrap()
        .unwrap()
}

fn cell<'a>(found: &'a Check, name: &str) -> &'a CheckCell {
    found.cells.iter().find(|cell| cell.requirement == name).unwrap()
}

/// The name of the only signal of the target.
fn signal() -> String {
    let resolved = ResolvedPlan::new(&Plan::new(TARGET, "")).unwrap();
    resolved.signal_names()[0].clone()
}

#[test]
fn each_verdict_is_what_the_geometry_says() {
    let x = signal();
    let requirements = format!(
        r#"
        [[requirement]]
        name = "avoid"
        formula = "success"
        [[requirement]]
        name = "R-1.2"
        formula = "always({x} >= -10)"
        severity = "critical"
        clause = ["A 1", "B 2"]
        [[requirement]]
        name = "rarely"
        formula = "success"
        max-failure-rate = 0.1
        [[requirement]]
        name = "almost-never"
        formula = "success"
        max-failure-rate = 0.001
        [[requirement]]
        name = "always-wrong"
        formula = "always({x} <= -10)"
        severity = "warning"
        [[requirement]]
        name = "other-machine"
        formula = "always(force <= 1)"
        "#
    )
    .replace(
        "\"success\"",
        &format!("\"{}\"", ResolvedPlan::new(&Plan::new(TARGET, "")).unwrap().specification.requirement),
    );
    let folder = tempfile::tempdir().unwrap();
    let found = run(&requirements, folder.path(), 1);
    assert_eq!(cell(&found, "avoid").verdict, CheckVerdict::Violated);
    assert_eq!(cell(&found, "R-1.2").verdict, CheckVerdict::NotViolated);
    // The true rate is 0.8 %: 200 random scenarios show that it is below 10 %, and not whether it
    // is below 0.1 %.
    assert_eq!(cell(&found, "rarely").verdict, CheckVerdict::NotViolated);
    assert_eq!(cell(&found, "almost-never").verdict, CheckVerdict::NoVerdict);
    assert_eq!(cell(&found, "always-wrong").verdict, CheckVerdict::Violated);
    assert_eq!(cell(&found, "other-machine").verdict, CheckVerdict::NotApplicable);
    assert_eq!(cell(&found, "other-machine").missing_signals, ["force"]);
    assert_eq!(found.requirements[1].clauses, ["A 1", "B 2"]);
    // A warning does not fail, and what could not be checked is open.
    assert!(found.fails(cell(&found, "avoid")) && !found.fails(cell(&found, "always-wrong")));
    assert!(found.is_open(cell(&found, "almost-never")) && found.is_open(cell(&found, "other-machine")));
    // A violation in random scenarios needs no search.
    let searched =
        |name: &str| found.controllers[0].runs.iter().any(|run| run.requirement.as_deref() == Some(name));
    assert!(searched("R-1.2") && !searched("always-wrong") && !searched("rarely"));
    assert_eq!(verified(folder.path(), words).unwrap().unwrap(), found);
}

#[test]
fn a_counterexample_violates_its_requirement_again_and_the_runs_have_their_digests() {
    let x = signal();
    let requirements = format!("[[requirement]]\nname = \"wrong\"\nformula = \"always({x} <= -10)\"");
    let folder = tempfile::tempdir().unwrap();
    let found = run(&requirements, folder.path(), 2);
    let evidence = cell(&found, "wrong").counterexample.clone().unwrap();
    let recorded = Counterexample::read(Path::new(evidence.file.as_ref().unwrap())).unwrap();
    let resolved = recorded.resolve(folder.path(), None).unwrap();
    let again = recorded.replay(&resolved).unwrap();
    assert!(again.differences.is_empty(), "{:?}", again.differences);
    assert_eq!(again.episode.robustness(), Some(evidence.robustness.0));
    for run in &found.controllers[0].runs {
        let file = RunFile::open(&run.run).unwrap();
        assert_eq!(format!("{:032x}", file.content_digest().unwrap()), run.digest);
        assert_eq!(file.counts().unwrap().simulations, run.simulations);
    }
}

#[test]
fn an_interrupted_check_continues_to_the_same_result_and_a_changed_file_is_an_error() {
    let x = signal();
    let requirements = format!("[[requirement]]\nname = \"fine\"\nformula = \"always({x} >= -10)\"");
    let whole = tempfile::tempdir().unwrap();
    let parts = tempfile::tempdir().unwrap();
    let expected = run(&requirements, whole.path(), 3);
    let file = file(&requirements);
    let text = &requirements;
    let subjects = [subject(TARGET, "", 3)];
    let mut interruptions = 0;
    loop {
        let mut calls = 0;
        let mut watch = |_: &_| {
            calls += 1;
            if calls > 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        match check(&subjects, &of_file(&file, text), &settings(), parts.path(), &mut watch).unwrap() {
            None => interruptions += 1,
            Some(found) => {
                assert!(interruptions > 1);
                assert_eq!(found.cells, expected.cells);
                let digests = |check: &Check| {
                    check.controllers[0].runs.iter().map(|run| run.digest.clone()).collect::<Vec<_>>()
                };
                assert_eq!(digests(&found), digests(&expected));
                break;
            }
        }
        assert!(interruptions < 200);
    }
    let other = self::file(&requirements.replace("-10", "-20"));
    let error = check(&subjects, &of_file(&other, text), &settings(), parts.path(), &mut |_| {
        ControlFlow::Continue(())
    });
    assert!(error.is_err());
}

/// The simulations of a finished check do not depend on this key, but its verdicts do.
#[test]
fn a_finished_check_concludes_with_its_own_share_without_a_verdict_only() {
    let text =
        format!("[[requirement]]\nname = \"odd\"\nformula = \"always(sqrt({} - 0.5) <= 2)\"", signal());
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run(&text, folder.path(), 1).cells[0].verdict, CheckVerdict::NoVerdict);
    let mut other = subject(TARGET, "", 1);
    other.plan.max_without_verdict = 1.0;
    let file = file(&text);
    let ask = |subject, folder: &Path| {
        let mut watch = |_: &_| ControlFlow::Continue(());
        let found = check(&[subject], &of_file(&file, &text), &settings(), folder, &mut watch);
        found.map_err(|error| error.with_causes())
    };
    let error = ask(other.clone(), folder.path()).unwrap_err();
    assert!(error.contains("max-without-verdict: recorded 0.05, given 1.0"), "{error}");
    let fresh = tempfile::tempdir().unwrap();
    let found = ask(other, fresh.path()).unwrap().unwrap();
    assert_eq!(found.cells[0].verdict, CheckVerdict::NotViolated);
}

#[test]
fn mistakes_are_found_before_the_first_simulation() {
    let x = signal();
    let folder = tempfile::tempdir().unwrap();
    for (keys, expected) in [
        ("formula = \"always(\"", "expected"),
        ("formula = \"always(X >= 0)\"\nspace = \"nowhere\"", "nowhere"),
        ("formula = \"always(X >= 0)\"\nbudget = 0", "0"),
        ("formula = \"always(X >= 0)\"\nepisodes = 0", "0"),
        ("formula = \"always[0:9999](X >= 0)\"", "9999"),
    ] {
        let text = format!("[[requirement]]\nname = \"a\"\n{}", keys.replace('X', &x));
        let file = file(&text);
        let settings = CheckSettings { episodes: None, budget: None, ..settings() };
        let mut watch = |_: &_| panic!("a simulation has started");
        let found: Result<_, MishandleError> =
            check(&[subject(TARGET, "", 0)], &of_file(&file, &text), &settings, folder.path(), &mut watch);
        let error = found.unwrap_err().with_causes();
        assert!(error.contains(expected), "{keys}: {error}");
        assert!(error.starts_with("requirement `a`: "), "{keys}: {error}");
    }
    assert!(!folder.path().join("runs").exists());
}

/// Returns the number of recorded simulations that leave one of their requirements open.
fn open_rows(found: &Check) -> u64 {
    let open = |path: &str| {
        let file = RunFile::open(path).unwrap();
        let own = file.header().verdicts.iter().map(|name| name.starts_with("requirement_"));
        let own: Vec<bool> = own.collect();
        let is_open =
            |verdicts: &[Option<f64>]| verdicts.iter().zip(&own).any(|(x, own)| *own && x.is_none());
        file.simulations().filter(|row| is_open(&row.as_ref().unwrap().verdicts)).count() as u64
    };
    found.controllers[0].runs.iter().map(|run| open(&run.run)).sum()
}

/// Scenarios nearer to the obstacle than 0.5 violate `keeps-away`, and have no square root.
#[test]
fn a_requirement_that_is_undefined_takes_no_verdict_from_another_one() {
    let x = signal();
    let keeps_away = format!("[[requirement]]\nname = \"keeps-away\"\nformula = \"always({x} >= 0.5)\"\n");
    let odd = format!("[[requirement]]\nname = \"odd\"\nformula = \"always(sqrt({x} - 0.5) <= 2)\"\n");
    let found =
        [keeps_away.clone(), format!("{keeps_away}{odd}"), format!("{odd}{keeps_away}")].map(|text| {
            let folder = tempfile::tempdir().unwrap();
            let found = run(&text, folder.path(), 1);
            let odd = found.cells.iter().find(|cell| cell.requirement == "odd");
            // It violates nothing where it is defined: absent evidence is never agreement.
            let is_open =
                |odd: &CheckCell| odd.random.without_verdict > 0 && odd.verdict == CheckVerdict::NoVerdict;
            assert!(odd.is_none_or(|odd| is_open(odd) && found.is_open(odd)), "{odd:?}");
            assert_eq!(found.without_verdict.ends.undecided, open_rows(&found), "{text}");
            assert_eq!(found.without_verdict.is_too_large(), odd.is_some(), "{text}");
            let cell = cell(&found, "keeps-away");
            (cell.verdict, cell.failure_rate, cell.random.without_verdict)
        });
    assert_eq!((found[0].0, found[0].2), (CheckVerdict::Violated, 0));
    assert!(found.iter().all(|other| *other == found[0]), "{found:?}");
}

#[test]
fn the_name_of_a_formula_comes_with_its_text() {
    let folder = tempfile::tempdir().unwrap();
    let found =
        run("[[requirement]]\nname = \"a\"\nformula = \"success\"\nmax-failure-rate = 0.5", folder.path(), 1);
    let target = ResolvedPlan::new(&Plan::new(TARGET, "")).unwrap().target;
    let success = target.formulas.iter().find(|formula| formula.name == "success").unwrap();
    assert_eq!(found.requirements[0].formula, "success");
    assert_eq!(found.requirements[0].formula_text(), success.text);
}

#[test]
fn a_result_is_what_follows_from_its_runs_and_its_requirements() {
    let x = signal();
    let text = format!(
        "[[requirement]]\nname = \"a\"\nformula = \"always({x} >= 0.5)\"\n[[requirement]]\nname = \"b\"\nformula = \"always({x} >= \
         -10)\"\n[[requirement]]\nname = \"c\"\nformula = \"always(force <= 1)\"\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let found = run(&text, folder.path(), 1);
    let files: Vec<RunFile> =
        found.controllers[0].runs.iter().map(|run| RunFile::open(&run.run).unwrap()).collect();
    let compare = |found: &Check, text: &str| {
        let run = |run: &str| files.iter().find(|file| file.path() == Path::new(run));
        differences(found, text, run, |file| Path::new(file).to_path_buf()).unwrap().problems
    };
    assert_eq!(compare(&found, &text), Vec::<String>::new());
    let forged = |change: &dyn Fn(&mut Check)| {
        let mut forged = found.clone();
        change(&mut forged);
        assert!(!compare(&forged, &text).is_empty(), "{forged:?}");
    };
    forged(&|check| check.cells[0].verdict = CheckVerdict::NotViolated);
    forged(&|check| check.cells[0].counterexample = None);
    forged(&|check| check.cells[0].counterexample.as_mut().unwrap().simulation += 1);
    forged(&|check| check.cells[1].random.simulations += 1);
    forged(&|check| check.cells[2].verdict = CheckVerdict::NotViolated);
    forged(&|check| check.requirements[0].formula = format!("always({x} >= 0.4)"));
    forged(&|check| check.controllers[0].runs[0].digest = "0".repeat(32));
    forged(&|check| drop(check.controllers[0].runs.pop()));
    forged(&|check| drop(check.cells.pop()));
    // Each sentence is compared, too.
    forged(&|check| check.target_kind = "robot".to_string());
    forged(&|check| check.search = "exhaustive proof".to_string());
    forged(&|check| check.program = "certified".to_string());
    forged(&|check| check.controllers[0].name = "certified".to_string());
    forged(&|check| check.requirements[1].space = "everything".to_string());
    forged(&|check| check.cells[0].evidence += ", certified");
    forged(&|check| {
        let (mut violated, other) = (check.cells[0].clone(), check.cells[2].clone());
        (violated.verdict, violated.evidence) = (other.verdict, other.evidence);
        (violated.missing_signals, violated.failure_rate) = (other.missing_signals, None);
        check.cells[0] = violated;
    });
    assert!(!compare(&found, &text.replace("0.5", "0.4")).is_empty());
    // The folder has another path now.
    let moved = tempfile::tempdir().unwrap();
    let place = moved.path().join("moved");
    std::fs::rename(folder.path(), &place).unwrap();
    let again = verified(&place, words).unwrap().unwrap();
    assert!(again.controllers[0].runs.iter().all(|run| RunFile::open(&run.run).is_ok()));
    let violation = again.cells[0].counterexample.as_ref().unwrap();
    let file = violation.file.as_ref().unwrap();
    assert!(Counterexample::read(Path::new(file)).is_ok() && violation.replay.contains(file.as_str()));
}

#[test]
fn the_files_of_two_controllers_and_requirements_never_have_the_same_path() {
    let requirement =
        |name: &str| format!("[[requirement]]\nname = \"{name}\"\nformula = \"always(tool_speed <= 0)\"\n");
    let text = requirement("v2-speed") + &requirement("speed");
    let file = file(&text);
    let folder = tempfile::tempdir().unwrap();
    let subjects = ["ppo", "ppo-v2"].map(|name| {
        let path = folder.path().join(format!("{name}.safetensors"));
        std::fs::copy("controllers/point-reaching/ppo.safetensors", &path).unwrap();
        subject("point-reaching", path.to_str().unwrap(), 0)
    });
    let settings = CheckSettings { episodes: Some(1), ..settings() };
    let mut watch = |_: &_| ControlFlow::Continue(());
    let found =
        check(&subjects, &of_file(&file, &text), &settings, &folder.path().join("checked"), &mut watch)
            .unwrap()
            .unwrap();
    let files = found.cells.iter().map(|cell| cell.counterexample.clone().unwrap().file.unwrap());
    let files: std::collections::BTreeSet<String> = files.collect();
    assert_eq!(files.len(), 4, "{files:?}");
}

#[test]
fn a_folder_with_files_of_something_else_stays_as_it_is() {
    let text = format!("[[requirement]]\nname = \"fine\"\nformula = \"always({} >= -10)\"", signal());
    let file = file(&text);
    for (name, content) in
        [("report.md", "mine"), ("junit.xml", "mine"), ("notes.txt", ""), ("check.json", "{}")]
    {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(name), content).unwrap();
        let mut watch = |_: &_| panic!("a simulation has started");
        let found =
            check(&[subject(TARGET, "", 0)], &of_file(&file, &text), &settings(), folder.path(), &mut watch);
        let error = found.unwrap_err().with_causes();
        assert!(error.contains(name), "{error}");
        assert_eq!(std::fs::read_to_string(folder.path().join(name)).unwrap(), content);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn a_check_that_was_killed_while_it_created_a_run_continues_and_one_that_runs_is_left_alone() {
    let text = format!("[[requirement]]\nname = \"fine\"\nformula = \"always({} >= -10)\"", signal());
    let folder = tempfile::tempdir().unwrap();
    let first = run(&text, folder.path(), 3);
    for run in &first.controllers[0].runs {
        std::fs::write(&run.run, "").unwrap();
    }
    assert_eq!(run(&text, folder.path(), 3), first);
    let file = file(&text);
    let again = || {
        let mut watch = |_: &_| ControlFlow::Continue(());
        check(&[subject(TARGET, "", 3)], &of_file(&file, &text), &settings(), folder.path(), &mut watch).err()
    };
    let mut inner = None;
    let mut watch = |_: &_| {
        inner.get_or_insert_with(&again);
        ControlFlow::Continue(())
    };
    let outer =
        check(&[subject(TARGET, "", 3)], &of_file(&file, &text), &settings(), folder.path(), &mut watch);
    assert_eq!(outer.unwrap().unwrap(), first);
    let error = inner.unwrap().expect("a second check of the same folder is refused");
    assert!(error.to_string().starts_with("another check is writing "), "{error}");
}

/// Every formula and space of the templates is one of every task.
#[test]
fn templates_apply_to_the_tasks() {
    for (name, text) in TEMPLATES {
        let file = file(text);
        for task in ["point-reaching", "cube-stacking", "cloth-placing"] {
            for requirement in &file.requirements {
                let formula = requirement.timed_formula();
                let space = requirement.check.space.clone().unwrap_or_default();
                let mut plan = Plan { space, ..Plan::new(task, "expert") };
                plan.requirements.insert("requirement".to_string(), formula);
                let resolved = ResolvedPlan::new(&plan);
                assert!(resolved.is_ok(), "{name}, {task}, {}: {resolved:?}", requirement.name);
            }
        }
    }
}

/// Requirements in one space share their random scenarios, so one that states fewer has more: its
/// evidence says why. A result without this sentence does not follow from the runs.
#[test]
fn a_row_says_why_it_has_another_number_of_random_scenarios_than_its_requirement_states() {
    let x = signal();
    let few = format!("[[requirement]]\nname = \"few\"\nformula = \"always({x} >= -10)\"\nepisodes = 30\n");
    let text = format!("{few}[[requirement]]\nname = \"other\"\nformula = \"always({x} >= -11)\"\n");
    let alone = few.as_str();
    for (text, episodes, expected) in [
        (
            &*text,
            None,
            Some("; 100 random scenarios instead of its 30: requirements in one space share them"),
        ),
        (alone, None, None),
        (alone, Some(7), Some("; 7 random scenarios instead of its 30: this number was requested")),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let settings = CheckSettings { episodes, ..settings() };
        let mut announced = None;
        let mut watch = |progress: &CheckProgress| {
            announced = announced.or(progress.largest);
            ControlFlow::Continue(())
        };
        let requirements = file(text);
        let asked = of_file(&requirements, text);
        let found = check(&[subject(TARGET, "", 1)], &asked, &settings, folder.path(), &mut watch);
        let found = found.unwrap().unwrap();
        let few = cell(&found, "few");
        match expected {
            Some(expected) => assert!(few.evidence.ends_with(expected), "{}", few.evidence),
            None => assert!(!few.evidence.contains("instead"), "{}", few.evidence),
        }
        // Nothing is violated, so that no simulation is left out.
        let run: u64 = found.controllers[0].runs.iter().map(|run| run.simulations).sum();
        let announced = announced.unwrap();
        assert_eq!((announced.simulations(), announced.random), (run, few.random.simulations));
        assert_eq!(verified(folder.path(), words).unwrap().unwrap().cells[0].evidence, few.evidence);
    }
}

/// The worst violation can be one that a search for another requirement found, which counts in no
/// rate.
#[test]
fn the_worst_violation_says_what_found_it() {
    let x = signal();
    let named = |name: &str, threshold: f64| {
        format!("[[requirement]]\nname = \"{name}\"\nformula = \"always({x} >= {threshold})\"\n")
    };
    // Random scenarios violate `wide`, and the search for `narrow` comes closer to the point.
    let text = named("wide", 0.3) + &named("narrow", 0.0);
    let folder = tempfile::tempdir().unwrap();
    let found = run(&text, folder.path(), 2);
    let runs = &found.controllers[0].runs;
    let wide = cell(&found, "wide");
    let worst = wide.counterexample.as_ref().unwrap();
    assert!(wide.random.violated > 0 && worst.run == runs[1].run, "{wide:?}");
    let by = "found by the search for narrow";
    assert_eq!(found.found_by(worst).as_deref(), Some(by));
    let verdict = mishandle::verdict::check(&found);
    let fact = verdict.facts.iter().find(|fact| fact.text.starts_with("wide: ")).unwrap();
    assert!(fact.text.ends_with(&format!(" ({by})")), "{}", fact.text);
    let random = CheckCounterexample { run: runs[0].run.clone(), ..worst.clone() };
    assert_eq!(found.found_by(&random).as_deref(), Some("a random scenario"));
}
