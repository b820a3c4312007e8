//! Results as documents, which have a version.

use serde::Serialize;

/// Version of the documents. Within a version, keys are only added.
pub const SCHEMA: u32 = 1;

/// A result as a document: with its version as the first key.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Versioned<'a, T> {
    schema: u32,
    #[serde(flatten)]
    result: &'a T,
}

impl<'a, T> Versioned<'a, T> {
    /// Adds the version to a result.
    pub fn new(result: &'a T) -> Versioned<'a, T> {
        Versioned { schema: SCHEMA, result }
    }
}
