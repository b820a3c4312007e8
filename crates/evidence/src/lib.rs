//! Folders of evidence: runs with the pages, hashes and files that others need to check them.
//!
//! - [`write()`](write()) makes such a folder from run files. `ssh-keygen -Y sign` signs its list of
//!   hashes with a [`Key`].
//! - [`verify`](verify()) checks a folder of others: signature, hashes, run files. Then it replays a
//!   random share of the simulations. It writes nothing, and starts no program but `ssh-keygen`.
//!
//! ```text
//! README.md           what the folder is, and how to verify it with and without this program
//! SHA256SUMS          hashes of all files but the signature, as `sha256sum -c` reads them
//! SHA256SUMS.sig      signature of SHA256SUMS, as `ssh-keygen -Y verify` reads it
//! manifest.json       program, plans, identities and sizes
//! runs/NAME.sqlite    the run files, byte for byte
//! pages/NAME.html     their reports
//! checks/NAME/        requirements that were checked: their file, the matrix, counterexamples
//! files/N/            what simulations need: target files, models, controllers
//! ```
//!
//! `SHA256SUMS` lists every other file, so its signature covers all of them.

mod checks;
mod closed;
mod error;
mod existing;
mod layout;
mod manifest;
mod page;
mod readme;
mod replays;
mod signature;
mod sums;
mod verify;
mod write;

pub use error::EvidenceError;
pub use layout::{SIGNATURE, SUMS};
pub use manifest::{Manifest, ManifestCheck, ManifestFile, ManifestRun};
pub use signature::{Key, NAMESPACE, Signers};
pub use verify::{Verification, random_seed, verify};
pub use write::{Collection, write};
