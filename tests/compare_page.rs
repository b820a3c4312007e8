//! COMPARE.md states facts about Mishandle in tables. These tests make each of its cells from the
//! lists of the code and from statements that they check, and compare the cells with the page. A
//! failure says what to write.

use std::path::Path;
use std::sync::Arc;

use mishandle::rollout::{AxisKind, Seed};
use mishandle::shipped::shipped_controllers;
use mishandle::{Plan, ResolvedPlan};
use mishandle_evaluation::{Estimate, PairedCounts, betting_mean, bootstrap_mean, sign_test, wilson};
use mishandle_stl::{
    Clock, DenseMonitor, DenseSignal, Formula, Interpolation, Monitor, OnlineMonitor, TimeUnit, Trace,
};
use mishandle_tasks::{CAMERA_NAMES, TASKS};

const PAGE: &str = include_str!("../COMPARE.md");

/// Returns the cells of a line of a table. No cell of the page contains an escaped `|`.
fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

/// Returns the cells of Mishandle in the tables of a section. In a table whose first column is
/// `tool`, Mishandle is a row; in the others it is a column.
fn stated(section: &str) -> Vec<(&'static str, &'static str)> {
    let start = PAGE.find(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("no section {section}"));
    let text = &PAGE[start + 1..];
    let text = &text[..text.find("\n## ").unwrap_or(text.len())];
    let mut stated = Vec::new();
    let mut header: Vec<&str> = Vec::new();
    for line in text.lines() {
        if !line.starts_with('|') {
            header.clear();
        } else if header.is_empty() {
            header = cells(line);
        } else if header[0] == "tool" {
            let row = cells(line);
            if row[0] == "Mishandle" {
                stated.extend(header.iter().copied().zip(row).skip(1));
            }
        } else if let Some(column) = header.iter().position(|name| *name == "Mishandle") {
            let row = cells(line);
            if !row[column].starts_with("---") {
                stated.push((row[0], row[column]));
            }
        }
    }
    stated
}

/// Checks that the cells of Mishandle in a section are `facts`, in this order.
#[track_caller]
fn assert_page(section: &str, facts: &[(&str, String)]) {
    let stated = stated(section);
    let names: Vec<&str> = stated.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, facts.iter().map(|(name, _)| *name).collect::<Vec<_>>(), "section {section}");
    let wrong: Vec<String> = facts
        .iter()
        .zip(&stated)
        .filter(|(fact, stated)| fact.1 != stated.1)
        .map(|(fact, _)| format!("{}: {}", fact.0, fact.1))
        .collect();
    assert!(wrong.is_empty(), "COMPARE.md, section {section}, write for Mishandle:\n{}", wrong.join("\n"));
}

/// Returns a statement that `shown` proves.
#[track_caller]
fn holds(statement: &str, shown: bool) -> &str {
    assert!(shown, "the code does not show this: {statement}");
    statement
}

/// Returns the code with which a command line ends.
fn exit_code(words: &[&str]) -> u8 {
    mishandle_cli::exit_code_of(["mishandle"].iter().chain(words).map(Into::into), None)
}

/// Returns whether the program knows a command and its flags with their values.
fn accepts(words: &[&str]) -> bool {
    exit_code(&[words, &["--help"]].concat()) == 0
}

/// Returns whether a plan or settings have a key.
fn has_key(name: &str) -> bool {
    mishandle::plan::keys().iter().any(|key| key.name == name)
}

/// Returns whether the Python package exports a name.
fn exports(name: &str) -> bool {
    include_str!("../python/mishandle/__init__.py").contains(&format!("    \"{name}\",\n"))
}

/// Returns whether an extra of the Python package installs a package.
fn installs(requirement: &str) -> bool {
    include_str!("../pyproject.toml").contains(&format!("\"{requirement}"))
}

/// Returns whether a page of the guide, whose examples a test runs, has a section.
fn guides(page: &str, section: &str) -> bool {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/guide").join(page);
    std::fs::read_to_string(path).unwrap().contains(&format!("\n## {section}\n"))
}

/// Returns names in backticks.
fn quoted<'a>(names: impl IntoIterator<Item = &'a str>, separator: &str) -> String {
    names.into_iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(separator)
}

/// Returns a number as the page writes it.
fn number(count: usize) -> &'static str {
    ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
        [count]
}

