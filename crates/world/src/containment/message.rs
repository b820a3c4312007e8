//! Messages between parent and child.

use std::io::{Read, Write};

use super::Task;
use crate::{Visuals, WorldError};

/// Begins the answer on the child's output. A program may print other text before it.
const ANSWER: &str = "\u{2}mishandle model ";

/// The largest part of a message, bytes: more than a file of a model may have.
const LARGEST: u64 = 1 << 30;

/// Begins a question, which ends with the name of a file.
const ASK: &str = "ask ";

fn push_part(to: &mut Vec<u8>, part: &[u8]) {
    to.extend((part.len() as u64).to_le_bytes());
    to.extend(part);
}

fn read_part(from: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut length = [0; 8];
    from.read_exact(&mut length)?;
    let length = u64::from_le_bytes(length);
    let mut part = Vec::new();
    from.take(length.min(LARGEST)).read_to_end(&mut part)?;
    if part.len() as u64 == length { Ok(part) } else { Err(std::io::ErrorKind::UnexpectedEof.into()) }
}

/// Returns the request: the task and the document.
pub fn request(task: Task, xml: &str) -> Vec<u8> {
    let mut bytes = vec![match task {
        Task::Parse => b'p',
        Task::Read => b'r',
        Task::Simulate(Visuals::Keep) => b'k',
        Task::Simulate(Visuals::Discard) => b'd',
        Task::Convert => b'c',
    }];
    push_part(&mut bytes, xml.as_bytes());
    bytes
}

/// Reads a request; `None` if it is incomplete, because the parent has ended.
pub fn read_request(from: &mut impl Read) -> Option<(Task, String)> {
    let mut task = [0];
    from.read_exact(&mut task).ok()?;
    let task = match &task {
        b"p" => Task::Parse,
        b"r" => Task::Read,
        b"k" => Task::Simulate(Visuals::Keep),
        b"d" => Task::Simulate(Visuals::Discard),
        b"c" => Task::Convert,
        _ => return None,
    };
    Some((task, String::from_utf8(read_part(from).ok()?).ok()?))
}

/// Asks the parent for a file; `None` if it is refused.
pub fn ask(name: &str, from: &mut impl Read, to: &mut impl Write) -> std::io::Result<Option<Vec<u8>>> {
    to.write_all(format!("{ANSWER}{ASK}{}\n{name}", name.len()).as_bytes())?;
    to.flush()?;
    let mut is_given = [0];
    from.read_exact(&mut is_given)?;
    if is_given == [1] { read_part(from).map(Some) } else { Ok(None) }
}

/// Returns the answer to a question.
pub fn given(content: Option<Vec<u8>>) -> Vec<u8> {
    let Some(content) = content else { return vec![0] };
    let mut bytes = vec![1];
    push_part(&mut bytes, &content);
    bytes
}

/// Takes the first complete question from what a child has written and returns the name of the
/// file. Other text before it is dropped.
pub fn take_question(written: &mut Vec<u8>) -> Option<String> {
    let start = [ANSWER, ASK].concat().into_bytes();
    let at = written.windows(start.len()).position(|window| window == start)? + start.len();
    let line = written[at..].iter().position(|byte| *byte == b'\n')? + at;
    let length: usize = std::str::from_utf8(&written[at..line]).ok()?.parse().ok()?;
    let name = written.get(line + 1..line.checked_add(1)?.checked_add(length)?)?;
    let name = String::from_utf8_lossy(name).into_owned();
    written.drain(..line + 1 + length);
    Some(name)
}

/// The result of a trial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The model can be used.
    Usable,
    /// MuJoCo rejects the document.
    Rejected(String),
    /// A fatal error of MuJoCo.
    Fatal(String),
}

impl Answer {
    pub fn of(result: Result<(), WorldError>) -> Answer {
        match result {
            Ok(()) => Answer::Usable,
            Err(WorldError::Model(message)) => Answer::Rejected(message),
            Err(error) => Answer::Rejected(error.to_string()),
        }
    }

    pub fn text(&self) -> String {
        let (word, message) = match self {
            Answer::Usable => ("usable", ""),
            Answer::Rejected(message) => ("rejected", message.as_str()),
            Answer::Fatal(message) => ("fatal", message.as_str()),
        };
        format!("{ANSWER}{word}\n{message}")
    }

    /// Reads the last answer in a text; `None` without one.
    pub fn read(text: &str) -> Option<Answer> {
        let (_, answer) = text.rsplit_once(ANSWER)?;
        let (word, message) = answer.split_once('\n')?;
        match word {
            "usable" => Some(Answer::Usable),
            "rejected" => Some(Answer::Rejected(message.to_string())),
            "fatal" => Some(Answer::Fatal(message.to_string())),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_survive_the_way() {
        let tasks =
            [Task::Parse, Task::Read, Task::Simulate(Visuals::Keep), Task::Simulate(Visuals::Discard)];
        for task in tasks.into_iter().chain([Task::Convert]) {
            let bytes = request(task, "<mujoco/>");
            assert_eq!(read_request(&mut bytes.as_slice()), Some((task, "<mujoco/>".to_string())));
            // A parent that ends early leaves a part.
            assert_eq!(read_request(&mut &bytes[..9]), None);
        }
        for content in [None, Some(Vec::new()), Some(vec![0, 255])] {
            let mut asked = b"running 1 test\n".to_vec();
            let found = ask("a\n.stl", &mut given(content.clone()).as_slice(), &mut asked).unwrap();
            assert_eq!(found, content);
            let mut part = asked[..asked.len() - 1].to_vec();
            assert_eq!(take_question(&mut part), None);
            asked.extend(b"rest");
            assert_eq!(
                (take_question(&mut asked).as_deref(), asked.as_slice()),
                (Some("a\n.stl"), &b"rest"[..])
            );
        }
        for answer in
            [Answer::Usable, Answer::Rejected("line 3\nx".to_string()), Answer::Fatal(String::new())]
        {
            assert_eq!(Answer::read(&format!("running 1 test\n{}", answer.text())), Some(answer));
        }
        assert_eq!(Answer::read("running 1 test\n"), None);
    }
}
