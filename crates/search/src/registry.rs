//! The list of searches, by name.

use crate::{
    AskTell, DualAnnealing, DualAnnealingOptions, NelderMead, NelderMeadOptions, Random, Search, SearchError,
};

/// The options of every search; each reads its own part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SearchOptions {
    /// Those of `nelder-mead`.
    pub nelder_mead: NelderMeadOptions,
    /// Those of `dual-annealing`.
    pub dual_annealing: DualAnnealingOptions,
}

/// One line of the list of searches.
#[derive(Debug, Clone, Copy)]
pub struct SearchEntry {
    /// The name users type.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// Makes one.
    pub make: Make,
}

/// Makes a search from its dimension, its seed and the options.
pub type Make = fn(usize, u64, &SearchOptions) -> Result<Box<dyn Search>, SearchError>;

/// Every search there is; a further one is one more line.
pub const SEARCHES: &[SearchEntry] = &[
    SearchEntry {
        name: "random",
        summary: "independent uniform points",
        make: |dimension, seed, _| Ok(Box::new(Random::new(dimension, seed)?)),
    },
    SearchEntry {
        name: "nelder-mead",
        summary: "the simplex search of Nelder and Mead from one start, as in SciPy",
        make: |dimension, seed, options| {
            Ok(Box::new(AskTell::new(NelderMead::new(dimension, seed, &options.nelder_mead)?)))
        },
    },
    SearchEntry {
        name: "dual-annealing",
        summary: "simulated annealing with restarts and local search (L-BFGS-B), as in SciPy",
        make: |dimension, seed, options| {
            Ok(Box::new(AskTell::new(DualAnnealing::new(dimension, seed, &options.dual_annealing)?)))
        },
    },
];

/// Makes the search called `name` on `[0,1]^d` with d = `dimension`.
///
/// # Errors
/// [`SearchError::UnknownSearch`] with the names there are, or what the search's constructor refuses.
///
/// # Example
/// ```
/// use mishandle_search::{SearchOptions, by_name};
/// let search = by_name("random", 3, 0, &SearchOptions::default())?;
/// assert_eq!((search.name(), search.dimension()), ("random", 3));
///
/// let error = by_name("randon", 3, 0, &SearchOptions::default()).err().expect("misspelt");
/// assert!(error.to_string().ends_with("there are random, nelder-mead, dual-annealing"));
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
pub fn by_name(
    name: &str,
    dimension: usize,
    seed: u64,
    options: &SearchOptions,
) -> Result<Box<dyn Search>, SearchError> {
    let Some(entry) = SEARCHES.iter().find(|entry| entry.name == name) else {
        return Err(SearchError::UnknownSearch {
            wanted: name.to_owned(),
            known: SEARCHES.iter().map(|entry| entry.name).collect(),
        });
    };
    (entry.make)(dimension, seed, options)
}
