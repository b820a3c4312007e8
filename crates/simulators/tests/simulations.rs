//! Simulations of a tank in Python, in both modes.

use crate::tank::{controlled, folder, levels, simulator, system, tank};
use mishandle_rollout::{EpisodeEnd, Request, Scenario, Seed};

#[test]
fn a_trace_has_the_signals_and_its_verdict() {
    let folder = folder("");
    let target = tank(folder.path(), 5.0);
    assert_eq!((target.identity.kind.as_str(), target.episode_steps), ("process", 5));
    let mut system = system(&target, "scenarios");
    let request = Request::new(Scenario::from([1.0, 2.0]), Seed(3));
    let episode = system.rollout(&[request]).expect("an episode").remove(0);
    assert_eq!(episode.trace.signal("level"), Some(&[1.0, 3.0, 5.0, 7.0, 9.0, 11.0][..]));
    assert_eq!((episode.end, episode.steps), (EpisodeEnd::Completed, 5));
    // The highest level is 11 and the bound 4.
    assert_eq!(episode.robustness(), Some(-7.0));
}

#[test]
fn one_process_for_each_thread_lives_on_between_batches_and_systems() {
    // The inflow of the answer is the number of the process.
    let folder = folder("def simulate(q): return {'trace': {'level': [0] * 6, 'inflow': [os.getpid()] * 6}}");
    let target = tank(folder.path(), 5.0);
    let processes = || {
        let episodes = levels(&target, &[1.0; 12]).expect("episodes");
        let number = |episode: &mishandle_rollout::Episode| episode.trace.column(1)[0] as u32;
        episodes.iter().map(number).collect::<std::collections::BTreeSet<u32>>()
    };
    let first = processes();
    assert!(!first.is_empty() && first.len() <= rayon::current_num_threads(), "{first:?}");
    let all: std::collections::BTreeSet<u32> = first.into_iter().chain(processes()).collect();
    assert!(all.len() <= rayon::current_num_threads(), "{all:?}");
}

#[test]
fn the_ends_of_a_simulator_have_no_verdict_but_termination() {
    let folder = folder(
        r#"
def simulate(q):
    level = q["scenario"]["level"]
    short = {"level": [level, 5], "inflow": [0, 0]}
    if level == 1: return {"trace": short, "end": "terminated", "reason": "dry"}
    if level == 2: return {"trace": short, "end": "diverged"}
    if level == 3: return {"end": "invalid", "reason": "no steady state"}
    if level == 4: return {"error": "no license"}
    return {"trace": {"level": [level, None, 0, 0, 0, 0], "inflow": [0] * 6}}
"#,
    );
    let found = levels(&tank(folder.path(), 5.0), &[1.0, 2.0, 3.0, 4.0, 5.0]).expect("episodes");
    let ends: Vec<EpisodeEnd> = found.iter().map(|episode| episode.end).collect();
    let expected = [
        EpisodeEnd::Terminated { step: 1 },
        EpisodeEnd::Diverged { step: 2 },
        EpisodeEnd::InvalidScenario,
        EpisodeEnd::Crashed { step: 0 },
        EpisodeEnd::InvalidSignal { step: 1, index: 0 },
    ];
    assert_eq!(ends, expected);
    // The level of 5 violates the bound 4 by 1, whatever would have come.
    let robustness: Vec<Option<f64>> = found.iter().map(mishandle_rollout::Episode::robustness).collect();
    assert_eq!(robustness, [Some(-1.0), None, None, None, None]);
    assert_eq!([0, 2, 3].map(|index| found[index].reason.as_str()), ["dry", "no steady state", "no license"]);
}

#[test]
fn a_stepped_tank_without_a_policy_has_the_trace_of_the_other_mode() {
    let stepped = folder("HELLO['mode'] = 'step'");
    let traced = folder("");
    let [stepped, traced] =
        [&stepped, &traced].map(|folder| levels(&tank(folder.path(), 5.0), &[1.0, 6.0]).expect("episodes"));
    for (one, other) in stepped.iter().zip(&traced) {
        assert_eq!((&one.trace, one.end, &one.verdict), (&other.trace, other.end, &other.verdict));
    }
}

#[test]
fn a_step_that_is_invalid_makes_an_invalid_scenario_and_one_that_diverges_does_not() {
    for (end, expected) in
        [("invalid", EpisodeEnd::InvalidScenario), ("diverged", EpisodeEnd::Diverged { step: 1 })]
    {
        let folder = folder(&format!(
            "HELLO['mode'] = 'step'\ndef answer(q):\n    if q['type'] == 'hello': return HELLO\n    \
             if q['type'] == 'reset': return {{'signals': [0, 0]}}\n    return {{'end': '{end}', 'reason': 'dry'}}"
        ));
        let found = levels(&tank(folder.path(), 5.0), &[1.0]).expect("episodes");
        assert_eq!((found[0].end, found[0].robustness(), found[0].reason.as_str()), (expected, None, "dry"));
    }
}

