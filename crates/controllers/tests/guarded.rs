//! Laws of guarded controllers: who acts depends on nothing but the simulation.

use std::sync::Arc;

use mishandle_controllers::guard::{Fallback, Guard, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_rollout::{Controller, ControllerFailure, ControllerWorker, Seed, Stream};
use mishandle_stl::Formula;

const STEPS: usize = 40;

/// Answers with its gain times the observation, plus the number of its answers and a random number
/// of the seed. It fails where the second number of the observation is large.
#[derive(Clone)]
struct Counter {
    gain: f32,
    failure: ControllerFailure,
    failed: Vec<bool>,
}

fn counter(gain: f32) -> Arc<dyn Controller> {
    let failure = ControllerFailure { is_timeout: true, reason: "too late".to_string() };
    Arc::new(Counter { gain, failure, failed: Vec::new() })
}

impl Controller for Counter {
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn state_size(&self) -> usize {
        2
    }
    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(self.clone())
    }
}

impl ControllerWorker for Counter {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        state.copy_from_slice(&[0.0, seed.uniform(Stream::Policy, 0, 0)]);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        self.failed = observations.chunks(2).map(|observation| observation[1] > 9.0).collect();
        for row in 0..rows {
            let state = &mut states[2 * row..][..2];
            actions[row] = self.gain * observations[2 * row] + (state[0] + state[1]) as f32;
            state[0] += 1.0;
        }
    }

    fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        self.failed[row].then_some(&self.failure)
    }
}

fn guard(formula: &str, switch: Switch, fallback: Fallback, is_privileged: bool) -> Guard {
    let names = ["x", "y"].map(String::from);
    let formula = Formula::parse(formula).expect("a formula");
    let watch = Watch::new(&formula, &names, 0.1, STEPS).expect("a watch");
    Guard::new(String::new(), watch, switch, fallback, is_privileged, 2, 1).expect("a guard")
}

/// Observations of a simulation.
fn observations(simulation: usize) -> Vec<[f32; 2]> {
    let number = |step: usize, index: u32| {
        (4.0 * Seed(7).child(simulation as u64).uniform(Stream::Reset, step as u64, index) - 2.0) as f32
    };
    (0..STEPS).map(|step| [number(step, 0), number(step, 1)]).collect()
}

/// Runs some simulations in one batch; returns the actions of each, and who acted.
fn run(controller: &dyn Controller, simulations: &[usize]) -> Vec<(Vec<u32>, Vec<bool>)> {
    let mut worker = controller.worker();
    let size = controller.state_size();
    let rows = simulations.len();
    let mut states = vec![0.0; rows * size];
    for (row, simulation) in simulations.iter().enumerate() {
        worker.reset(&mut states[row * size..][..size], Seed(u64::MAX - *simulation as u64));
    }
    let inputs: Vec<_> = simulations.iter().map(|simulation| observations(*simulation)).collect();
    let mut done = vec![(Vec::new(), Vec::new()); rows];
    let mut actions = vec![0.0; rows];
    for step in 0..STEPS {
        let observed: Vec<f32> = inputs.iter().flat_map(|input| input[step]).collect();
        worker.act(rows, &observed, &mut states, &mut actions);
        for (row, (bits, active)) in done.iter_mut().enumerate() {
            bits.push(actions[row].to_bits());
            if let [_, _] = controller.signals() {
                let mut signals = [0.0; 2];
                worker.signals(&states[row * size..][..size], &mut signals);
                active.push(signals[0] == 1.0);
            }
        }
    }
    done
}

fn switch(threshold: f64, back: Option<f64>) -> Switch {
    Switch::new(threshold, back, 2).expect("a switch")
}

fn fallbacks() -> Vec<Fallback> {
    let motion = |meaning| Motion { meanings: vec![meaning], limit: 1.0 };
    vec![
        Fallback::Controller(counter(-3.0)),
        Fallback::Hold(motion(Meaning::Position)),
        Fallback::Hold(motion(Meaning::Increment)),
        Fallback::Retreat(motion(Meaning::Position), 3),
        Fallback::Retreat(motion(Meaning::Increment), 3),
    ]
}

const FORMULA: &str = "historically[0:0.3s](x >= -1.5) or once(y >= 1.9)";

#[test]
fn a_guard_that_never_hands_over_changes_no_bit() {
    let bare = run(&*counter(2.0), &[0, 1, 2]);
    for fallback in fallbacks() {
        let guard = guard(FORMULA, switch(f64::NEG_INFINITY, None), fallback, false);
        let guarded = run(&Guarded::new(counter(2.0), guard), &[0, 1, 2]);
        for (bare, guarded) in bare.iter().zip(guarded) {
            assert_eq!(bare.0, guarded.0);
            assert!(!guarded.1.contains(&true));
        }
    }
}

