//! Compares all searches on small falsification problems: the restricted mean number of evaluations
//! to a violation.
//!
//! ```sh
//! cargo run --release -p mishandle-search --example compare_searches            # all searches
//! cargo run --release -p mishandle-search --example compare_searches -- sobol   # these searches only
//! cargo run --release -p mishandle-search --example compare_searches -- axes=2,5 portfolio portfolio:faces=false
//! ```
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

#![allow(clippy::print_stdout, reason = "an example prints its results")]
#![allow(clippy::expect_used, reason = "an example with fixed inputs")]

use std::time::Instant;

use mishandle_random::Sequence;
use mishandle_search::{Coordinate, SEARCHES, Search, SearchOptions, by_name, functions};

const BUDGET: usize = 300;
const SEEDS: u64 = 30;
const DIMENSIONS: [usize; 4] = [2, 5, 10, 30];

/// A name, and the value at a point for a target.
type Problem = (&'static str, fn(&[f64], &[f64]) -> f64);

const PROBLEMS: [Problem; 12] = [
    ("corner", corner),
    ("inside", inside),
    ("face", face),
    ("rough", rough),
    ("needle", needle),
    ("min-max", min_max),
    ("signs", signs),
    ("plateau", plateau),
    ("cliff", cliff),
    ("two-basins", two_basins),
    ("separable", separable),
    ("one-corner", one_corner),
];

/// Returns the distance between two points, divided by the diagonal of the box.
fn distance(u: &[f64], center: impl Fn(usize) -> f64) -> f64 {
    let squares = u.iter().enumerate().map(|(i, x)| (x - center(i)) * (x - center(i)));
    (squares.sum::<f64>() / u.len() as f64).sqrt()
}

/// Returns 0.1 in 2 dimensions and 0.2 in 30.
fn radius(d: usize) -> f64 {
    0.1 + 0.1 * (d as f64 / 2.0).ln() / 15f64.ln()
}

fn corner(u: &[f64], t: &[f64]) -> f64 {
    distance(u, |i| t[i].round()) - radius(u.len())
}

fn inside(u: &[f64], t: &[f64]) -> f64 {
    distance(u, |i| 0.1 + 0.8 * t[i]) - radius(u.len())
}

fn face(u: &[f64], t: &[f64]) -> f64 {
    distance(u, |i| if i < 2 { t[i].round() } else { 0.1 + 0.8 * t[i] }) - radius(u.len())
}

fn rough(u: &[f64], t: &[f64]) -> f64 {
    let moved: Vec<f64> = u.iter().zip(t).map(|(x, t)| x - t + 0.6).collect();
    functions::rastrigin(&moved) / u.len() as f64 - 2.0
}

fn needle(u: &[f64], t: &[f64]) -> f64 {
    let far = distance(u, |i| 0.1 + 0.8 * t[i]);
    if far < radius(u.len()) { -1.0 } else { 2.0 - far }
}

fn min_max(u: &[f64], _: &[f64]) -> f64 {
    functions::min_max(u)
}

fn signs(u: &[f64], t: &[f64]) -> f64 {
    let agreement: f64 = u.iter().zip(t).map(|(x, t)| (2.0 * t.round() - 1.0) * (2.0 * x - 1.0)).sum();
    0.55 - agreement / u.len() as f64
}

fn plateau(u: &[f64], t: &[f64]) -> f64 {
    (distance(u, |i| 0.1 + 0.8 * t[i]) - 0.6 * radius(u.len())).min(0.1)
}

fn cliff(u: &[f64], t: &[f64]) -> f64 {
    let largest = u.iter().zip(t).map(|(x, t)| (x - 0.1 - 0.8 * t).abs()).fold(0.0, f64::max);
    if largest < 0.3 * radius(u.len()) { -0.5 } else { 0.3 + largest }
}

fn two_basins(u: &[f64], t: &[f64]) -> f64 {
    let place = |i: usize| 0.1 + 0.8 * t[i];
    let wide = distance(u, |i| (place(i) + 0.5) % 1.0);
    (0.05 + 0.5 * wide).min(2.0 * (distance(u, place) - 0.6 * radius(u.len())))
}

fn separable(u: &[f64], t: &[f64]) -> f64 {
    let term = |(x, t): (&f64, &f64)| {
        let far = (x - t).abs();
        2.0 * far + 0.5 * (1.0 - (8.0 * std::f64::consts::PI * (x - t)).cos())
    };
    u.iter().zip(t).map(term).sum::<f64>() / u.len() as f64 - 0.25
}

fn one_corner(u: &[f64], t: &[f64]) -> f64 {
    let is_near = u.iter().zip(t).all(|(x, t)| (x - t.round()).abs() < 0.15);
    if is_near { -1.0 } else { 0.5 + 0.1 * (u[0] - t[0]).abs() }
}

/// Returns the search of an argument `name` or `name:option=value,option=value`.
fn make(argument: &str, d: usize, seed: u64) -> Box<dyn Search> {
    let (name, rest) = argument.split_once(':').unwrap_or((argument, ""));
    let mut options = match name {
        "nelder-mead" => SearchOptions::new().with("restarts", 1000).with("max-evaluations", BUDGET as i64),
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

/// Returns the number of evaluations to a violation, at most the budget, and whether there was one.
fn evaluations(search: &str, f: fn(&[f64], &[f64]) -> f64, d: usize, seed: u64) -> (usize, bool) {
    let mut random = Sequence::new(seed, d as u64);
    let target: Vec<f64> = (0..d).map(|_| random.uniform()).collect();
    let mut search = make(search, d, random.bits());
    for count in 1..=BUDGET {
        let Some(u) = search.ask() else { break };
        let value = f(&u, &target);
        if value < 0.0 {
            return (count, true);
        }
        search.tell(&u, &value.into()).expect("a pending point");
    }
    (BUDGET, false)
}

/// Returns the results of all seeds, which are divided among two threads.
fn results(search: &str, f: fn(&[f64], &[f64]) -> f64, d: usize) -> Vec<(usize, bool)> {
    let some = |first: u64| -> Vec<_> {
        (first..SEEDS).step_by(2).map(|seed| evaluations(search, f, d, seed)).collect()
    };
    std::thread::scope(|scope| {
        let odd = scope.spawn(move || some(1));
        let mut results = some(0);
        results.extend(odd.join().expect("a finished thread"));
        results
    })
}

fn main() {
    let (mut names, mut axes) = (Vec::new(), DIMENSIONS.to_vec());
    for argument in std::env::args().skip(1) {
        match argument.strip_prefix("axes=") {
            Some(list) => axes = list.split(',').map(|d| d.parse().expect("a number of axes")).collect(),
            None => names.push(argument),
        }
    }
    if names.is_empty() {
        names = SEARCHES.iter().map(|entry| entry.name.to_owned()).collect();
    }
    println!(
        "restricted mean of {SEEDS} seeds (budget {BUDGET}); in parentheses the trials without a violation"
    );
    print!("{:<14}", "problem, d");
    for name in &names {
        // The end of a name shows its option.
        let end = name.len().saturating_sub(14);
        print!(" {:>14}", name.get(end..).unwrap_or(name));
    }
    println!();
    let (mut seconds, mut count) = (vec![0.0; names.len()], vec![0; names.len()]);
    for (problem, f) in PROBLEMS {
        for &d in &axes {
            print!("{:<14}", format!("{problem}, {d}"));
            for (k, name) in names.iter().enumerate() {
                let start = Instant::now();
                let results = results(name, f, d);
                seconds[k] += start.elapsed().as_secs_f64();
                let total: usize = results.iter().map(|(n, _)| n).sum();
                let missed = results.iter().filter(|(_, found)| !found).count();
                count[k] += total;
                print!(" {:>14}", format!("{:.1} ({missed})", total as f64 / SEEDS as f64));
            }
            println!();
        }
    }
    let n_cells = SEEDS as usize * PROBLEMS.len() * axes.len();
    print!("{:<14}", "mean");
    count.iter().for_each(|count| print!(" {:>14.1}", *count as f64 / n_cells as f64));
    print!("\n{:<14}", "µs per point");
    for (seconds, count) in seconds.iter().zip(count) {
        print!(" {:>14.1}", 1e6 * seconds / f64::from(u32::try_from(count).unwrap_or(u32::MAX)));
    }
    println!();
}
