//! Compares searches on small falsification problems: the restricted mean number of evaluations to
//! a violation.
//!
//! ```sh
//! cargo run --release -p mishandle-studies --example compare_searches            # all searches
//! cargo run --release -p mishandle-studies --example compare_searches -- sobol   # these searches only
//! cargo run --release -p mishandle-studies --example compare_searches -- axes=2,5 portfolio portfolio:faces=false
//! cargo run --release -p mishandle-studies --example compare_searches -- problems=ripple seeds=0..60 rows portfolio
//! ```
//!
//! | argument | meaning | default |
//! |---|---|---|
//! | `problems=A,B` | groups (`smooth`, `flat`, `ripple`, `plants`, `all`) or beginnings of names | `smooth` |
//! | `axes=A,B` | numbers of axes, for problems that leave them open | 2, 5, 10, 30 |
//! | `seeds=A..B` | seeds from A to B - 1 | 0..30 |
//! | `budget=N` | evaluations of a trial at most | 300 |
//! | `rows` | a line `problem,axes,search,seed,evaluations,found` for each trial instead of the table | |
//!
//! A trial ends at the first value below 0 or after 300 evaluations, which then counts as 300. Each
//! seed has its own random target t, so that no search meets it by its construction, for example
//! because it starts in the center:
//!
//! | problem | value | violations |
//! |---|---|---|
//! | `corner` | distance to a random corner, less a radius | a ball around a corner |
//! | `inside` | distance to t, less a radius | a ball inside the box |
//! | `face` | distance to t with two coordinates at bounds, less a radius | a ball around a point of two faces |
//! | `rough` | mean of Rastrigin's function around t, less 2 | a few of many local minima |
//! | `needle` | 2 less the distance to t, and -1 in a ball around t | a ball that the slope leads away from |
//! | `min-max` | maximum over coordinates of the minimum of two ramps | coordinates in one of two intervals each |
//! | `signs` | 0.55 less the mean of s (2u - 1) with random signs s | corner regions of disturbances of about the same sign |
//! | `plateau` | distance to t, less a radius, at most 0.1 | a ball; no slope far from it |
//! | `cliff` | 0.3 plus the distance to t, and -0.5 in a small cube around t | a cube at the bottom of a slope |
//! | `two-basins` | minimum of a wide cone without and a narrow cone with violations | a ball around the top of the narrow cone |
//! | `separable` | mean of one function with four minima per coordinate, less 0.25 | boxes around combinations of low minima |
//! | `one-corner` | 0.5 plus a small slope, and -1 near a random corner | 0.15 from one corner in each coordinate |
//!
//! Distances are divided by the diagonal of the box; the radius rises from 0.1 in 2 dimensions to
//! 0.2 in 30.
//!
//! The other groups are described where they are defined.

#![allow(clippy::print_stdout, reason = "an example prints its results")]
#![allow(clippy::expect_used, reason = "an example with fixed inputs")]

mod flat;
mod plants;
mod problem;
mod ripple;
mod smooth;

use std::ops::Range;
use std::time::Instant;

use mishandle::search::{Coordinate, SEARCHES, Search, SearchOptions, by_name};
use problem::Problem;

/// The arguments.
struct Comparison {
    searches: Vec<String>,
    problems: Vec<Problem>,
    axes: Vec<usize>,
    seeds: Range<u64>,
    budget: usize,
    rows: bool,
}

/// The result of a trial: its seed, the number of evaluations, and whether there was a violation.
type Trial = (u64, usize, bool);

/// Returns the problems of a group, or whose names begin with `name`.
fn problems(name: &str) -> Vec<Problem> {
    let groups: [(&str, &[Problem]); 4] = [
        ("smooth", &smooth::PROBLEMS),
        ("flat", &flat::PROBLEMS),
        ("ripple", &ripple::PROBLEMS),
        ("plants", &plants::PROBLEMS),
    ];
    if let Some((_, group)) = groups.iter().find(|(group, _)| *group == name) {
        return group.to_vec();
    }
    let all = groups.iter().flat_map(|(_, group)| group.iter().copied());
    all.filter(|problem| name == "all" || problem.name.starts_with(name)).collect()
}

impl Comparison {
    fn read(arguments: impl Iterator<Item = String>) -> Self {
        let mut comparison = Self {
            searches: Vec::new(),
            problems: Vec::new(),
            axes: vec![2, 5, 10, 30],
            seeds: 0..30,
            budget: 300,
            rows: false,
        };
        for argument in arguments {
            // A search with options has a `=`, too, behind its colon.
            match argument.split_once('=').filter(|(key, _)| !key.contains(':')) {
                Some(("axes", list)) => {
                    comparison.axes = list.split(',').map(|d| d.parse().expect("a number of axes")).collect();
                }
                Some(("problems", list)) => {
                    comparison.problems = list.split(',').flat_map(problems).collect();
                }
                Some(("seeds", range)) => {
                    let (first, end) = range.split_once("..").expect("seeds=A..B");
                    comparison.seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
                }
                Some(("budget", n)) => comparison.budget = n.parse().expect("a number of evaluations"),
                _ if argument == "rows" => comparison.rows = true,
                _ => comparison.searches.push(argument),
            }
        }
        if comparison.problems.is_empty() {
            comparison.problems = problems("smooth");
        }
        if comparison.searches.is_empty() {
            comparison.searches = SEARCHES.iter().map(|entry| entry.name.to_owned()).collect();
        }
        comparison
    }

