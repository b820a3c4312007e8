//! Compares `portfolio` with and without models of the parts of the robustness.
//!
//! ```sh
//! cargo run --release -p mishandle-search --example trace_search -- heaters,tanks all 0 60   # seeds 0 to 59
//! cargo run --release -p mishandle-search --example trace_search -- always:heaters,tanks all 0 60
//! cargo run --release -p mishandle-search --example trace_search -- functions today,trace 0 60
//! cargo run --release -p mishandle-search --example trace_search -- costs
//! ```
//!
//! A trial ends at the first violation or after 300 evaluations, which then counts as 300. Each row
//! has the restricted mean, the trials without a violation, and the ratio of means to the first
//! variant with a 95 % bootstrap interval over common seeds. Each seed has its own plant, function
//! and limits.
//!
//! | variant | observes |
//! |---|---|
//! | `today` | the robustness |
//! | `trace` | the extremum of each signal in 4 windows; knots act from the knot before them |
//! | `windows` | the same, but all knots act from the start |
//! | `causal` | the extremum of each signal in 1 window; knots act from the knot before them |
//! | `leaves` | the same, but all knots act from the start |
//! | `whole` | the robustness, modeled as a part |
//! | `today-1`, `whole-1`, `trace-1` | the same with both signals in equal units |
//!
//! The constants of the source were chosen with the plants `masses`, `reactor` and `vehicle`.

#![allow(clippy::print_stdout, reason = "an example prints its results")]
#![allow(clippy::expect_used, reason = "an example with fixed inputs")]

mod functions;
mod plants;
mod problem;

use mishandle_random::Sequence;
use mishandle_search::{Coordinate, Observation, SearchOptions, SearchSpace, by_name};
use rustix::time::{ClockId, clock_gettime};

use functions::{FUNCTIONS, Function};
use plants::PLANTS;
use problem::{Observed, Problem, VARIANTS, Variant};

const BUDGET: usize = 300;

/// Returns the number of evaluations to a violation, at most the budget.
fn evaluations(
    space: &SearchSpace,
    has_trace: bool,
    seed: u64,
    observe: impl Fn(&[f64]) -> Observation,
) -> usize {
    let options = SearchOptions::new().with("trace", has_trace);
    let mut search = by_name("portfolio", space, seed, &options).expect("a search");
    for count in 1..=BUDGET {
        let u = search.ask().expect("portfolio never ends");
        let observation = observe(&u);
        if observation.robustness.is_sign_negative() {
            return count;
        }
        search.tell(&u, &observation).expect("a pending point");
    }
    BUDGET
}

fn of_plant(problem: &Problem, variant: &Variant, seed: u64) -> usize {
    let has_trace = variant.observed != Observed::Robustness;
    evaluations(&problem.space(variant), has_trace, seed, |u| problem.observation(u, variant))
}

fn of_function(function: &Function, variant: &Variant, seed: u64) -> usize {
    let targets = function.targets(seed);
    let parts = function.parts();
    let space = SearchSpace {
        parts: Some(parts.clone()),
        ..SearchSpace::from(&vec![Coordinate::Continuous; function.axes])
    };
    evaluations(&space, variant.observed != Observed::Robustness, seed, |u| {
        let values = function.values(u, &targets);
        Observation { robustness: parts.composition.value(&values), parts: values }
    })
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [problems, variants, first, n] = arguments.as_slice() else { return print_costs() };
    // `always:heaters` is the conclusion alone.
    let (has_premise, problems) = match problems.strip_prefix("always:") {
        Some(problems) => (false, problems),
        None => (true, problems.as_str()),
    };
    let has = |list: &str, name: &str| list == "all" || list.split(',').any(|x| x == name);
    let first: u64 = first.parse().expect("the first seed");
    let seeds = first..first + n.parse::<u64>().expect("the number of seeds");
    let variants: Vec<&Variant> = VARIANTS.iter().filter(|variant| has(variants, variant.name)).collect();
    for (name, plant, ends) in PLANTS.into_iter().filter(|(name, ..)| has(problems, name)) {
        for knots in [6, 12] {
            let of_seed = |seed| {
                let problem = Problem::new(plant, ends, knots, has_premise, seed);
                variants.iter().map(|variant| of_plant(&problem, variant, seed)).collect()
            };
            print_rows(
                &format!("{name} {knots}"),
                &variants,
                &seeds.clone().map(of_seed).collect::<Vec<_>>(),
            );
        }
    }
    for function in
        FUNCTIONS.iter().filter(|function| has(problems, "functions") || has(problems, function.name))
    {
        let of_seed = |seed| variants.iter().map(|variant| of_function(function, variant, seed)).collect();
        print_rows(function.name, &variants, &seeds.clone().map(of_seed).collect::<Vec<_>>());
    }
}

/// Prints a row for each variant. `counts` has the evaluations of each seed and variant.
fn print_rows(problem: &str, variants: &[&Variant], counts: &[Vec<usize>]) {
    for (k, variant) in variants.iter().enumerate() {
        let pairs: Vec<[usize; 2]> = counts.iter().map(|counts| [counts[k], counts[0]]).collect();
        let all: Vec<usize> = (0..pairs.len()).collect();
        let mean = pairs.iter().map(|pair| pair[0]).sum::<usize>() as f64 / pairs.len() as f64;
        let missed = pairs.iter().filter(|pair| pair[0] == BUDGET).count();
        let [low, high] = interval(&pairs);
        let ratio = ratio(&pairs, &all);
        let name = variant.name;
        println!("{problem:<12} {name:<8} {mean:>6.1} ({missed}) ratio {ratio:.2} [{low:.2}, {high:.2}]");
    }
}

/// Returns the ratio of sums of the pairs with these indices.
fn ratio(pairs: &[[usize; 2]], indices: &[usize]) -> f64 {
    let sum = |k: usize| indices.iter().map(|&i| pairs[i][k]).sum::<usize>() as f64;
    sum(0) / sum(1)
}

/// Returns the 95 % interval of the ratio, by the bootstrap.
fn interval(pairs: &[[usize; 2]]) -> [f64; 2] {
    let mut random = Sequence::new(0, 0);
    let mut drawn = || {
        let indices: Vec<usize> = pairs.iter().map(|_| random.below(pairs.len() as u64) as usize).collect();
        ratio(pairs, &indices)
    };
    let mut ratios: Vec<f64> = (0..2000).map(|_| drawn()).collect();
    ratios.sort_by(f64::total_cmp);
    [ratios[50], ratios[1949]]
}

/// Prints the CPU time of the search per simulation, in trials without a violation.
fn print_costs() {
    let (_, plant, ends) = PLANTS[0];
    for variant in &VARIANTS {
        let cost = |seed| {
            let mut problem = Problem::new(plant, ends, 12, true, seed);
            problem.limits = problem.limits.map(|limit| 10.0 * limit);
            let now = || clock_gettime(ClockId::ThreadCPUTime);
            let start = now();
            assert_eq!(of_plant(&problem, variant, seed), BUDGET);
            let spent = now() - start;
            (1e3 * spent.tv_sec as f64 + 1e-6 * spent.tv_nsec as f64) / BUDGET as f64
        };
        let costs: Vec<f64> = (0..5).map(cost).collect();
        println!("{:<8} {costs:.2?} ms per simulation, with 12 axes", variant.name);
    }
}
