//! Properties of every listed search and of the local search L-BFGS-B.

use mishandle_search::functions::{self, FUNCTIONS};
use mishandle_search::{
    AskTell, Coordinate, Lbfgsb, LbfgsbOptions, Observation, OptionType, OptionValue, Random, SEARCHES,
    Search, SearchEnd, SearchError, SearchOptions, by_name,
};

fn continuous(d: usize) -> Vec<Coordinate> {
    vec![Coordinate::Continuous; d]
}

fn make(name: &str, d: usize, seed: u64) -> Box<dyn Search> {
    if name == "l-bfgs-b" {
        let start = Random::new(d, seed).expect("d is at least 1").point(0);
        let machine = Lbfgsb::new(&start, &LbfgsbOptions::default()).expect("a start in the box");
        return Box::new(AskTell::new(machine));
    }
    by_name(name, &continuous(d), seed, &SearchOptions::default()).expect("a listed name")
}

/// Searches whose points do not depend on values, so that they never wait for one.
const NEVER_WAIT: [&str; 3] = ["random", "sobol", "corners"];

fn names() -> impl Iterator<Item = &'static str> {
    SEARCHES.iter().map(|entry| entry.name).chain(["l-bfgs-b"])
}

/// The searches that fit a Gaussian process, which take about a millisecond per evaluation. Tests
/// of many evaluations use fewer for them.
const MODEL_BASED: [&str; 3] = ["bayesian", "turbo", "portfolio"];

/// Returns a function with a slope, steps, ties and infinite values.
fn rough(u: &[f64]) -> f64 {
    let value = functions::min_max(u) + 0.1 * u[0];
    if u[0] + u[u.len() - 1] > 1.7 { f64::INFINITY } else { value }
}

/// Returns the points and values of at most `budget` evaluations in batches of `batch`.
fn trace(search: &mut dyn Search, f: fn(&[f64]) -> f64, budget: usize, batch: usize) -> Vec<(Vec<f64>, f64)> {
    let mut trace = Vec::new();
    while trace.len() < budget {
        let points = search.ask_batch(batch.min(budget - trace.len()));
        if points.is_empty() {
            assert!(
                search.finished().is_some(),
                "{} proposes nothing although no point is pending",
                search.name()
            );
            break;
        }
        for u in points {
            let value = f(&u);
            search.tell(&u, &value.into()).expect("a pending point");
            trace.push((u, value));
        }
    }
    trace
}

#[test]
fn listed_searches_have_distinct_names() {
    let listed: Vec<&str> = SEARCHES.iter().map(|entry| entry.name).collect();
    assert_eq!(
        listed,
        [
            "random",
            "nelder-mead",
            "dual-annealing",
            "sobol",
            "corners",
            "line",
            "cross-entropy",
            "differential-evolution",
            "direct",
            "cma-es",
            "bayesian",
            "turbo",
            "portfolio"
        ]
    );
    for entry in SEARCHES {
        let search = make(entry.name, 3, 1);
        assert_eq!((search.name(), search.dimension()), (entry.name, 3));
        assert!(search.finished().is_none() && search.best().is_none());
        assert!(!entry.summary.is_empty());
    }
}

#[test]
fn every_point_is_in_the_unit_cube() {
    for name in names() {
        let budget = if MODEL_BASED.contains(&name) { 150 } else { 600 };
        for d in 1..=5 {
            for f in [rough as fn(&[f64]) -> f64, functions::sphere, |_| 1.0, |_| f64::INFINITY, |u| -u[0]] {
                let points = trace(&mut *make(name, d, d as u64), f, budget, 7);
                assert!(!points.is_empty());
                for (u, _) in points {
                    let inside = u.len() == d && u.iter().all(|x| (0.0..=1.0).contains(x));
                    assert!(inside, "{name} proposes {u:?} for d = {d}");
                }
            }
        }
    }
}

#[test]
fn equal_seeds_give_equal_points_and_different_seeds_different_ones() {
    for name in names() {
        let points = |seed| trace(&mut *make(name, 3, seed), rough, 300, 1);
        assert_eq!(points(5), points(5), "{name}");
        // DIRECT uses no random numbers.
        assert_eq!(points(5) == points(6), name == "direct", "{name}");
    }
}

#[test]
fn batch_sizes_do_not_change_the_points() {
    for name in names() {
        let one_by_one = trace(&mut *make(name, 3, 2), rough, 300, 1);
        for batch in [2, 5, 64] {
            assert_eq!(trace(&mut *make(name, 3, 2), rough, 300, batch), one_by_one, "{name} by {batch}");
        }
    }
}

