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
/// [`SearchError::UnknownSearch`] with the nearest name, or what the search's constructor refuses.
///
/// # Example
/// ```
/// use mishandle_search::{SearchOptions, by_name};
/// let search = by_name("random", 3, 0, &SearchOptions::default())?;
/// assert_eq!((search.name(), search.dimension()), ("random", 3));
///
/// let error = by_name("randon", 3, 0, &SearchOptions::default()).err().expect("misspelt");
/// assert!(error.to_string().ends_with("did you mean random?"));
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
pub fn by_name(
    name: &str,
    dimension: usize,
    seed: u64,
    options: &SearchOptions,
) -> Result<Box<dyn Search>, SearchError> {
    let Some(entry) = SEARCHES.iter().find(|entry| entry.name == name) else {
        let known: Vec<&'static str> = SEARCHES.iter().map(|entry| entry.name).collect();
        return Err(SearchError::UnknownSearch {
            wanted: name.to_owned(),
            nearest: nearest(name, &known),
            known,
        });
    };
    (entry.make)(dimension, seed, options)
}

/// The known name within a third of its letters of `wanted`, the closest first.
fn nearest(wanted: &str, known: &[&'static str]) -> Option<&'static str> {
    let wanted = wanted.to_lowercase().replace(['_', ' '], "-");
    let distances = known.iter().map(|name| (edit_distance(&wanted, name), *name));
    distances.filter(|(distance, name)| 3 * distance <= name.len()).min().map(|(_, name)| name)
}

/// The number of letters to insert, delete or replace to get from `a` to `b` (Levenshtein).
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.chars().count()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, to) in b.chars().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row.last().copied().unwrap_or(0)
}