fn identity() -> (&'static str, String) {
    let language = holds("Rust, with a Python package", exports("falsify"));
    let license = env!("CARGO_PKG_LICENSE").replace(" OR ", " or ");
    let version = env!("CARGO_PKG_VERSION");
    let heading = format!("\n## {version}, unreleased\n");
    let changelog = include_str!("../CHANGELOG.md");
    assert!(changelog.contains(&heading), "CHANGELOG.md has a date for this version: write it here");
    ("language, license, version", format!("{language}; {license}; {version}, not released"))
}

/// Returns the long names in rows of the table of operators on the page of formulas.
fn operators(rows: &[&str]) -> Vec<&'static str> {
    let page = include_str!("../docs/reference/formulas.md");
    let row = |name: &&str| page.lines().find(|line| line.starts_with(&format!("| [{name}]"))).unwrap();
    let words = rows.iter().flat_map(|name| row(name).split('`').skip(1).step_by(2));
    let words = words.map(|text| text.split('(').next().unwrap());
    words.filter(|word| !word.starts_with(char::is_uppercase) && !["sX", "sY"].contains(word)).collect()
}

#[test]
fn the_cells_about_monitors_are_true() {
    let parses = |text: &str| Formula::parse(text).is_ok();
    assert!(parses("a + b - c * d / e <= 0"));
    let arithmetic = quoted(operators(&["functions"]), " ");
    let mut past = operators(&["historically", "once", "since", "neighbors"]);
    past.retain(|word| !word.contains("next"));

    let names: Arc<[String]> = Arc::from(["d".to_string()]);
    let mut trace = Trace::new(Arc::clone(&names));
    [1.0, 4.0, 2.0].iter().for_each(|sample| trace.push(&[*sample]));
    let smallest = Monitor::new(&Formula::parse("always(d <= 3)").unwrap(), &names, Clock::unknown());
    let smallest = smallest.unwrap().robustness(&trace).unwrap();
    let unbounded = Formula::parse("always(eventually(d <= 3)) and historically(d >= 0)").unwrap();
    let mut online = OnlineMonitor::new(&[unbounded], &names, Clock::unknown(), None).unwrap();
    online.push(&[1.0]).unwrap();
    let bounds = online.bounds(0);
    let dense = |interpolation| {
        let formula = Formula::parse("always[0:1](d <= 3)").unwrap();
        let signal = DenseSignal::new("d", vec![0.0, 2.0], vec![0.0, 4.0], interpolation).unwrap();
        DenseMonitor::new(&formula, &names, Some(TimeUnit::Seconds)).unwrap().robustness(&[signal]).unwrap()
    };
    let is_dense = (dense(Interpolation::Hold), dense(Interpolation::Linear)) == (3.0, 1.0);

    assert_page(
        "Monitors",
        &[
            (
                "formula language",
                holds("STL in RTAMT's syntax", parses("always[0:30](d <= 0.3) and eventually[0,1] (a >= b)"))
                    .to_string(),
            ),
            ("arithmetic in formulas", format!("`+ - * /`, {arithmetic}")),
            ("past operators", quoted(past, " ")),
            (
                "time",
                format!(
                    "samples at a fixed period; {}",
                    holds("dense time, held or linear between samples", is_dense)
                ),
            ),
            ("value", holds("robustness (minimum and maximum)", smallest == -1.0).to_string()),
            (
                "trace shorter than the formula",
                format!(
                    "cut windows; {}",
                    holds("an error with `log.strict-horizon`", has_key("log.strict-horizon"))
                ),
            ),
            (
                "online",
                format!(
                    "{}; {}",
                    holds("yes, all operators, with bounds over all continuations", bounds.low < bounds.high),
                    holds(
                        "a C interface",
                        include_str!("../crates/monitor-c/include/mishandle_monitor.h").contains("_push(")
                    )
                ),
            ),
            identity(),
        ],
    );
}

/// Runs that the program made in a folder.
struct Runs(tempfile::TempDir);

impl Runs {
    const QUESTIONS: [&str; 4] = ["evaluate", "falsify", "margin", "risk"];

    /// Asks each question about a toy.
    fn new() -> Runs {
        let runs = Runs(tempfile::tempdir().unwrap());
        for question in Runs::QUESTIONS {
            let size = match question {
                "evaluate" => ["--episodes", "8"],
                "risk" => ["--simulations", "100"],
                _ => ["--budget", "20"],
            };
            let path = runs.path(question);
            let asked = [question, "toy/car-following", "--space", "dynamics+events", "--out", &path];
            let code = exit_code(&[&asked[..], &size].concat());
            assert!(code <= 1, "{question}");
        }
        runs
    }

