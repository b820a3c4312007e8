//! The list of searches, by name.

use crate::{
    Coordinate, OptionSpec, Search, SearchError, SearchOptions, coordinate, dual_annealing, nelder_mead,
    random,
};

/// What the list knows about a search.
#[derive(Debug, Clone, Copy)]
pub struct SearchEntry {
    /// The name that users type.
    pub name: &'static str,
    /// A summary in one line.
    pub summary: &'static str,
    /// The publication that describes the method.
    pub reference: &'static str,
    /// Returns its options.
    pub options: fn() -> Vec<OptionSpec>,
    /// Makes the search.
    pub make: SearchConstructor,
}

/// Makes a search from the types of its coordinates, its seed and its options.
pub type SearchConstructor = fn(&[Coordinate], u64, &SearchOptions) -> Result<Box<dyn Search>, SearchError>;

/// All searches. To add one, write its file and add a line here.
pub const SEARCHES: &[SearchEntry] = &[
    random::ENTRY, //
    nelder_mead::ENTRY,
    dual_annealing::ENTRY,
];

/// Returns the entry of the search called `name`.
///
/// # Errors
/// [`SearchError::UnknownSearch`] with the known names.
pub fn find_search(name: &str) -> Result<&'static SearchEntry, SearchError> {
    SEARCHES.iter().find(|entry| entry.name == name).ok_or_else(|| SearchError::UnknownSearch {
        wanted: name.to_owned(),
        known: SEARCHES.iter().map(|entry| entry.name).collect(),
    })
}

/// Makes the search called `name` on `[0,1]^d`, with one coordinate type for each of the d coordinates.
///
/// # Errors
/// [`SearchError::UnknownSearch`] with the known names, [`SearchError::Dimension`] without coordinates,
/// [`SearchError::NoLevels`] for a coordinate with 0 levels, [`SearchError::UnknownOption`] and
/// [`SearchError::Option`] for options that the search does not accept.
///
/// # Example
/// ```
/// use mishandle_search::{Coordinate, SearchOptions, by_name};
/// let space = [Coordinate::Continuous, Coordinate::Continuous, Coordinate::Integer { levels: 4 }];
/// let search = by_name("random", &space, 0, &SearchOptions::default())?;
/// assert_eq!((search.name(), search.dimension()), ("random", 3));
///
/// let error = by_name("randon", &space, 0, &SearchOptions::default()).err().expect("misspelt");
/// assert!(error.to_string().ends_with("there are random, nelder-mead, dual-annealing"));
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
pub fn by_name(
    name: &str,
    coordinates: &[Coordinate],
    seed: u64,
    options: &SearchOptions,
) -> Result<Box<dyn Search>, SearchError> {
    let entry = find_search(name)?;
    coordinate::dimension(coordinates)?;
    (entry.make)(coordinates, seed, options)
}
