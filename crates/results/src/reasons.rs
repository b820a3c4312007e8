use serde::Serialize;

/// The simulations of a run with one end whose target, or its controller, said why.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EndReasons {
    /// The end, such as `crashed`, `timed out`, `invalid scenario` or `terminated`.
    pub end: String,
    /// Number of simulations with this end and a reason, those of corners and of the moves toward
    /// nominal included.
    pub simulations: u64,
    /// Trial of the first of them.
    pub trial: u32,
    /// Number of the first of them.
    pub simulation: u32,
    /// Reason of the first of them, in the words of the program: at most 4096 bytes, often with the
    /// end of its standard error.
    pub reason: String,
}

impl EndReasons {
    /// Returns the end in a word that is true whatever happened: an invalid answer of a program has
    /// the end `crashed`, too.
    pub fn word(&self) -> &str {
        if self.end == "crashed" { "failed" } else { &self.end }
    }
}
