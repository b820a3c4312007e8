//! `mishandle compare`: two evaluations on the same scenarios and seeds.

use crate::bench;
use crate::bench::{Bench, unwrapped};
use mishandle::store::RunFile;

const EXPERT: &str = "evaluate point-reaching --controller expert --seed 3";

/// Makes the run of the expert and one of an expert that a defect makes worse: noise in its
/// actions.
fn bench() -> Bench {
    let bench = Bench::new();
    bench.check(&format!("{EXPERT} --episodes 40 --out good.sqlite"), 0);
    bench.check(&format!("{EXPERT} --episodes 40 --action-noise 1.2 --out worse.sqlite"), 0);
    bench
}

#[test]
fn a_worse_controller_has_new_failures_and_every_count_matches_the_rows() {
    let bench = bench();
    let found = bench.json("compare good.sqlite worse.sqlite --json", 1);
    let successes = |path: &str| -> Vec<bool> {
        let run = RunFile::open(bench.path(path)).unwrap();
        let index = run.header().verdicts.iter().position(|name| name == "success").unwrap();
        run.trial_simulations(1).map(|row| row.unwrap().verdicts[index] > Some(0.0)).collect()
    };
    let good = successes("good.sqlite");
    let worse = successes("worse.sqlite");
    let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count();
    let lost = only(&good, &worse);
    let gained = only(&worse, &good);
    assert!(lost > 5, "the defect must be visible: {lost}");
    assert_eq!(found["success"]["first_only"], lost);
    assert_eq!(found["success"]["second_only"], gained);
    assert_eq!(found["pairs"], 40);
    let new = found["new_failures"].as_array().unwrap();
    assert_eq!(new.iter().filter(|failure| failure["trial"] == 1).count(), lost);
    // Without fixed failures, the p-value is twice the probability of one side: 2 (1/2)^n.
    if gained == 0 {
        let p = found["success"]["p_value"].as_f64().unwrap();
        assert!((p / (2.0 * 0.5_f64.powi(lost as i32)) - 1.0).abs() < 1e-9, "{p}");
    }
    let value = |key: &str| found["success"]["difference"][key].as_f64().unwrap();
    assert!((value("value") + (lost as f64 - gained as f64) / 40.0).abs() < 1e-12);
    assert!(value("low") < value("value") && value("value") < value("high") && value("high") < 0.0);
    // The listed command replays the failure.
    let replay = new[0]["replay"].as_str().unwrap().strip_prefix("mishandle ").unwrap().to_string();
    assert!(bench.check(&replay, 0).contains("robustness -"), "{replay}");
    let text = unwrapped(&bench.check("compare good.sqlite worse.sqlite --verbose", 1));
    for part in
        ["action noise: A has 0, B has 1.2", "B succeeds less often", "New failures: A succeeds, B fails"]
    {
        assert!(text.contains(part), "{part}:\n{text}");
    }
}

#[test]
fn the_page_has_a_row_and_marks_for_every_new_failure() {
    let bench = bench();
    let found = bench.json("compare good.sqlite worse.sqlite --json --out page.html", 1);
    let html = std::fs::read_to_string(bench.path("page.html")).unwrap();
    let new = found["new_failures"].as_array().unwrap();
    for failure in new {
        let row = format!("new-t{}-s{}", failure["trial"], failure["simulation"]);
        assert_eq!(html.matches(&format!("<tr id=\"{row}\">")).count(), 1, "{row}");
        // One in the chart of robustness and one in each of the three maps of pairs of axes.
        assert_eq!(html.matches(&format!("href=\"#{row}\"")).count(), 4, "{row}");
    }
    let listed = format!("New failures: A succeeds, B fails ({})", new.len());
    let lost = found["success"]["first_only"].as_u64().unwrap();
    let sentence = format!("B fails in {lost} random simulations where A succeeds");
    for part in [
        "<h2>point-reaching: B succeeds less often.</h2>",
        listed.as_str(),
        sentence.as_str(),
        "action noise: A has 0, B has 1.2",
        "mishandle replay worse.sqlite --trial 1 --simulation",
    ] {
        assert!(html.contains(part), "{part}");
    }
    bench.refuses(
        "compare good.sqlite worse.sqlite --out page.html",
        &["page.html exists already", "--force"],
    );
    bench.check("compare worse.sqlite good.sqlite --out page.html --force", 0);
    let html = std::fs::read_to_string(bench.path("page.html")).unwrap();
    assert!(html.contains(&format!("Fixed failures: A fails, B succeeds ({})", new.len())));
}