/// A new search that replays the recorded values continues like the original, after any number of
/// evaluations.
#[test]
fn replaying_the_values_resumes_the_search() {
    for name in names() {
        let whole = trace(&mut *make(name, 2, 9), rough, 120, 1);
        for stop in 0..whole.len() {
            let mut resumed = make(name, 2, 9);
            for (u, value) in &whole[..stop] {
                assert_eq!(resumed.ask().as_ref(), Some(u), "{name} stopped at {stop}");
                resumed.tell(u, &(*value).into()).expect("a pending point");
            }
            assert_eq!(resumed.ask().as_ref(), Some(&whole[stop].0), "{name} stopped at {stop}");
        }
    }
}

#[test]
fn best_is_the_earliest_point_with_the_lowest_value() {
    for name in names() {
        let mut search = make(name, 2, 4);
        let evaluated = trace(&mut *search, rough, 200, 3);
        let lowest = evaluated.iter().map(|(_, value)| *value).fold(f64::INFINITY, f64::min);
        let (u, _) = evaluated.iter().find(|(_, value)| *value == lowest).expect("values");
        assert_eq!(search.best(), Some((u.as_slice(), lowest)), "{name}");
    }
}

/// The caller may stop with pending points at any time. A search proposes nothing while the next
/// point depends on pending values.
#[test]
fn pending_points_never_block_the_caller() {
    for name in names() {
        let mut search = make(name, 2, 1);
        let first = search.ask_batch(1000);
        assert!(!first.is_empty());
        assert!(search.finished().is_none());
        if !NEVER_WAIT.contains(&name) {
            assert!(search.ask_batch(1000).is_empty(), "{name} has no values yet");
        }
        for u in &first[..first.len() - 1] {
            search.tell(u, &1.0.into()).expect("a pending point");
        }
        assert!(search.best().is_some() || first.len() == 1);
    }
}

#[test]
fn wrong_observations_are_errors_and_change_nothing() {
    for name in names() {
        let mut search = make(name, 2, 3);
        let point = vec![0.1234, 0.5678];
        assert_eq!(
            search.tell(&point, &1.0.into()),
            Err(SearchError::NotAsked { point: point.clone() }),
            "{name}"
        );
        let asked = search.ask().expect("a first point");
        let wrong = SearchError::WrongPoint { point: point.clone(), expected: asked.clone() };
        assert_eq!(search.tell(&point, &1.0.into()), Err(wrong), "{name}");
        assert!(search.tell(&asked[..1], &1.0.into()).is_err(), "{name}");
        assert_eq!(
            search.tell(&asked, &f64::NAN.into()),
            Err(SearchError::NotANumber { point: asked.clone() }),
            "{name}"
        );
        assert!(search.best().is_none());
        assert_eq!(search.tell(&asked, &f64::INFINITY.into()), Ok(()), "{name}");
        assert_eq!(
            search.tell(&asked, &1.0.into()),
            Err(SearchError::NotAsked { point: asked.clone() }),
            "{name}"
        );
        assert!(search.ask_batch(0).is_empty());
    }
}

#[test]
fn a_point_of_random_depends_only_on_seed_and_number() {
    let mut search = Random::new(3, 11).expect("d is at least 1");
    let points = search.ask_batch(20);
    for (i, u) in points.iter().enumerate().rev() {
        assert_eq!(search.point(i as u64), *u);
    }
    assert_eq!(Random::new(2, 11).expect("d is at least 1").point(7), points[7][..2]);
}

