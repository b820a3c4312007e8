//! Guarded controllers on the command line: of a task, and of the robot of the guide.

use crate::bench::Bench;
use serde_json::Value;

const PAGE: &str = include_str!("../../../docs/guide/robots.md");

/// Returns a folder with the cart-pole of the guide and some guards.
fn cartpole() -> Bench {
    let bench = Bench::new();
    for part in PAGE.split("<!-- file: ").skip(1) {
        let (name, rest) = part.split_once(" -->").unwrap();
        bench.write(name, rest.split("```").nth(1).unwrap().split_once('\n').unwrap().1);
    }
    for (name, text) in [
        ("policy", "formula = 'abs(angle) <= 0.1'\nreturn-threshold = 0.05\nfallback = 'policy'"),
        ("hold", "formula = 'abs(angle) <= 0.1'\nfallback = 'hold'"),
        ("still", "formula = 'abs(angle) <= 0.1'\nfallback = 'hold'\nactions = 'increments'"),
        (
            "never",
            "formula = 'abs(angle) <= 0.1'\nthreshold = -inf\nfallback = 'hold'\nactions = 'positions'",
        ),
        ("signal", "formula = 'tilt_angle <= 0.1'\nfallback = 'policy'"),
        ("privileged", "formula = 'tilt_angle <= 0.1'\nfallback = 'policy'\nprivileged = true"),
        ("misspelled", "formula = 'abs(angel) <= 0.1'\nfallback = 'policy'"),
        ("key", "formula = 'abs(angle) <= 0.1'\nfalback = 'policy'"),
        ("future", "formula = 'always[0:300](angle <= 0.1)'\nfallback = 'policy'"),
        ("value", "formula = 'angle <= 0.1'\nthreshold = 'low'\nfallback = 'policy'"),
    ] {
        bench.write(&format!("{name}.toml.guard"), text);
    }
    bench
}

const ASKED: &str = "evaluate cartpole.toml --space starts+delay --episodes 12 --seed 2 --json";

/// Returns the document without what names the controller and the guard.
fn outcomes(bench: &Bench, guard: &str) -> Value {
    let mut found = bench.document(&format!("{ASKED} {guard}"), 0);
    let document = found.as_object_mut().unwrap();
    document.remove("guard");
    document.remove("target_hash");
    found
}

#[test]
fn a_fallback_that_is_the_policy_and_a_guard_that_never_acts_change_nothing() {
    let bench = cartpole();
    let bare = outcomes(&bench, "");
    assert_eq!(outcomes(&bench, "--guard policy.toml.guard"), bare);
    assert_eq!(outcomes(&bench, "--guard never.toml.guard"), bare);
    // The policy balances and no motor does not.
    assert!(outcomes(&bench, "--guard still.toml.guard") != bare);
}

#[test]
fn a_guarded_run_does_not_depend_on_threads_and_replays_to_the_bit() {
    let bench = cartpole();
    let asked = format!("{ASKED} --guard still.toml.guard");
    let one = bench.document(&format!("{asked} --threads 1 --out one.sqlite"), 0);
    let two = bench.document(&format!("{asked} --threads 2 --out two.sqlite"), 0);
    assert_eq!(one, two);
    assert_eq!(one["guard"]["fallback"], "hold");
    // The run needs the file of the guard no more.
    std::fs::remove_file(bench.path("still.toml.guard")).unwrap();
    for simulation in 1..=12 {
        let replayed =
            bench.json(&format!("replay one.sqlite --trial 1 --simulation {simulation} --json"), 0);
        assert_eq!(replayed["differences"].as_array().map(Vec::len), Some(0), "{replayed}");
    }
}

#[test]
fn a_search_finds_a_false_alarm_and_its_counterexample_replays() {
    let bench = cartpole();
    let formula = "--formula 'always(guard_active <= 0.5)'";
    let search = "falsify cartpole.toml --guard policy.toml.guard --trials 1 --budget 30 --seed 1";
    bench.check(&format!("{search} {formula} --out found.sqlite"), 1);
    bench.check("regress --add found.sqlite --out alarm.json", 0);
    let replayed = bench.json("replay alarm.json --json", 0);
    assert_eq!(replayed["differences"].as_array().map(Vec::len), Some(0), "{replayed}");
    // The first alarm of this guard is found by the search; `explain` says when.
    let explained = bench.check("show found.sqlite --simulation first", 1);
    assert!(explained.contains("The guard hands over at step "), "{explained}");
    // A page names the guard.
    bench.check("report found.sqlite --out page.html", 0);
    let page = std::fs::read_to_string(bench.path("page.html")).unwrap();
    assert!(page.contains("and a guard"), "the page does not name the guard");
}

#[test]
fn a_guard_is_tuned_by_a_flag_and_keys() {
    let bench = cartpole();
    let tune = "guard cartpole.toml --guard policy.toml.guard --out tuned";
    bench.refuses(tune, &["--tune"]);
    bench.refuses(
        &format!("{tune} --tune -k tune.false-alarms=1"),
        &["the share of false alarms is 1", "less than 1"],
    );
    // The pole does not fall so soon.
    bench.refuses(&format!("{tune} --tune -k tune.episodes=12"), &["of 12 training scenarios fail"]);
}

#[test]
fn mistakes_name_the_key_or_the_quantity() {
    let bench = cartpole();
    for (guard, parts) in [
        ("missing", &["missing.toml.guard"][..]),
        ("hold", &["the guard has no `actions`", "increments"]),
        ("signal", &["quantity of the observation", "`tilt_angle`"]),
        ("misspelled", &["`angel`", "did you mean `angle`"]),
        ("key", &["line 2", "guard.falback", "guard.fallback"]),
        ("value", &["line 2", "guard.threshold"]),
        ("future", &["300 control steps", "has 250"]),
    ] {
        bench.refuses(&format!("{ASKED} --guard {guard}.toml.guard"), parts);
    }
    let privileged = bench.json(&format!("{ASKED} --guard privileged.toml.guard"), 0);
    assert_eq!(privileged["guard"]["privileged"], true);
    bench.write("task.guard", "formula = 'ball_speed >= 0'\nfallback = 'expert'\nprivileged = true");
    let train = "train ball-balancing --algorithm ppo --guard task.guard --out a.safetensors";
    bench.refuses(train, &["`privileged` of the guard", "training computes no signals"]);
    bench.refuses("evaluate toy/needle --guard policy.toml.guard", &["nothing can be guarded"]);
    bench.write("gone.guard", "formula = 'angle <= 0.1'\nfallback = 'gone.safetensors'");
    bench.refuses(&format!("{ASKED} --guard gone.guard"), &["the fallback of the guard", "gone.safetensors"]);
    bench.check("evaluate cartpole.toml --episodes 2 --out run.sqlite", 0);
    bench.refuses("evaluate --resume run.sqlite --guard policy.toml.guard", &["--guard", "--resume"]);
}