#[test]
fn the_other_direction_has_fixed_failures_and_exit_code_0() {
    let bench = bench();
    let found = bench.json("compare worse.sqlite good.sqlite --json", 0);
    let mirror = bench.json("compare good.sqlite worse.sqlite --json", 1);
    assert_eq!(found["new_failures"].as_array().unwrap().len(), 0);
    let places = |list: &serde_json::Value| -> Vec<String> {
        list.as_array()
            .unwrap()
            .iter()
            .map(|pair| format!("{} {}", pair["simulation"], pair["seed"]))
            .collect()
    };
    assert_eq!(places(&found["fixed_failures"]), places(&mirror["new_failures"]));
    let itself = bench.json("compare good.sqlite good.sqlite --json", 0);
    assert_eq!(
        (&itself["success"]["p_value"], &itself["robustness"]["difference"]["value"]),
        (&1.0.into(), &0.0.into())
    );
}

#[test]
fn runs_that_are_no_pairs_are_refused() {
    let bench = bench();
    bench.check(&format!("{EXPERT} --episodes 30 --out short.sqlite"), 0);
    bench.check("evaluate point-reaching --controller expert --seed 4 --episodes 40 --out seed.sqlite", 0);
    bench.check("evaluate toy/sphere-2d --seed 3 --episodes 40 --out toy.sqlite", 0);
    bench.check("falsify toy/sphere-2d --trials 1 --budget 3 --out falsify.sqlite", 0);
    for (other, message) in [
        ("short.sqlite", "A has 40 random simulations and B has 30"),
        ("seed.sqlite", "seed: A has 3, B has 4"),
        ("toy.sqlite", "target: A has point-reaching, B has toy/sphere-2d"),
        ("falsify.sqlite", "B is a run of `falsify`"),
    ] {
        bench.refuses(&format!("compare good.sqlite {other}"), &["cannot be compared", message]);
    }
    bench.refuses("compare good.sqlite", &["expected two run files"]);
    bench.refuses("compare good.sqlite short.sqlite --episodes 10", &["--episodes"]);
}

#[test]
fn against_evaluates_both_controllers_first() {
    let bench = Bench::new();
    let flags = "--controller expert --against expert --episodes 20 --seed 3";
    let found = bench.json(&format!("compare point-reaching {flags} --json"), 0);
    assert_eq!(
        (&found["first"]["controller"], &found["second"]["controller"]),
        (&"expert".into(), &"expert".into())
    );
    bench.check(&format!("{EXPERT} --episodes 20 --out single.sqlite"), 0);
    let digest = |path: &str| RunFile::open(bench.path(path)).unwrap().content_digest().unwrap();
    assert_eq!(digest(found["first"]["run"].as_str().unwrap()), digest("single.sqlite"));
    bench.refuses("compare point-reaching --controller expert --against pppo", &["pppo"]);
}

