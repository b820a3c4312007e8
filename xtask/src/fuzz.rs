//! `cargo xtask fuzz`: builds the fuzz targets of `fuzz/` and runs them with libFuzzer.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::thread;

use anyhow::{Context, Result, bail, ensure};

use crate::corpus::{archive, pack, unpack};
use crate::process::{as_typed, cargo, output, run};

/// The package and its build folder, which `fuzz/.cargo/config.toml` sets.
const PACKAGE: &str = "fuzz";
const BUILD: &str = "target/fuzz";
const PROGRAMS: &str = "target/fuzz/x86_64-unknown-linux-gnu/debug";

/// Duration per target without `--minutes`, s.
const SHORT_RUN: u64 = 5;

/// Limits of one input: libFuzzer reports an input that takes longer, s, or a process that uses
/// more memory, MiB.
const LIMITS: [&str; 2] = ["-timeout=1", "-rss_limit_mb=512"];

/// Largest input of the corpus, bytes.
const LARGEST_INPUT: u64 = 2048;

/// Exit code of libFuzzer for an input that takes longer than the limit.
const TIMEOUT: i32 = 70;

/// The arguments of the command.
#[derive(Debug, PartialEq)]
struct Options {
    /// Duration of the whole run; `None` for a short run of every target.
    minutes: Option<u64>,
    /// Whether inputs that reach new code are added to the corpus.
    keep: bool,
    /// A file to add to the corpus of the one target that is named, instead of running targets.
    add: Option<PathBuf>,
    /// Names of targets; empty for all.
    targets: Vec<String>,
}

impl Options {
    fn parse(arguments: &[String]) -> Result<Options> {
        let mut options = Options { minutes: None, keep: false, add: None, targets: Vec::new() };
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            match argument.as_str() {
                "--minutes" => {
                    let value = rest.next().map_or("missing", String::as_str);
                    let minutes = value.parse().ok().filter(|minutes| *minutes > 0);
                    let minutes = minutes
                        .with_context(|| format!("--minutes is {value}; expected a whole number from 1"))?;
                    options.minutes = Some(minutes);
                }
                "--keep" => options.keep = true,
                "--add" => {
                    let file = rest.next().context("--add needs the path of an input")?;
                    options.add = Some(PathBuf::from(file));
                }
                flag if flag.starts_with('-') => {
                    bail!("unknown flag `{flag}`; expected --minutes N, --keep or --add FILE")
                }
                target => options.targets.push(target.to_owned()),
            }
        }
        Ok(options)
    }

    /// Returns the duration of each of `targets`, s, if `workers` of them run at once.
    fn seconds(&self, targets: usize, workers: usize) -> u64 {
        match self.minutes {
            Some(minutes) => (minutes * 60 * workers.min(targets) as u64 / targets as u64).max(1),
            None => SHORT_RUN,
        }
    }
}

