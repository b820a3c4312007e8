//! The scenarios of a training run: names in the settings become axes of the target.

use std::path::Path;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_rollout::{Axis, AxisKind, AxisSet, RolloutError, Space, TrainingScenarios, named_space};
use mishandle_training::{AlgorithmSettings, AxisSetting, SpaceSetting};

use crate::archive::given_scenarios;
use crate::error::{MishandleError, problem};
use crate::resolve::{STARTS, TrainingEnvironment, TrainingScene, TrainingTarget, with_settings};

/// Returns the scenarios that settings name, and the environment over their axes of the scene.
///
/// A fault that shows NaN to the policy is excluded in the settings, because no policy can learn
/// from it.
///
/// # Errors
/// If a name is unknown, an axis is set to a value that it cannot have, the settings ask for NaN,
/// or the file of scenarios cannot be read.
pub(super) fn scenarios(
    target: &dyn TrainingTarget,
    scene: TrainingScene,
    settings: &mut AlgorithmSettings,
) -> Result<(TrainingEnvironment, TrainingScenarios), MishandleError> {
    if !settings.scenarios().is_used() {
        let scenarios = TrainingScenarios::of(scene.starts.environment.space().clone());
        settings.check_curriculum(&scenarios)?;
        return Ok((scene.starts, scenarios));
    }
    let TrainingScene { disturbances, axes, spaces, .. } = &scene;
    let setting = settings.scenarios().space.clone().unwrap_or_else(|| SpaceSetting::One(STARTS.to_string()));
    let named = space_with_starts(&setting.name(), axes, spaces)?;
    let scenarios = loop {
        let space = with_settings(named.clone(), &settings.scenarios().axes, axes)?;
        let found = TrainingScenarios {
            space,
            disturbances: disturbances.clone(),
            given: Vec::new(),
            mixture: Vec::new(),
        };
        let Some((axis, allowed)) = found.not_a_number() else { break found };
        let name = axis.name.clone();
        if settings.scenarios().axes.contains_key(&name) {
            let text = format!("{name} may show NaN to the policy, from which none can learn");
            let finite = Choice::Of(name, Box::new(Choice::Range(allowed.into_inner().into())));
            return Err(problem(text).with(Remedy::set(Key::AXES, finite)));
        }
        settings.scenarios_mut().axes.insert(name, AxisSetting::Range(allowed.into_inner().into()));
    };
    settings.check_curriculum(&scenarios)?;
    let given = match &settings.scenarios().file {
        Some(file) => given_scenarios(Path::new(file), &scenarios.space, Some(target))?,
        None => Vec::new(),
    };
    let mixture = match setting {
        SpaceSetting::One(_) => Vec::new(),
        SpaceSetting::Mixture(weights) => {
            let sets = weights.iter().map(|(name, weight)| {
                let part = space_with_starts(name, axes, spaces)?;
                Ok((axis_set(&scenarios.space, &named, &part), *weight))
            });
            sets.collect::<Result<_, MishandleError>>()?
        }
    };
    Ok((scene.over(&scenarios.space)?, TrainingScenarios { given, mixture, ..scenarios }))
}

/// Returns which axes of a space belong to one of the spaces of a mixture. An axis that none of
/// them has, because the settings add it, belongs to each.
fn axis_set(space: &Space, union: &Space, part: &Space) -> AxisSet {
    let has = |space: &Space, axis: &Axis| space.axes().iter().any(|other| other.name == axis.name);
    space.axes().iter().map(|axis| has(part, axis) || !has(union, axis)).collect()
}