#[test]
fn unknown_names_and_invalid_options_are_reported_with_the_allowed_values() {
    let message_of =
        |name: &str, d: usize, options: &SearchOptions| match by_name(name, &continuous(d), 0, options) {
            Ok(_) => panic!("{name} in {d} dimensions was created"),
            Err(error) => error.to_string(),
        };
    let defaults = SearchOptions::default();
    let all: Vec<&str> = SEARCHES.iter().map(|entry| entry.name).collect();
    assert_eq!(
        message_of("Nelder_Mead", 2, &defaults),
        format!("search `Nelder_Mead` is not known; known searches: {}", all.join(", "))
    );
    for entry in SEARCHES {
        let message = message_of(entry.name, 0, &defaults);
        assert_eq!(message, "the dimension of the search is 0; it must be at least 1");
    }
    let nan = f64::NAN;
    let cases: [(&str, &str, OptionValue); 32] = [
        ("nelder-mead", "start", vec![0.5].into()),
        ("nelder-mead", "start", vec![0.5, 1.5].into()),
        ("nelder-mead", "initial-simplex", vec![vec![0.5; 2]; 2].into()),
        ("nelder-mead", "initial-simplex", vec![vec![nan; 2]; 3].into()),
        ("nelder-mead", "xatol", nan.into()),
        ("nelder-mead", "fatol", (-1.0).into()),
        ("nelder-mead", "max-iterations", 0.into()),
        ("nelder-mead", "max-evaluations", 0.into()),
        ("nelder-mead", "adaptive", "yes".into()),
        ("dual-annealing", "start", vec![nan, 0.5].into()),
        ("dual-annealing", "initial-temperature", 0.0.into()),
        ("dual-annealing", "restart-ratio", 1.0.into()),
        ("dual-annealing", "visit", 3.0.into()),
        ("dual-annealing", "accept", (-1.0).into()),
        ("dual-annealing", "max-iterations", 0.into()),
        ("nelder-mead", "restarts", (-1).into()),
        ("sobol", "scramble", 1.into()),
        ("line", "start", vec![0.5].into()),
        ("line", "threshold", nan.into()),
        ("line", "amplitude-tolerance", 0.0.into()),
        ("line", "lines", 0.into()),
        ("cross-entropy", "population", 1.into()),
        ("cross-entropy", "elite-fraction", 0.0.into()),
        ("cross-entropy", "smoothing", 1.5.into()),
        ("differential-evolution", "strategy", "rand2bin".into()),
        ("differential-evolution", "population", 4.into()),
        ("differential-evolution", "mutation-max", 0.1.into()),
        ("differential-evolution", "recombination", (-0.1).into()),
        ("direct", "eps", (-1.0).into()),
        ("cma-es", "bounds", "penalty".into()),
        ("cma-es", "initial-deviation", 2.0.into()),
        ("cma-es", "population", 3.into()),
    ];
    for (name, option, value) in cases {
        let message = message_of(name, 2, &SearchOptions::new().with(option, value));
        assert!(message.starts_with(&format!("option `{option}` of {name} is ")), "{message}");
        assert!(message.contains("; it must be "), "{message}");
    }
    let unknown = SearchOptions::new().with("x-atol", 1.0);
    assert!(message_of("nelder-mead", 2, &unknown).contains("no option `x-atol`; its options are: start, "));
    assert_eq!(message_of("random", 2, &unknown), "random has no option `x-atol`; it has no options");
}

/// Setting every option to its default changes no point.
#[test]
fn the_listed_defaults_are_the_defaults() {
    let value = |spec: &mishandle_search::OptionSpec| -> Option<OptionValue> {
        let text = &spec.default;
        match spec.kind {
            OptionType::Float => text.parse::<f64>().ok().map(OptionValue::from),
            OptionType::Integer => text.parse::<i64>().ok().map(OptionValue::from),
            OptionType::Boolean => text.parse::<bool>().ok().map(OptionValue::from),
            OptionType::Text => Some(text.trim_matches('"').into()),
            // These defaults depend on the dimension or the seed; their description is text.
            OptionType::Point | OptionType::Points => None,
        }
    };
    for entry in SEARCHES {
        assert!(entry.reference.contains("19") || entry.reference.contains("20"), "{}", entry.name);
        let mut given = SearchOptions::new();
        for spec in (entry.options)() {
            assert!(!spec.meaning.is_empty() && !spec.default.is_empty(), "{} {}", entry.name, spec.name);
            if let Some(value) = value(&spec) {
                given.set(&spec.name, value);
            }
        }
        let mut search = by_name(entry.name, &continuous(3), 4, &given).expect("the defaults");
        assert_eq!(trace(&mut *search, rough, 200, 1), trace(&mut *make(entry.name, 3, 4), rough, 200, 1));
    }
}

// --- coordinates and observations ---

const TYPED: [Coordinate; 3] =
    [Coordinate::Integer { levels: 5 }, Coordinate::Categorical { levels: 2 }, Coordinate::Continuous];

/// Searches that treat every coordinate as continuous.
const CONTINUOUS: [&str; 4] = ["random", "nelder-mead", "dual-annealing", "sobol"];

