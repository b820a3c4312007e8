//! The list of searches, by name.

use crate::free::{FreeSearch, is_free};
use crate::{
    OptionSpec, Search, SearchError, SearchOptions, SearchSpace, bayesian, coordinate, dual_annealing,
    nelder_mead, portfolio, random, turbo,
};
use crate::{cma_es, corners, cross_entropy, differential_evolution, direct, line, sobol};

/// An entry of [`SEARCHES`].
#[derive(Debug, Clone, Copy)]
pub struct SearchEntry {
    /// The name of the search.
    pub name: &'static str,
    /// A one-line description.
    pub summary: &'static str,
    /// The publication that describes the method.
    pub reference: &'static str,
    /// Returns its options.
    pub options: fn() -> Vec<OptionSpec>,
    /// Creates the search.
    pub make: SearchConstructor,
}

/// A function that creates a search from its space, its random seed and its options.
pub type SearchConstructor = fn(&SearchSpace, u64, &SearchOptions) -> Result<Box<dyn Search>, SearchError>;

/// All searches. To add one, write its file and add a line here.
pub const SEARCHES: &[SearchEntry] = &[
    random::ENTRY, //
    nelder_mead::ENTRY,
    dual_annealing::ENTRY,
    sobol::ENTRY,
    corners::ENTRY,
    line::ENTRY,
    cross_entropy::ENTRY,
    differential_evolution::ENTRY,
    direct::ENTRY,
    cma_es::ENTRY,
    bayesian::ENTRY,
    turbo::ENTRY,
    portfolio::ENTRY,
];

/// Returns the entry of the search with this name.
///
/// # Errors
/// [`SearchError::UnknownSearch`] with the known names.
pub fn find_search(name: &str) -> Result<&'static SearchEntry, SearchError> {
    SEARCHES.iter().find(|entry| entry.name == name).ok_or_else(|| SearchError::UnknownSearch {
        name: name.to_owned(),
        known: SEARCHES.iter().map(|entry| entry.name).collect(),
    })
}

/// Creates the search called `name` on `[0,1]^d`, given the type of each of the d coordinates, or
/// more facts about the space. A coordinate with one level is 0.5 in each point; the search and its
/// options have the other coordinates only.
///
/// # Errors
/// [`SearchError::UnknownSearch`] with the known names, [`SearchError::Dimension`] without
/// coordinates, [`SearchError::NoLevels`] for a coordinate with 0 levels,
/// [`SearchError::UnknownOption`] and [`SearchError::Option`] for options that the search does not
/// accept.
///
/// # Example
/// ```
/// use mishandle_search::{Coordinate, SearchOptions, by_name};
/// let space = [Coordinate::Continuous, Coordinate::Continuous, Coordinate::Integer { levels: 4 }];
/// let search = by_name("random", &space, 0, &SearchOptions::default())?;
/// assert_eq!((search.name(), search.dimension()), ("random", 3));
///
/// let error = by_name("randon", &space, 0, &SearchOptions::default()).err().expect("misspelled");
/// assert!(error.to_string().contains("known searches: random, nelder-mead, dual-annealing"));
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
pub fn by_name(
    name: &str,
    space: impl Into<SearchSpace>,
    seed: u64,
    options: &SearchOptions,
) -> Result<Box<dyn Search>, SearchError> {
    let entry = find_search(name)?;
    let space = space.into();
    let all = space.dimension()?;
    let free = space.only(is_free);
    if free.coordinates.len() == all {
        return (entry.make)(&space, seed, options);
    }
    coordinate::check_dimension(free.coordinates.len())?;
    let inner = (entry.make)(&free, seed, &options.projected(&space.coordinates))?;
    Ok(Box::new(FreeSearch::new(inner, &space.coordinates)))
}
