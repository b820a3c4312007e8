//! Stores runs: one SQLite file per run, one row per simulation.
//!
//! A *run* is one falsification campaign or one evaluation. Its file contains
//!
//! - the **header** ([`RunHeader`]): plan, target, scenario space and build;
//! - the **trials** ([`TrialRecord`]): seeded searches;
//! - the **simulations** ([`Simulation`]): one row each, committed when the simulation ends;
//! - the **traces** ([`StoredTrace`]) of selected simulations, such as counterexamples.
//!
//! [`RunWriter`] writes a run; a file has at most one writer. [`RunFile`] reads a run; there can be
//! any number of readers, also while the run is being written.
//!
//! # Guarantees
//! - Numbers are read back with the same bits, including ±infinity, −0.0 and seeds above 2⁶³.
//! - A killed process loses at most its current transaction.
//! - Every row contains a hash of itself and of its trace. Opening a run compares all of them;
//!   reading a row whose bytes were changed fails with [`StoreError::Damaged`]. The hashes contain
//!   no secret: they detect accidental damage, not forgery, and not missing rows.
//! - A run has one writer at a time, also during its creation. A process without the lock never
//!   creates, changes or removes the file.
//! - A closed run is a single file, which can be copied, and read from a read-only folder. Until
//!   the run is closed, and after a kill, the files ending in `-wal`, `-shm` and `.lock` beside it
//!   belong to it.
//! - The folder of a run that is being written must be on a local disk, because SQLite's
//!   write-ahead log needs memory shared by readers and writer.
//! - The same records give the same [`RunFile::content_digest`]. The bytes of two SQLite files can
//!   differ, because they depend on the order and size of the transactions.
//! - A file of another format version is an error that names both versions.
//! - A file contains the tables and views that this program creates and nothing else. A file with
//!   other views or triggers, which could change the meaning of SQL statements, is reported as
//!   damaged. Sizes of values and times of statements are limited.
//!
//! The file can be read with plain `sqlite3`: `docs/reference/run_file.md` lists its tables, views
//! and columns.
//!
//! # Example
//! ```
//! use mishandle_store::{AxisRecord, BuildRecord, ComponentRecord, SignalRecord, TargetRecord};
//! use mishandle_store::{IfExists, RunFile, RunHeader, RunKind, RunWriter, Simulation, SimulationEnd, TrialStatus};
//!
//! # fn main() -> Result<(), mishandle_store::StoreError> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("run.sqlite");
//! let header = RunHeader {
//!     kind: RunKind::Falsify,
//!     build: BuildRecord { program_version: "0.1.0".into(), ..BuildRecord::default() },
//!     versions: vec![("MuJoCo".into(), "3.17.0".into())],
//!     plan: "budget = 300\n".into(),
//!     target: TargetRecord {
//!         kind: "task".into(),
//!         name: "point-reaching".into(),
//!         hash: "41d0".into(),
//!         is_deterministic: true,
//!     },
//!     components: vec![ComponentRecord {
//!         role: "controller".into(),
//!         name: "ppo".into(),
//!         hash: "9f2c".into(),
//!         file_hash: "07aa".into(),
//!     }],
//!     space: "starts".into(),
//!     formula: "always[50:300](finger_target_distance <= 0.12)".into(),
//!     formulas: vec![],
//!     search: "random".into(),
//!     seed: 7,
//!     control_dt: 1.0 / 60.0,
//!     episode_steps: 300,
//!     signals: vec![SignalRecord { name: "finger_target_distance".into(), unit: "m".into() }],
//!     axes: vec![AxisRecord {
//!         name: "target_x".into(),
//!         unit: "m".into(),
//!         kind: "start".into(),
//!         low: 0.3,
//!         high: 0.7,
//!         nominal: Some(0.5),
//!         values: "continuous".into(),
//!         meaning: "distance of the target in front of the robot".into(),
//!     }],
//!     verdicts: vec!["strict_robustness".into()],
//!     preflight: vec![],
//! };
//! let mut writer = RunWriter::create(&path, &header, IfExists::Refuse)?;
//! writer.start_trial(1, 11)?;
//! writer.record(&[Simulation {
//!     trial: 1,
//!     number: 1,
//!     seed: u64::MAX,
//!     unit_point: vec![0.5],
//!     scenario: vec![Some(0.5)],
//!     robustness: Some(-0.01),
//!     robustness_low: Some(-0.01),
//!     robustness_high: Some(-0.01),
//!     stop_threshold: None,
//!     end: SimulationEnd::Completed,
//!     steps: 300,
//!     verdicts: vec![None],
//!     reason: String::new(),
//!     trace_digest: None,
//!     trace: None,
//! }])?;
//! writer.end_trial(1, TrialStatus::Falsified)?;
//! writer.close()?;
//!
//! let run = RunFile::open(&path)?;
//! assert_eq!(run.header(), &header);
//! assert_eq!(run.simulation(1, 1)?.seed, u64::MAX);
//! assert_eq!(run.counts()?.falsified, 1);
//! # Ok(())
//! # }
//! ```

mod columns;
mod csv;
mod database;
mod digest;
mod error;
mod finding;
mod header;
mod header_table;
mod json;
mod memory;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(not(feature = "parquet"))]
mod parquet {
    //! The export of a build without the feature `parquet`.

    use std::io::Write;

    use crate::{Result, RunFile, StoreError};

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// [`NoParquet`](StoreError::NoParquet), always.
    pub fn export_parquet(_run: &RunFile, _writer: &mut (impl Write + Send)) -> Result<()> {
        Err(StoreError::NoParquet)
    }
}
mod reason;
mod record;
mod row;
mod run_file;
mod run_writer;
mod schema;
mod screened;
mod trace_blob;
mod version;

pub use csv::{TraceColumn, export_csv, export_trace_csv};
pub use error::StoreError;
pub use finding::Finding;
pub use header::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, RunHeader, RunKind, SignalRecord, TargetRecord,
};
pub use parquet::export_parquet;
pub use reason::EndReasons;
pub use record::{Counts, Simulation, SimulationEnd, TrialRecord, TrialStatus, TrialSummary};
pub use run_file::{MAX_TRIALS, RANDOM_TRIAL, RunFile, Simulations};
pub use run_writer::{IfExists, RunWriter};
pub use screened::{ScreenedChunk, requests_digest};
pub use trace_blob::{StoredTrace, trace_digest};
pub use version::FORMAT_VERSION;

/// A result of this crate.
pub type Result<T, E = StoreError> = std::result::Result<T, E>;