#[test]
fn the_types_of_coordinates_do_not_change_the_points_of_continuous_searches() {
    for name in CONTINUOUS {
        let mut search = by_name(name, &TYPED, 7, &SearchOptions::new()).expect("a typed space");
        let points = trace(&mut *search, rough, 200, 1);
        assert_eq!(points, trace(&mut *make(name, 3, 7), rough, 200, 1), "{name}");
    }
}

/// A space with all types of coordinates.
const MIXED: [Coordinate; 5] = [
    Coordinate::Integer { levels: 5 },
    Coordinate::Categorical { levels: 6 },
    Coordinate::Continuous,
    Coordinate::Integer { levels: 1 },
    Coordinate::Categorical { levels: 2 },
];

/// Returns a function of the levels of a mixed space: 0 for the integer 3, the fourth category,
/// about 0.3, and the first of two categories.
fn of_levels(u: &[f64]) -> f64 {
    let level = |x: f64, levels: f64| (levels * x).floor().min(levels - 1.0);
    let wrong_category = if level(u[1], 6.0) == 3.0 { 0.0 } else { 0.5 };
    (level(u[0], 5.0) - 3.0).abs() / 4.0 + wrong_category + (u[2] - 0.3).abs() + level(u[4], 2.0)
}

/// A start has all coordinates, also those with one value.
#[test]
fn a_start_in_a_space_with_a_fixed_coordinate_is_accepted() {
    let space = [Coordinate::Continuous, Coordinate::Integer { levels: 1 }, Coordinate::Continuous];
    let mut options = SearchOptions::new();
    options.set("start", OptionValue::Point(vec![0.25, 0.5, 0.75]));
    let mut search = by_name("nelder-mead", &space, 1, &options).expect("a start");
    assert_eq!(search.ask(), Some(vec![0.25, 0.5, 0.75]));
    options.set("start", OptionValue::Point(vec![0.25]));
    let error = by_name("nelder-mead", &space, 1, &options).err().expect("a point of one number");
    assert!(error.to_string().contains("start"), "{error}");
}

/// Numbers of points that would need gigabytes of memory.
#[test]
fn more_points_at_once_than_memory_has_are_refused() {
    for (name, option) in [
        ("bayesian", "round-size"),
        ("bayesian", "initial"),
        ("turbo", "round-size"),
        ("turbo", "initial"),
        ("portfolio", "round-size"),
        ("cross-entropy", "population"),
        ("differential-evolution", "population"),
        ("cma-es", "population"),
    ] {
        let options: SearchOptions = [(option, OptionValue::Integer(100_001))].into_iter().collect();
        let error = by_name(name, &TYPED, 1, &options).err();
        assert!(matches!(error, Some(SearchError::Option { .. })), "{name} {option}: {error:?}");
    }
}

#[test]
fn points_in_mixed_spaces_are_in_the_cube_and_do_not_depend_on_batches_or_resumption() {
    for entry in SEARCHES {
        let make = || by_name(entry.name, &MIXED, 2, &SearchOptions::new()).expect("a mixed space");
        let one_by_one = trace(&mut *make(), of_levels, 200, 1);
        assert!(one_by_one.iter().all(|(u, _)| u.iter().all(|x| (0.0..=1.0).contains(x))), "{}", entry.name);
        assert_eq!(trace(&mut *make(), of_levels, 200, 64), one_by_one, "{}", entry.name);
        let mut resumed = make();
        for (u, value) in &one_by_one {
            assert_eq!(resumed.ask().as_ref(), Some(u), "{}", entry.name);
            resumed.tell(u, &(*value).into()).expect("a pending point");
        }
    }
}

/// Searches that treat integers and categories as such find the best levels: any other level adds
/// at least 0.25.
#[test]
fn the_best_levels_of_a_mixed_space_are_found() {
    for name in ["cross-entropy", "differential-evolution", "direct", "cma-es"] {
        for seed in 0..10 {
            let mut search = by_name(name, &MIXED, seed, &SearchOptions::new()).expect("a mixed space");
            trace(&mut *search, of_levels, 1000, 16);
            let (u, value) = search.best().expect("values were reported");
            assert!(value < 0.1, "{name}, seed {seed}: {value} at {u:?}");
        }
    }
}