#[test]
fn an_evaluation_that_is_not_complete_is_not_compared() {
    use mishandle::store::{IfExists, RunWriter};
    let bench = Bench::new();
    bench.check("evaluate toy/noisy --episodes 12 --out whole.sqlite", 0);
    let whole = RunFile::open(bench.path("whole.sqlite")).unwrap();
    let empty = RunWriter::create(bench.path("empty.sqlite"), whole.header(), IfExists::Refuse).unwrap();
    empty.close().unwrap();
    let mut part = RunWriter::create(bench.path("part.sqlite"), whole.header(), IfExists::Refuse).unwrap();
    part.start_trial(1, 0).unwrap();
    part.record(&whole.trial_simulations(1).take(7).map(Result::unwrap).collect::<Vec<_>>()).unwrap();
    part.close().unwrap();
    for (name, found) in [("empty", "it has 0 of 12"), ("part", "it has 7 of 12")] {
        for command in
            [format!("compare {name}.sqlite {name}.sqlite"), format!("compare {name}.sqlite whole.sqlite")]
        {
            let resume = format!("mishandle evaluate --resume {name}.sqlite");
            bench.refuses(&command, &["A is not complete", found, &resume]);
        }
        let listed = bench.json(&format!("show {name}.sqlite whole.sqlite --json"), 0);
        assert_eq!(listed[0]["is_complete"], false);
        assert!(bench.check(&format!("show {name}.sqlite whole.sqlite"), 0).contains("not finished"));
        bench.check(&format!("evaluate --resume {name}.sqlite"), 0);
        bench.check(&format!("compare whole.sqlite {name}.sqlite"), 0);
        assert_eq!(bench.json(&format!("show {name}.sqlite whole.sqlite --json"), 0)[0]["is_complete"], true);
    }
}

#[test]
fn another_preset_is_listed_and_the_opposite_comparison_has_the_opposite_interval() {
    let bench = bench();
    bench.check(&format!("{EXPERT} --episodes 40 --action-noise 0.6 --out third.sqlite"), 0);
    let difference = |a: &str, b: &str, code| {
        let found = bench.json(&format!("compare {a}.sqlite {b}.sqlite --json"), code);
        let difference = &found["robustness"]["difference"];
        ["value", "low", "high"].map(|key| difference[key].as_f64().unwrap())
    };
    let [value, low, high] = difference("worse", "third", 0);
    assert_eq!(difference("third", "worse", 1), [-value, -high, -low]);
    // The formulas of the presets differ in most tasks; in this one only the box of the start does.
    bench.check("evaluate toy/noisy --episodes 12 --out paper.sqlite", 0);
    let run = RunFile::open(bench.path("paper.sqlite")).unwrap();
    let mut header = run.header().clone();
    header.plan = header.plan.replace("preset = \"paper\"", "preset = \"code\"");
    let writer = mishandle::store::IfExists::Refuse;
    let mut other = mishandle::store::RunWriter::create(bench.path("code.sqlite"), &header, writer).unwrap();
    for trial in run.trials().unwrap() {
        other.start_trial(trial.trial.number, trial.trial.seed).unwrap();
        for row in run.trial_simulations(trial.trial.number) {
            let row = row.unwrap();
            other.record(&[run.simulation(row.trial, row.number).unwrap()]).unwrap();
        }
        other.end_trial(trial.trial.number, trial.trial.status).unwrap();
    }
    other.close().unwrap();
    let found = bench.json("compare paper.sqlite code.sqlite --json", 0);
    let listed = found["differences"].as_array().unwrap();
    assert!(listed.contains(&"task preset: A has paper, B has code".into()), "{listed:?}");
}

#[test]
fn an_interrupted_comparison_prints_commands_that_work() {
    let bench = Bench::new();
    let compare = "compare point-reaching --controller expert --against ppo --episodes 3000 --seed 3";
    let child = bench
        .command(compare)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while !bench.path("runs/evaluate-point-reaching-ppo-s3.sqlite").exists() {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    std::thread::sleep(std::time::Duration::from_millis(100));
    bench::signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let err = bench::text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    let commands: Vec<&str> = err.lines().filter_map(|line| line.trim().strip_prefix("mishandle ")).collect();
    assert!(commands.len() >= 2 && commands.last().unwrap().starts_with("compare "), "{err}");
    // Each of them runs: the files exist, and have the plans of the interrupted command.
    for command in &commands[..commands.len() - 1] {
        let path = command.strip_prefix("evaluate --resume ").unwrap();
        let run = RunFile::open(bench.path(path)).unwrap();
        assert!(run.header().plan.contains("episodes = 3000"), "{}", run.header().plan);
    }
    let compared: Vec<&str> = commands.last().unwrap().split(' ').skip(1).collect();
    assert!(compared.iter().all(|path| bench.path(path).exists()), "{compared:?}");
}
