use std::sync::Arc;

use mishandle_rollout::{
    Axis, AxisKind, Episode, EpisodeEnd, Identity, NamedFormula, Request, RolloutError, Scenario, Seed,
    Signal, Space, Specification, SpecificationMonitor, System, Target,
};
use mishandle_stl::{MonitorError, Trace};

use crate::TOYS;

/// The kind of these targets, which begins their names in plans.
const KIND: &str = "toy";

/// The name of the space of all axes of a kind.
const SPACES: [(AxisKind, &str); 5] = [
    (AxisKind::Start, "starts"),
    (AxisKind::Model, "dynamics"),
    (AxisKind::Event, "events"),
    (AxisKind::Input, "disturbance"),
    (AxisKind::Noise, "noise"),
];

/// A system in closed form, or nearly so.
pub trait Toy: Send + Sync {
    /// Name in plans, with `toy/` before it.
    fn name(&self) -> &'static str;
    /// One sentence for people.
    fn summary(&self) -> &'static str;
    /// What a scenario may set.
    fn axes(&self) -> Vec<Axis>;
    /// Name and unit of each signal.
    fn signals(&self) -> &'static [(&'static str, &'static str)];
    /// Name and text of each formula, the default requirement first.
    fn formulas(&self) -> &'static [(&'static str, &'static str)];
    /// Duration of a step, s.
    fn control_dt(&self) -> f64 {
        1.0
    }
    /// Steps of an episode.
    fn episode_steps(&self) -> usize {
        1
    }
    /// Runs an episode under a value for each of [`axes`](Self::axes), and pushes each sample of the signals.
    fn simulate(&self, values: &[Option<f64>], seed: Seed, push: &mut dyn FnMut(&[f64]));
}

/// The toy of that name, with `toy/` before it, as a target; `None` if there is none.
pub fn target(name: &str) -> Option<Result<Target, RolloutError>> {
    let own = name.strip_prefix(KIND)?.strip_prefix('/')?;
    TOYS.iter().find(|toy| toy.name() == own).map(|toy| of(*toy))
}

fn of(toy: &'static dyn Toy) -> Result<Target, RolloutError> {
    let axes = toy.axes();
    let of_kind = |kind: AxisKind| axes.iter().filter(|axis| axis.kind == kind).cloned().collect::<Vec<_>>();
    let spaces = SPACES
        .iter()
        .map(|(kind, name)| (name, of_kind(*kind)))
        .filter(|(_, axes)| !axes.is_empty())
        .map(|(name, axes)| Space::new(name, axes))
        .collect::<Result<Vec<Space>, RolloutError>>()?;
    let stated = format!("{axes:?} {:?} {:?} {}", toy.signals(), toy.formulas(), env!("CARGO_PKG_VERSION"));
    let formula = |(name, text): &(&str, &str)| NamedFormula { name: (*name).into(), text: (*text).into() };
    let signal = |(name, unit): &(&str, &str)| Signal { name: (*name).into(), unit: (*unit).into() };
    Ok(Target {
        identity: Identity::new(KIND, &format!("{KIND}/{}", toy.name()), &stated),
        components: Vec::new(),
        spaces,
        signals: toy.signals().iter().map(signal).collect(),
        formulas: toy.formulas().iter().map(formula).collect(),
        control_dt: toy.control_dt(),
        episode_steps: toy.episode_steps(),
        is_deterministic: true,
        versions: Vec::new(),
        reachable: None,
        factory: Arc::new(move |space: &Space, specification: &Specification| {
            Ok(Box::new(ToySystem::new(toy, space, specification)?) as Box<dyn System>)
        }),
        axes,
    })
}

/// A toy that runs scenarios of a space.
struct ToySystem {
    toy: &'static dyn Toy,
    space: Space,
    /// For each axis of the toy its place in a scenario, or its nominal value.
    places: Vec<Result<usize, Option<f64>>>,
    signals: Arc<[String]>,
    judge: SpecificationMonitor,
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
        let place = |axis: &Axis| space.axes().iter().position(|own| own.name == axis.name);
        let signals: Arc<[String]> = toy.signals().iter().map(|(name, _)| (*name).to_string()).collect();
        Ok(ToySystem {
            toy,
            space: space.clone(),
            places: axes.iter().map(|axis| place(axis).ok_or(axis.nominal)).collect(),
            judge: SpecificationMonitor::new(specification, &signals, toy.control_dt())?,
            signals,
        })
    }

    fn values(&self, scenario: &Scenario) -> Vec<Option<f64>> {
        self.places
            .iter()
            .map(|place| place.map_or_else(|nominal| nominal, |place| scenario.get(place)))
            .collect()
    }

    fn episode(&mut self, request: &Request) -> Result<Episode, RolloutError> {
        let values = self.values(&request.scenario);
        let mut trace = Trace::with_capacity(self.signals.clone(), self.toy.episode_steps() + 1);
        self.toy.simulate(&values, request.seed, &mut |sample| trace.push(sample));
        let (end, mut verdict) = match self.judge.verdict(&trace, true) {
            Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                (EpisodeEnd::Undefined { step }, mishandle_rollout::Verdict::default())
            }
            verdict => (EpisodeEnd::Completed, verdict?),
        };
        if request.needs_subformulas && verdict.robustness.is_some() {
            verdict.subformulas = self.judge.subformulas(&trace)?;
        }
        let steps = trace.len().saturating_sub(1);
        Ok(Episode { request: request.clone(), end, steps, verdict, total_reward: 0.0, trace })
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
    fn every_toy_is_a_target_whose_nominal_episode_meets_its_requirement() {
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
                assert!(episode.verdict.robustness > Some(0.0), "{} in {}", toy.name(), space.name());
                let drawn = Request::new(space.sample(Seed(1), 0), Seed(3));
                assert!(system.rollout(&[drawn]).is_ok());
            }
        }
    }

    #[test]
    fn names_are_distinct_and_others_are_unknown() {
        for (i, toy) in TOYS.iter().enumerate() {
            assert!(TOYS[..i].iter().all(|other| other.name() != toy.name()));
            assert!(target(toy.name()).is_none(), "the kind belongs to the name");
        }
        let joined = target("toy/noisy").unwrap().unwrap();
        assert_eq!(joined.space("all+starts").unwrap().axes(), joined.space("all").unwrap().axes());
        assert!(target("toy/none").is_none() && target("toysphere-2d").is_none());
    }

    #[test]
    fn the_violated_part_of_each_closed_form_has_the_stated_size() {
        // By geometry: a disc of radius 0.1 in a square of side 2.
        let pi = std::f64::consts::PI;
        for (name, share) in [("toy/sphere-2d", pi * 0.1 * 0.1 / 4.0), ("toy/plateau", pi * 0.1 * 0.1 / 4.0)]
        {
            let target = target(name).unwrap().unwrap();
            let requirement = Formula::parse(&target.formulas[0].text).unwrap();
            let space = target.space("starts").unwrap();
            let mut system = target.system(&space, &Specification::new(requirement)).unwrap();
            let n = 40_000;
            let requests: Vec<Request> =
                (0..n).map(|i| Request::new(space.sample(Seed(5), i), Seed(i))).collect();
            let episodes = system.rollout(&requests).unwrap();
            let violated = episodes.iter().filter(|e| e.verdict.robustness < Some(0.0)).count();
            let error = 5.0 * (share * (1.0 - share) / n as f64).sqrt();
            assert!((violated as f64 / n as f64 - share).abs() < error, "{name}: {violated} of {n}");
        }
    }
}
