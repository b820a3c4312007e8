//! The parent: starts the child, sends it a model and waits for its answer.

use std::collections::HashSet;
use std::ffi::OsString;
use std::hash::{BuildHasher, RandomState};
use std::io::{Read, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::Task;
use super::child::{CPU_SECONDS, MEMORY_GIB};
use super::message::{Answer, given, request, take_question};
use crate::{Assets, Open, Visuals, WorldError};

/// Time of a trial. The child's limit of processor time comes before, unless the machine is busy.
const TIME: Duration = Duration::from_secs(120);

/// The largest size of an answer or a question, bytes.
const LARGEST: usize = 1 << 16;

/// Hashes of models that a child of this process has tried: a command resolves a plan several
/// times.
static TRIED: LazyLock<Mutex<HashSet<[u64; 2]>>> = LazyLock::new(Mutex::default);

/// Random in each process, so that no file can be made to have the hash of another one.
static HASHERS: LazyLock<[RandomState; 2]> = LazyLock::new(|| [RandomState::new(), RandomState::new()]);

fn key(task: Task, xml: &str, assets: &Assets) -> [u64; 2] {
    HASHERS.each_ref().map(|hasher| hasher.hash_one((task, xml, assets)))
}

fn insert(keys: impl IntoIterator<Item = [u64; 2]>) {
    TRIED.lock().unwrap_or_else(PoisonError::into_inner).extend(keys);
}

/// Remembers that a child has compiled a model with these files for pictures and for physics.
pub fn remember(xml: &str, assets: &Assets) {
    insert([Visuals::Keep, Visuals::Discard].map(|visuals| key(Task::Simulate(visuals), xml, assets)));
}

/// Tries a model in a child process of this program; does nothing without a program.
///
/// # Errors
/// If MuJoCo rejects the model, or it ends or blocks the child.
pub fn try_in_child(
    program: Option<&Vec<OsString>>,
    task: Task,
    xml: &str,
    assets: &Assets,
) -> Result<(), WorldError> {
    let Some(program) = program else { return Ok(()) };
    let key = key(task, xml, assets);
    if TRIED.lock().unwrap_or_else(PoisonError::into_inner).contains(&key) {
        return Ok(());
    }
    converse(program, task, xml, &mut |name| assets.get(name).cloned())?;
    insert([key]);
    Ok(())
}

/// Sends a document to a new child, answers its questions for files, and waits for its answer.
///
/// # Errors
/// As for [`try_in_child`].
pub fn converse(program: &[OsString], task: Task, xml: &str, open: &mut Open<'_>) -> Result<(), WorldError> {
    let [program, arguments @ ..] = program else { return Ok(()) };
    let mut command = Command::new(program);
    // Names in the working directory mean nothing to the child.
    command.args(arguments).current_dir(if cfg!(unix) { "/" } else { "." });
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let child = command.spawn().map_err(|error| {
        WorldError::Untried(format!("cannot start {}: {error}", program.to_string_lossy()))
    })?;
    match answered(child, request(task, xml), open)? {
        Answer::Usable => Ok(()),
        Answer::Rejected(message) => Err(WorldError::Model(message)),
        Answer::Fatal(message) => {
            Err(WorldError::Hostile(format!("a fatal error of MuJoCo: {}", message.trim())))
        }
    }
}

/// A message of a child.
enum Written {
    Question(String),
    /// Its last words.
    End(String),
}

/// Sends a request to a child, answers its questions and returns its answer.
fn answered(mut child: Child, request: Vec<u8>, open: &mut Open<'_>) -> Result<Answer, WorldError> {
    let (Some(mut stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(WorldError::Untried("the child process has no input and output".to_string()));
    };
    let answer = std::thread::scope(|scope| {
        let (to_child, messages) = channel::<Vec<u8>>();
        // A child that ends early closes its input; its end says why.
        scope.spawn(move || messages.iter().try_for_each(|message| stdin.write_all(&message)));
        let (sender, written) = channel();
        scope.spawn(move || listen(stdout, &sender));
        let _ = to_child.send(request);
        let start = Instant::now();
        loop {
            match written.recv_timeout(TIME.saturating_sub(start.elapsed())) {
                Ok(Written::Question(name)) => drop(to_child.send(given(open(&name)))),
                Ok(Written::End(text)) => break Some(text),
                Err(_) => {
                    let _ = child.kill();
                    break None;
                }
            }
        }
    });
    let status = child.wait().map_err(|error| WorldError::Untried(error.to_string()))?;
    let Some(answer) = answer else {
        return Err(WorldError::Hostile(format!("it takes more than {} s", TIME.as_secs())));
    };
    Answer::read(&answer).ok_or_else(|| end(status))
}

/// Passes on the questions of a child, and what it writes after them until its end.
fn listen(mut stdout: impl Read, to: &Sender<Written>) {
    let mut written = Vec::new();
    let mut part = [0; 4096];
    // A parent that waits no longer hears nothing.
    while let Ok(length @ 1..) = stdout.read(&mut part) {
        written.extend(&part[..length]);
        while let Some(name) = take_question(&mut written) {
            let _ = to.send(Written::Question(name));
        }
        if written.len() > LARGEST {
            break;
        }
    }
    let _ = to.send(Written::End(String::from_utf8_lossy(&written).into_owned()));
}

/// Describes the end of a child without an answer.
fn end(status: ExitStatus) -> WorldError {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        use rustix::process::Signal;
        let is = |known: Signal| signal == known.as_raw();
        return if is(Signal::INT) || is(Signal::TERM) || is(Signal::HUP) {
            WorldError::Untried(format!("signal {signal} ended the child process"))
        } else if is(Signal::XCPU) || is(Signal::KILL) {
            WorldError::Hostile(format!(
                "it takes more than {CPU_SECONDS} s of processor time, or the memory of the machine"
            ))
        } else {
            WorldError::Hostile(format!(
                "MuJoCo crashes with signal {signal}, or needs more than {MEMORY_GIB} GiB of memory"
            ))
        };
    }
    WorldError::Untried(format!("the child process ended with {status}"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn error(program: &[&str]) -> WorldError {
        let program = program.iter().map(OsString::from).collect();
        try_in_child(Some(&program), Task::Simulate(Visuals::Keep), "<mujoco/>", &Assets::new())
            .expect_err("the child ends without an answer")
    }

    #[test]
    fn each_end_of_a_child_without_an_answer_is_an_error_that_names_it() {
        let end = |signal: &str| error(&["sh", "-c", &format!("kill -{signal} $$")]).to_string();
        assert!(end("SEGV").contains("MuJoCo crashes with signal 11"), "{}", end("SEGV"));
        assert!(end("ABRT").contains("or needs more than 4 GiB of memory"), "{}", end("ABRT"));
        for signal in ["XCPU", "KILL"] {
            assert!(end(signal).contains("more than 60 s of processor time"), "{}", end(signal));
        }
        // Ctrl-C says nothing about the model.
        assert!(matches!(error(&["sh", "-c", "kill -INT $$"]), WorldError::Untried(_)));
        assert!(matches!(error(&["sh", "-c", "exit 3"]), WorldError::Untried(_)));
        assert!(matches!(error(&["/no/such/program"]), WorldError::Untried(_)));
    }

    #[test]
    fn a_fatal_error_has_the_text_of_mujoco() {
        let answer = Answer::Fatal("stack overflow".to_string()).text();
        let found = error(&["printf", "%s", &answer]).to_string();
        assert!(found.contains("a fatal error of MuJoCo: stack overflow"), "{found}");
    }
}
