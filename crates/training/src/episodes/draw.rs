//! The scenario of each episode.

use std::fmt::Write;

use mishandle_controllers::bytes_hash;
use mishandle_rollout::{Scenario, ScenarioPart, Seed, Stream, TrainingScenarios};

use crate::ScenarioSettings;

/// Where the scenario of an episode comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenarioOrigin {
    /// A random start without a disturbance.
    Nominal,
    /// A corner of the space.
    Corner,
    /// One of the given scenarios.
    Given,
    /// A random scenario of the space.
    Random,
}

/// Draws scenarios with the shares of the settings. A scenario depends on the seed of its episode
/// only, and on the part of the ranges from which a curriculum draws.
pub struct ScenarioDraw {
    scenarios: TrainingScenarios,
    /// The scenarios from which episodes draw at present.
    part: ScenarioPart,
    /// Upper ends, in [0, 1], of the shares of nominal episodes, corners and given scenarios.
    shares: [f64; 3],
}

impl ScenarioDraw {
    /// Makes the draw of given scenarios and settings, of which only the shares matter here.
    pub fn new(scenarios: TrainingScenarios, settings: &ScenarioSettings) -> ScenarioDraw {
        let ScenarioSettings { nominal, corners, file_share, .. } = *settings;
        let part = scenarios.part(settings.curriculum.map_or(1.0, |curriculum| curriculum.share(0)));
        ScenarioDraw { scenarios, part, shares: [nominal, nominal + corners, nominal + corners + file_share] }
    }

    /// Returns the scenarios.
    pub fn scenarios(&self) -> &TrainingScenarios {
        &self.scenarios
    }

    /// Draws from a share of the range of each axis around its nominal value.
    pub fn set_share(&mut self, share: f64) {
        self.part = self.scenarios.part(share);
    }

    /// Returns the scenario of the episode with this seed, and where it comes from.
    pub fn draw(&self, seed: Seed) -> (ScenarioOrigin, Scenario) {
        let [nominal, corners, given] = self.shares;
        let uniform = |index: u32| seed.uniform(Stream::Scenario, 0, index);
        match if given > 0.0 { uniform(0) } else { 1.0 } {
            u if u < nominal => (ScenarioOrigin::Nominal, self.scenarios.nominal(seed, 0)),
            u if u < corners => (ScenarioOrigin::Corner, self.part.corner(seed, 0)),
            u if u < given => match self.scenarios.given(uniform(1)) {
                Some(scenario) => (ScenarioOrigin::Given, self.with_random_start(scenario, seed)),
                None => (ScenarioOrigin::Random, self.part.random(seed, 0)),
            },
            _ => (ScenarioOrigin::Random, self.part.random(seed, 0)),
        }
    }

    /// Returns a given scenario, with a random value for each initial state that it leaves open.
    fn with_random_start(&self, scenario: &Scenario, seed: Seed) -> Scenario {
        let nominal = self.scenarios.nominal(seed, 0);
        let values = scenario.values().iter().zip(nominal.values());
        let filled = Scenario::new(values.map(|(given, drawn)| given.or(*drawn)).collect());
        self.scenarios.space.canonical(filled)
    }

    /// Returns a text that identifies the given scenarios; empty without any.
    pub fn identity_of_given(&self) -> String {
        if self.scenarios.given.is_empty() {
            return String::new();
        }
        let mut text = String::new();
        for (scenario, weight) in &self.scenarios.given {
            writeln!(text, "{:?} {weight}", scenario.values()).expect("writing to a text does not fail");
        }
        format!(" with scenarios {}", &bytes_hash(text.as_bytes())[..12])
    }
}
