//! Agreement with SciPy and NLopt: `make.py` in their folders of `golden` runs them and writes the
//! golden files.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use mishandle_random::Sequence;
use mishandle_search::{
    AskTell, CmaEs, CmaEsOptions, Coordinate, DifferentialEvolution, DifferentialEvolutionOptions, Direct,
    DirectOptions, DualAnnealing, DualAnnealingOptions, Lbfgsb, LbfgsbOptions, NelderMead, NelderMeadOptions,
    PointSequence, Search, SearchEnd, Sobol, SobolOptions, VisitingDistribution, functions,
};
use serde::Deserialize;
use serde::de::DeserializeOwned;

#[derive(Deserialize)]
struct Golden<T> {
    runs: Vec<T>,
}

fn golden<T: DeserializeOwned>(name: &str) -> Vec<T> {
    golden_of("scipy", name)
}

fn golden_of<T: DeserializeOwned>(program: &str, name: &str) -> Vec<T> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(program).join(name);
    let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str::<Golden<T>>(&text).unwrap_or_else(|error| panic!("{name}: {error}")).runs
}

/// A number, or the text `inf`, which JSON has no number for.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged)]
enum Number {
    Finite(f64),
    Infinite(Infinite),
}

#[derive(Deserialize, Clone, Copy)]
enum Infinite {
    #[serde(rename = "inf")]
    Positive,
}

impl Number {
    fn value(self) -> f64 {
        match self {
            Number::Finite(value) => value,
            Number::Infinite(Infinite::Positive) => f64::INFINITY,
        }
    }
}

// --- the test functions of make.py, operation for operation ---

fn function(name: &str) -> fn(&[f64]) -> f64 {
    match name {
        "sphere" => functions::sphere,
        "rosenbrock" => functions::rosenbrock,
        "rastrigin" => functions::rastrigin,
        "ackley" => functions::ackley,
        "min_max" => functions::min_max,
        "hole" => functions::hole,
        "noisy" => noisy,
        "cliff" => cliff,
        "corner" => corner,
        "edge" => edge,
        "flat" => |_| 1.0,
        "failing" => |_| f64::INFINITY,
        _ => panic!("function `{name}` of make.py is missing here"),
    }
}

fn noisy(u: &[f64]) -> f64 {
    let phase: f64 = u.iter().zip(1..).map(|(x, i)| f64::from(i) * 12345.0 * x).sum();
    functions::sphere(u) + 0.01 * (phase - phase.floor())
}

fn cliff(u: &[f64]) -> f64 {
    if u[0] > 0.55 { f64::INFINITY } else { functions::sphere(u) }
}

fn corner(u: &[f64]) -> f64 {
    let term = |(i, x): (usize, &f64)| {
        let y = if i % 2 == 0 { *x } else { 1.0 - x };
        (i as f64 + 1.0) * y + 0.5 * y * y
    };
    u.iter().enumerate().map(term).sum()
}

fn edge(u: &[f64]) -> f64 {
    let mut total = 0.0;
    for (i, x) in u.iter().enumerate() {
        let y = x - if i == 0 { 1.2 } else { 0.35 };
        total += y * y + 3.0 * y * y * y * y;
    }
    u.windows(2).fold(total, |total, pair| total + 0.5 * (pair[0] - pair[1]) * (pair[0] - pair[1]))
}

// --- Nelder-Mead ---

#[derive(Deserialize)]
struct NelderMeadRun {
    function: String,
    start: Vec<f64>,
    simplex: Option<Vec<Vec<f64>>>,
    options: NelderMeadGiven,
    n: usize,
    hash: String,
    points: BTreeMap<usize, Vec<f64>>,
    finish: String,
}

#[derive(Deserialize)]
struct NelderMeadGiven {
    xatol: Option<f64>,
    fatol: Option<f64>,
    maxiter: Option<usize>,
    maxfev: Option<usize>,
    #[serde(default)]
    adaptive: bool,
}

impl NelderMeadRun {
    fn options(&self) -> NelderMeadOptions {
        let defaults = NelderMeadOptions::default();
        NelderMeadOptions {
            start: Some(self.start.clone()),
            simplex_origin: 0.0,
            initial_simplex: self.simplex.clone(),
            xatol: self.options.xatol.unwrap_or(defaults.xatol),
            fatol: self.options.fatol.unwrap_or(defaults.fatol),
            max_iterations: self.options.maxiter,
            max_evaluations: self.options.maxfev,
            adaptive: self.options.adaptive,
            restarts: 0,
        }
    }
}

