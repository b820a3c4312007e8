//! A program in a process group of its own, which does not outlive its owner.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

use crate::process::Failure;

/// A program to start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// The program and its arguments. A program without `/` is looked up in `PATH`.
    pub words: Vec<String>,
    /// Working directory.
    pub folder: PathBuf,
}

/// Ends the process group of a program as soon as its input ends: as soon as this process does,
/// however it ends.
const WATCH: &str = "read -r _; kill -s KILL -- \"-$1\"";

/// A running program. Dropping it ends its process group.
pub struct Job {
    pub(crate) child: Child,
    watcher: Child,
    /// Whether it is reaped: its number may belong to another program.
    is_over: bool,
}

impl Job {
    /// Starts a program in a process group of its own, so that Ctrl-C reaches it only through this
    /// process. `streams` are its standard input, output and error.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(program: &Program, streams: [Stdio; 3]) -> Result<Job, Failure> {
        let failed = |source: std::io::Error| {
            // The system reports a missing folder as if it were the program.
            let source = if program.folder.is_dir() {
                source
            } else {
                std::io::Error::other(format!(
                    "its working folder {} does not exist",
                    program.folder.display()
                ))
            };
            Failure::start(program, source)
        };
        let mut command = Command::new(program.words.first().map_or("", String::as_str));
        command.args(program.words.iter().skip(1)).current_dir(&program.folder).process_group(0);
        let [stdin, stdout, stderr] = streams;
        let mut child = command.stdin(stdin).stdout(stdout).stderr(stderr).spawn().map_err(failed)?;
        let mut watch = Command::new("sh");
        watch.args(["-c", WATCH, "sh", &child.id().to_string()]).current_dir("/").process_group(0);
        watch.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        match watch.spawn() {
            Ok(watcher) => Ok(Job { child, watcher, is_over: false }),
            Err(_) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(failed(std::io::Error::other("no `sh` watches it")))
            }
        }
    }

    /// Waits until the program ends, at most `limit`, and leaves its status to be read. Returns
    /// whether it ended.
    pub fn wait(&self, limit: Duration) -> bool {
        let Some(pid) = self.pid() else { return true };
        let end = Instant::now() + limit;
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
        while let Ok(None) = waitid(WaitId::Pid(pid), options) {
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        true
    }

    /// Asks the program and its process group to end (SIGTERM), waits for it, at most `limit`, and
    /// then ends all of them.
    pub fn stop(mut self, limit: Duration) {
        self.signal(Signal::TERM);
        self.wait(limit);
        self.kill();
    }

    /// Returns the status of a program that has ended, and ends what is left of its process group.
    ///
    /// # Errors
    /// If the status cannot be read.
    pub fn status(mut self) -> std::io::Result<ExitStatus> {
        self.kill();
        self.child.wait()
    }

    /// Ends the program and its process group.
    pub(crate) fn kill(&mut self) {
        if !self.is_over {
            let _ = self.watcher.kill();
            let _ = self.watcher.wait();
            self.signal(Signal::KILL);
            let _ = self.child.wait();
            self.is_over = true;
        }
    }

    fn signal(&self, signal: Signal) {
        if let Some(group) = self.pid() {
            let _ = kill_process_group(group, signal);
        }
    }

    fn pid(&self) -> Option<Pid> {
        i32::try_from(self.child.id()).ok().and_then(Pid::from_raw)
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        self.kill();
    }
}
