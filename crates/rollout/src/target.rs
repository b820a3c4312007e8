use std::fmt;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::{Axis, RolloutError, Scenario, Space, Specification, System};

/// What a target is: enough to know it again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// What kind of target it is, for instance `task` or `toy`.
    pub kind: String,
    /// Its name within its kind, as a plan states it.
    pub name: String,
    /// Hash of all that it states: equal hashes, equal targets.
    pub hash: String,
}

impl Identity {
    /// The identity of a target that states `content`, which is hashed by SHA-256.
    pub fn new(kind: &str, name: &str, content: &str) -> Identity {
        let hash = Sha256::digest(content.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        Identity { kind: kind.to_string(), name: name.to_string(), hash }
    }
}

/// A part of a target that comes from outside, such as a trained controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Component {
    /// What it is for, for instance `controller`.
    pub role: String,
    /// What it is called.
    pub name: String,
    /// Hash of what it does.
    pub hash: String,
    /// Hash of the bytes of its file; empty if it has none.
    pub file_hash: String,
}

/// A named number of a trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// Name, as formulas use it.
    pub name: String,
    /// Unit; empty for plain numbers.
    pub unit: String,
}

/// A formula with a name.
///
/// Four names are roles: `success` and `strict` make success rates, `safe` (a predicate on one sample) the dangerous
/// behavior rate, `completion` the task completion time. A target without one of them has no such metric.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFormula {
    /// Its name.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// The formulas of a target; the first is the requirement if a plan names no other.
pub type Formulas = Vec<NamedFormula>;

/// Makes the system for a space and a specification.
pub type SystemFactory =
    dyn Fn(&Space, &Specification) -> Result<Box<dyn System>, RolloutError> + Send + Sync;

/// Says whether the requirement can be met at all under a scenario of a space.
pub type Reachable = dyn Fn(&Space, &Scenario) -> bool + Send + Sync;

/// Anything that can be falsified: what may vary, what is seen, what is required, and what runs it.
///
/// Nothing that uses a target knows what kind it is.
#[derive(Clone)]
pub struct Target {
    /// What it is.
    pub identity: Identity,
    /// Parts of it that come from outside.
    pub components: Vec<Component>,
    /// Every axis that a scenario may set.
    pub axes: Vec<Axis>,
    /// Named sets of these axes; the first is the default.
    pub spaces: Vec<Space>,
    /// The signals of its traces, in order.
    pub signals: Vec<Signal>,
    /// Its formulas, the default requirement first.
    pub formulas: Formulas,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Control steps of a whole episode.
    pub episode_steps: usize,
    /// Whether equal requests give equal episodes, to the bit.
    pub is_deterministic: bool,
    /// Versions that its episodes depend on, beside the program's own: name and version.
    pub versions: Vec<(String, String)>,
    /// Whether a scenario can be met at all; every one can if this is absent.
    pub reachable: Option<Arc<Reachable>>,
    /// What makes its systems.
    pub factory: Arc<SystemFactory>,
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Target").field("identity", &self.identity).finish_non_exhaustive()
    }
}

impl Target {
    /// The names of its signals.
    pub fn signal_names(&self) -> Arc<[String]> {
        self.signals.iter().map(|signal| signal.name.clone()).collect()
    }

    /// The space of that name. Names joined by `+` make the space of all their axes, each taken once; `all` is the space
    /// of all axes.
    ///
    /// # Errors
    /// [`RolloutError::UnknownSpace`] with the names there are.
    pub fn space(&self, name: &str) -> Result<Space, RolloutError> {
        let parts: Vec<&str> = name.split('+').collect();
        if parts.contains(&ALL_AXES) {
            return Space::new(name, self.axes.clone());
        }
        let mut axes: Vec<Axis> = Vec::new();
        for part in parts {
            let Some(space) = self.spaces.iter().find(|space| space.name() == part) else {
                let known = self.spaces.iter().map(|space| space.name().to_string());
                let known = known.chain([ALL_AXES.to_string()]).collect();
                return Err(RolloutError::UnknownSpace { name: part.to_string(), known });
            };
            for axis in space.axes() {
                if axes.iter().all(|known| known.name != axis.name) {
                    axes.push(axis.clone());
                }
            }
        }
        Space::new(name, axes)
    }

    /// The system that runs scenarios of `space` and judges them by `specification`.
    ///
    /// # Errors
    /// If an axis is not the target's, or a formula does not fit its signals.
    pub fn system(
        &self,
        space: &Space,
        specification: &Specification,
    ) -> Result<Box<dyn System>, RolloutError> {
        (self.factory)(space, specification)
    }
}

/// Name of the space of all axes of a target.
const ALL_AXES: &str = "all";
