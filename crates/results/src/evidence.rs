use serde::Serialize;

use crate::Seed;

/// A folder of evidence that was written: runs with their pages and files, hashes of all, and a
/// signature.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Evidence {
    /// Path of the folder.
    pub folder: String,
    /// The key that signed it; `null` without a signature.
    pub signer: Option<EvidenceSigner>,
    /// Number of files, without the list of hashes and the signature.
    pub files: u64,
    /// Their size, in bytes.
    pub bytes: u64,
    /// The runs, in the order in which they were given.
    pub runs: Vec<EvidenceRun>,
    /// The checks of requirements, whose runs are among them.
    pub checks: Vec<EvidenceCheck>,
}

/// A check of requirements in a folder of evidence.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EvidenceCheck {
    /// Folder of its requirements, matrix and counterexamples in the folder.
    pub folder: String,
    /// Its verdicts, counted in a sentence.
    pub verdicts: String,
}

/// A run of a folder of evidence.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EvidenceRun {
    /// Run file in the folder.
    pub file: String,
    /// Page in the folder.
    pub page: String,
    /// Folder with the files of its target and its controllers, in the folder; `null` if it needs
    /// none.
    pub files: Option<String>,
    /// Name of the target.
    pub target: String,
    /// Number of simulations.
    pub simulations: u64,
    /// Whether the run is finished.
    pub is_complete: bool,
    /// Why its simulations cannot be replayed from the folder alone; `null` if they can.
    pub not_replayable: Option<String>,
}

/// The key of a signature.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EvidenceSigner {
    /// Algorithm of the key as `ssh-keygen -l` prints it, such as `ED25519`.
    pub algorithm: String,
    /// Fingerprint as `ssh-keygen -l` prints it, such as `SHA256:...`.
    pub fingerprint: String,
    /// Names of this key in the file of `--allowed-signers`: in its first line with the key.
    pub principals: Vec<String>,
}

/// A folder of evidence, verified. The document is printed also if the folder differs (exit code
/// 1).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EvidenceVerification {
    /// Path of the folder.
    pub folder: String,
    /// `trusted`: the key of the signature is that of `--public-key` or one of `--allowed-signers`;
    /// `valid`: the signature fits, but nothing vouches for the key; `missing`; `wrong`: it does
    /// not fit the hashes, or its key is not allowed; `unchecked`: `ssh-keygen`, which checks
    /// signatures, is missing or does not answer.
    pub signature: String,
    /// The key of the signature; `null` without one that fits.
    pub signer: Option<EvidenceSigner>,
    /// Number of files whose hashes were compared.
    pub files: u64,
    /// Everything wrong with signature, files, manifest, pages and run files; empty if nothing is.
    pub problems: Vec<String>,
    /// Everything that cannot be verified although nothing differs: simulations that cannot be
    /// replayed, runs that are not finished or empty, pages of another build, counterexamples
    /// without a replay, a signature without `ssh-keygen`; empty if there is nothing.
    pub unverified: Vec<String>,
    /// Whether README and pages were made again and compared; `false` if another build made them,
    /// or the files of a run are not its own.
    pub pages_compared: bool,
    /// Commit of this program.
    pub program: String,
    /// Share of the simulations that were to be replayed, at least one of each run.
    pub share: f64,
    /// Seed that chose the simulations.
    pub seed: Seed,
    /// The runs; empty if a file differs, because then no run is opened.
    pub runs: Vec<VerifiedRun>,
    /// The checks of requirements: their verdicts follow from the runs, or a problem says that they
    /// do not.
    pub checks: Vec<VerifiedCheck>,
    /// Whether all is as it should be: no problem, nothing unverified, no replay that differs, and
    /// no interruption.
    pub is_verified: bool,
    /// Whether the verification came to its end; `false` after an interruption.
    pub is_complete: bool,
}

/// A run of a folder of evidence, verified.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VerifiedRun {
    /// Run file in the folder.
    pub file: String,
    /// Number of simulations.
    pub simulations: u64,
    /// Number of simulations that the seed chose. Those that a time limit ended are not replayed.
    pub chosen: u64,
    /// The simulations that were replayed.
    pub replayed: Vec<ReplayedSimulation>,
    /// Why none could be replayed; `null` if some were, or none was to be.
    pub not_replayed: Option<String>,
    /// Differences between the build that made the run and this program. Results can differ between
    /// builds.
    pub build_differences: Vec<String>,
}

/// A check of requirements, verified.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VerifiedCheck {
    /// Its folder in the folder of evidence.
    pub folder: String,
    /// Number of verdicts that were derived from the runs again.
    pub verdicts: u64,
    /// Number of counterexamples that were replayed.
    pub replayed: u64,
}

/// A simulation that was replayed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ReplayedSimulation {
    /// Its trial.
    pub trial: u32,
    /// Its number in the trial.
    pub simulation: u32,
    /// Differences between record, plan and replay; empty if they agree to the bit.
    pub differences: Vec<String>,
}
