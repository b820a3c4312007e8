//! Settings of a hardening.

use std::ops::RangeInclusive;

use super::declare::plan_table;
use super::keys;
use crate::error::{MishandleError, invalid};
use crate::plan::{CPU, DEVICES, Plan, RiskPlan};

plan_table! {
    /// Settings of a hardening: the table `[harden]` of a plan. The plan's space is the one in
    /// which the controller shall fail less often.
    pub struct HardenPlan in "harden" {
        /// Largest number of rounds.
        pub rounds: u32 = 3, "an integer from 1 to 1000";
        /// Environment steps of the training of a round.
        pub steps: u64 = 2_000_000, "an integer from 1 to 10^12";
        /// Device of the training's physics: `cpu` or `gpu`.
        pub device: String = CPU.to_string(), "\"cpu\" or \"gpu\"";
        /// Training settings: a file. `None`: those by which the controller was trained.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub settings: Option<String> = None, "a string: the path of a file of training settings";
        /// Command of the trainer of a round, in the plan's `folder`. `None`: this program trains.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub trainer: Option<String> = None,
            "a string: the command of a trainer, such as \"python train.py\"";
        /// Whether the user typed the command of the trainer. One that a file names needs
        /// permission.
        #[serde(skip)]
        pub is_trainer_typed: bool = false;
        /// Names of the searches that look for failures.
        pub searches: Vec<String> = ["portfolio", "cma-es", "random"].map(String::from).to_vec(),
            "a list of strings, such as [\"portfolio\"]";
        /// Simulations of each search in a round, and in the final comparison.
        pub budget: u32 = 300, keys::BUDGET;
        /// Simulations of each validation, which accepts or rejects a round.
        pub validation: u64 = 500, keys::EPISODES;
        /// Simulations of each measure of the final comparison.
        pub episodes: u64 = 1000, keys::EPISODES;
        /// Simulations of the failure probability in the final comparison.
        pub risk: u64 = 2000, keys::SIMULATIONS;
        /// Simulations of the search for the smallest disturbance in the final comparison.
        pub margin: u64 = 500, keys::BUDGET;
        /// Share of the training episodes without disturbances.
        pub nominal: f64 = 0.25, keys::SHARE;
        /// Share of the training episodes at corners of the space.
        pub corners: f64 = 0.1, keys::SHARE;
        /// Share of the training episodes with an archived failure, or a scenario that passed
        /// nearby.
        pub archive: f64 = 0.25, keys::SHARE;
        /// Measures that may get worse: `success`, `strict`, `careful`, `noise`, `corners`.
        pub allow: Vec<String> = Vec::new(), "a list of strings, such as [\"strict\"]";
    }
}

impl HardenPlan {
    /// Names of the measures that a plan may allow to get worse.
    pub const MEASURES: [&str; 5] = ["success", "strict", "careful", "noise", "corners"];

    /// Allowed numbers of rounds.
    pub const ROUNDS: RangeInclusive<u64> = 1..=1000;

    /// Allowed numbers of environment steps of a round.
    pub const STEPS: RangeInclusive<u64> = 1..=1_000_000_000_000;

    /// Checks the values.
    ///
    /// # Errors
    /// If a number is out of its range, a name is unknown, or the shares exceed the whole.
    pub fn check(&self) -> Result<(), MishandleError> {
        for (what, value, allowed, expected) in [
            ("harden.rounds", self.rounds.into(), HardenPlan::ROUNDS, "an integer from 1 to 1000"),
            ("harden.steps", self.steps, HardenPlan::STEPS, "an integer from 1 to 10^12"),
            ("harden.budget", self.budget.into(), Plan::BUDGET, "an integer from 1 to 1000000"),
            ("harden.validation", self.validation, Plan::EPISODES, "an integer from 1 to 1000000000"),
            ("harden.episodes", self.episodes, Plan::EPISODES, "an integer from 1 to 1000000000"),
            ("harden.risk", self.risk, RiskPlan::SIMULATIONS, "an integer from 100 to 1000000000"),
            ("harden.margin", self.margin, Plan::BUDGET, "an integer from 1 to 1000000"),
        ] {
            if !allowed.contains(&value) {
                return Err(invalid(what, value.to_string(), expected));
            }
        }
        for (what, share) in [
            ("harden.nominal", self.nominal),
            ("harden.corners", self.corners),
            ("harden.archive", self.archive),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return Err(invalid(what, share.to_string(), "a number from 0 to 1"));
            }
        }
        let shares = self.nominal + self.corners + self.archive;
        // The sum of shares that a user writes as decimal numbers may be rounded up.
        if shares > 1.0 + 1e-9 {
            let expected = "at most 1 together with `harden.nominal` and `harden.corners`";
            return Err(invalid("harden.archive", self.archive.to_string(), expected));
        }
        if !DEVICES.contains(&self.device.as_str()) {
            let known = DEVICES.map(String::from).to_vec();
            return Err(MishandleError::UnknownName { kind: "device", name: self.device.clone(), known });
        }
        self.check_trainer()?;
        if self.searches.is_empty() {
            return Err(invalid("harden.searches", "empty".to_string(), "the name of at least one search"));
        }
        if let Some(name) = self.allow.iter().find(|name| !HardenPlan::MEASURES.contains(&name.as_str())) {
            let known = HardenPlan::MEASURES.map(String::from).to_vec();
            return Err(MishandleError::UnknownName { kind: "measure", name: name.clone(), known });
        }
        Ok(())
    }
    /// Checks that a plan with a trainer has nothing that only training by this program reads.
    fn check_trainer(&self) -> Result<(), MishandleError> {
        if self.trainer.as_ref().is_some_and(|command| command.trim().is_empty()) {
            let what = "harden.trainer";
            let value = "empty".to_string();
            let expected = "a command, such as python train.py";
            return Err(invalid(what, value, expected));
        }
        let default = HardenPlan::default();
        let shares = [
            ("harden.nominal", self.nominal, default.nominal),
            ("harden.corners", self.corners, default.corners),
            ("harden.archive", self.archive, default.archive),
        ];
        let given = [
            ("harden.settings", self.settings.clone()),
            ("harden.device", (self.device != default.device).then(|| self.device.clone())),
        ];
        let changed = |(what, share, default): (&'static str, f64, f64)| {
            (what, (share != default).then(|| share.to_string()))
        };
        let mut given = given.into_iter().chain(shares.map(changed));
        match given.find_map(|(what, value)| Some((what, value?))) {
            Some((what, value)) if self.trainer.is_some() => Err(invalid(
                what,
                value,
                "left out with a trainer, which has settings, device and scenarios of its own",
            )),
            _ => Ok(()),
        }
    }
}
