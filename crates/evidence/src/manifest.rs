//! `manifest.json`: what the folder holds, and which program made it.

use mishandle::Plan;
use mishandle::build::build;
use mishandle::inspect::run_facts;
use mishandle::portable::portable_plan;
use mishandle::run::requirements;
use mishandle::store::{BuildRecord, ComponentRecord, RunFile};
use serde::{Deserialize, Serialize};

use crate::error::EvidenceError;

/// Version of the format.
pub const FORMAT: u32 = 2;

/// Largest size of a manifest, in bytes.
pub const MAX_SIZE: u64 = 64 << 20;

/// The version of the format of a manifest, whatever else it has.
#[derive(Debug, Deserialize)]
pub(crate) struct Format {
    pub evidence_format: u32,
}

/// The manifest. Everything in it follows from the runs, the files and the program that made it. It
/// contains no time and no path of the machine, so that the same runs give the same bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the format: 2.
    pub evidence_format: u32,
    /// The program that made the folder.
    pub program: Program,
    /// Version of its physics engine.
    pub mujoco: String,
    /// The runs.
    pub runs: Vec<ManifestRun>,
    /// The checks of requirements, whose runs are among them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub checks: Vec<ManifestCheck>,
    /// All files but the manifest, the list of hashes and the signature.
    pub files: Vec<ManifestFile>,
}

/// A build of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Program {
    /// Version.
    pub version: String,
    /// Git commit.
    pub commit: String,
    /// Target triple.
    pub target: String,
    /// Version of the compiler.
    pub rustc: String,
    /// Architecture and instruction set.
    pub architecture: String,
}

/// A run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestRun {
    /// Run file.
    pub file: String,
    /// Page.
    pub page: String,
    /// Folder with the files of its target; `null` if it needs none.
    pub files: Option<String>,
    /// Kind of the run.
    pub kind: String,
    /// Kind, name and hash of the target.
    pub target: [String; 3],
    /// The parts of the target: role, name, hash, hash of the file.
    pub components: Vec<[String; 4]>,
    /// The requirement.
    pub formula: String,
    /// Names and formulas of the requirements with a verdict of their own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub requirements: Vec<[String; 2]>,
    /// Number of simulations.
    pub simulations: u64,
    /// Number of these that violate the requirement.
    pub failures: u64,
    /// Whether the run is finished.
    pub is_complete: bool,
    /// Digest of all rows and traces.
    pub content_digest: String,
    /// The program that made the run.
    pub program: Program,
    /// Versions of other software on which its simulations depend, such as Python packages.
    pub versions: Vec<[String; 2]>,
    /// The plan as TOML; files have their names instead of their paths.
    pub plan: String,
    /// Why its simulations cannot be replayed from the folder alone; `null` if they can.
    pub not_replayable: Option<String>,
}

/// A check of requirements.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestCheck {
    /// Folder of its requirements and reports.
    pub folder: String,
    /// Name of the target.
    pub target: String,
    /// Its verdicts, counted.
    pub verdicts: String,
    /// Its run files.
    pub runs: Vec<String>,
    /// Its counterexamples.
    pub counterexamples: Vec<String>,
}

/// A file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestFile {
    /// Its name in the folder.
    pub path: String,
    /// Size in bytes.
    pub size: u64,
    /// SHA-256.
    pub sha256: String,
}

impl Manifest {
    /// Describes this program.
    pub(crate) fn new(runs: Vec<ManifestRun>, checks: Vec<ManifestCheck>) -> Manifest {
        Manifest {
            evidence_format: FORMAT,
            program: Program::from(&build()),
            mujoco: mishandle::world::mujoco_version(),
            runs,
            checks,
            files: Vec::new(),
        }
    }

    /// Returns whether this program made the folder, so that it would write the same pages.
    pub(crate) fn is_of_this_build(&self) -> bool {
        self.program == Program::from(&build()) && self.mujoco == mishandle::world::mujoco_version()
    }
}

impl ManifestRun {
    /// Lists the facts that differ from those of the run file.
    pub(crate) fn differences(
        &self,
        run: &RunFile,
        is_of_this_build: bool,
    ) -> Result<Vec<&'static str>, EvidenceError> {
        let again = ManifestRun::new(
            run,
            [self.file.clone(), self.page.clone()],
            self.files.clone(),
            self.not_replayable.clone(),
        )?;
        // Another version of the program can write the same plan in other words, or not read it.
        let is_same_plan = again.plan == self.plan
            || (!is_of_this_build
                && match Plan::from_toml(&self.plan) {
                    Ok(plan) => plan == portable_plan(run.header())?,
                    Err(_) => again.program != Program::from(&build()),
                });
        let facts = [
            ("kind", again.kind == self.kind),
            ("target", again.target == self.target),
            ("components", again.components == self.components),
            ("formula", again.formula == self.formula),
            ("requirements", again.requirements == self.requirements),
            ("simulations", again.simulations == self.simulations),
            ("failures", again.failures == self.failures),
            ("is_complete", again.is_complete == self.is_complete),
            ("content_digest", again.content_digest == self.content_digest),
            ("program", again.program == self.program),
            ("versions", again.versions == self.versions),
            ("plan", is_same_plan),
        ];
        Ok(facts.into_iter().filter(|(_, is_same)| !is_same).map(|(name, _)| name).collect())
    }

    /// Describes a run. `name` is that of its files in the folder.
    pub(crate) fn new(
        run: &RunFile,
        [file, page]: [String; 2],
        files: Option<String>,
        not_replayable: Option<String>,
    ) -> Result<ManifestRun, EvidenceError> {
        let header = run.header();
        let facts = run_facts(run)?;
        let requirements = requirements(run)?.unwrap_or_default();
        let component = |part: &ComponentRecord| {
            [part.role.clone(), file_name(&part.name), part.hash.clone(), part.file_hash.clone()]
        };
        Ok(ManifestRun {
            file,
            page,
            files,
            kind: facts.kind,
            target: [header.target.kind.clone(), header.target.name.clone(), header.target.hash.clone()],
            components: header.components.iter().map(component).collect(),
            formula: header.formula.clone(),
            requirements: requirements.into_iter().map(|found| [found.name, found.formula]).collect(),
            simulations: facts.simulations,
            failures: facts.failures,
            is_complete: facts.is_complete,
            content_digest: digest(run)?,
            program: Program::from(&header.build),
            versions: header.versions.iter().map(|(name, version)| [name.clone(), version.clone()]).collect(),
            plan: portable_plan(header)?.to_toml(),
            not_replayable,
        })
    }
}

/// Returns the digest of the rows of a run.
pub(crate) fn digest(run: &RunFile) -> Result<String, EvidenceError> {
    Ok(format!("{:032x}", run.content_digest()?))
}

/// Returns the last part of a path, and any other name as it is.
pub(crate) fn file_name(name: &str) -> String {
    let path = std::path::Path::new(name);
    if path.is_absolute() {
        path.file_name().map_or_else(|| name.to_string(), |name| name.to_string_lossy().into_owned())
    } else {
        name.to_string()
    }
}

impl From<&BuildRecord> for Program {
    fn from(build: &BuildRecord) -> Program {
        Program {
            version: build.program_version.clone(),
            commit: build.git_commit.clone(),
            target: build.target.clone(),
            rustc: build.rustc.clone(),
            architecture: build.architecture.clone(),
        }
    }
}