/// In spaces of one type only, and in many dimensions, searches go on to the end of the budget or
/// end by their criterion.
#[test]
fn searches_accept_spaces_of_one_type_and_many_dimensions() {
    let spaces = [
        vec![Coordinate::Categorical { levels: 3 }; 2],
        vec![Coordinate::Integer { levels: 2 }; 3],
        vec![Coordinate::Integer { levels: 2 }],
        vec![Coordinate::Continuous; 100],
        vec![Coordinate::Categorical { levels: 40 }; 30],
    ];
    for space in spaces {
        for entry in SEARCHES {
            for f in [functions::sphere as fn(&[f64]) -> f64, |_| 1.0] {
                let mut search = by_name(entry.name, &space, 3, &SearchOptions::new()).expect("a space");
                let budget = if MODEL_BASED.contains(&entry.name) { 60 } else { 300 };
                let points = trace(&mut *search, f, budget, 64);
                let all_inside = points
                    .iter()
                    .all(|(u, _)| u.len() == space.len() && u.iter().all(|x| (0.0..=1.0).contains(x)));
                assert!(
                    all_inside && (points.len() == budget || search.finished().is_some()),
                    "{}",
                    entry.name
                );
            }
        }
    }
}

/// Searches with a Gaussian process propose the centers of levels only, and a point of a discrete
/// space again only after all of its points.
#[test]
fn model_based_searches_propose_levels_and_repeat_none_of_them_early() {
    let discrete = [Coordinate::Integer { levels: 5 }, Coordinate::Categorical { levels: 4 }];
    for name in ["bayesian", "portfolio"] {
        let mut search = by_name(name, &TYPED, 7, &SearchOptions::new()).expect("a typed space");
        for (u, _) in trace(&mut *search, rough, 100, 1) {
            let centers = [(5.0 * u[0]).fract(), (2.0 * u[1]).fract()];
            assert!(centers.iter().all(|x| (x - 0.5).abs() < 1e-12), "{name} proposes {u:?}");
        }
        let mut search = by_name(name, &discrete, 7, &SearchOptions::new()).expect("a typed space");
        let mut points: Vec<Vec<f64>> =
            trace(&mut *search, rough, 60, 1).into_iter().map(|(u, _)| u).collect();
        assert_eq!(points.len(), 60);
        points.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
        points.dedup();
        assert_eq!(points.len(), 20, "{name} evaluates all points of a small space");
    }
}

#[test]
fn a_coordinate_without_levels_is_an_error() {
    for coordinate in [Coordinate::Integer { levels: 0 }, Coordinate::Categorical { levels: 0 }] {
        let space = [Coordinate::Continuous, coordinate];
        for entry in SEARCHES {
            let error = by_name(entry.name, &space, 0, &SearchOptions::new()).err();
            assert_eq!(error, Some(SearchError::NoLevels { coordinate: 1 }), "{}", entry.name);
        }
    }
}

/// A search that does not request parts proposes the same points with and without them.
#[test]
fn parts_do_not_change_the_points_of_a_search_that_does_not_need_them() {
    for name in names() {
        let mut plain = make(name, 2, 3);
        let mut with = make(name, 2, 3);
        assert!(!plain.needs_parts(), "{name}");
        for i in 0..200 {
            let (Some(u), v) = (plain.ask(), with.ask()) else { break };
            assert_eq!(Some(&u), v.as_ref(), "{name}");
            let observation = Observation::from(rough(&u));
            plain.tell(&u, &observation).expect("a pending point");
            with.tell(&u, &Observation { parts: vec![f64::from(i); 2], ..observation })
                .expect("a pending point");
        }
        assert_eq!(plain.best(), with.best());
    }
}

/// A value above the stop threshold of its point has the same effect as any other value above it.
#[test]
fn values_above_the_stop_threshold_do_not_change_the_points() {
    for name in names() {
        let mut replaced = 0;
        let mut plain = make(name, 2, 3);
        let mut bounded = make(name, 2, 3);
        for i in 0..300 {
            let (Some(u), v) = (plain.ask(), bounded.ask()) else { break };
            assert_eq!(Some(&u), v.as_ref(), "{name}, evaluation {i}");
            let value = rough(&u);
            let threshold = bounded.stop_threshold(&u);
            assert!(threshold >= 0.0, "{name}");
            let bound = if value > threshold { f64::midpoint(threshold, value) } else { value };
            replaced += u32::from(bound < value);
            plain.tell(&u, &Observation::from(value)).expect("a pending point");
            bounded.tell(&u, &Observation::from(bound)).expect("a pending point");
        }
        let needs_exact_values =
            !["random", "sobol", "corners", "differential-evolution", "turbo", "portfolio"].contains(&name);
        // `turbo` evaluates few points above the quantile, because it stays near the best one.
        let least = if name == "turbo" { 20 } else { 40 };
        assert!(if needs_exact_values { replaced == 0 } else { replaced > least }, "{name}: {replaced}");
    }
}

