//! The JSON of a counterexample.

use std::collections::BTreeMap;
use std::fmt::Display;

use mishandle_results::{PhysicsCheck, SolverChange, SolverSimulation};
use mishandle_stl::is_satisfied;
use mishandle_store::{BuildRecord, ComponentRecord, SimulationEnd, TargetRecord};
use serde::{Deserialize, Deserializer, Serialize};

use super::{AxisValue, Counterexample, Decisive, Expected, MinimizedFrom};
use crate::error::{MishandleError, problem};
use crate::plan::{FalsifyPlan, GuardPlan, Plan};
use crate::portable::BESIDE;
use crate::resolve::{command, command_target, is_path, is_target_file};

/// Version of the format.
const FORMAT: u64 = 1;

/// The key that identifies a counterexample. It is read before the others.
#[derive(Deserialize)]
struct Version {
    counterexample_format: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    counterexample_format: u64,
    target: Target,
    preset: String,
    space: String,
    controller: String,
    stochastic: bool,
    action_noise: f64,
    observation_noise: f64,
    /// Keys of the guard as TOML, which has infinite thresholds; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    guard: Option<String>,
    formula: String,
    components: Vec<Component>,
    scenario: Vec<Value>,
    seed: String,
    expected: Outcome,
    #[serde(deserialize_with = "present")]
    decisive: Option<Predicate>,
    trial: u32,
    simulation: u32,
    #[serde(deserialize_with = "present")]
    minimized_from: Option<Origin>,
    /// `null` if the physics was not checked.
    #[serde(deserialize_with = "present")]
    physics: Option<Physics>,
    build: Build,
    versions: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Target {
    kind: String,
    name: String,
    hash: String,
    deterministic: bool,
    /// `./FILE` for a target file beside the counterexample; absent for any other target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file: Option<String>,
    /// Command of a simulator, in the folder of the counterexample; absent for any other target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    command: Option<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Component {
    role: String,
    name: String,
    hash: String,
    file_hash: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Value {
    axis: String,
    #[serde(deserialize_with = "present")]
    value: Option<f64>,
    #[serde(deserialize_with = "present")]
    nominal: Option<f64>,
    unit: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Outcome {
    end: String,
    #[serde(deserialize_with = "present")]
    end_step: Option<u32>,
    steps: u32,
    robustness: Number,
    trace_digest: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Predicate {
    predicate: String,
    sample: u64,
    time: f64,
    sides: [String; 2],
    values: [Number; 2],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Origin {
    scenario: Vec<Option<f64>>,
    robustness: Number,
    simulations: u64,
    complete: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Physics {
    depends_on_solver: bool,
    simulations: Vec<Variant>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Variant {
    change: SolverChange,
    #[serde(deserialize_with = "present")]
    robustness: Option<Number>,
    #[serde(deserialize_with = "present")]
    violated: Option<bool>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Build {
    program_version: String,
    git_commit: String,
    target: String,
    rustc: String,
    architecture: String,
}

/// Reads a value that can be `null`. Its key must be there, because an absent fact would be taken
/// for one that agrees.
fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Option<T>, D::Error> {
    Option::deserialize(from)
}

/// A number, or `"inf"` or `"-inf"`, which JSON numbers cannot be.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Number {
    Finite(f64),
    Text(String),
}

impl Number {
    fn new(value: f64) -> Number {
        if value.is_finite() { Number::Finite(value) } else { Number::Text(value.to_string()) }
    }

    fn value(&self, key: &str) -> Result<f64, MishandleError> {
        match self {
            Number::Finite(value) => Ok(*value),
            Number::Text(text) if text == "inf" => Ok(f64::INFINITY),
            Number::Text(text) if text == "-inf" => Ok(f64::NEG_INFINITY),
            Number::Text(text) => Err(no_counterexample(format!(
                "`{key}` is \"{text}\"; it must be a number, \"inf\" or \"-inf\""
            ))),
        }
    }
}

pub(super) fn no_counterexample(reason: impl Display) -> MishandleError {
    problem(format!("not a counterexample file: {reason}"))
}

pub(super) fn read(text: &str) -> Result<Counterexample, MishandleError> {
    let syntax = |error: serde_json::Error| no_counterexample(error.to_string());
    let Version { counterexample_format: found } = serde_json::from_str(text).map_err(syntax)?;
    if found > FORMAT {
        return Err(problem(format!(
            "the counterexample has format {found}, this program reads formats up to {FORMAT}: use a newer Mishandle"
        )));
    }
    if found < FORMAT {
        return Err(no_counterexample(format!("`counterexample_format` is {found}; it must be {FORMAT}")));
    }
    let document: Document = serde_json::from_str(text).map_err(syntax)?;
    document.counterexample()
}

pub(super) fn write(counterexample: &Counterexample) -> String {
    // Cannot fail: the keys are texts, and all numbers are finite.
    serde_json::to_string_pretty(&Document::new(counterexample)).unwrap_or_default() + "\n"
}

impl Document {
    fn new(from: &Counterexample) -> Document {
        let Counterexample { plan, target, build, expected, .. } = from;
        let component = |known: &ComponentRecord| Component {
            role: known.role.clone(),
            name: known.name.clone(),
            hash: known.hash.clone(),
            file_hash: known.file_hash.clone(),
        };
        let value = |known: &AxisValue| Value {
            axis: known.axis.clone(),
            value: known.value,
            nominal: known.nominal,
            unit: known.unit.clone(),
        };
        let formula = plan.falsify.as_ref().and_then(|falsify| falsify.formula.clone());
        Document {
            counterexample_format: FORMAT,
            target: Target {
                kind: target.kind.clone(),
                name: target.name.clone(),
                hash: target.hash.clone(),
                deterministic: target.is_deterministic,
                file: is_target_file(&plan.target).then(|| plan.target.clone()),
                command: command(&plan.target).map(str::to_string),
            },
            preset: plan.preset.clone(),
            space: plan.space.clone(),
            controller: plan.controller.clone(),
            stochastic: plan.stochastic,
            action_noise: plan.action_noise,
            observation_noise: plan.observation_noise,
            guard: plan.guard.as_ref().map(GuardPlan::to_toml),
            formula: formula.unwrap_or_default(),
            components: from.components.iter().map(component).collect(),
            scenario: from.scenario.iter().map(value).collect(),
            seed: from.seed.to_string(),
            expected: Outcome {
                end: expected.end.name().to_string(),
                end_step: expected.end.step(),
                steps: expected.steps,
                robustness: Number::new(expected.robustness),
                trace_digest: format!("{:032x}", expected.trace_digest),
            },
            decisive: from.decisive.as_ref().map(|known| Predicate {
                predicate: known.predicate.clone(),
                sample: known.sample,
                time: known.time,
                sides: known.sides.clone(),
                values: known.values.map(Number::new),
            }),
            trial: from.trial,
            simulation: from.simulation,
            minimized_from: from.minimized_from.as_ref().map(|known| Origin {
                scenario: known.scenario.clone(),
                robustness: Number::new(known.robustness),
                simulations: known.simulations,
                complete: known.is_complete,
            }),
            physics: from.physics.as_ref().map(Physics::new),
            build: Build {
                program_version: build.program_version.clone(),
                git_commit: build.git_commit.clone(),
                target: build.target.clone(),
                rustc: build.rustc.clone(),
                architecture: build.architecture.clone(),
            },
            versions: from.versions.iter().cloned().collect(),
        }
    }

    fn counterexample(self) -> Result<Counterexample, MishandleError> {
        check_controller(&self.controller)?;
        // A name that is the path of a file would be read.
        if let Some(file) =
            self.target.file.as_ref().or(Some(&self.target.name).filter(|name| is_target_file(name)))
        {
            check_target_file(file)?;
        }
        for (index, known) in self.scenario.iter().enumerate() {
            if self.scenario[..index].iter().any(|other| other.axis == known.axis) {
                return Err(no_counterexample(format!("`scenario` has the axis `{}` twice", known.axis)));
            }
        }
        let seed = self.seed.parse().map_err(|_| {
            no_counterexample(format!(
                "`seed` is \"{}\"; it must be a whole number from 0 to 2^64 - 1",
                self.seed
            ))
        })?;
        let robustness = self.expected.robustness.value("expected.robustness")?;
        if is_satisfied(robustness) {
            return Err(no_counterexample(format!(
                "`expected.robustness` is {robustness}; it must be negative"
            )));
        }
        let decisive = self.decisive.map(|known| {
            let [left, right] = &known.values;
            Ok::<_, MishandleError>(Decisive {
                values: [left.value("decisive.values")?, right.value("decisive.values")?],
                predicate: known.predicate,
                sample: known.sample,
                time: known.time,
                sides: known.sides,
            })
        });
        let minimized_from = self.minimized_from.map(|known| {
            Ok::<_, MishandleError>(MinimizedFrom {
                robustness: known.robustness.value("minimized_from.robustness")?,
                scenario: known.scenario,
                simulations: known.simulations,
                is_complete: known.complete,
            })
        });
        let target = match (&self.target.file, &self.target.command) {
            (Some(file), _) => file.clone(),
            (None, Some(command)) => command_target(command),
            (None, None) => self.target.name.clone(),
        };
        let plan = Plan {
            space: self.space,
            preset: self.preset,
            stochastic: self.stochastic,
            action_noise: self.action_noise,
            observation_noise: self.observation_noise,
            guard: self.guard.as_deref().map(GuardPlan::from_toml).transpose()?,
            seed,
            falsify: Some(FalsifyPlan { formula: Some(self.formula), ..FalsifyPlan::default() }),
            ..Plan::new(&target, &self.controller)
        };
        Ok(Counterexample {
            plan,
            target: TargetRecord {
                kind: self.target.kind,
                name: self.target.name,
                hash: self.target.hash,
                is_deterministic: self.target.deterministic,
            },
            components: self.components.into_iter().map(ComponentRecord::from).collect(),
            build: BuildRecord {
                program_version: self.build.program_version,
                git_commit: self.build.git_commit,
                target: self.build.target,
                rustc: self.build.rustc,
                architecture: self.build.architecture,
            },
            versions: self.versions.into_iter().collect(),
            scenario: self.scenario.into_iter().map(AxisValue::from).collect(),
            seed,
            expected: Expected {
                end: end(&self.expected.end, self.expected.end_step)?,
                steps: self.expected.steps,
                robustness,
                trace_digest: digest(&self.expected.trace_digest)?,
            },
            decisive: decisive.transpose()?,
            trial: self.trial,
            simulation: self.simulation,
            minimized_from: minimized_from.transpose()?,
            physics: self.physics.map(Physics::check).transpose()?,
        })
    }
}

impl Physics {
    fn new(from: &PhysicsCheck) -> Physics {
        let variant = |known: &SolverSimulation| Variant {
            change: known.change,
            robustness: known.robustness.map(|robustness| Number::new(robustness.0)),
            violated: known.violated,
        };
        let simulations = from.simulations.iter().map(variant).collect();
        Physics { depends_on_solver: from.depends_on_solver, simulations }
    }

    fn check(self) -> Result<PhysicsCheck, MishandleError> {
        let simulation = |known: Variant| {
            let robustness = known.robustness.map(|robustness| robustness.value("physics.robustness"));
            Ok::<_, MishandleError>(SolverSimulation {
                change: known.change,
                robustness: robustness.transpose()?.map(Into::into),
                violated: known.violated,
            })
        };
        let simulations = self.simulations.into_iter().map(simulation).collect::<Result<_, _>>()?;
        let check = PhysicsCheck::new(simulations);
        if check.depends_on_solver == self.depends_on_solver {
            Ok(check)
        } else {
            Err(no_counterexample(format!(
                "`physics.depends_on_solver` is {}; its simulations say {}",
                self.depends_on_solver, check.depends_on_solver
            )))
        }
    }
}

impl From<Component> for ComponentRecord {
    fn from(known: Component) -> ComponentRecord {
        let Component { role, name, hash, file_hash } = known;
        ComponentRecord { role, name, hash, file_hash }
    }
}

impl From<Value> for AxisValue {
    fn from(known: Value) -> AxisValue {
        let Value { axis, value, nominal, unit } = known;
        AxisValue { axis, unit, value, nominal }
    }
}

/// Checks that the controller is the name of a shipped one, or `./FILE` for a file beside the
/// counterexample, which cannot name another file of the machine.
fn check_controller(controller: &str) -> Result<(), MishandleError> {
    if is_beside(controller) || (!controller.starts_with(BESIDE) && !is_path(controller)) {
        return Ok(());
    }
    Err(no_counterexample(format!(
        "`controller` is \"{controller}\"; it must be the name of a shipped controller, or ./FILE for a file beside the \
         counterexample"
    )))
}

/// Checks that the target file is `./NAME.toml`, which cannot name another file of the machine.
fn check_target_file(file: &str) -> Result<(), MishandleError> {
    if is_beside(file) && is_target_file(file) {
        return Ok(());
    }
    Err(no_counterexample(format!(
        "`target.file` is \"{file}\"; it must be ./NAME.toml for a file beside the counterexample"
    )))
}

/// Returns whether this is `./FILE`.
fn is_beside(path: &str) -> bool {
    path.strip_prefix(BESIDE)
        .is_some_and(|file| !file.contains(['/', '\0']) && !["", ".", ".."].contains(&file))
}

/// Returns the end with this name. Only an episode with a verdict can be a counterexample.
fn end(name: &str, step: Option<u32>) -> Result<SimulationEnd, MishandleError> {
    match (name, step) {
        ("completed", None) => Ok(SimulationEnd::Completed),
        ("terminated", Some(step)) => Ok(SimulationEnd::Terminated { step }),
        ("stopped", Some(step)) => Ok(SimulationEnd::Stopped { step }),
        _ => Err(no_counterexample(format!(
            "`expected.end` is \"{name}\" and `end_step` {step:?}; it must be \"completed\" without a step, or \"terminated\" or \
             \"stopped\" with one"
        ))),
    }
}

fn digest(text: &str) -> Result<u128, MishandleError> {
    let is_digest = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    u128::from_str_radix(text, 16).ok().filter(|_| is_digest).ok_or_else(|| {
        no_counterexample(format!("`trace_digest` is \"{text}\"; it must be 32 hexadecimal digits"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Counterexample {
        let value = |axis: &str, value| AxisValue {
            axis: axis.to_string(),
            unit: "m".to_string(),
            value,
            nominal: value.map(|_| 0.0),
        };
        let formula = Some("always(x >= 1)".to_string());
        Counterexample {
            plan: Plan {
                action_noise: 0.1 + 0.2,
                seed: u64::MAX,
                falsify: Some(FalsifyPlan { formula, ..FalsifyPlan::default() }),
                ..Plan::new("ball-balancing", "./mine.safetensors")
            },
            target: TargetRecord { name: "ball-balancing".to_string(), ..TargetRecord::default() },
            components: vec![ComponentRecord {
                role: "controller".to_string(),
                ..ComponentRecord::default()
            }],
            build: BuildRecord::default(),
            versions: vec![("MuJoCo".to_string(), "3.17.0".to_string())],
            scenario: vec![
                value("x", Some(5e-324)),
                value("y", Some(-0.0)),
                value("z", Some(0.1 + 0.2)),
                value("draw", None),
            ],
            seed: u64::MAX,
            expected: Expected {
                end: SimulationEnd::Terminated { step: 3 },
                steps: 3,
                robustness: f64::NEG_INFINITY,
                trace_digest: 0xab,
            },
            decisive: Some(Decisive {
                predicate: "x >= 1".to_string(),
                sample: 2,
                time: 1.0 / 3.0,
                sides: ["x", "1"].map(String::from),
                values: [f64::NEG_INFINITY, 1.0],
            }),
            trial: 2,
            simulation: 17,
            minimized_from: Some(MinimizedFrom {
                scenario: vec![Some(1.0 / 3.0), None],
                robustness: -1e-300,
                simulations: 40,
                is_complete: true,
            }),
            physics: Some(PhysicsCheck::new(vec![
                SolverSimulation {
                    change: SolverChange::HalfStep,
                    robustness: Some(f64::NEG_INFINITY.into()),
                    violated: Some(true),
                },
                SolverSimulation { change: SolverChange::MovedStart, robustness: None, violated: None },
            ])),
        }
    }

    #[test]
    fn every_number_survives_with_its_bits() {
        let written = write(&example());
        let read = read(&written).unwrap();
        assert_eq!(read, example());
        // `==` ignores the sign of a zero.
        assert_eq!(format!("{read:?}"), format!("{:?}", example()));
        assert_eq!(write(&read), written);
    }

    #[test]
    fn hostile_and_damaged_files_are_errors_that_name_the_problem() {
        let text = write(&example());
        let error = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            read(&text.replacen(from, to, 1)).unwrap_err().to_string()
        };
        let path = "\"./mine.safetensors\"";
        for to in ["/etc/a.safetensors", "./../a.safetensors", "a/b.safetensors", "./", "./..", "a.onnx"] {
            let error = error(path, &format!("\"{to}\""));
            assert!(error.contains("`controller` is") && error.contains("beside"), "{error}");
        }
        for (from, to, part) in [
            ("\"preset\"", "\"presett\"", "unknown field `presett`"),
            ("\"axis\": \"y\"", "\"axis\": \"x\"", "the axis `x` twice"),
            ("\"axis\": \"y\"", "\"code\": \"y\"", "unknown field `code`"),
            ("\"robustness\": \"-inf\"", "\"robustness\": 0.5", "0.5; it must be negative"),
            ("\"robustness\": \"-inf\"", "\"robustness\": \"nan\"", "must be a number, \"inf\""),
            ("\"robustness\": \"-inf\"", "\"robustness\": 1e999", "out of range"),
            ("\"terminated\"", "\"diverged\"", "`expected.end` is \"diverged\""),
            ("18446744073709551615", "18446744073709551616", "`seed` is"),
            ("000000ab", "+00000ab", "32 hexadecimal digits"),
            ("\"trial\": 2", "\"trial\": -2", "invalid value"),
            ("\"half step\"", "\"no step\"", "unknown variant `no step`"),
            ("\"violated\": null", "\"violated\": true", "`physics.depends_on_solver` is true"),
            ("{", "[", "not a counterexample file"),
        ] {
            let error = error(from, to);
            assert!(error.contains(part), "{error}");
        }
        let deep = "[".repeat(100_000);
        assert!(read(&deep).is_err() && read("").is_err() && read("{\"schema\": 1}").is_err());
    }

    /// Returns each copy of a value that lacks one key, with the key.
    fn without_a_key(value: &serde_json::Value) -> Vec<(String, serde_json::Value)> {
        let mut found = Vec::new();
        if let Some(object) = value.as_object() {
            for (key, inner) in object {
                let mut copy = object.clone();
                copy.remove(key);
                found.push((key.clone(), copy.into()));
                for (name, changed) in without_a_key(inner) {
                    let mut copy = object.clone();
                    copy.insert(key.clone(), changed);
                    found.push((name, copy.into()));
                }
            }
        }
        for (index, inner) in value.as_array().into_iter().flatten().enumerate() {
            for (name, changed) in without_a_key(inner) {
                let mut copy = value.clone();
                copy[index] = changed;
                found.push((name, copy));
            }
        }
        found
    }

    #[test]
    fn every_key_is_required() {
        let whole: serde_json::Value = serde_json::from_str(&write(&example())).unwrap();
        let lacking = without_a_key(&whole);
        let has = |name: &str| lacking.iter().any(|(key, _)| key == name);
        assert!(["trace_digest", "file_hash", "role", "name", "minimized_from"].into_iter().all(has));
        for (key, document) in lacking {
            // The versions are a list of any names.
            if key != "MuJoCo" {
                let error = read(&document.to_string()).unwrap_err().to_string();
                assert!(error.contains(&format!("missing field `{key}`")), "{key}: {error}");
            }
        }
    }

    #[test]
    fn a_newer_format_is_refused_before_its_keys_are_read() {
        let error = read("{\"counterexample_format\": 2, \"new_key\": 1}").unwrap_err().to_string();
        assert!(error.contains("format 2") && error.contains("use a newer Mishandle"), "{error}");
        let error = read("{\"counterexample_format\": 0}").unwrap_err().to_string();
        assert!(error.contains("is 0; it must be 1"), "{error}");
    }
}
