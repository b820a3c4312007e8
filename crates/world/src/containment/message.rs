//! Requests of the parent and answers of the child.

use std::io::{Read, Write};

use super::Task;
use crate::{Assets, WorldError};

/// Begins the answer on the child's output. A program may print other text before it.
const ANSWER: &str = "\u{2}mishandle model ";

/// The largest size of a request, bytes: twice that of all files of a model.
const LARGEST: u64 = 1 << 30;

/// Writes a request: the task, the document, and name and content of each file.
pub fn write_request(to: &mut impl Write, task: Task, xml: &str, assets: &Assets) -> std::io::Result<()> {
    let task = match task {
        Task::Simulate => "simulate",
        Task::Convert => "convert",
    };
    let files = assets.iter().flat_map(|(name, bytes)| [name.as_bytes(), bytes.as_slice()]);
    for part in [task.as_bytes(), xml.as_bytes()].into_iter().chain(files) {
        to.write_all(&(part.len() as u64).to_le_bytes())?;
        to.write_all(part)?;
    }
    to.flush()
}

/// Reads a request; `None` if it is incomplete, because the parent has ended.
pub fn read_request(from: &mut impl Read) -> Option<(Task, String, Assets)> {
    let mut bytes = Vec::new();
    from.take(LARGEST).read_to_end(&mut bytes).ok()?;
    let mut rest = bytes.as_slice();
    let mut part = || {
        let (length, after) = rest.split_first_chunk::<8>()?;
        let (part, after) = after.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        rest = after;
        Some(part)
    };
    let task = match part()? {
        b"simulate" => Task::Simulate,
        b"convert" => Task::Convert,
        _ => return None,
    };
    let xml = String::from_utf8(part()?.to_vec()).ok()?;
    let mut assets = Assets::new();
    while let Some(name) = part() {
        assets.insert(String::from_utf8(name.to_vec()).ok()?, part()?.to_vec());
    }
    Some((task, xml, assets))
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
    fn a_request_and_an_answer_survive_the_way() {
        let assets = Assets::from([("a.stl".to_string(), vec![0, 255]), (String::new(), Vec::new())]);
        for task in [Task::Simulate, Task::Convert] {
            let mut bytes = Vec::new();
            write_request(&mut bytes, task, "<mujoco/>", &assets).unwrap();
            let read = read_request(&mut bytes.as_slice()).unwrap();
            assert_eq!(read, (task, "<mujoco/>".to_string(), assets.clone()));
            // A parent that ends early leaves a part.
            assert_eq!(read_request(&mut &bytes[..9]), None);
        }
        for answer in
            [Answer::Usable, Answer::Rejected("line 3\nx".to_string()), Answer::Fatal(String::new())]
        {
            assert_eq!(Answer::read(&format!("running 1 test\n{}", answer.text())), Some(answer));
        }
        assert_eq!(Answer::read("running 1 test\n"), None);
    }
}