    /// Returns the search of an argument `name` or `name:option=value,option=value`.
    fn make(&self, argument: &str, d: usize, seed: u64) -> Box<dyn Search> {
        let (name, rest) = argument.split_once(':').unwrap_or((argument, ""));
        let mut options = match name {
            "nelder-mead" => {
                SearchOptions::new().with("restarts", 1000).with("max-evaluations", self.budget as i64)
            }
            _ => SearchOptions::new(),
        };
        for pair in rest.split(',').filter(|pair| !pair.is_empty()) {
            let (option, value) = pair.split_once('=').expect("option=value");
            match (value.parse::<bool>(), value.parse::<i64>(), value.parse::<f64>()) {
                (Ok(value), ..) => options.set(option, value),
                (_, Ok(value), _) => options.set(option, value),
                (.., Ok(value)) => options.set(option, value),
                _ => options.set(option, value),
            }
        }
        by_name(name, &vec![Coordinate::Continuous; d], seed, &options).expect("a search and its options")
    }

    fn trial(&self, search: &str, problem: &Problem, d: usize, seed: u64) -> Trial {
        let (instance, search_seed) = problem.instance(d, seed);
        let mut search = self.make(search, d, search_seed);
        for count in 1..=self.budget {
            let Some(u) = search.ask() else { break };
            let value = problem.at(&u, &instance);
            if value < 0.0 {
                return (seed, count, true);
            }
            search.tell(&u, &value.into()).expect("a pending point");
        }
        (seed, self.budget, false)
    }

    /// Returns the trials of all seeds, which are divided among two threads.
    fn trials(&self, search: &str, problem: &Problem, d: usize) -> Vec<Trial> {
        let some = |odd: u64| -> Vec<_> {
            let seeds = self.seeds.clone().filter(|seed| seed % 2 == odd);
            seeds.map(|seed| self.trial(search, problem, d, seed)).collect()
        };
        let mut trials = std::thread::scope(|scope| {
            let odd = scope.spawn(|| some(1));
            let mut trials = some(0);
            trials.extend(odd.join().expect("a finished thread"));
            trials
        });
        trials.sort_unstable();
        trials
    }

    /// Returns the problems with their numbers of axes.
    fn cells(&self) -> Vec<(Problem, usize)> {
        let axes = |problem: &Problem| -> Vec<usize> {
            if problem.axes.is_empty() { self.axes.clone() } else { problem.axes.to_vec() }
        };
        self.problems.iter().flat_map(|p| axes(p).into_iter().map(|d| (*p, d))).collect()
    }

    fn print_rows(&self) {
        for (problem, d) in self.cells() {
            for search in &self.searches {
                for (seed, count, found) in self.trials(search, &problem, d) {
                    println!("{},{d},{search},{seed},{count},{}", problem.name, u8::from(found));
                }
            }
        }
    }

    fn print_table(&self) {
        let Self { searches, seeds, budget, .. } = self;
        let n_seeds = (seeds.end - seeds.start) as f64;
        println!(
            "restricted mean of {n_seeds} seeds (budget {budget}); in parentheses the trials without a violation"
        );
        print!("{:<18}", "problem, d");
        for name in searches {
            // The end of a name shows its option.
            let end = name.len().saturating_sub(14);
            print!(" {:>14}", name.get(end..).unwrap_or(name));
        }
        println!();
        let mut seconds = vec![0.0; searches.len()];
        let mut count = vec![0; searches.len()];
        let cells = self.cells();
        for (problem, d) in &cells {
            print!("{:<18}", format!("{}, {d}", problem.name));
            for (k, name) in searches.iter().enumerate() {
                let start = Instant::now();
                let trials = self.trials(name, problem, *d);
                seconds[k] += start.elapsed().as_secs_f64();
                let total: usize = trials.iter().map(|(_, n, _)| n).sum();
                let missed = trials.iter().filter(|(.., found)| !found).count();
                count[k] += total;
                print!(" {:>14}", format!("{:.1} ({missed})", total as f64 / n_seeds));
            }
            println!();
        }
        print!("{:<18}", "mean");
        count.iter().for_each(|count| print!(" {:>14.1}", *count as f64 / (n_seeds * cells.len() as f64)));
        print!("\n{:<18}", "µs per point");
        for (seconds, count) in seconds.iter().zip(count) {
            print!(" {:>14.1}", 1e6 * seconds / f64::from(u32::try_from(count).unwrap_or(u32::MAX)));
        }
        println!();
    }
}

fn main() {
    let comparison = Comparison::read(std::env::args().skip(1));
    if comparison.rows { comparison.print_rows() } else { comparison.print_table() }
}
