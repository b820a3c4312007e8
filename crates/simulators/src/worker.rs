//! One running simulator.

use std::time::Duration;

use crate::process::{Failure, Peer, Program};

use crate::answer::{self, Answer, Asked, AskedKind};
use crate::hello::{self, Hello, NoHello, PROTOCOL};

/// Time limit of the first answer: starting MATLAB or compiling a model takes its time.
const HELLO_LIMIT: Duration = Duration::from_secs(120);

/// A running simulator. It answers one question at a time; after a failure it is dropped, so that a
/// late answer is never read.
pub(crate) struct SimulatorProcess {
    peer: Peer,
    /// Number of the last question.
    id: u64,
    line: String,
}

/// Why a process has no description.
pub(crate) enum NoStart {
    Failed(Failure),
    Refused(String),
    Malformed(String),
}

impl SimulatorProcess {
    /// Starts the program and asks who it is.
    pub(crate) fn start(program: &Program) -> Result<(SimulatorProcess, Hello), NoStart> {
        let mut peer = Peer::start(program).map_err(NoStart::Failed)?;
        let question = format!("{{\"id\":1,\"type\":\"hello\",\"protocol\":{PROTOCOL}}}");
        let text = peer.ask(&question, HELLO_LIMIT).map_err(NoStart::Failed)?;
        let hello = hello::read(&text, 1).map_err(|why| match why {
            NoHello::Refused(text) => NoStart::Refused(answer::kept(&text)),
            NoHello::Malformed(problem) => NoStart::Malformed(problem),
        })?;
        Ok((SimulatorProcess { peer, id: 1, line: String::new() }, hello))
    }

    /// Asks a question of this type; `write` appends its other keys.
    ///
    /// # Errors
    /// If the program does not answer, or with something else. It is not asked again then.
    pub(crate) fn ask(
        &mut self,
        kind: &str,
        write: impl FnOnce(&mut String),
        signals: &[String],
        asked: AskedKind,
        limit: Duration,
    ) -> Result<Answer, Failure> {
        self.id += 1;
        self.line.clear();
        self.line.push_str(&format!("{{\"id\":{},\"type\":\"{kind}\"", self.id));
        write(&mut self.line);
        self.line.push('}');
        let text = self.peer.ask(&self.line, limit)?;
        answer::read(&text, Asked { id: self.id, signals, kind: asked })
            .map_err(|what| Failure::Malformed { what, stderr: self.peer.stderr() })
    }

    /// Asks a question of a type that does not exist, and returns its number and the line of the
    /// answer.
    pub(crate) fn ask_unknown(&mut self, limit: Duration) -> Result<(u64, String), Failure> {
        self.id += 1;
        let line = format!("{{\"id\":{},\"type\":\"does-not-exist\"}}", self.id);
        Ok((self.id, self.peer.ask(&line, limit)?))
    }

    /// Returns the program behind it.
    pub(crate) fn into_peer(self) -> Peer {
        self.peer
    }

    /// Returns whether the program has written something since its last answer.
    pub(crate) fn has_unread(&mut self) -> bool {
        self.peer.has_unread()
    }
}