#[test]
fn a_guard_that_hands_over_at_once_is_its_fallback() {
    let guard = guard(FORMULA, switch(f64::INFINITY, None), Fallback::Controller(counter(-3.0)), false);
    let guarded = run(&Guarded::new(counter(2.0), guard), &[3, 4]);
    for (fallback, guarded) in run(&*counter(-3.0), &[3, 4]).iter().zip(guarded) {
        assert_eq!(fallback.0, guarded.0);
        assert!(!guarded.1.contains(&false));
    }
}

#[test]
fn a_row_does_not_depend_on_the_other_rows() {
    for fallback in fallbacks() {
        for back in [None, Some(0.1)] {
            let guard = guard(FORMULA, switch(0.0, back), fallback.clone(), false);
            let controller = Guarded::new(counter(2.0), guard);
            let alone: Vec<_> = (0..9).map(|simulation| run(&controller, &[simulation]).remove(0)).collect();
            let together = run(&controller, &[8, 3, 0, 5, 7, 1, 2, 6, 4]);
            for (row, simulation) in [8, 3, 0, 5, 7, 1, 2, 6, 4].into_iter().enumerate() {
                assert_eq!(together[row], alone[simulation]);
            }
            let active = alone.iter().flat_map(|(_, active)| active).filter(|active| **active).count();
            assert!(active > STEPS / 2 && active < 8 * STEPS, "{active}");
        }
    }
}

#[test]
fn the_switch_follows_the_robustness_of_the_formula() {
    // The robustness at the present sample is that of the definition, computed here by hand.
    let guard = guard("historically[0:3](x >= -1)", switch(0.0, Some(0.2)), fallbacks().remove(0), false);
    let controller = Guarded::new(counter(2.0), guard);
    for simulation in 0..20 {
        let x: Vec<f64> =
            observations(simulation).iter().map(|observation| f64::from(observation[0])).collect();
        let robustness = |step: usize| {
            x[step.saturating_sub(3)..=step].iter().map(|x| x + 1.0).fold(f64::INFINITY, f64::min)
        };
        let mut expected = Vec::new();
        let mut since = 0;
        for step in 0..STEPS {
            let hands_over = since == 0 && robustness(step) < 0.0;
            let stays = since > 0 && (since < 2 || robustness(step) < 0.2);
            since = if hands_over || stays { since + 1 } else { 0 };
            expected.push(since > 0);
        }
        assert_eq!(run(&controller, &[simulation])[0].1, expected, "simulation {simulation}");
    }
}

#[test]
fn a_controller_without_an_action_loses_the_control() {
    let guard = guard("x >= -100", switch(0.0, None), Fallback::Controller(counter(-3.0)), false);
    let controller = Guarded::new(counter(2.0), guard);
    let mut worker = controller.worker();
    let size = controller.state_size();
    let mut states = vec![0.0; 3 * size];
    let mut actions = [0.0; 3];
    (0..3).for_each(|row| worker.reset(&mut states[row * size..][..size], Seed(1)));
    // The second row gets an action of NaN, and the third one a failure.
    worker.act(3, &[1.0, 0.0, f32::NAN, 0.0, 1.0, 10.0], &mut states, &mut actions);
    let active = |worker: &dyn ControllerWorker, states: &[f64], row: usize| {
        let mut signals = [0.0; 2];
        worker.signals(&states[row * size..][..size], &mut signals);
        signals[0] == 1.0
    };
    assert_eq!([0, 1, 2].map(|row| active(&*worker, &states, row)), [false, true, true]);
    assert!(worker.failure(0).is_none() && worker.failure(1).is_none());
    // The fallback fails in the same place, and no one else is left.
    assert_eq!(worker.failure(2).map(|failure| failure.reason.as_str()), Some("too late"));
}

#[test]
fn only_a_privileged_guard_reads_signals() {
    for is_privileged in [false, true] {
        let guard = guard("x >= 0", switch(0.0, None), Fallback::Controller(counter(-3.0)), is_privileged);
        let controller = Guarded::new(counter(2.0), guard);
        let mut worker = controller.worker();
        let mut state = vec![0.0; controller.state_size()];
        let mut actions = [0.0];
        worker.reset(&mut state, Seed(1));
        worker.see_signals(&mut state, &[-1.0, 0.0]);
        worker.act(1, &[1.0, 0.0], &mut state, &mut actions);
        let mut signals = [0.0; 2];
        worker.signals(&state, &mut signals);
        assert_eq!(signals, if is_privileged { [1.0, -1.0] } else { [0.0, 1.0] });
    }
}

#[test]
fn a_formula_of_the_future_has_no_way_back() {
    let names = ["x", "y"].map(String::from);
    let formula = Formula::parse("always[0:5](x >= 0)").expect("a formula");
    let watch = Watch::new(&formula, &names, 0.1, STEPS).expect("a watch");
    let made = Guard::new(String::new(), watch, switch(0.0, Some(0.1)), fallbacks().remove(0), false, 2, 1);
    assert!(made.is_err_and(|error| error.to_string().contains("no way back")));
}
