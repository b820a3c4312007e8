//! `mishandle show RUN --simulation`: the decisive predicate and sample of a recorded simulation.

use crate::bench::Bench;
use serde_json::Value;

/// Reads a CSV file with a header.
fn columns(text: &str) -> Vec<(String, Vec<f64>)> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut columns: Vec<(String, Vec<f64>)> =
        lines.next().unwrap().split(',').map(|name| (name.to_string(), Vec::new())).collect();
    for line in lines {
        for ((_, values), value) in columns.iter_mut().zip(line.split(',')) {
            values.push(value.parse().unwrap());
        }
    }
    columns
}

#[test]
fn the_explanation_agrees_with_the_exported_trace() {
    let bench = Bench::new();
    let formula = "always[10:80](gap >= 5 and closing_speed <= 4)";
    bench.write(
        "plan.toml",
        &format!(
            "target = 'toy/car-following'\nspace = 'events'\n[falsify]\nformula = '{formula}'\ntrials = 1\n"
        ),
    );
    bench.check("falsify --plan plan.toml --out run.sqlite", 1);
    bench.check("replay run.sqlite --trace trace.csv", 0);
    let explained = bench.json("show run.sqlite --simulation first --json", 1);
    let trace = columns(&std::fs::read_to_string(bench.path("trace.csv")).unwrap());
    let signal = |name: &str| &trace.iter().find(|(known, _)| known.starts_with(name)).unwrap().1;
    // The minimum over the window of the margins of both predicates, by hand.
    let gap = signal("gap");
    let speed = signal("closing_speed");
    let margins = |sample: usize| [gap[sample] - 5.0, 4.0 - speed[sample]];
    let least =
        (10..=80).map(|sample| margins(sample)[0].min(margins(sample)[1])).fold(f64::INFINITY, f64::min);
    let sample = (10..=80).find(|sample| margins(*sample).contains(&least)).unwrap();
    assert_eq!(explained["robustness"], least);
    assert_eq!(explained["predicate"]["sample"], sample);
    let predicate = if margins(sample)[0] == least { "gap >= 5" } else { "closing_speed <= 4" };
    assert_eq!(explained["predicate"]["formula"], predicate);
    let alone = |i: usize| (10..=80).map(|sample| margins(sample)[i]).fold(f64::INFINITY, f64::min);
    let conjuncts: Vec<&Value> = explained["conjuncts"].as_array().unwrap().iter().collect();
    assert_eq!([&conjuncts[0]["robustness"], &conjuncts[1]["robustness"]], [alone(0), alone(1)]);
    let violated = (10..=80).filter(|sample| margins(*sample)[usize::from(predicate != "gap >= 5")] < 0.0);
    assert_eq!(explained["window"]["violated"], violated.count());
    // The first violation of any of the two, which no later sample can undo.
    let first = (10..=80).find(|sample| margins(*sample).iter().any(|margin| *margin < 0.0));
    assert_eq!(explained["decided"]["sample"], first.unwrap());
    let text = bench.check("show run.sqlite --simulation first", 1);
    for part in ["violated: robustness", "Decisive:", "window", predicate, "nothing can satisfy the formula"]
    {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}

#[test]
fn a_simulation_without_a_recorded_trace_is_replayed() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --trials 1 --budget 5 --seed 3 --out run.sqlite", 0);
    let explained = bench.json("show run.sqlite --simulation 2 --json", 0);
    let replayed = bench.json("replay run.sqlite --simulation 2 --json", 0);
    assert_eq!(explained["robustness"], replayed["robustness"]);
    bench.refuses("show run.sqlite --simulation 6", &["simulation 6"]);
}

#[test]
fn masking_counts_what_the_explanations_of_all_simulations_say() {
    let bench = Bench::new();
    let formula = "always[10:80](gap >= 12 and closing_speed <= 4)";
    let plan = format!(
        "target = 'toy/car-following'\nspace = 'events'\n[falsify]\nformula = '{formula}'\ntrials = 2\nbudget = 9\n"
    );
    bench.write("plan.toml", &plan);
    bench.run("falsify --plan plan.toml --seed 4 --out run.sqlite");
    let found = bench.json("show run.sqlite --masking --json", 0);
    let mut expected = [[0_u64; 3]; 2];
    let mut simulations = [0_u64; 2];
    for trial in 1..=2 {
        for simulation in 1..=9 {
            let output =
                bench.run(&format!("show run.sqlite --trial {trial} --simulation {simulation} --json"));
            let Ok(explained) = serde_json::from_slice::<Value>(&output.stdout) else { continue };
            let is_violated = explained["robustness"].as_f64().unwrap() < 0.0;
            simulations[usize::from(is_violated)] += 1;
            for (index, counts) in expected.iter_mut().enumerate() {
                let conjunct = &explained["conjuncts"][index];
                let sets = explained["predicate"]["formula"] == conjunct["formula"];
                counts[usize::from(is_violated)] += u64::from(sets);
                counts[2] += u64::from(conjunct["robustness"].as_f64().unwrap() < 0.0);
            }
        }
    }
    assert!(simulations[0] > 0 && simulations[1] > 0, "{simulations:?}");
    for (kind, count) in ["satisfied", "violated"].iter().zip(simulations) {
        assert_eq!((&found[kind]["evaluated"], &found[kind]["total"]), (&count.into(), &count.into()));
    }
    for (conjunct, counts) in found["conjuncts"].as_array().unwrap().iter().zip(expected) {
        let keys = ["sets_satisfied", "sets_violated", "fails"];
        assert_eq!(keys.map(|key| conjunct[key].as_u64().unwrap()), counts, "{found}");
    }
    // The limit drops satisfied simulations first.
    let few = bench.json(&format!("show run.sqlite --masking={} --json", simulations[1]), 0);
    assert_eq!(
        (&few["violated"]["evaluated"], &few["satisfied"]["evaluated"]),
        (&simulations[1].into(), &0.into())
    );
}

