use std::sync::Arc;

use mishandle_rollout::{
    Axis, AxisKind, Episode, EpisodeEnd, Identity, NamedFormula, Request, RolloutError, Scenario, Seed,
    Signal, Space, Specification, SpecificationMonitor, System, Target,
};
use mishandle_stl::Trace;

use crate::TOYS;

/// The kind of these targets, a prefix of their names in plans.
const KIND: &str = "toy";

/// The names of the spaces; each contains all axes of one kind.
const SPACES: [(AxisKind, &str); 5] = [
    (AxisKind::Start, "starts"),
    (AxisKind::Model, "dynamics"),
    (AxisKind::Event, "events"),
    (AxisKind::Input, "disturbance"),
    (AxisKind::Noise, "noise"),
];

/// A system in closed form, or one whose equations a function integrates.
pub trait Toy: Send + Sync {
    /// Returns the name; plans add the kind as a prefix, as in `toy/`.
    fn name(&self) -> &'static str;
    /// Returns a one-sentence description.
    fn summary(&self) -> &'static str;
    /// Returns all axes that a scenario may set.
    fn axes(&self) -> Vec<Axis>;
    /// Returns the spaces, of which the first is the default: by default one for each kind of axis.
    fn spaces(&self) -> Vec<(&'static str, Vec<Axis>)> {
        let axes = self.axes();
        let of_kind =
            |kind: AxisKind| axes.iter().filter(|axis| axis.kind == kind).cloned().collect::<Vec<_>>();
        let spaces = SPACES.iter().map(|(kind, name)| (*name, of_kind(*kind)));
        spaces.filter(|(_, axes)| !axes.is_empty()).collect()
    }
    /// Returns the name and unit of each signal.
    fn signals(&self) -> &'static [(&'static str, &'static str)];
    /// Returns the name and text of each formula; the first is the default requirement.
    fn formulas(&self) -> &'static [(&'static str, &'static str)];
    /// Returns the duration of a control step, s.
    fn control_dt(&self) -> f64 {
        1.0
    }
    /// Returns the number of control steps of an episode.
    fn episode_steps(&self) -> usize {
        1
    }
    /// Runs an episode and passes each sample of the signals to `push`. `values` has one value per
    /// axis of [`axes`](Self::axes); `None` is a random value from `seed`.
    fn simulate(&self, values: &[Option<f64>], seed: Seed, push: &mut dyn FnMut(&[f64]));
}

/// Returns the target with this name, including the prefix `toy/`; `None` if there is no such toy.
///
/// # Errors
/// If the toy's axes do not form valid spaces.
pub fn target(name: &str) -> Option<Result<Target, RolloutError>> {
    target_among(KIND, TOYS, name)
}

