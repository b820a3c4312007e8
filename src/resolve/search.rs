//! The search that a plan names, with its options.

use mishandle_falsification::coordinate;
use mishandle_rollout::Space;
use mishandle_search::{
    Coordinate, SEARCHES, Search, SearchEntry, SearchError, SearchOptions, SearchSpace, by_name, find_search,
};

use crate::error::MishandleError;
use crate::plan::FalsifyPlan;

/// Returns the search with the name `name` and its options.
///
/// # Errors
/// If the name is unknown; the message lists the known searches.
pub fn search_entry(name: &str) -> Result<&'static SearchEntry, MishandleError> {
    find_search(name).map_err(|_| MishandleError::UnknownName {
        kind: "search",
        name: name.to_string(),
        known: SEARCHES.iter().map(|entry| entry.name.to_string()).collect(),
    })
}

/// Returns the type of each coordinate of the search.
pub(crate) fn coordinates(space: &Space) -> Vec<Coordinate> {
    space.axes().iter().map(coordinate).collect()
}

/// Returns the options of the plan, completed by the defaults that depend on the plan.
fn search_options(falsify: &FalsifyPlan) -> SearchOptions {
    let mut options = falsify.options.clone();
    let specs = find_search(&falsify.search).map(|entry| (entry.options)()).unwrap_or_default();
    // As in SciPy, a maximum number of evaluations is then the only limit.
    if specs.iter().any(|spec| spec.name == "max-evaluations") && options.get("max-evaluations").is_none() {
        options.set("max-evaluations", falsify.budget);
    }
    options
}

/// Returns the function that makes a search of the plan from its seed.
pub(crate) fn new_search(
    falsify: &FalsifyPlan,
    space: impl Into<SearchSpace>,
) -> impl Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'static {
    let name = falsify.search.clone();
    let space = space.into();
    let options = search_options(falsify);
    move |seed| by_name(&name, &space, seed, &options)
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::Axis;

    use super::*;
    use crate::resolve::check_falsify;

    fn plane() -> Space {
        Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0), Axis::start("y", "m", 0.0, 1.0)]).unwrap()
    }

    #[test]
    fn the_budget_limits_evaluations_unless_the_plan_sets_a_limit() {
        let plan = |search: &str| FalsifyPlan { search: search.to_string(), ..FalsifyPlan::default() };
        assert_eq!(search_options(&plan("nelder-mead")), SearchOptions::new().with("max-evaluations", 300));
        let own = SearchOptions::new().with("max-evaluations", 7);
        assert_eq!(search_options(&FalsifyPlan { options: own.clone(), ..plan("nelder-mead") }), own);
        for search in ["random", "dual-annealing"] {
            assert!(search_options(&plan(search)).is_empty(), "{search}");
        }
    }

    #[test]
    fn an_option_of_another_search_is_an_error() {
        let options = SearchOptions::new().with("xatol", 1e-6);
        let plan = FalsifyPlan { search: "dual-annealing".to_string(), options, ..FalsifyPlan::default() };
        let error = check_falsify(&plan, &plane()).unwrap_err();
        assert!(error.to_string().contains("dual-annealing has no option `xatol`"), "{error}");
    }
}
