//! The kinds of faults and their parameters, as data.

use super::parameter::Parameter::{self, *};

/// The side of the controller on which a fault acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// On the observation, which the controller sees.
    Sensing,
    /// On the action, which the environment gets, or on the controller as a whole.
    Actuation,
}

/// Kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// No fault.
    None,
    /// The channel delivers nothing. The controller sees its [`Fill`].
    Dropout,
    /// The channel holds its last value.
    Freeze,
    /// The channel has a constant value.
    Stuck,
    /// An offset is added.
    Bias,
    /// An offset is added that grows linearly.
    Ramp,
    /// An offset is added that begins with its largest value and falls linearly.
    Spike,
    /// The channel has multiples of a step only.
    Quantization,
    /// Two channels are exchanged.
    Swap,
    /// Bursts of samples are lost at random. The controller sees their [`Fill`].
    BurstLoss,
    /// All actions have a part of their effect.
    AuthorityLoss,
    /// The channel holds its last command.
    Hold,
    /// Bursts of commands are lost at random, and the last one is held.
    CommandLoss,
    /// The channel has the opposite action.
    SignFlip,
    /// The channel has a part of its range.
    Saturation,
    /// Commands arrive late by whole control steps, at random.
    ClockJitter,
    /// The controller does not act, and its state does not change. Its last action is held.
    Pause,
}

/// Value that a controller sees instead of a lost sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// The last sample that was not lost.
    Last,
    /// Zero.
    Zero,
    /// NaN.
    NotANumber,
}

impl Fill {
    /// All fills with their names.
    pub const ALL: [(Fill, &'static str); 3] =
        [(Fill::Last, "last"), (Fill::Zero, "zero"), (Fill::NotANumber, "nan")];
}

/// Description of a kind of fault.
#[derive(Debug)]
pub struct Description {
    /// The kind.
    pub kind: FaultKind,
    /// Name in scenarios.
    pub name: &'static str,
    /// Parameters that have a meaning for it, besides onset and duration.
    pub parameters: &'static [Parameter],
    /// Whether it computes with the numbers of a channel instead of only moving them.
    pub needs_numbers: bool,
}

impl Description {
    /// Returns whether the fault decreases slowly after its duration.
    pub fn recovers(&self) -> bool {
        self.parameters.contains(&Recovery)
    }
}

const fn of(
    kind: FaultKind,
    name: &'static str,
    parameters: &'static [Parameter],
    needs_numbers: bool,
) -> Description {
    Description { kind, name, parameters, needs_numbers }
}

/// Kinds on the observation. The first is the nominal one.
const SENSING: &[Description] = &[
    of(FaultKind::None, "none", &[], false),
    of(FaultKind::Dropout, "dropout", &[Channel, Filling], false),
    of(FaultKind::Freeze, "freeze", &[Channel, Recovery], false),
    of(FaultKind::Stuck, "stuck", &[Channel, Recovery, Level], true),
    of(FaultKind::Bias, "bias", &[Channel, Recovery, Offset], true),
    of(FaultKind::Ramp, "ramp", &[Channel, Recovery, Offset], true),
    of(FaultKind::Spike, "spike", &[Channel, Offset], true),
    of(FaultKind::Quantization, "quantization", &[Channel, Recovery, Quantum], true),
    of(FaultKind::Swap, "swap", &[Channel, Partner], false),
    of(FaultKind::BurstLoss, "burst-loss", &[Channel, Filling, Probability, Burst], false),
];

/// Kinds on the action. The first is the nominal one.
const ACTUATION: &[Description] = &[
    of(FaultKind::None, "none", &[], false),
    of(FaultKind::AuthorityLoss, "authority-loss", &[Recovery, Loss], true),
    of(FaultKind::Hold, "stuck", &[Channel], false),
    of(FaultKind::CommandLoss, "command-loss", &[Probability, Burst], false),
    of(FaultKind::SignFlip, "sign-flip", &[Channel], true),
    of(FaultKind::Saturation, "saturation", &[Channel, Recovery, Limit], true),
    of(FaultKind::ClockJitter, "clock-jitter", &[Lateness], false),
    of(FaultKind::Pause, "pause", &[], false),
];

impl Side {
    /// Returns the kinds of faults of this side. The number of a kind in a scenario is its index.
    pub fn kinds(self) -> &'static [Description] {
        match self {
            Side::Sensing => SENSING,
            Side::Actuation => ACTUATION,
        }
    }
}
