//! `mishandle simulate`: chosen scenarios, once or repeatedly.

use crate::bench::Bench;

#[test]
fn a_scenario_and_seed_of_a_run_give_the_recorded_robustness() {
    let bench = Bench::new();
    bench.check("falsify toy/noisy --trials 1 --budget 200 --seed 1 -k report.repeats=0 --out run.sqlite", 1);
    let recorded = bench.json("replay run.sqlite --json", 0);
    let at = recorded["initial_configuration"].as_array().unwrap();
    let at: Vec<String> = at.iter().map(ToString::to_string).collect();
    let seed = recorded["seed"].as_str().unwrap();
    let simulated = bench.json(&format!("simulate toy/noisy --at {} --seed {seed} --json", at.join(",")), 1);
    assert_eq!(simulated["robustness"], recorded["robustness"]);
    assert_eq!(simulated["scenario"], recorded["scenario"]);
}

#[test]
fn a_full_trace_extends_the_signals_and_monitor_reads_it() {
    let bench = Bench::new();
    let simulate = "simulate point-reaching --controller expert --at 0.5,0.1,0.6 --trace";
    bench.check(&format!("{simulate} signals.csv"), 0);
    bench.check(&format!("{simulate} full.csv -k trace.columns=full"), 0);
    let lines = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(bench.path(name)).unwrap();
        text.lines().map(str::to_string).collect()
    };
    let signals = lines("signals.csv");
    let full = lines("full.csv");
    assert_eq!(full.len(), signals.len());
    assert!(full.iter().zip(&signals).all(|(full, signals)| full.starts_with(&format!("{signals},"))));
    assert!(full[0].contains(",q_joint1_rad,"), "{}", full[0]);
    assert!(full[0].contains(",dq_finger_joint1_m_per_s,"), "{}", full[0]);
    assert!(full[0].contains(",action_joint7,"), "{}", full[0]);
    assert!(full[0].contains(",contact_largest_N,fixture_force_N,"), "{}", full[0]);
    assert!(full[0].ends_with(",rest_time_s"), "{}", full[0]);
    bench.check("monitor --formula always(finger_target_distance<=10) full.csv", 0);
    bench.check("monitor --formula always(tool_speed_m_per_s<=1.7) full.csv", 0);
    bench.check(&format!("{simulate} other.csv -k trace.columns=everything"), 2);
    bench.check("simulate point-reaching --controller expert -k trace.columns=full", 2);
}

#[test]
fn repeats_have_other_seeds_than_the_counterexample_and_depend_on_the_seed_only() {
    let bench = Bench::new();
    let falsify = "falsify toy/noisy --trials 2 --budget 200 --seed 1 --json -k report.repeats=50 --out";
    let run = bench.json(&format!("{falsify} a.sqlite"), 1);
    assert_eq!(run["trials"], bench.json(&format!("{falsify} b.sqlite --threads 1"), 1)["trials"]);
    let trial = &run["trials"][0];
    let at: Vec<String> =
        trial["initial_configuration"].as_array().unwrap().iter().map(ToString::to_string).collect();
    let seed = trial["seed"].as_str().unwrap();
    let n = trial["repeats"]["simulations"].as_u64().unwrap();
    let at = at.join(",");
    let simulate =
        format!("simulate toy/noisy --at {at} --seed {seed} --repeat {n} -k simulate.scenarios=0 --json");
    let code = i32::from(trial["repeats"]["failures"] != 0);
    assert_eq!(bench.json(&simulate, code)["repeats"], trial["repeats"]);
    // Not all repeats have the seed of the counterexample, which was selected for its failure.
    assert!(trial["repeats"]["failures"].as_u64().unwrap() < n, "{trial}");
}

/// In total at most as many as the run has simulations, but at least 20 for each counterexample: an
/// early find is repeated, too.
#[test]
fn repeats_are_limited_by_the_simulations_of_the_run_and_not_fewer_than_20() {
    let bench = Bench::new();
    for repeats in [7, 1_000_000] {
        let run = bench.json(
            &format!(
                "falsify toy/noisy --trials 3 --budget 60 --seed 1 --json -k report.repeats={repeats} --out {repeats}.sqlite"
            ),
            1,
        );
        let trials = run["trials"].as_array().unwrap();
        let of =
            |key: fn(&serde_json::Value) -> Option<u64>| trials.iter().filter_map(key).collect::<Vec<u64>>();
        let repeated = of(|trial| trial["repeats"]["simulations"].as_u64());
        let share = of(|trial| trial["simulations"].as_u64()).iter().sum::<u64>() / repeated.len() as u64;
        assert_eq!(repeated, vec![repeats.min(share.max(20)); repeated.len()], "{run}");
    }
}

#[test]
fn a_target_without_randomness_is_simulated_once() {
    let bench = Bench::new();
    let simulated = bench.json("simulate toy/sphere-2d --repeat 100 --json", 0);
    assert_eq!((&simulated["repeats"]["simulations"], simulated["noise"].is_null()), (&1.into(), true));
    assert!(
        !bench
            .check("falsify toy/sphere-2d --seed 2 --search nelder-mead --trials 2 --out a.sqlite", 1)
            .contains("repeats")
    );
}

#[test]
fn axes_are_set_in_order_or_by_name() {
    let bench = Bench::new();
    let by_order = bench.json("simulate toy/sphere-2d --at 0.5,-0.25 --json", 0);
    assert_eq!(bench.json("simulate toy/sphere-2d --at y=-0.25,x=0.5 --json", 0), by_order);
    for (at, message) in [
        ("0.5", "--at has 1 value and the space starts 2 axes: x, y"),
        ("0.5,y=1", "mixes"),
        ("z=1", "there is no axis `z`; choose from: x, y"),
        ("x=1,x=2", "sets x twice"),
        ("x=one", "expected a number in m, found `one`"),
        ("x=nan", "expected a number in m, found `nan`"),
    ] {
        bench.refuses(&format!("simulate toy/sphere-2d --at {at}"), &[message]);
    }
}

#[test]
fn a_formula_without_a_signal_is_refused_with_this_reason() {
    let bench = Bench::new();
    for formula in ["true", "always(false)", "1 < 2"] {
        for command in
            ["falsify toy/sphere-2d --trials 1 --budget 3 --out a.sqlite", "simulate toy/sphere-2d"]
        {
            bench.refuses(
                &format!("{command} --formula '{formula}'"),
                &["contains no signal", "same verdict"],
            );
        }
    }
}

#[test]
fn huge_robustness_has_an_exponent_instead_of_300_digits() {
    let bench = Bench::new();
    let text = bench.check("simulate toy/sphere-2d --formula 'distance * 1e307 <= -1e307'", 1);
    assert!(text.contains("e307") && text.lines().all(|line| line.len() < 200), "{text}");
}

#[test]
fn an_axis_of_another_space_is_said_to_be_there() {
    let bench = Bench::new();
    let simulate = "simulate ball-balancing --controller ppo --at";
    let hint = "the axis noise_ball is not in the space starts but in sensing; give --space starts+sensing";
    bench.refuses(&format!("{simulate} noise_ball=0.01"), &[hint]);
    bench.refuses(&format!("{simulate} nois_ball=0.01"), &["no axis `nois_ball`"]);
    bench.refuses(&format!("{simulate} ball_x=0,35"), &["--at mixes values", "decimal points"]);
}
