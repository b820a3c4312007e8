//! Trained controllers: neural-network policies and their file format.
//!
//! A [`Policy`] normalizes an observation, evaluates a multi-layer perceptron and returns the
//! action: the mean of a Gaussian, or of a Gaussian squashed by tanh. It is a
//! [`Controller`](mishandle_rollout::Controller), so it can be evaluated and falsified like any
//! other. A [`ControllerFile`] stores a policy in a safetensors file. Its [`Header`] contains the
//! task, the [`Layout`] of observations and actions, and the training record.
//! [`guard`] hands the control from a controller over to a fallback.

mod checksum;
mod error;
mod file;
mod fitted;
pub mod guard;
mod history;
mod interface;
mod layout;
mod limited;
mod policy;
pub mod squashed;
mod tensor_file;

pub use checksum::{EMPTY_CHECKSUM, has_valid_checksum, write_checksum};
pub use error::{ControllerError, FileProblem};
pub use file::{
    ControllerFile, FORMAT_VERSION, Header, TrainingRecord, ValidationRecord, WRITTEN_VERSIONS, bytes_hash,
};
pub use fitted::Fitted;
pub use history::{History, remember};
pub use interface::{
    ActionInterface, ActionLimiter, JOINT_TARGETS, JointTargets, interface_hash, stopping_velocity,
};
pub use layout::{Entry, Layout};
pub use limited::LimitedPolicy;
pub use policy::Policy;
pub use tensor_file::parse_tensors;