#[test]
fn invalid_options_of_the_local_search_are_errors() {
    let cases = [
        ("start", vec![1.5], LbfgsbOptions::default()),
        ("memory", vec![0.5], LbfgsbOptions { memory: 0, ..Default::default() }),
        ("ftol", vec![0.5], LbfgsbOptions { ftol: f64::NAN, ..Default::default() }),
        ("difference", vec![0.5], LbfgsbOptions { difference: 0.0, ..Default::default() }),
        ("max_line_search", vec![0.5], LbfgsbOptions { max_line_search: 0, ..Default::default() }),
    ];
    for (wrong, start, options) in cases {
        let error = Lbfgsb::new(&start, &options).err().unwrap_or_else(|| panic!("{wrong} was accepted"));
        assert!(matches!(&error, SearchError::Option { option, .. } if option == wrong), "{error}");
    }
    let empty = Lbfgsb::new(&[], &LbfgsbOptions::default()).err();
    assert_eq!(empty, Some(SearchError::Dimension { found: 0 }));
}

// --- known optima ---

/// With the budget of a falsification trial, 300 evaluations, each search approaches the minimum of
/// suitable functions.
///
/// Tolerances depend on the method: random points in two dimensions have a distance of about
/// 300^(-1/2), Nelder-Mead ends at value differences of 1e-4, a local search moves slowly along
/// Rosenbrock's valley, and a Gaussian process sees the lowest of its values, which span five
/// orders of magnitude, as equal.
#[test]
fn known_optima_are_approached_within_the_budget() {
    let cases = [
        ("random", "sphere", 2e-2),
        ("random", "min-max", 0.25),
        ("nelder-mead", "sphere", 1e-4),
        ("nelder-mead", "rosenbrock", 1e-4),
        ("dual-annealing", "sphere", 1e-9),
        ("dual-annealing", "rosenbrock", 1e-3),
        ("dual-annealing", "min-max", 0.15),
        ("sobol", "sphere", 5e-3),
        ("cross-entropy", "sphere", 1e-2),
        ("differential-evolution", "sphere", 1e-2),
        ("direct", "sphere", 1e-6),
        ("direct", "min-max", 0.05),
        ("cma-es", "sphere", 1e-5),
        ("bayesian", "sphere", 1e-4),
        ("bayesian", "rosenbrock", 0.1),
        ("turbo", "sphere", 1e-4),
        ("turbo", "rosenbrock", 0.1),
        ("portfolio", "sphere", 1e-4),
        ("portfolio", "rosenbrock", 0.1),
        ("portfolio", "min-max", 0.15),
        ("l-bfgs-b", "sphere", 1e-9),
        ("l-bfgs-b", "rosenbrock", 1e-3),
    ];
    for (name, function, tolerance) in cases {
        let function = FUNCTIONS.iter().find(|f| f.name == function).expect("a listed function");
        for seed in 0..if MODEL_BASED.contains(&name) { 3 } else { 10 } {
            let mut search = make(name, 2, seed);
            trace(&mut *search, function.at, 300, 1);
            let (_, found) = search.best().expect("values were reported");
            let gap = found - function.minimum;
            assert!((0.0..=tolerance).contains(&gap), "{name} on {}, seed {seed}: gap {gap}", function.name);
        }
    }
}

/// Given enough evaluations, dual annealing finds the global minimum of functions with many local
/// ones.
#[test]
fn dual_annealing_finds_global_minima() {
    for function in FUNCTIONS {
        let mut search = make("dual-annealing", 2, 1);
        trace(&mut *search, function.at, 12_000, 1);
        let (_, found) = search.best().expect("values were reported");
        let gap = found - function.minimum;
        assert!((-1e-12..=1e-3).contains(&gap), "{}: gap {gap}", function.name);
    }
}

// --- termination ---

fn ended(
    options: &SearchOptions,
    name: &str,
    f: fn(&[f64]) -> f64,
    most: usize,
) -> (usize, Option<SearchEnd>) {
    let mut search = by_name(name, &continuous(2), 1, options).expect("valid options");
    let n = trace(&mut *search, f, most, 10).len();
    (n, search.finished())
}

