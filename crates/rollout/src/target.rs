use std::fmt;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::{Axis, RolloutError, Scenario, SolverSystem, SolverVariant, Space, Specification, System};

/// Identity of a target: name and hash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Kind of target, for instance `task` or `toy`.
    pub kind: String,
    /// Name in plans and on the command line.
    pub name: String,
    /// SHA-256 of the description of the target, in hexadecimal. Equal targets have equal hashes.
    pub hash: String,
}

impl Identity {
    /// Makes the identity of a target with the description `content`, of which it stores the
    /// SHA-256 hash.
    pub fn new(kind: &str, name: &str, content: &str) -> Identity {
        Identity { kind: kind.to_string(), name: name.to_string(), hash: hash(content) }
    }
}

/// An external part of a target, such as a trained controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Component {
    /// Role in the target, for instance `controller`.
    pub role: String,
    /// Name.
    pub name: String,
    /// Hash of its behavior.
    pub hash: String,
    /// Hash of the bytes of its file; empty if it has no file.
    pub file_hash: String,
}

impl Component {
    /// Returns the hash of the behavior of several components together: that of a single one, or
    /// the SHA-256 of their roles and hashes.
    pub fn joint_hash(components: &[Component]) -> String {
        match components {
            [only] => only.hash.clone(),
            all => {
                let lines: Vec<String> = all.iter().map(|own| format!("{} {}", own.role, own.hash)).collect();
                hash(&lines.join("\n"))
            }
        }
    }
}

/// Returns the SHA-256 of a text in hexadecimal.
fn hash(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A named column of a trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// Name in formulas.
    pub name: String,
    /// Unit; empty for dimensionless numbers.
    pub unit: String,
}

/// A formula with a name.
///
/// Five names are roles. `success`, `strict` and `careful` define the success rates, `safe` (a
/// predicate on one sample) defines the dangerous behavior rate, and `completion` defines the task
/// completion time. A target without one of these formulas has no such metric.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFormula {
    /// Name.
    pub name: String,
    /// Text in the formula language.
    pub text: String,
}

/// Makes the system for a space and a specification.
pub type SystemFactory =
    dyn Fn(&Space, &Specification) -> Result<Box<dyn System>, RolloutError> + Send + Sync;

/// Returns whether the requirement can be satisfied under a scenario of a space.
pub type ReachabilityCheck = dyn Fn(&Space, &Scenario) -> bool + Send + Sync;

/// Anything that can be falsified: axes of scenarios, signals, formulas, and a factory of systems.
///
/// The code that uses a target does not depend on its kind.
#[derive(Clone)]
pub struct Target {
    /// Name and hash.
    pub identity: Identity,
    /// External parts, such as the controller.
    pub components: Vec<Component>,
    /// All axes that a scenario may set.
    pub axes: Vec<Axis>,
    /// Named lists of these axes. The first is the default.
    pub spaces: Vec<Space>,
    /// The signals of its traces, in order.
    pub signals: Vec<Signal>,
    /// Further signals, which cost time. A trace has all of them, after the others, if a formula of
    /// its specification reads one of them, and otherwise none.
    pub signals_on_request: Vec<Signal>,
    /// Signals of the controller, which follow those of the system.
    pub controller_signals: Vec<Signal>,
    /// Formulas. The first is the default requirement.
    pub formulas: Vec<NamedFormula>,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
    /// Whether equal requests give bit-identical episodes.
    pub is_deterministic: bool,
    /// Whether a simulation can fail (crash, time out, reject its scenario) or be terminated by the
    /// target.
    pub can_fail: bool,
    /// Whether an episode depends on the seed of its request when every axis is nominal: the
    /// initial state, the observations or the actions contain random numbers.
    pub depends_on_seed: bool,
    /// Names of the axes that add randomness, such as the standard deviation of a sensor's noise:
    /// with another value than the nominal one, an episode depends on its seed.
    pub random_axes: Vec<String>,
    /// Names and versions of the software that its episodes depend on, except this program.
    pub versions: Vec<(String, String)>,
    /// Check whether the requirement can be satisfied under a scenario. `None` means that it always
    /// can.
    pub reachable: Option<Arc<ReachabilityCheck>>,
    /// Makes systems.
    pub factory: Arc<SystemFactory>,
    /// The target under changes of its physics that no failure may depend on; empty if this program
    /// does not step its physics.
    pub solver_variants: Vec<SolverVariant>,
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Target").field("identity", &self.identity).finish_non_exhaustive()
    }
}

