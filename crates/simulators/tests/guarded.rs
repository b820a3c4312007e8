//! Guarded policies in the loop of a simulator that Mishandle steps.

use crate::tank;
use std::sync::Arc;

use mishandle_controllers::guard::{Fallback, Guard, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_rollout::EpisodeEnd;
use mishandle_stl::Formula;

/// Returns the levels and `guard_active` of a tank whose policy is guarded.
fn guarded(action: &str, formula: &str, is_privileged: bool) -> (Vec<f64>, Vec<f64>, EpisodeEnd) {
    let folder = tank::folder("HELLO |= {'mode': 'step', 'policy': POLICY}");
    let (policy, component) = tank::policy(folder.path(), action);
    // The signals have the same name as the observation, and one more.
    let names: &[String] = &["level", "inflow"].map(String::from)[..if is_privileged { 2 } else { 1 }];
    let formula = Formula::parse(formula).expect("a formula");
    let watch = Watch::new(&formula, names, 0.5, 5).expect("a watch");
    let switch = Switch::new(0.0, None, 0).expect("a switch");
    let hold = Fallback::Hold(Motion { meanings: vec![Meaning::Increment], limit: 1.0 });
    let guard = Guard::new(String::new(), watch, switch, hold, is_privileged, 1, 1).expect("a guard");
    let target = tank::controlled_by(folder.path(), Arc::new(Guarded::new(policy, guard)), component);
    let episode = tank::levels(&target, &[4.0]).expect("episodes").remove(0);
    let column = |name: &str| episode.trace.signal(name).expect(name).to_vec();
    (column("level"), column("guard_active"), episode.end)
}

#[test]
fn the_fallback_acts_from_the_step_after_the_alarm_on() {
    for is_privileged in [false, true] {
        let (levels, active, end) = guarded("action = 0.5", "level >= 3.25", is_privileged);
        // The valve closes at 3.0, the first level below 3.25.
        assert_eq!(levels, [4.0, 3.5, 3.0, 3.0, 3.0, 3.0]);
        assert_eq!(active, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        assert_eq!(end, EpisodeEnd::Completed);
    }
}

#[test]
fn a_program_that_ends_hands_over() {
    let (levels, active, end) = guarded("action = 0.5 if level > 3.2 else sys.exit()", "level >= 0", false);
    assert_eq!(levels, [4.0, 3.5, 3.0, 3.0, 3.0, 3.0]);
    assert_eq!(active, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    assert_eq!(end, EpisodeEnd::Completed);
}