    fn path(&self, question: &str) -> String {
        self.0.path().join(format!("{question}.sqlite")).to_string_lossy().into_owned()
    }

    /// Returns whether a run file has simulations, all with a hash.
    fn have_hashes(&self, question: &str) -> bool {
        let file = rusqlite::Connection::open(self.path(question)).unwrap();
        let counts = "SELECT count(*), count(row_hash) FROM simulation";
        let [rows, hashes]: [i64; 2] =
            file.query_row(counts, [], |row| Ok([row.get(0)?, row.get(1)?])).unwrap();
        rows > 0 && rows == hashes
    }
}

fn record() -> String {
    let runs = Runs::new();
    let commands = Runs::QUESTIONS.map(|name| format!("`mishandle {name}`"));
    let (last, others) = commands.split_last().unwrap();
    let file =
        format!("one SQLite file for each {} and {last}, with a hash of each simulation", others.join(", "));
    let falsified = runs.path("falsify");
    [
        holds(&file, Runs::QUESTIONS.iter().all(|question| runs.have_hashes(question))),
        holds("`mishandle replay` compares bits with it", exit_code(&["replay", &falsified]) == 0),
        holds(
            "`--resume` continues it",
            Runs::QUESTIONS
                .iter()
                .all(|question| exit_code(&[question, "--resume", &runs.path(question)]) <= 1),
        ),
    ]
    .join("; ")
}