impl Target {
    /// Returns all signals that a formula may read.
    pub fn all_signals(&self) -> impl Iterator<Item = &Signal> + Clone {
        self.signals.iter().chain(&self.signals_on_request).chain(&self.controller_signals)
    }

    /// Returns the names of all signals that a formula may read.
    pub fn signal_names(&self) -> Arc<[String]> {
        self.all_signals().map(|signal| signal.name.clone()).collect()
    }

    /// Returns the signals of the traces of a system with this specification.
    pub fn traced_signals(&self, specification: &Specification) -> Vec<Signal> {
        let names: Vec<&str> = self.signals_on_request.iter().map(|signal| signal.name.as_str()).collect();
        let traced = if specification.reads_any(&names) { self.signals_on_request.as_slice() } else { &[] };
        self.signals.iter().chain(traced).chain(&self.controller_signals).cloned().collect()
    }

    /// Returns the space with this name.
    ///
    /// Names joined by `+` give the union of their axes. `all` is the space of all axes.
    ///
    /// # Errors
    /// [`RolloutError::UnknownSpace`] with the available names.
    pub fn space(&self, name: &str) -> Result<Space, RolloutError> {
        named_space(name, &self.axes, &self.spaces)
    }

    /// Returns the axes that a plan can name: all axes, then those that only a named space has.
    pub fn named_axes(&self) -> Vec<Axis> {
        let mut named = self.axes.clone();
        for axis in self.spaces.iter().flat_map(Space::axes) {
            if named.iter().all(|known| known.name != axis.name) {
                named.push(axis.clone());
            }
        }
        named
    }

    /// Makes the system that simulates scenarios of `space` and evaluates `specification`.
    ///
    /// # Errors
    /// If `space` contains an axis that the target does not have, or a formula does not fit its
    /// signals.
    pub fn system(
        &self,
        space: &Space,
        specification: &Specification,
    ) -> Result<Box<dyn System>, RolloutError> {
        (self.factory)(space, specification)
    }

    /// Makes the systems of the [variants](Self::solver_variants) of the target, as
    /// [`system`](Self::system) makes that of the target itself.
    ///
    /// # Errors
    /// As for [`system`](Self::system).
    pub fn solver_systems(
        &self,
        space: &Space,
        specification: &Specification,
    ) -> Result<Vec<SolverSystem>, RolloutError> {
        let system = |variant: &SolverVariant| Ok((variant.change, (variant.factory)(space, specification)?));
        self.solver_variants.iter().map(system).collect()
    }
}

/// Returns the space with a name: one of `spaces`, the union of several joined by `+`, or `all`,
/// the space of all `axes`.
///
/// # Errors
/// [`RolloutError::UnknownSpace`] with the available names.
pub fn named_space(name: &str, axes: &[Axis], spaces: &[Space]) -> Result<Space, RolloutError> {
    let parts: Vec<&str> = name.split('+').collect();
    if parts.contains(&ALL_AXES) {
        return Space::new(name, axes.to_vec());
    }
    let mut joined: Vec<Axis> = Vec::new();
    for part in parts {
        let Some(space) = spaces.iter().find(|space| space.name() == part) else {
            let known = spaces.iter().map(|space| space.name().to_string());
            let known = known.chain([ALL_AXES.to_string()]).collect();
            return Err(RolloutError::UnknownSpace { name: part.to_string(), known });
        };
        for axis in space.axes() {
            if joined.iter().all(|known| known.name != axis.name) {
                joined.push(axis.clone());
            }
        }
    }
    Space::new(name, joined)
}

/// Name of the space of all axes of a target.
const ALL_AXES: &str = "all";