#[test]
fn a_python_run_without_a_counterexample_says_that_passing_traces_are_not_stored() {
    use mishandle::store::{IfExists, RunFile, RunWriter};
    let bench = Bench::new();
    bench.check("evaluate toy/sphere-2d --episodes 3 --seed 1 --out toy.sqlite", 0);
    let run = RunFile::open(bench.path("toy.sqlite")).unwrap();
    assert_eq!(run.counts().unwrap().falsified, 0);
    let mut header = run.header().clone();
    header.target.kind = "python".to_string();
    header.target.name = "cart".to_string();
    header.plan = header.plan.replace("toy/sphere-2d", "cart");
    let mut writer = RunWriter::create(bench.path("python.sqlite"), &header, IfExists::Refuse).unwrap();
    for trial in run.trials().unwrap() {
        writer.start_trial(trial.trial.number, trial.trial.seed).unwrap();
        for row in run.trial_simulations(trial.trial.number) {
            writer.record(&[row.unwrap()]).unwrap();
        }
        writer.end_trial(trial.trial.number, trial.trial.status).unwrap();
    }
    writer.close().unwrap();
    bench.refuses(
        "show python.sqlite --simulation first",
        &[
            "no counterexample, and the run has none",
            "Python code",
            "mishandle.replay(\"python.sqlite\", system",
        ],
    );
    bench.check("show toy.sqlite --simulation first", 0);
}

/// The explanation agrees with the simulations that the falsification recorded, with `simulate` in
/// the same scenarios, and with the axes that the falsification named.
#[test]
fn an_axis_that_removes_a_failure_alone_is_named_with_its_simulation() {
    let bench = Bench::new();
    let falsify = "falsify toy/car-following --space events --trials 1 --budget 100 --seed 1";
    let found = bench.json(&format!("{falsify} --out run.sqlite --json"), 1);
    bench.check(&format!("{falsify} -k falsify.isolate=false --out alone.sqlite"), 1);
    let explained = bench.json("show run.sqlite --simulation first --json", 1);
    let tried = &explained["axes_at_nominal"];
    let axes = tried["axes"].as_array().unwrap();
    assert!(axes.len() > 1 && tried["left_out"] == 0 && tried["reason"].is_null(), "{tried}");
    assert_eq!(*tried, bench.json("show alone.sqlite --simulation first --json", 1)["axes_at_nominal"]);
    for row in axes {
        let name = row["axis"].as_str().unwrap();
        let mut scenario = explained["scenario"].as_object().unwrap().clone();
        assert_eq!(row["value"], scenario[name]);
        scenario.insert(name.to_string(), row["nominal"].clone());
        let values: Vec<String> = scenario.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let at = values.join(",");
        let seed = explained["seed"].to_string().replace('"', "");
        let simulate = format!("simulate toy/car-following --space events --at {at} --seed {seed} --json");
        let code = i32::from(row["violated"].as_bool().unwrap());
        assert_eq!(row["robustness"], bench.json(&simulate, code)["robustness"], "{name}");
    }
    let mut removing: Vec<&Value> =
        axes.iter().filter(|row| row["violated"] == false).map(|row| &row["axis"]).collect();
    let mut necessary: Vec<&Value> =
        found["trials"][0]["cause"]["necessary"].as_array().unwrap().iter().collect();
    removing.sort_by_key(ToString::to_string);
    necessary.sort_by_key(ToString::to_string);
    assert_eq!(removing, necessary);
    assert!(!removing.is_empty(), "the test shows nothing");
    let text = bench.check("show run.sqlite --simulation first -k report.axes=1", 1);
    assert!(text.contains("one axis at nominal (1 simulation)") && text.contains("Left out"), "{text}");
    assert!(
        bench.json("show run.sqlite --simulation first -k report.axes=0 --json", 1)["axes_at_nominal"]
            .is_null()
    );
}