#[test]
fn a_policy_acts_on_the_observation_within_its_limit() {
    let folder = folder("HELLO['policy'] = POLICY");
    let target = controlled(folder.path(), "action = level / 4");
    let found = levels(&target, &[8.0]).expect("episodes");
    // An action of 2 is clipped to 1; from a level of 4 on, a quarter flows out.
    let mut expected = vec![8.0];
    for _ in 0..5 {
        let level: f64 = expected[expected.len() - 1];
        expected.push(level - (level / 4.0).min(1.0));
    }
    assert_eq!(found[0].trace.column(0), expected);
}

#[test]
fn a_delay_shifts_the_actions_and_a_bias_the_observation() {
    let folder = folder("HELLO['policy'] = POLICY");
    let target = controlled(folder.path(), "action = 1.0 if level > 2.01 else 0.0");
    let names: Vec<&str> = target.spaces.iter().map(mishandle_rollout::Space::name).collect();
    for name in
        ["scenarios", "delay", "timing", "sensing", "disturbance", "faults-sensing", "faults-actuation"]
    {
        assert!(names.contains(&name), "{names:?}");
    }
    let run = |axis: &str, value: f64| {
        let mut system = system(&target, "all");
        let axes = system.space().axes().to_vec();
        let nominal = system.space().nominal();
        let values = axes.iter().enumerate().map(|(index, known)| match known.name.as_str() {
            name if name == axis => Some(value),
            "level" => Some(4.0),
            _ => nominal.get(index),
        });
        let request = Request::new(Scenario::new(values.collect()), Seed(1));
        system.rollout(&[request]).expect("an episode").remove(0).trace.column(0).to_vec()
    };
    assert_eq!(run("action_delay", 0.0), [4.0, 3.0, 2.0, 2.0, 2.0, 2.0]);
    // Two actions of 1 arrive two steps late.
    assert_eq!(run("action_delay", 2.0), [4.0, 4.0, 4.0, 3.0, 2.0, 1.0]);
    // A level of 2 looks like 2.02.
    assert_eq!(run("bias_level", 0.02), [4.0, 3.0, 2.0, 1.0, 1.0, 1.0]);
}

#[test]
fn a_stepped_simulation_stops_as_soon_as_its_threshold_allows() {
    let folder = folder(
        "HELLO.update(mode='step', steps=60, formulas=[{'name': 'high', 'text': 'eventually(level >= 1)'}])",
    );
    let target = tank(folder.path(), 5.0);
    let mut system = system(&target, "scenarios");
    let mut request = Request::new(Scenario::from([6.0, 0.0]), Seed(1));
    let whole = system.rollout(&[request.clone()]).expect("an episode").remove(0);
    request.stop_threshold = Some(0.0);
    let stopped = system.rollout(&[request]).expect("an episode").remove(0);
    assert_eq!((whole.end, whole.robustness()), (EpisodeEnd::Completed, Some(5.0)));
    // The level is high at once, and the threshold is checked every ten control steps.
    assert_eq!((stopped.end, stopped.trace.len()), (EpisodeEnd::Stopped { step: 10 }, 11));
}

#[test]
fn a_policy_that_fails_ends_the_simulation_with_its_reason() {
    let folder = folder("HELLO['policy'] = POLICY");
    let target = controlled(folder.path(), "action = 1 / (level - 3)");
    let found = levels(&target, &[1.0, 3.0]).expect("episodes");
    assert_eq!(found[1].end, EpisodeEnd::Crashed { step: 1 });
    assert!(found[1].reason.contains("ZeroDivisionError"), "{}", found[1].reason);
    assert_eq!(found[0].end, EpisodeEnd::Completed);
}

#[test]
fn the_hash_follows_command_files_and_description() {
    let hash = |changes: &str, more: &str| {
        let folder = folder(changes);
        std::fs::write(folder.path().join("data.csv"), more).expect("a file");
        simulator(folder.path(), 5.0).expect("a simulator").hash().to_string()
    };
    let named = "HELLO['files'] = ['data.csv']";
    assert_eq!(hash("", "1"), hash("", "2"));
    assert_eq!(hash(named, "1"), hash(named, "1"));
    assert_ne!(hash(named, "1"), hash(named, "2"));
    assert_ne!(hash("", "1"), hash("# another script", "1"));
    assert!(simulator(folder("HELLO['files'] = ['absent.csv']").path(), 5.0).is_err());
}