/// Runs the corpus and then new inputs through each target, in parallel on all cores.
///
/// # Errors
/// If a target does not build, or an input breaks a law; the message contains the input's path and
/// a command that repeats the failure.
pub fn fuzz(root: &Path, arguments: &[String]) -> Result<()> {
    let options = Options::parse(arguments)?;
    let targets = select(known_targets(root)?, &options.targets)?;
    if let Some(file) = &options.add {
        let [target] = &options.targets[..] else { bail!("--add needs the name of one target") };
        return add(root, target, file);
    }
    build(root)?;
    let workers = thread::available_parallelism().map_or(1, usize::from).min(targets.len());
    let seconds = options.seconds(targets.len(), workers);
    eprintln!("{} targets, {seconds} s each, {workers} at once", targets.len());
    let queue = Mutex::new(targets.iter());
    let failures = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some(target) = queue.lock().ok().and_then(|mut queue| queue.next().cloned()) {
                    match fuzz_target(root, &target, seconds) {
                        Ok(statistics) => eprintln!("{target:<12} {statistics}"),
                        Err(error) => {
                            eprintln!("{target:<12} failed");
                            failures.lock().into_iter().for_each(|mut list| list.push(format!("{error:#}")));
                        }
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap_or_default();
    ensure!(failures.is_empty(), "{}", failures.join("\n"));
    if options.keep {
        targets.iter().try_for_each(|target| merge(root, target))?;
    }
    Ok(())
}

/// Returns the names of all targets: those of the files in `fuzz/fuzz_targets`.
fn known_targets(root: &Path) -> Result<Vec<String>> {
    let folder = root.join(PACKAGE).join("fuzz_targets");
    let files = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let mut names = Vec::new();
    for file in files {
        names.extend(file?.path().file_stem().map(|name| name.to_string_lossy().into_owned()));
    }
    names.sort();
    Ok(names)
}

fn select(known: Vec<String>, requested: &[String]) -> Result<Vec<String>> {
    if let Some(unknown) = requested.iter().find(|name| !known.contains(name)) {
        bail!("unknown fuzz target `{unknown}`; expected one of {}", known.join(", "));
    }
    Ok(if requested.is_empty() { known } else { requested.to_vec() })
}

fn build(root: &Path) -> Result<()> {
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
    ensure!(
        Command::new(&compiler).arg("--version").output().is_ok_and(|output| output.status.success()),
        "libFuzzer needs a C++ compiler, but `{compiler}` does not run; install one (Debian: apt install g++)"
    );
    // Cargo reads the flags of the instrumentation from the folder in which it runs.
    run(cargo(root, &["build", "--bins"]).current_dir(root.join(PACKAGE)), &[0])
}

/// Report of libFuzzer at its end.
#[derive(Debug, Default, PartialEq)]
struct Statistics {
    executions: u64,
    /// Number of covered edges of the control flow.
    coverage: u64,
    new_inputs: u64,
    peak_mebibytes: u64,
}

impl Statistics {
    fn read(text: &str) -> Statistics {
        let number = |key: &str| {
            let (_, rest) = text.rsplit_once(key)?;
            rest.split_whitespace().next()?.parse().ok()
        };
        Statistics {
            executions: number("stat::number_of_executed_units:").unwrap_or(0),
            coverage: number(" cov:").unwrap_or(0),
            new_inputs: number("stat::new_units_added:").unwrap_or(0),
            peak_mebibytes: number("stat::peak_rss_mb:").unwrap_or(0),
        }
    }
}

impl fmt::Display for Statistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Statistics { executions, coverage, new_inputs, peak_mebibytes } = self;
        write!(
            f,
            "{executions:>9} executions, {coverage:>5} edges covered, {new_inputs:>4} new inputs, \
             {peak_mebibytes:>3} MiB"
        )
    }
}

/// Returns the command of a target. Its output is discarded, except that of libFuzzer.
fn program(root: &Path, target: &str) -> Command {
    let mut command = Command::new(Path::new(PROGRAMS).join(target));
    command.current_dir(root).args(LIMITS).stdin(Stdio::null());
    command
}

fn fuzz_target(root: &Path, target: &str, seconds: u64) -> Result<Statistics> {
    let found = format!("{BUILD}/corpus/{target}");
    let crashes = format!("{BUILD}/crashes/{target}");
    fs::create_dir_all(root.join(&crashes)).with_context(|| crashes.clone())?;
    unpack(root, target, &root.join(&found))?;
    let mut command = program(root, target);
    command.args(["-close_fd_mask=3", "-print_final_stats=1"]);
    command.args([format!("-max_total_time={seconds}"), format!("-artifact_prefix={crashes}/")]);
    command.arg(&found);
    let output = command.output().with_context(|| format!("cannot run `{}`", as_typed(&command)))?;
    let text = String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        return Ok(Statistics::read(&text));
    }
    match failing_input(&text) {
        Some(input) => repeat(root, target, &input).map(|()| Statistics::read(&text)),
        None => bail!("{target} ended with {}\n{}", output.status, tail(&text)),
    }
}

/// Returns the path of the input that libFuzzer wrote.
fn failing_input(text: &str) -> Option<String> {
    let (_, path) = text.rsplit_once("Test unit written to ")?;
    path.lines().next().map(|line| line.trim().to_owned())
}

/// Repeats an input that failed.
///
/// # Errors
/// If it fails again, or was no timeout. On a busy machine, any input can take a second once.
fn repeat(root: &Path, target: &str, input: &str) -> Result<()> {
    let mut command = program(root, target);
    let Output { status, stderr, .. } = command.arg(input).output()?;
    if status.success() && input.contains("/timeout-") {
        eprintln!("{target:<12} took more than 1 s for {input} once, but not when it was repeated");
        return Ok(());
    }
    let kind = match status.code() {
        Some(TIMEOUT) => "takes longer than 1 s",
        _ => "breaks a law or a limit",
    };
    let shown = as_typed(&command).replacen(target, &format!("{PROGRAMS}/{target}"), 1);
    bail!("{target}: {input} {kind}\n{}\nrepeat it with: {shown}", tail(&String::from_utf8_lossy(&stderr)))
}