/// Returns the target with this name, `KIND/NAME`, among `toys`; `None` if there is no such toy.
///
/// # Errors
/// If the toy's axes do not form valid spaces.
pub fn target_among(
    kind: &str,
    toys: &[&'static dyn Toy],
    name: &str,
) -> Option<Result<Target, RolloutError>> {
    let own = name.strip_prefix(kind)?.strip_prefix('/')?;
    toys.iter().find(|toy| toy.name() == own).map(|toy| target_of(kind, *toy))
}

fn target_of(kind: &str, toy: &'static dyn Toy) -> Result<Target, RolloutError> {
    let axes = toy.axes();
    let spaces = toy.spaces().into_iter().map(|(name, axes)| Space::new(name, axes));
    let spaces = spaces.collect::<Result<Vec<Space>, RolloutError>>()?;
    let stated = format!("{axes:?} {:?} {:?} {}", toy.signals(), toy.formulas(), env!("CARGO_PKG_VERSION"));
    let formula = |(name, text): &(&str, &str)| NamedFormula { name: (*name).into(), text: (*text).into() };
    let signal = |(name, unit): &(&str, &str)| Signal { name: (*name).into(), unit: (*unit).into() };
    Ok(Target {
        identity: Identity::new(kind, &format!("{kind}/{}", toy.name()), &stated),
        components: Vec::new(),
        spaces,
        signals: toy.signals().iter().map(signal).collect(),
        formulas: toy.formulas().iter().map(formula).collect(),
        control_dt: toy.control_dt(),
        episode_steps: toy.episode_steps(),
        is_deterministic: true,
        signals_on_request: Vec::new(),
        controller_signals: Vec::new(),
        can_fail: false,
        // Toys have no random numbers except those that their noise axes make explicit.
        random_axes: Vec::new(),
        depends_on_seed: axes.iter().any(|axis| axis.nominal.is_none()),
        versions: Vec::new(),
        reachable: None,
        factory: Arc::new(move |space: &Space, specification: &Specification| {
            Ok(Box::new(ToySystem::new(toy, space, specification)?) as Box<dyn System>)
        }),
        solver_variants: Vec::new(),
        axes,
    })
}

/// A system that runs a toy with scenarios of a space.
struct ToySystem {
    toy: &'static dyn Toy,
    space: Space,
    /// For each axis of the toy its index in the space, or its nominal value if the space lacks it.
    indices: Vec<Result<usize, Option<f64>>>,
    signals: Arc<[String]>,
    monitor: SpecificationMonitor,
}

impl ToySystem {
    fn new(
        toy: &'static dyn Toy,
        space: &Space,
        specification: &Specification,
    ) -> Result<ToySystem, RolloutError> {
        let axes = toy.axes();
        if let Some(axis) = space.axes().iter().find(|axis| axes.iter().all(|own| own.name != axis.name)) {
            return Err(RolloutError::Axis { axis: axis.name.clone(), what: "the toy has no such axis" });
        }
        let index = |axis: &Axis| space.axes().iter().position(|own| own.name == axis.name);
        let signals: Arc<[String]> = toy.signals().iter().map(|(name, _)| (*name).to_string()).collect();
        Ok(ToySystem {
            toy,
            space: space.clone(),
            indices: axes.iter().map(|axis| index(axis).ok_or(axis.nominal)).collect(),
            monitor: SpecificationMonitor::new(specification, &signals, toy.control_dt())?,
            signals,
        })
    }

    fn values(&self, scenario: &Scenario) -> Vec<Option<f64>> {
        self.indices
            .iter()
            .map(|index| index.map_or_else(|nominal| nominal, |index| scenario.get(index)))
            .collect()
    }

    fn episode(&mut self, request: &Request) -> Result<Episode, RolloutError> {
        let values = self.values(&request.scenario);
        let mut trace = Trace::with_capacity(self.signals.clone(), self.toy.episode_steps() + 1);
        self.toy.simulate(&values, request.seed, &mut |sample| trace.push(sample));
        let mut end = EpisodeEnd::Completed;
        let verdict = self.monitor.judge(request, &trace, trace.len(), &mut end)?;
        let steps = trace.len().saturating_sub(1);
        Ok(Episode {
            request: request.clone(),
            end,
            steps,
            verdict,
            reason: String::new(),
            total_reward: 0.0,
            trace,
            trace_digest: None,
        })
    }
}

impl System for ToySystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        requests.iter().try_for_each(|request| self.space.check(&request.scenario))?;
        requests.iter().map(|request| self.episode(request)).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use mishandle_stl::Formula;

    use super::*;

    #[test]
    fn the_nominal_episode_of_every_toy_satisfies_its_requirement() {
        for toy in TOYS {
            let target = target(&format!("toy/{}", toy.name())).unwrap().unwrap();
            let requirement = Formula::parse(&target.formulas[0].text).unwrap();
            let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
            for space in target.spaces.iter().cloned().chain([target.space("all").unwrap()]) {
                let mut system = target.system(&space, &specification).unwrap();
                let request = Request::new(space.nominal(), Seed(3));
                let episode = system.rollout(&[request]).unwrap().remove(0);
                let nominal = system.rollout(&[Request::new(space.nominal(), Seed(3))]).unwrap().remove(0);
                assert_eq!(episode, nominal, "{}", toy.name());
                assert_eq!(episode.steps, toy.episode_steps());
                assert!(!episode.is_violated(), "{} in {}", toy.name(), space.name());
                let drawn = Request::new(space.sample(Seed(1), 0), Seed(3));
                assert!(system.rollout(&[drawn]).is_ok());
            }
        }
    }

    #[test]
    fn a_toy_declares_whether_its_episodes_depend_on_the_seed() {
        for toy in TOYS {
            let target = target(&format!("toy/{}", toy.name())).unwrap().unwrap();
            let requirement = Formula::parse(&target.formulas[0].text).unwrap();
            let starts = target.space("starts").unwrap();
            let mut system = target.system(&starts, &Specification::new(requirement)).unwrap();
            let requests = [1, 2].map(|seed| Request::new(starts.nominal(), Seed(seed)));
            let episodes = system.rollout(&requests).unwrap();
            let differ = episodes[0].trace != episodes[1].trace;
            assert_eq!(target.depends_on_seed, differ, "{}", toy.name());
        }
    }

    #[test]
    fn names_are_distinct_and_unknown_names_have_no_target() {
        for (i, toy) in TOYS.iter().enumerate() {
            assert!(TOYS[..i].iter().all(|other| other.name() != toy.name()));
            assert!(target(toy.name()).is_none(), "the name must have the prefix");
        }
        let joined = target("toy/noisy").unwrap().unwrap();
        assert_eq!(joined.space("all+starts").unwrap().axes(), joined.space("all").unwrap().axes());
        assert!(target("toy/none").is_none() && target("toysphere-2d").is_none());
    }

    #[test]
    fn the_failure_rate_of_each_closed_form_is_the_stated_one() {
        // A disc of radius 0.1 in a square of side 2.
        let pi = std::f64::consts::PI;
        let disc = pi * 0.1 * 0.1 / 4.0;
        for (name, share) in [("toy/sphere-2d", disc), ("toy/plateau", disc), ("toy/hidden-corner", 2e-3)] {
            let target = target(name).unwrap().unwrap();
            let requirement = Formula::parse(&target.formulas[0].text).unwrap();
            let space = target.space("starts").unwrap();
            let mut system = target.system(&space, &Specification::new(requirement)).unwrap();
            let n = 40_000;
            let requests: Vec<Request> =
                (0..n).map(|i| Request::new(space.sample(Seed(5), i), Seed(i))).collect();
            let episodes = system.rollout(&requests).unwrap();
            let violated = episodes.iter().filter(|e| e.is_violated()).count();
            let error = 5.0 * (share * (1.0 - share) / n as f64).sqrt();
            assert!((violated as f64 / n as f64 - share).abs() < error, "{name}: {violated} of {n}");
        }
    }
}