#[test]
fn searches_end_by_the_reported_criterion() {
    let defaults = SearchOptions::default();
    assert_eq!(ended(&defaults, "random", functions::sphere, 1000), (1000, None));
    let (n, finish) = ended(&defaults, "nelder-mead", functions::sphere, 1000);
    assert!(n < 400 && finish == Some(SearchEnd::Converged));
    // Without a finite value the tolerances are never met: 200 d evaluations.
    assert_eq!(
        ended(&defaults, "nelder-mead", |_| f64::INFINITY, 1000),
        (400, Some(SearchEnd::EvaluationLimit))
    );
    // The first initial point and 1000 redraws.
    assert_eq!(
        ended(&defaults, "dual-annealing", |_| f64::INFINITY, 2000),
        (1001, Some(SearchEnd::NoFiniteStart))
    );
    let ten = SearchOptions::new().with("max-iterations", 10).with("local-search", false);
    // The initial point and ten chains of 2d = 4 visits.
    assert_eq!(ended(&ten, "dual-annealing", functions::sphere, 100), (41, Some(SearchEnd::IterationLimit)));
}

/// With restarts, Nelder-Mead spends its budget, also where no value is finite, and leaves local
/// minima. Each coordinate has a local minimum at 0.2 and the global one at 0.8, in a basin of
/// 0.55, so a start finds the global minimum of two coordinates in 3 of 10 cases. 3000 evaluations
/// are about 30 starts, which all miss it with a probability of 2e-5.
#[test]
fn nelder_mead_restarts_after_convergence_and_spends_its_budget() {
    let valleys = |u: &[f64]| u.iter().map(|x| (x - 0.2).abs().min((x - 0.8).abs() - 0.1)).sum::<f64>();
    let options = |restarts: usize| {
        let limit = OptionValue::Integer(3000);
        SearchOptions::new().with("restarts", restarts as i64).with("max-evaluations", limit)
    };
    let reaches = |restarts, seed| {
        let mut search = by_name("nelder-mead", &continuous(2), seed, &options(restarts)).expect("valid");
        trace(&mut *search, valleys, 3000, 1);
        search.best().expect("values").1 < -0.19
    };
    let count = |restarts| (0..20).filter(|seed| reaches(restarts, *seed)).count();
    assert!(count(0) < 12 && count(1000) == 20, "{} and {}", count(0), count(1000));
    for f in [functions::sphere as fn(&[f64]) -> f64, |_| f64::INFINITY, |_| 1.0] {
        let end = ended(&options(1000), "nelder-mead", f, 4000);
        assert_eq!(end, (3000, Some(SearchEnd::EvaluationLimit)));
    }
    // The first start is the same with and without restarts.
    let points = |restarts| {
        let mut search = by_name("nelder-mead", &continuous(2), 3, &options(restarts)).expect("valid");
        trace(&mut *search, functions::sphere, 3000, 1)
    };
    let one = points(0);
    let many = points(1);
    assert!(one.len() < many.len() && one == many[..one.len()]);
}

/// The temperature of chain t is (2^1.62 - 1) / ((t + 2)^1.62 - 1) times the initial one: 0.120 at
/// t = 4, 0.093 at t = 5. With a restart ratio of 0.1 a restart comes after five chains, so twelve
/// chains of 2d = 4 visits have three initial points: 51 evaluations, the same number as in SciPy's
/// `dual_annealing`.
#[test]
fn annealing_restarts_below_the_restart_temperature() {
    let options = SearchOptions::new()
        .with("restart-ratio", 0.1)
        .with("local-search", false)
        .with("max-iterations", 12);
    let end = ended(&options, "dual-annealing", functions::sphere, 1000);
    assert_eq!(end, (51, Some(SearchEnd::IterationLimit)));
}

/// On a plateau with a small funnel, steps from its edge need far fewer evaluations than random
/// points, whose number is geometric with mean 1 / volume. The ball of violations has the radius
/// 0.12 in 4 dimensions: volume π²/2 · 0.12⁴ = 0.0010.
#[test]
fn portfolio_descends_from_the_edge_of_a_plateau() {
    const SEEDS: u64 = 10;
    let volume = 0.5 * std::f64::consts::PI.powi(2) * 0.12_f64.powi(4);
    let total: usize = (0..SEEDS)
        .map(|seed| {
            let mut random = mishandle_random::Sequence::new(seed, 0);
            let center: Vec<f64> = (0..4).map(|_| 0.2 + 0.6 * random.uniform()).collect();
            let far = |u: &[f64]| u.iter().zip(&center).map(|(x, c)| (x - c) * (x - c)).sum::<f64>().sqrt();
            let mut search = make("portfolio", 4, seed);
            let evaluated = (1..300).find(|_| {
                let u = search.ask().expect("a point");
                let value = (far(&u) - 0.12).min(0.2);
                search.tell(&u, &value.into()).expect("a pending point");
                value < 0.0
            });
            evaluated.unwrap_or(300)
        })
        .sum();
    let mean = total as f64 / SEEDS as f64;
    assert!(mean < 0.25 / volume, "{mean} evaluations, random points need {}", 1.0 / volume);
}

