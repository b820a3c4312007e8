//! Compares all searches on small falsification problems: the restricted mean number of evaluations to a violation.
//!
//! ```sh
//! cargo run --release -p mishandle-search --example compare_searches            # all searches
//! cargo run --release -p mishandle-search --example compare_searches -- sobol   # these searches only
//! ```
//!
//! A trial ends at the first value below 0 or after 300 evaluations, which then counts as 300. Each seed has its own
//! random target t, so that no search meets it by its construction, for example because it starts in the center:
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
//!
//! Distances are divided by the diagonal of the box; the radius rises from 0.1 in 2 dimensions to 0.2 in 30.

#![allow(clippy::print_stdout, reason = "an example prints its results")]
#![allow(clippy::expect_used, reason = "an example with fixed inputs")]

use std::time::Instant;

use mishandle_random::Sequence;
use mishandle_search::{Coordinate, SEARCHES, SearchOptions, by_name, functions};

const BUDGET: usize = 300;
const SEEDS: u64 = 30;
const DIMENSIONS: [usize; 4] = [2, 5, 10, 30];

/// A name, and the value at a point for a target.
type Problem = (&'static str, fn(&[f64], &[f64]) -> f64);

const PROBLEMS: [Problem; 7] = [
    ("corner", corner),
    ("inside", inside),
    ("face", face),
    ("rough", rough),
    ("needle", needle),
    ("min-max", min_max),
    ("signs", signs),
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

/// Returns the number of evaluations to a violation, at most the budget, and whether there was one.
fn evaluations(search: &str, f: fn(&[f64], &[f64]) -> f64, d: usize, seed: u64) -> (usize, bool) {
    let space = vec![Coordinate::Continuous; d];
    let options = match search {
        "nelder-mead" => SearchOptions::new().with("restarts", 1000).with("max-evaluations", BUDGET as i64),
        _ => SearchOptions::new(),
    };
    let mut random = Sequence::new(seed, d as u64);
    let target: Vec<f64> = (0..d).map(|_| random.uniform()).collect();
    let mut search = by_name(search, &space, random.bits(), &options).expect("valid options");
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

fn main() {
    let chosen: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<&str> = SEARCHES
        .iter()
        .map(|entry| entry.name)
        .filter(|name| chosen.is_empty() || chosen.iter().any(|chosen| chosen == name))
        .collect();
    println!(
        "restricted mean of {SEEDS} seeds (budget {BUDGET}); in parentheses the trials without a violation"
    );
    print!("{:<12}", "problem, d");
    names.iter().for_each(|name| print!(" {:>14}", name.chars().take(14).collect::<String>()));
    println!();
    let mut seconds = vec![0.0; names.len()];
    let mut count = vec![0; names.len()];
    for (problem, f) in PROBLEMS {
        for d in DIMENSIONS {
            print!("{:<12}", format!("{problem}, {d}"));
            for (k, name) in names.iter().enumerate() {
                let start = Instant::now();
                let results: Vec<_> = (0..SEEDS).map(|seed| evaluations(name, f, d, seed)).collect();
                seconds[k] += start.elapsed().as_secs_f64();
                let total: usize = results.iter().map(|(n, _)| n).sum();
                let missed = results.iter().filter(|(_, found)| !found).count();
                count[k] += total;
                print!(" {:>14}", format!("{:.1} ({missed})", total as f64 / SEEDS as f64));
            }
            println!();
        }
    }
    print!("{:<12}", "µs per point");
    for (seconds, count) in seconds.iter().zip(count) {
        print!(" {:>14.1}", 1e6 * seconds / f64::from(u32::try_from(count).unwrap_or(u32::MAX)));
    }
    println!();
}
