//! One SQLite file a run, a row a simulation, readable for years.
//!
//! A *run* is one campaign of falsification or one evaluation. Its file holds
//!
//! - the **header** ([`RunHeader`]): what was run, by which build, from which plan;
//! - the **trials** ([`TrialRecord`]): one seeded search each;
//! - the **simulations** ([`Simulation`]): a row each, written in a transaction as it ends;
//! - the **traces** ([`StoredTrace`]) of those simulations for which they were wanted.
//!
//! [`RunWriter`] writes (one per file), [`RunFile`] reads (any number, also while the run goes on).
//!
//! # What can be relied on
//! - A number comes back with the same bits: ±infinity, −0.0 and seeds above 2⁶³ included.
//! - A process that is killed loses at most the transaction in flight.
//! - Every row carries a hash of itself, and one of its trace: a changed byte in them is found out
//!   ([`StoreError::Damaged`]) whenever they are read, never shown as a result. That rows are missing is
//!   found out by [`RunFile::check`].
//! - At rest a run is a single file, which can be copied and read from a read-only folder. While it is
//!   written, and after a kill, three more files stand beside it (`-wal`, `-shm`, `.lock`) and belong to it.
//! - The folder of a run that is being written has to be on a disk of the machine itself, not on a network:
//!   SQLite's log needs memory that its readers and its writer share.
//! - The same records in give the same content out, [`RunFile::content_digest`]. The bytes of two SQLite
//!   files are not to be compared: they depend on the order and the size of the transactions.
//! - A file of an older format is upgraded in place when it is opened; one of a newer format is refused.
//! - A file contains the tables and views that this program creates and nothing else. A file with other views or
//!   triggers, which SQL statements could run into, is refused as damaged.
//!
//! People read the file with plain `sqlite3`: `docs/run_file.md` lists its tables, views and columns.
//!
//! # Example
//! ```
//! use mishandle_store::{AxisRecord, BuildRecord, ComponentRecord, SimulationEnd, IfExists, RunFile, RunHeader, RunKind, RunWriter};
//! use mishandle_store::{SignalRecord, Simulation, TargetRecord, TrialStatus};
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

mod csv;
mod digest;
mod error;
mod header;
mod header_table;
mod json;
mod record;
mod row;
mod run_file;
mod run_writer;
mod schema;
mod trace_blob;
mod upgrade;

pub use csv::{export_csv, export_trace_csv};
pub use error::StoreError;
pub use header::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, RunHeader, RunKind, SignalRecord, TargetRecord,
};
pub use record::{Counts, Simulation, SimulationEnd, TrialRecord, TrialStatus, TrialSummary};
pub use run_file::{RunFile, Simulations};
pub use run_writer::{IfExists, RunWriter};
pub use schema::FORMAT_VERSION;
pub use trace_blob::{StoredTrace, trace_digest};

/// A result of this crate.
pub type Result<T, E = StoreError> = std::result::Result<T, E>;