/// Without a slope, all points cover the box after the first round of 14. Two of 14 coordinates
/// that differ by 0.16 to 0.24, a share of 0.08 · 0.8 of the box without its faces, are found in
/// 1.1 times the evaluations of random points, whose number is geometric with mean 1 / 0.064.
#[test]
fn portfolio_covers_the_box_while_robustness_is_flat() {
    const SEEDS: u64 = 400;
    let is_violated =
        |u: &[f64]| (0.16..0.24).contains(&(u[4] - u[9])) && u.iter().all(|x| *x > 0.0 && *x < 1.0);
    let total: usize = (0..SEEDS)
        .map(|seed| {
            let mut search = make("portfolio", 14, seed);
            let evaluated = (1..300).find(|_| {
                let u = search.ask().expect("a point");
                let value = if is_violated(&u) { -0.5 } else { 0.5 };
                search.tell(&u, &value.into()).expect("a pending point");
                value < 0.0
            });
            evaluated.unwrap_or(300)
        })
        .sum();
    let mean = total as f64 / SEEDS as f64;
    assert!(mean < 1.1 / 0.064 + 14.0, "{mean} evaluations");
}

/// The distance to a face of three coordinates shows the way to it, and random numbers of small
/// cells decide there: one cell of about eleven at the face violates. Points where the model is low
/// find one in fewer evaluations than points that cover the box.
#[test]
fn portfolio_stays_where_ripple_decides() {
    const SEEDS: u64 = 60;
    let value = |u: &[f64], seed: u64| {
        let mut cell = seed;
        for x in u {
            cell = mishandle_random::Sequence::new(cell, (50.0 * x) as u64).bits();
        }
        u[1] + 0.1 + 0.12 * (2.0 * mishandle_random::Sequence::new(cell, 0).uniform() - 1.0)
    };
    let mean = |ripple: bool| {
        let options = SearchOptions::new().with("ripple", ripple);
        let evaluations = |seed| {
            let mut search = by_name("portfolio", &continuous(3), seed, &options).expect("an option");
            let found = (1..300).find(|_| {
                let u = search.ask().expect("a point");
                let value = value(&u, seed);
                search.tell(&u, &value.into()).expect("a pending point");
                value < 0.0
            });
            found.unwrap_or(300)
        };
        (0..SEEDS).map(evaluations).sum::<usize>() as f64 / SEEDS as f64
    };
    let with = mean(true);
    let without = mean(false);
    assert!(with < 0.9 * without, "{with} evaluations with ripple, {without} without");
}

/// A wide basin without violations surrounds the center, a small one with violations is elsewhere.
/// CMA-ES leaves the first within the budget of a trial: it finds the second in at least half as
/// many trials again as without its patience.
#[test]
fn cma_es_leaves_a_local_minimum_within_a_trial() {
    const SEEDS: u64 = 60;
    let found = |patience: i64| {
        let options = SearchOptions::new().with("patience", patience);
        let is_found = |seed: &u64| {
            let mut search = by_name("cma-es", &continuous(2), *seed, &options).expect("an option");
            let mut random = mishandle_random::Sequence::new(*seed, 3);
            let center = [0.1 + 0.8 * random.uniform(), if random.uniform() < 0.5 { 0.1 } else { 0.9 }];
            (0..300).any(|_| {
                let u = search.ask().expect("a point");
                let far = |center: &[f64; 2]| (u[0] - center[0]).hypot(u[1] - center[1]);
                let value = (0.05 + 0.3 * far(&[0.5, 0.5])).min(2.0 * far(&center) - 0.1);
                search.tell(&u, &value.into()).expect("a pending point");
                value < 0.0
            })
        };
        (0..SEEDS).filter(is_found).count()
    };
    let without = found(100_000);
    let with = found(10);
    assert!(2 * with >= 3 * without, "{with} with patience, {without} without");
}