/// Returns the 64-bit FNV-1a hash of the coordinates' bytes, little endian.
fn fnv1a(points: &[Vec<f64>]) -> String {
    let bytes = points.iter().flatten().flat_map(|x| x.to_le_bytes());
    let hash = bytes.fold(0xCBF2_9CE4_8422_2325_u64, |state, byte| {
        (state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    });
    format!("{hash:016x}")
}

fn run_to_the_end(search: &mut dyn Search, f: fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
    let mut points = Vec::new();
    while let Some(u) = search.ask() {
        search.tell(&u, &f(&u).into()).expect("a pending point");
        points.push(u);
    }
    points
}

/// All points of all runs equal SciPy's bit for bit, and so do the number of points and the
/// termination criterion.
#[test]
fn nelder_mead_proposes_the_points_of_scipy() {
    for run in golden::<NelderMeadRun>("nelder_mead.json") {
        let name = format!("{} from {:?} with {:?}", run.function, run.start, run.options());
        let machine = NelderMead::new(run.start.len(), 0, &run.options()).expect("valid options");
        let mut search = AskTell::new(machine);
        let points = run_to_the_end(&mut search, function(&run.function));
        for (i, expected) in &run.points {
            assert_eq!(points.get(*i), Some(expected), "point {i} of {name}");
        }
        assert_eq!((points.len(), fnv1a(&points)), (run.n, run.hash), "all points of {name}");
        let finish = search.finished().expect("it has ended");
        assert_eq!(format!("{finish:?}"), run.finish, "end of {name}");
    }
}

// --- L-BFGS-B ---

#[derive(Deserialize)]
struct LbfgsbRun {
    function: String,
    start: Vec<f64>,
    options: LbfgsbGiven,
    points: Vec<Vec<f64>>,
    values: Vec<Vec<Number>>,
    /// `None` if SciPy continued to a NaN point.
    result: Option<LbfgsbResult>,
}

#[derive(Deserialize)]
struct LbfgsbGiven {
    maxcor: Option<usize>,
    ftol: Option<f64>,
    gtol: Option<f64>,
    maxiter: Option<usize>,
    maxfun: Option<usize>,
}

#[derive(Deserialize)]
struct LbfgsbResult {
    x: Vec<f64>,
    value: f64,
    success: bool,
}

impl LbfgsbRun {
    fn options(&self) -> LbfgsbOptions {
        let defaults = LbfgsbOptions::default();
        LbfgsbOptions {
            memory: self.options.maxcor.unwrap_or(defaults.memory),
            ftol: self.options.ftol.unwrap_or(defaults.ftol),
            gtol: self.options.gtol.unwrap_or(defaults.gtol),
            max_iterations: self.options.maxiter.unwrap_or(defaults.max_iterations),
            max_evaluations: self.options.maxfun.unwrap_or(defaults.max_evaluations),
            ..defaults
        }
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Given SciPy's values, the search proposes SciPy's points.
///
/// The values are SciPy's own, round by round. Finite differences multiply the rounding error of a
/// value by 1e8, so runs with recomputed values diverge after a few iterations.
#[test]
fn the_local_search_proposes_the_points_of_scipy() {
    for run in golden::<LbfgsbRun>("lbfgsb.json") {
        let name = format!("{} from {:?}", run.function, run.start);
        let d = run.start.len();
        let mut search = AskTell::new(Lbfgsb::new(&run.start, &run.options()).expect("a start in the box"));
        for (i, (expected, values)) in run.points.iter().zip(&run.values).enumerate() {
            let round = search.ask_batch(d + 1);
            assert_eq!(round.len(), d + 1, "round {i} of {} of {name}", run.points.len());
            let error = distance(&round[0], expected);
            assert!(error < 1e-8, "round {i} of {name}: {:?}, not {expected:?}, off by {error:e}", round[0]);
            for (u, value) in round.iter().zip(values) {
                search.tell(u, &value.value().into()).expect("a pending point");
            }
        }
        let finish =
            search.finished().unwrap_or_else(|| panic!("{name} continues after {}", run.points.len()));
        let Some(result) = run.result else {
            assert_eq!(finish, SearchEnd::Abnormal, "{name}");
            continue;
        };
        assert_eq!(finish == SearchEnd::Converged, result.success, "{name}: {finish}");
        let (x, value) = search.machine().result();
        assert!(distance(x, &result.x) < 1e-8, "{name}: {x:?}, not {:?}", result.x);
        assert_eq!(value, result.value, "{name}");
    }
}

// --- dual annealing ---

/// Returns the Kolmogorov-Smirnov statistic: the maximum distance between the empirical
/// distribution functions of two sorted samples.
fn kolmogorov_smirnov(a: &[f64], b: &[f64]) -> f64 {
    let share = |sample: &[f64], x: f64| sample.partition_point(|s| *s <= x) as f64 / sample.len() as f64;
    a.iter().chain(b).map(|x| (share(a, *x) - share(b, *x)).abs()).fold(0.0, f64::max)
}

/// Returns the statistic that two samples of one distribution exceed with probability 1 %
/// (asymptotically; less with ties).
fn critical_distance(n: usize, m: usize) -> f64 {
    let n = n as f64;
    let m = m as f64;
    (-(0.01_f64 / 2.0).ln() / 2.0 * (n + m) / (n * m)).sqrt()
}

#[track_caller]
fn check_same_distribution(name: &str, mut ours: Vec<f64>, mut theirs: Vec<f64>) {
    ours.sort_by(f64::total_cmp);
    theirs.sort_by(f64::total_cmp);
    let found = kolmogorov_smirnov(&ours, &theirs);
    let most = critical_distance(ours.len(), theirs.len());
    let median = |sample: &[f64]| sample[sample.len() / 2];
    let medians = format!("medians {} and {}", median(&ours), median(&theirs));
    #[expect(clippy::print_stdout, reason = "the distances are shown with --nocapture")]
    {
        println!("{name}: distance {found:.4}, 1 % level {most:.4}, {medians}");
    }
    assert!(found <= most, "{name}: distance {found} exceeds {most}; {medians}");
}

#[derive(Deserialize)]
struct Benchmark {
    function: String,
    d: usize,
    threshold: f64,
    most: usize,
    evaluations: Vec<f64>,
}

fn evaluations_to(benchmark: &Benchmark, seed: u64) -> usize {
    let f = function(&benchmark.function);
    let options = DualAnnealingOptions { max_iterations: 100_000, ..Default::default() };
    let mut search = AskTell::new(DualAnnealing::new(benchmark.d, seed, &options).expect("valid options"));
    for count in 1..=benchmark.most {
        let u = search.ask().expect("100,000 chains take more evaluations than the limit");
        let value = f(&u);
        if value <= benchmark.threshold {
            return count;
        }
        search.tell(&u, &value.into()).expect("a pending point");
    }
    benchmark.most + 1
}

/// On six functions, the number of evaluations to a threshold has the same distribution as SciPy's,
/// over 200 seeds each, by the two-sample Kolmogorov-Smirnov test at the 1 % level.
#[test]
fn dual_annealing_needs_as_many_evaluations_as_scipy() {
    let benchmarks = golden::<Benchmark>("dual_annealing.json");
    assert_eq!(benchmarks.len(), 6);
    for benchmark in benchmarks {
        assert!(benchmark.evaluations.len() >= 200);
        let n_seeds = benchmark.evaluations.len() as u64;
        let ours = (0..n_seeds).map(|seed| evaluations_to(&benchmark, seed) as f64).collect();
        check_same_distribution(
            &format!("{} in {} dimensions", benchmark.function, benchmark.d),
            ours,
            benchmark.evaluations.clone(),
        );
    }
}

#[derive(Deserialize)]
struct Visits {
    visit: f64,
    temperature: f64,
    jumps: Vec<f64>,
    first_of_all: Vec<f64>,
    last_alone: Vec<f64>,
}

/// Jumps, and points visited from (0.1, 0.5, 0.9) by all coordinates or the last one, have SciPy's
/// distributions.
#[test]
fn visits_have_the_distribution_of_scipy() {
    for (i, visits) in golden::<Visits>("visiting.json").into_iter().enumerate() {
        let distribution = VisitingDistribution::new(visits.visit);
        let t = visits.temperature;
        let mut stream = Sequence::new(1, i as u64);
        let name = format!("q = {}, T = {t}", visits.visit);
        let jumps = (0..20_000).map(|_| distribution.jump(t, &mut stream)).collect();
        check_same_distribution(&format!("jumps at {name}"), jumps, visits.jumps);
        let mut visit = |step: usize, coordinate: usize| {
            (0..20_000)
                .map(|_| distribution.visit(&[0.1, 0.5, 0.9], step, t, &mut stream)[coordinate])
                .collect()
        };
        check_same_distribution(&format!("first of all at {name}"), visit(0, 0), visits.first_of_all);
        check_same_distribution(&format!("last alone at {name}"), visit(5, 2), visits.last_alone);
    }
}

// --- differential evolution ---

#[derive(Deserialize)]
struct Evolution {
    function: String,
    d: usize,
    strategy: String,
    population: usize,
    threshold: f64,
    most: usize,
    evaluations: Vec<f64>,
}

/// On four functions, the number of evaluations to a threshold has the same distribution as
/// SciPy's, over 200 seeds each, by the two-sample Kolmogorov-Smirnov test at the 1 % level.
#[test]
fn differential_evolution_needs_as_many_evaluations_as_scipy() {
    for run in golden::<Evolution>("evolution.json") {
        let f = function(&run.function);
        let options = DifferentialEvolutionOptions {
            strategy: run.strategy.clone(),
            population: Some(run.population),
            tol: 0.0,
            ..Default::default()
        };
        let evaluations = |seed| {
            let space = vec![Coordinate::Continuous; run.d];
            let machine = DifferentialEvolution::new(&space, seed, &options).expect("valid options");
            let mut search = AskTell::new(machine);
            for count in 1..=run.most {
                let u = search.ask().expect("it does not end");
                let value = f(&u);
                if value <= run.threshold {
                    return count as f64;
                }
                search.tell(&u, &value.into()).expect("a pending point");
            }
            (run.most + 1) as f64
        };
        let ours = (0..run.evaluations.len() as u64).map(evaluations).collect();
        check_same_distribution(&format!("{} by {}", run.function, run.strategy), ours, run.evaluations);
    }
}

// --- CMA-ES ---

/// An ellipsoid with a condition number of 1e4, rotated by 45 degrees in each pair of neighbors.
fn ellipsoid(u: &[f64]) -> f64 {
    let d = u.len();
    let y = |i: usize| (u[i] + u[(i + 1) % d] - 0.8) * 0.5_f64.sqrt();
    (0..d).map(|i| 10f64.powf(4.0 * i as f64 / (d as f64 - 1.0)) * y(i) * y(i)).sum()
}

/// On four functions, the number of evaluations to a threshold has the same distribution as that of
/// the Python package `cmaes`, which follows Hansen's tutorial too, over 200 seeds each, by the
/// two-sample Kolmogorov-Smirnov test at the 1 % level.
#[test]
fn cma_es_needs_as_many_evaluations_as_the_package_cmaes() {
    let options = CmaEsOptions { initial_deviation: 0.05, ..Default::default() };
    for run in golden_of::<Benchmark>("cmaes", "evaluations.json") {
        let f = if run.function == "ellipsoid" { ellipsoid } else { function(&run.function) };
        let evaluations = |seed| {
            let machine =
                CmaEs::new(&vec![Coordinate::Continuous; run.d], seed, &options).expect("valid options");
            let mut search = AskTell::new(machine);
            for count in 1..=run.most {
                let u = search.ask().expect("it does not end");
                let value = f(&u);
                if value <= run.threshold {
                    return count as f64;
                }
                search.tell(&u, &value.into()).expect("a pending point");
            }
            (run.most + 1) as f64
        };
        let ours = (0..run.evaluations.len() as u64).map(evaluations).collect();
        check_same_distribution(&format!("{} in {} dimensions", run.function, run.d), ours, run.evaluations);
    }
}

// --- DIRECT ---

#[derive(Deserialize)]
struct DirectRun {
    function: String,
    d: usize,
    locally_biased: bool,
    n: usize,
    hash: String,
    points: BTreeMap<usize, Vec<f64>>,
}

/// All points of all runs equal those of NLopt's DIRECT and DIRECT-L bit for bit, in the same
/// order.
#[test]
fn direct_proposes_the_points_of_nlopt() {
    for run in golden_of::<DirectRun>("nlopt", "direct.json") {
        let name =
            format!("{} in {} dimensions, locally biased: {}", run.function, run.d, run.locally_biased);
        let f = function(&run.function);
        let options = DirectOptions { eps: 0.0, locally_biased: run.locally_biased };
        let machine = Direct::new(&vec![Coordinate::Continuous; run.d], &options).expect("valid options");
        let mut search = AskTell::new(machine);
        let mut points = Vec::new();
        for _ in 0..run.n {
            let u = search.ask().expect("it does not end");
            let tilt: f64 = u.iter().zip(1..).map(|(x, i)| 0.001 * f64::from(i) * x).sum();
            search.tell(&u, &(f(&u) + tilt).into()).expect("a pending point");
            points.push(u);
        }
        for (i, expected) in &run.points {
            assert_eq!(points[*i], *expected, "point {i} of {name}");
        }
        assert_eq!(fnv1a(&points), run.hash, "all points of {name}");
    }
}

// --- Sobol ---

#[derive(Deserialize)]
struct SobolRun {
    d: usize,
    n: u64,
    hash: String,
    last: Vec<f64>,
}

/// Without a scramble, all points equal SciPy's bit for bit, in up to 1024 dimensions.
#[test]
fn sobol_proposes_the_points_of_scipy() {
    for run in golden::<SobolRun>("sobol.json") {
        let sequence =
            Sobol::new(run.d, 0, &SobolOptions { scramble: false }).expect("at least one coordinate");
        let points: Vec<Vec<f64>> = (0..run.n).map(|i| sequence.point(i)).collect();
        assert_eq!(points.last(), Some(&run.last), "last point for d = {}", run.d);
        assert_eq!(fnv1a(&points), run.hash, "all points for d = {}", run.d);
    }
}
