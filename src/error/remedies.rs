//! Remedies of errors of the crates that know no settings of a plan.

use mishandle_controllers::{ControllerError, FileProblem};
use mishandle_interchange::{ACTIVATIONS, InterchangeError, PolicyPart, TorchProblem};
use mishandle_results::{Choice, Command, Key, Remedy};

use super::MishandleError;

impl MishandleError {
    /// Returns what helps.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            MishandleError::OfRequirement { source, .. }
            | MishandleError::CampaignRun { source, .. }
            | MishandleError::Fallback { source, .. } => source.remedies(),
            MishandleError::Interchange(InterchangeError::Torch { problem, .. }) => of_checkpoint(problem),
            MishandleError::Controller(ControllerError::File { problem: FileProblem::Archive, .. }) => {
                vec![Remedy::Run(Command::Import)]
            }
            _ => Vec::new(),
        }
    }
}

fn of_checkpoint(problem: &TorchProblem) -> Vec<Remedy> {
    match problem {
        TorchProblem::Unknown { what, .. } => state(*what),
        TorchProblem::Preprocessor => state(PolicyPart::Normalizer),
        TorchProblem::Contradiction { what, .. } => vec![Remedy::Unset(key(*what))],
        _ => Vec::new(),
    }
}

fn key(part: PolicyPart) -> Key {
    match part {
        PolicyPart::HiddenActivation => Key::ACTIVATION,
        PolicyPart::OutputActivation => Key::OUTPUT_ACTIVATION,
        PolicyPart::Normalizer => Key::NORMALIZER,
    }
}

/// Returns the remedies to state a part of a policy.
fn state(part: PolicyPart) -> Vec<Remedy> {
    let key = key(part);
    match part {
        PolicyPart::Normalizer => {
            let none = Remedy::set(key, Choice::Text("none".to_owned()));
            vec![Remedy::set(key, Choice::FILE), none.when("observations were not normalized")]
        }
        PolicyPart::HiddenActivation | PolicyPart::OutputActivation => {
            vec![Remedy::set(key, Choice::OneOf(ACTIVATIONS))]
        }
    }
}