/// Returns a named space with the axes of the initial state first, so that a start has the same
/// random numbers in every space.
fn space_with_starts(name: &str, axes: &[Axis], spaces: &[Space]) -> Result<Space, MishandleError> {
    let unknown = |error| match error {
        RolloutError::UnknownSpace { name, known } => {
            MishandleError::UnknownName { kind: "space", name, known }
        }
        error => error.into(),
    };
    let named = named_space(name, axes, spaces).map_err(unknown)?;
    let mut joined = named_space(STARTS, axes, spaces).map_err(unknown)?.axes().to_vec();
    joined.extend(named.axes().iter().filter(|axis| axis.kind != AxisKind::Start).cloned());
    Ok(Space::new(name, joined)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{EvaluatePlan, Plan};
    use crate::resolve::{ResolvedPlan, training_target};
    use mishandle_rollout::{Environment, Request, Scenario, Seed};
    use std::sync::Arc;

    fn resolved(
        text: &str,
    ) -> Result<(AlgorithmSettings, Arc<dyn Environment>, TrainingScenarios), MishandleError> {
        let mut settings = AlgorithmSettings::from_toml("ppo", text).unwrap()?;
        let target = training_target("ball-balancing", "cpu")?;
        let scene = target.scene("shaped", &settings)?;
        let (environment, scenarios) = scenarios(&*target, scene, &mut settings)?;
        Ok((settings, environment.environment, scenarios))
    }

    fn error(text: &str) -> String {
        resolved(text).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn starts_come_first_in_every_space() {
        let (_, plain, starts) = resolved("").unwrap();
        for name in ["delay", "dynamics+starts", "all"] {
            let (_, environment, found) = resolved(&format!("scenarios.space = \"{name}\"")).unwrap();
            assert_eq!(found.space.name(), name);
            assert_eq!(found.space.axes()[..plain.space().dimension()], *starts.space.axes());
            let scene = environment.space().axes();
            assert!(scene.iter().all(|axis| found.space.axes().contains(axis)));
        }
    }

    #[test]
    fn nan_is_excluded_and_cannot_be_asked_for() {
        let (settings, _, found) = resolved("scenarios.space = \"faults-sensing\"").unwrap();
        assert!(found.not_a_number().is_none());
        let axes = &settings.scenarios().axes;
        assert_eq!(axes["sensor_fault_fill"], AxisSetting::Range([0.0, 1.0]), "last and zero");
        let (again, ..) = resolved(&settings.to_toml()).unwrap();
        assert_eq!(again, settings, "stated settings resolve to themselves");
        let text = "scenarios = { space = \"faults-sensing\", axes.sensor_fault_fill = \"nan\" }";
        assert!(error(text).contains("sensor_fault_fill"), "{}", error(text));
    }

    #[test]
    fn mistakes_in_names_and_values_are_errors() {
        for (text, part) in [
            ("scenarios.space = \"delays\"", "delays"),
            ("scenarios.space = { delays = 1 }", "delays"),
            ("scenarios.space = { delay = 0 }", "weights above 0"),
            ("scenarios.space = {}", "weights above 0"),
            ("scenarios.space = { delay = nan }", "weights above 0"),
            ("scenarios.axes.action_delai = 1", "action_delai"),
            ("scenarios.curriculum = { start = 0.1, step = 0.1, threshold = 0.9 }", "whose range can grow"),
            ("scenarios.axes.action_delay = 7", "from 0 to 3"),
            ("scenarios = { file = \"/none/a.csv\", file_share = 0.1 }", "/none/a.csv"),
        ] {
            assert!(error(text).contains(part), "{}", error(text));
        }
    }

    #[test]
    fn an_episode_of_a_mixture_has_disturbances_of_one_space() {
        let text =
            "scenarios = { space = { \"delay+sensing\" = 3, dynamics = 1 }, axes.push_force_x = 0.003 }";
        let (settings, _, found) = resolved(text).unwrap();
        assert_eq!(found.space.name(), "delay+sensing+dynamics");
        let (again, ..) = resolved(&settings.to_toml()).unwrap();
        assert_eq!(again, settings, "stated settings resolve to themselves");
        let axes = found.space.axes();
        let moved = |scenario: &Scenario, part: &str| {
            axes.iter().zip(scenario.values()).any(|(axis, value)| {
                let inside = match axis.kind {
                    AxisKind::Start | AxisKind::Event => false,
                    _ => {
                        axis.name.contains("_delay")
                            || axis.name.starts_with("bias_")
                            || axis.name.starts_with("noise_")
                    }
                };
                let model = axis.kind == AxisKind::Model && !inside;
                (if part == "dynamics" { model } else { inside }) && *value != axis.nominal
            })
        };
        let part = found.part(1.0);
        let mut dynamics = 0;
        for index in 0..400 {
            for scenario in [found.random(Seed(5), index), found.corner(Seed(5), index)] {
                assert!(moved(&scenario, "dynamics") != moved(&scenario, "delay+sensing"), "{scenario:?}");
                let push = axes.iter().position(|axis| axis.name == "push_force_x").unwrap();
                assert_eq!(scenario.get(push), Some(0.003), "an added axis belongs to each space");
            }
            assert_eq!(found.random(Seed(5), index), part.random(Seed(5), index));
            assert_eq!(found.corner(Seed(5), index), part.corner(Seed(5), index));
            dynamics += u32::from(moved(&found.random(Seed(5), index), "dynamics"));
        }
        assert!((70..=130).contains(&dynamics), "{dynamics} of 400 with weight 1 of 4");
    }

    #[test]
    fn failures_of_the_same_task_can_be_given_and_others_cannot() {
        let folder = tempfile::tempdir().unwrap();
        let failing = |task: &str| {
            let plan = Plan { space: "starts+delay".to_string(), ..Plan::new(task, "ppo") };
            let plan = Plan { evaluate: Some(EvaluatePlan::default()), ..plan };
            let resolved = ResolvedPlan::new(&plan).unwrap();
            let drawn = (0..64).map(|index| resolved.space.sample(Seed(1), index));
            let found = drawn.map(|scenario| {
                crate::counterexample::Counterexample::simulate(&resolved, Request::new(scenario, Seed(2)))
            });
            let file = folder.path().join(format!("{task}.json"));
            let failing = found.flatten().next().expect("long delays break the controller");
            std::fs::write(&file, failing.to_json()).unwrap();
            (failing, file.to_string_lossy().into_owned())
        };
        let settings = |file: &str| {
            format!("scenarios = {{ space = \"delay+drift\", file = {file:?}, file_share = 0.5 }}")
        };
        let (known, file) = failing("ball-balancing");
        let (_, _, found) = resolved(&settings(&file)).unwrap();
        assert_eq!(found.given.len(), 1);
        let given = &found.given[0].0;
        for (axis, value) in found.space.axes().iter().zip(given.values()) {
            let recorded = known.scenario.iter().find(|recorded| recorded.axis == axis.name);
            assert_eq!(*value, recorded.map_or(axis.nominal, |recorded| recorded.value), "{}", axis.name);
        }
        let (_, other) = failing("point-reaching");
        let text = error(&settings(&other));
        assert!(text.contains("has failures of point-reaching, and"), "{text}");
        let older = std::fs::read_to_string(&file).unwrap().replace(&known.target.hash, &"0".repeat(64));
        std::fs::write(&file, older).unwrap();
        let text = error(&settings(&file));
        assert!(text.contains("ball-balancing in another version"), "{text}");
    }
}