/// Returns the names of the tasks' spaces, in the order of the first task that has them.
fn spaces() -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for task in TASKS {
        let resolved = ResolvedPlan::new(&Plan::new(task.definition().name, "expert")).unwrap();
        for space in &resolved.target.spaces {
            let name = match space.name().trim_end_matches(char::is_numeric) {
                factor if factor.len() < space.name().len() => format!("{factor}S"),
                name => name.to_string(),
            };
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    names
}

/// Returns the target of a file that describes a robot with a camera.
fn robot(folder: &Path) -> (String, mishandle::rollout::Target) {
    let change = |text: String| {
        text.replace("policy = { ", "policy = { expression = \"state[2]\", ")
            + "\n[cameras]\nside = { position = [0, -2, 0.5], look_at = [0, 0, 0.3] }\n"
    };
    let file = crate::cart_pole::write(folder, change).to_string_lossy().into_owned();
    let target = ResolvedPlan::new(&Plan::new(&file, "")).unwrap().target;
    (file, target)
}

#[test]
fn the_cells_about_falsifiers_are_true() {
    // A variant of a task, such as the cloth of 7 by 7 points, is not counted as a task.
    let tasks = TASKS.iter().filter(|task| task.definition().variant_of.is_none()).count();
    let toys = mishandle_toys::TOYS.len();
    let problems = mishandle_toys::arch::PROBLEMS.len();
    let folder = tempfile::tempdir().unwrap();
    let (_, robot) = robot(folder.path());
    // These lines compile as long as other crates can have tasks and searches of their own.
    let _: fn(&'static dyn mishandle_tasks::Task) -> _ = mishandle_tasks::add;
    let _: Option<&dyn mishandle_search::Search> = None;
    let systems = [
        &format!("{} manipulation tasks under MuJoCo", number(tasks)),
        holds("robots that a TOML file describes", robot.identity.kind == mishandle_robots::KIND),
        holds("programs that answer lines of JSON", accepts(&["falsify", "--command", "program"])),
        holds("Python functions", guides("python.md", "Falsify a function")),
        holds(
            "Gymnasium environments with a policy",
            guides("python.md", "Falsify a policy in a Gymnasium environment"),
        ),
        &format!("{} problems of the ARCH competition, as equations", number(problems)),
        &format!("{} toys in closed form", number(toys)),
        "own tasks in Rust",
    ]
    .join("; ");
    let kinds = quoted(AxisKind::ALL.map(|(_, name)| name), ", ");
    let searches = quoted(mishandle_search::SEARCHES.iter().map(|search| search.name), ", ");
    let parallel = [
        holds("threads", accepts(&["falsify", "--threads", "2"])),
        holds("a Ray cluster", exports("RayExecutor") && installs("ray>=")),
        holds(
            "thousands of worlds of MuJoCo Warp on an NVIDIA GPU, whose violations MuJoCo C repeats (`-k screening.device=gpu`)",
            accepts(&["falsify", "-k", "screening.device=gpu", "-k", "screening.rows=16384"])
                && installs("mujoco-warp=="),
        ),
    ];
    assert_page(
        "Falsifiers",
        &[
            ("systems under test", systems),
            (
                "inputs and scenario spaces",
                format!("axes with unit, bounds and nominal value in named spaces, of the kinds {kinds}"),
            ),
            ("searches shipped", format!("{searches}; own searches in Rust")),
            ("specification", "STL".to_string()),
            ("parallel runs", parallel.join("; ")),
            ("record, replay and resumption", record()),
            identity(),
        ],
    );
}

/// Returns whether an interval has these bounds, to three decimals.
fn is_interval(estimate: Estimate, low: f64, high: f64) -> bool {
    let is_near = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 5e-4;
    is_near(estimate.low, low) && is_near(estimate.high, high)
}

fn statistics() -> String {
    let pairs = PairedCounts { both: 36, first_only: 12, second_only: 2, neither: 0 };
    let values: Vec<f64> = (0..20).map(|i| f64::from(i) / 20.0).collect();
    let has_interval = |found: Estimate| found.low < found.value && found.value < found.high;
    let until = |command| {
        accepts(&[command, "--until", "decided"])
            && accepts(&[command, "--until", "width=0.1"])
            && !accepts(&[command, "--until", "soon"])
    };
    let methods = mishandle_risk::Method::ALL.map(|(_, name)| name);
    let risk = format!("probabilities: `mishandle risk` by {}", quoted(methods, ", "));
    let method = |name: &&str| accepts(&["risk", "-k", &format!("risk.method={name}")]);
    [
        holds("Wilson", is_interval(wilson(85, 100), 0.7672, 0.9069)),
        holds(", bootstrap", has_interval(bootstrap_mean(&values, Seed(0)))),
        holds(" and betting intervals", has_interval(betting_mean(&values))),
        holds("; paired: Newcombe's interval", is_interval(pairs.difference(), -0.3404, -0.0569)),
        holds(", exact McNemar and sign tests", (sign_test(12, 2) - 212.0 / 16384.0).abs() < 1e-12),
        holds("; sequential: `--until` of `mishandle evaluate`", until("evaluate")),
        holds(" and `mishandle compare`", until("compare")),
        holds("; sample sizes: `--expect`; ", accepts(&["evaluate", "--expect", "0.9"])),
        holds(&risk, methods.iter().all(method)),
    ]
    .concat()
}

#[test]
fn the_cells_about_evaluation_are_true() {
    let folder = tempfile::tempdir().unwrap();
    let (_, robot) = robot(folder.path());
    let seeing = TASKS.iter().filter(|task| {
        let definition = task.definition();
        definition.variant_of.is_none() && shipped_controllers(definition).iter().any(|name| name == "vision")
    });
    let shipped = format!("shipped controllers, which see in {} tasks", number(seeing.count()));
    let policies = [
        shipped.as_str(),
        holds("controller files and ONNX models", accepts(&["controller", "a", "--out", "b"])),
        holds(
            "imports from Stable-Baselines3, skrl and PyTorch",
            accepts(&["controller", "model.zip", "--task", "t", "--out", "o"]),
        ),
        holds("LeRobot (`mishandle.lerobot`)", exports("lerobot") && installs("lerobot>=")),
        holds(
            "policy servers (`mishandle.PolicyServer`)",
            exports("PolicyServer") && installs("websockets>="),
        ),
        holds("Python functions", guides("python.md", "Falsify a policy on one of our tasks")),
    ];
    let formulas = |task: &&dyn mishandle_tasks::Task| {
        let resolved = ResolvedPlan::new(&Plan::new(task.definition().name, "expert")).unwrap();
        let has = |name: &&str| resolved.target.formulas.iter().any(|formula| formula.name == *name);
        ["success", "strict", "careful"].iter().all(has)
    };
    let evidence = [
        &record(),
        holds("HTML reports", accepts(&["report", "run", "--out", "page.html"])),
        holds("JUnit", accepts(&["regress", "folder", "--junit", "report.xml"])),
        holds(
            "folders with hashes and a signature of `ssh-keygen` (`mishandle evidence --key`), verified with a replay of a random share",
            accepts(&["evidence", "run", "--out", "folder", "--key", "key"])
                && accepts(&["evidence", "--verify", "folder", "-k", "evidence.replay=0.05"])
                && has_key("evidence.replay"),
        ),
    ];
    let cameras = quoted(CAMERA_NAMES, ", ");
    let images = [
        &format!("images of the cameras {cameras} of the tasks"),
        holds(
            "of the cameras of robots in files",
            robot.spaces.iter().any(|space| space.name() == "camera-3"),
        ),
        holds("of Gymnasium environments (`mishandle.sight`)", exports("sight")),
    ];
    let servers = include_str!("../python/mishandle/policies/servers.py");
    let language = holds("instructions for policies behind servers", servers.contains("instruction: "));
    let spaces = spaces();
    assert_page(
        "Evaluation and stress tests of robot policies",
        &[
            ("systems", "those of [Falsifiers](#falsifiers)".to_string()),
            ("policies", policies.join("; ")),
            (
                "perturbations",
                format!(
                    "the spaces {} (S: severity 1 to 5) of the tasks; {}",
                    quoted(spaces.iter().map(String::as_str), ", "),
                    holds("own axes", robot.named_axes().iter().any(|axis| axis.name == "pole"))
                ),
            ),
            (
                "search and sampling",
                [
                    "the searches of [Falsifiers](#falsifiers)",
                    holds("random scenarios and corners", mishandle::plan::EvaluatePlan::default().corners),
                    holds("the smallest disturbance (`mishandle margin`)", accepts(&["margin"])),
                ]
                .join("; "),
            ),
            ("intervals, comparisons, sequential tests, probabilities", statistics()),
            (
                "specification",
                holds(
                    "STL; success, strict success and careful success of the tasks",
                    TASKS.iter().all(formulas),
                )
                .to_string(),
            ),
            ("records, evidence, replay", evidence.join("; ")),
            ("images and language", format!("{}; {language}", images.join(", "))),
            identity(),
        ],
    );
}

#[test]
fn the_cells_about_training_are_true() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = robot(folder.path());
    let algorithms = quoted(mishandle_training::ALGORITHMS.iter().map(|entry| entry.name), ", ");
    let trains = |target: &str| exit_code(&["train", target, "--algorithm", "ppo", "--dry-run"]) == 0;
    let environments = [
        holds("the tasks and own tasks in Rust", TASKS.iter().all(|task| trains(task.definition().name))),
        holds("robots in files", trains(&file)),
        holds("with disturbances (`--space`)", accepts(&["train", "--space", "delay"])),
    ];
    let gymnasium = holds(
        "the tasks as Gymnasium environments for other libraries (`mishandle.TaskEnv`)",
        exports("TaskEnv"),
    );
    assert_page(
        "Training libraries",
        &[
            ("algorithms", algorithms),
            (
                "framework",
                [
                    "own networks on the CPU",
                    holds(
                        "of PPO on an NVIDIA GPU, too (`-k train.device=gpu`)",
                        accepts(&["train", "-k", "train.device=gpu"]) && has_key("train.device"),
                    ),
                ]
                .join("; "),
            ),
            ("environments", format!("{}; {gymnasium}", environments.join(", "))),
            (
                "parallel environments",
                [
                    holds("rows of one batch on threads", accepts(&["train", "--threads", "2"])),
                    holds("worlds of MuJoCo Warp on an NVIDIA GPU", installs("mujoco-warp==")),
                ]
                .join("; "),
            ),
            identity(),
        ],
    );
}

/// The probes see a name that does not exist.
#[test]
fn unknown_commands_flags_and_names_are_not_accepted() {
    assert!(accepts(&["falsify", "--threads", "2"]));
    for words in [&["falsificate"][..], &["falsify", "--no-such-flag"], &["falsify", "--threads", "many"]] {
        assert!(!accepts(words), "{words:?}");
    }
    assert!(!exports("falsificate") && !installs("falsificate") && !guides("python.md", "Falsificate"));
}

#[test]
fn every_command_and_python_name_of_the_page_exists() {
    let names: Vec<&str> = PAGE.split('`').skip(1).step_by(2).collect();
    for command in names.iter().filter_map(|text| text.strip_prefix("mishandle ")) {
        let command = command.split(' ').next().unwrap();
        assert!(accepts(&[command]), "COMPARE.md names `mishandle {command}`");
    }
    for name in names.iter().filter_map(|text| text.strip_prefix("mishandle.")) {
        assert!(exports(name), "COMPARE.md names `mishandle.{name}`");
    }
}