/// Returns the last lines of an output.
fn tail(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(20)..].join("\n")
}

/// Adds an input to the corpus of a target: one that broke a law, after the fix.
fn add(root: &Path, target: &str, file: &Path) -> Result<()> {
    let folder = root.join(BUILD).join("added").join(target);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    unpack(root, target, &folder)?;
    let name = file.file_name().with_context(|| format!("{} is not a file", file.display()))?;
    fs::copy(file, folder.join(name)).with_context(|| file.display().to_string())?;
    let count = pack(root, target, &folder)?;
    eprintln!("{target:<12} {count} inputs in {}", archive(target).display());
    Ok(())
}

/// Replaces the corpus of a target by the smallest set of inputs that covers the code which seeds,
/// corpus and new inputs cover.
fn merge(root: &Path, target: &str) -> Result<()> {
    let folder = |name: &str| PathBuf::from(format!("{BUILD}/{name}/{target}"));
    let seeds = folder("seeds");
    let found = folder("corpus");
    let merged = folder("merged");
    for folder in [&seeds, &merged] {
        let folder = root.join(folder);
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    output(Command::new(Path::new(PROGRAMS).join("seeds")).current_dir(root).arg(target).arg(&seeds))?;
    let mut command = program(root, target);
    // Edges without counts of their executions, so that tens of inputs suffice.
    command.args(["-set_cover_merge=1", "-use_counters=0", "-close_fd_mask=3"]);
    command.arg(format!("-max_len={LARGEST_INPUT}")).arg(&merged).args([&seeds, &found]);
    let merging = command.output().with_context(|| format!("cannot run `{}`", as_typed(&command)))?;
    ensure!(
        merging.status.success(),
        "cannot merge the corpus of {target}\n{}",
        tail(&String::from_utf8_lossy(&merging.stderr))
    );
    let count = pack(root, target, &root.join(merged))?;
    eprintln!("{target:<12} {count} inputs in {}", archive(target).display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str) -> Result<Options> {
        Options::parse(&text.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn the_minutes_are_divided_among_the_targets() {
        let ten_minutes = options("--minutes 10").unwrap();
        assert_eq!(ten_minutes.seconds(10, 2), 120);
        assert_eq!(ten_minutes.seconds(1, 2), 600);
        assert_eq!(options("").unwrap().seconds(10, 2), SHORT_RUN);
    }

    #[test]
    fn mistakes_in_the_arguments_name_what_is_allowed() {
        let error = |text: &str| options(text).unwrap_err().to_string();
        assert_eq!(error("--minutes 0"), "--minutes is 0; expected a whole number from 1");
        assert_eq!(error("--minutes"), "--minutes is missing; expected a whole number from 1");
        assert_eq!(
            error("--seconds 3"),
            "unknown flag `--seconds`; expected --minutes N, --keep or --add FILE"
        );
        let known = || vec!["plan".to_owned(), "csv".to_owned()];
        let unknown = select(known(), &["plans".to_owned()]).unwrap_err().to_string();
        assert_eq!(unknown, "unknown fuzz target `plans`; expected one of plan, csv");
        assert_eq!(select(known(), &[]).unwrap(), known());
    }

    #[test]
    fn statistics_are_those_at_the_end_of_libfuzzers_output() {
        let text = "#3\tINITED cov: 7 ft: 9 corp: 2/9b\n#99\tDONE   cov: 12 ft: 20 corp: 5/80b lim: 4 exec/s: 33\n\
                    Done 99 runs in 3 second(s)\nstat::number_of_executed_units: 99\n\
                    stat::average_exec_per_sec:     33\nstat::new_units_added:         3\n\
                    stat::slowest_unit_time_sec:    0\nstat::peak_rss_mb:              41\n";
        let expected = Statistics { executions: 99, coverage: 12, new_inputs: 3, peak_mebibytes: 41 };
        assert_eq!(Statistics::read(text), expected);
    }

    #[test]
    fn the_path_of_a_failing_input_is_found() {
        let text = "==1== ERROR: libFuzzer: deadly signal\nartifact_prefix='a/'; Test unit written to a/crash-0f\nBase64: YQ==\n";
        assert_eq!(failing_input(text).as_deref(), Some("a/crash-0f"));
        assert_eq!(failing_input("killed"), None);
    }
}
