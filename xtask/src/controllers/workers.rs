//! Runs many things side by side, each a process, so that all can be stopped.

use std::fmt;
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, sleep};
use std::time::Duration;

use anyhow::{Context, Result, bail};

use crate::process::as_typed;

/// How often a process is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// The exit code of a program that saved what it had when it was interrupted.
const INTERRUPTED: i32 = 130;

/// Somebody wants it to end.
#[derive(Debug)]
pub struct Interrupted;

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "interrupted")
    }
}

impl std::error::Error for Interrupted {}

/// How many things were done, and how many could not be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub done: usize,
    pub failed: usize,
}

/// Does each job, `workers` at a time, in their order, until `stop`. One that fails does not end the others; `tell` is
/// told how each went, but for those that were interrupted.
pub fn side_by_side<J: Sync>(
    jobs: &[J],
    workers: usize,
    stop: &AtomicBool,
    work: impl Fn(&J) -> Result<()> + Sync,
    tell: impl Fn(&J, &Result<()>) + Sync,
) -> Outcome {
    let [next, done, failed] = [const { AtomicUsize::new(0) }; 3];
    let turn = || {
        while !stop.load(Ordering::Relaxed) {
            let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            let result = work(job);
            let counter = match &result {
                Ok(()) => &done,
                Err(error) if error.is::<Interrupted>() => continue,
                Err(_) => &failed,
            };
            counter.fetch_add(1, Ordering::Relaxed);
            tell(job, &result);
        }
    };
    thread::scope(|scope| {
        for _ in 0..workers.min(jobs.len()) {
            scope.spawn(turn);
        }
    });
    Outcome { done: done.into_inner(), failed: failed.into_inner() }
}

/// Runs a program to its end, its output in the file `out` and its words in `log`, and gives what it wrote. At `stop` it
/// is interrupted, as by Ctrl-C, and waited for: it saves what it has.
///
/// # Errors
/// [`Interrupted`], or the last words of a program that ended with none of the `accepted` exit codes.
pub fn run(
    command: &mut Command,
    accepted: &[i32],
    out: &Path,
    log: &Path,
    stop: &AtomicBool,
) -> Result<String> {
    let create = |path: &Path| File::create(path).with_context(|| path.display().to_string());
    let typed = as_typed(command);
    // A group of its own: Ctrl-C at the terminal is for us to pass on.
    command.stdin(Stdio::null()).stdout(create(out)?).stderr(create(log)?).process_group(0);
    let mut child = command.spawn().with_context(|| format!("cannot run `{typed}`"))?;
    let mut told = false;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if stop.load(Ordering::Relaxed) && !told {
            told = true;
            Command::new("kill")
                .args(["-INT", &child.id().to_string()])
                .status()
                .context("cannot run `kill`")?;
        }
        sleep(LOOK);
    };
    match status.code() {
        Some(code) if accepted.contains(&code) => {
            std::fs::read_to_string(out).with_context(|| out.display().to_string())
        }
        Some(INTERRUPTED) => bail!(Interrupted),
        _ if told => bail!(Interrupted),
        _ => bail!("`{typed}` ended with {status}: {}", last_words(log)),
    }
}

/// The end of what a program said.
fn last_words(log: &Path) -> String {
    let said = std::fs::read_to_string(log).unwrap_or_default();
    let lines: Vec<&str> = said.trim().lines().collect();
    lines[lines.len().saturating_sub(3)..].join("; ")
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Instant;

    use super::*;

    fn shell(script: &str, stop: &AtomicBool) -> Result<String> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        run(&mut command, &[0, 1], &folder.path().join("out"), &folder.path().join("log"), stop)
    }

    #[test]
    fn a_program_gives_what_it_wrote_or_its_last_words() {
        let stop = AtomicBool::new(false);
        assert_eq!(shell("echo data; echo words >&2; exit 1", &stop).unwrap(), "data\n");
        let error = shell("echo no such file >&2; exit 2", &stop).unwrap_err().to_string();
        assert!(error.contains("exit status: 2: no such file"), "{error}");
        // What a program does that was interrupted by somebody else.
        assert!(shell("exit 130", &stop).unwrap_err().is::<Interrupted>());
    }

    #[test]
    fn a_program_is_interrupted_and_may_save() {
        let stop = AtomicBool::new(true);
        let started = Instant::now();
        let folder = tempfile::tempdir().unwrap();
        let saved = folder.path().join("saved");
        let ready = folder.path().join("ready");
        let script = format!(
            "trap 'touch {}; exit 130' INT; touch {}; while :; do sleep 0.02; done",
            saved.display(),
            ready.display()
        );
        let result = thread::scope(|scope| {
            stop.store(false, Ordering::Relaxed);
            let running = scope.spawn(|| shell(&script, &stop));
            while !ready.exists() {
                sleep(LOOK);
            }
            stop.store(true, Ordering::Relaxed);
            running.join().unwrap()
        });
        assert!(result.unwrap_err().is::<Interrupted>());
        assert!(saved.exists());
        assert!(started.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_failure_does_not_end_the_others_and_a_stop_ends_all() {
        let told = Mutex::new(Vec::new());
        let stop = AtomicBool::new(false);
        let work = |job: &u32| match job {
            2 => bail!("two"),
            5 => {
                stop.store(true, Ordering::Relaxed);
                bail!(Interrupted)
            }
            _ => Ok(()),
        };
        let tell = |job: &u32, result: &Result<()>| told.lock().unwrap().push((*job, result.is_ok()));
        let outcome = side_by_side(&[1, 2, 3, 4, 5, 6, 7], 1, &stop, work, tell);
        assert_eq!(outcome, Outcome { done: 3, failed: 1 });
        assert_eq!(*told.lock().unwrap(), [(1, true), (2, false), (3, true), (4, true)]);
    }
}
