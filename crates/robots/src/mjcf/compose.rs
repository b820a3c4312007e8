//! One text of a document and the documents that it includes, as edits see it.

use std::collections::HashSet;
use std::ops::Range;

use crate::mjcf::source::decoded;
use crate::mjcf::splice::Splices;
use crate::mjcf::tree::{inner, lenient, name, parse};
use crate::mjcf::{MjcfError, Source};

/// A composed text, and where its parts are from.
#[derive(Debug, Default)]
pub(crate) struct Composed {
    pub(crate) text: String,
    pieces: Vec<Piece>,
    /// Names and texts of the files. That of the document is empty.
    files: Vec<(String, String)>,
}

/// A part of the text that begins at `start` and is from byte `from` of a file on.
#[derive(Debug)]
struct Piece {
    start: usize,
    file: usize,
    from: usize,
}

impl Composed {
    /// Replaces the includes of a document by what their root elements contain. MuJoCo has parsed
    /// it, so each file is there and is included once.
    pub(crate) fn new(source: &Source) -> Result<Composed, MjcfError> {
        let mut composed = Composed::default();
        composed.append(String::new(), &source.document, source, &mut HashSet::new())?;
        Ok(composed)
    }

    /// Applies replacements to the files that the replaced parts are from.
    pub(crate) fn apply(self, splices: Splices, source: &mut Source) {
        let mut of_files: Vec<Splices> = self.files.iter().map(|_| Splices::default()).collect();
        for (range, text) in splices.into_parts() {
            let piece = self.pieces.partition_point(|piece| piece.start <= range.start).saturating_sub(1);
            let Piece { start, file, from } = self.pieces[piece];
            of_files[file].replace(range.start - start + from..range.end - start + from, text);
        }
        for ((name, text), splices) in self.files.into_iter().zip(of_files) {
            let edited = splices.apply(&text);
            if name.is_empty() {
                source.document = edited;
            } else if edited != text {
                source.assets.insert(name, edited.into_bytes());
            }
        }
    }

    /// Appends a file, with its includes.
    fn append(
        &mut self,
        own: String,
        text: &str,
        source: &Source,
        included: &mut HashSet<String>,
    ) -> Result<(), MjcfError> {
        let lenient = lenient(text);
        let document = parse(&lenient, &own)?;
        let part = if own.is_empty() { Some(0..text.len()) } else { inner(document.root_element()) };
        let part = part.unwrap_or(0..0);
        let folder = own.rfind('/').map_or("", |slash| &own[..=slash]).to_string();
        let file = self.files.len();
        self.files.push((own, text.to_string()));
        let mut from = part.start;
        let within = document.descendants().filter(|node| part.contains(&node.range().start));
        for include in within.filter(|node| name(*node).eq_ignore_ascii_case("include")) {
            let range = include.range();
            self.copy(file, from..range.start, text);
            from = range.end;
            let target = include.attribute("file").unwrap_or_default();
            let candidates = [reduced(target), reduced(&format!("{folder}{target}"))];
            let found = candidates.into_iter().find_map(|name| {
                let bytes = source.assets.get(&name)?;
                Some((name, decoded(bytes).into_owned()))
            });
            if let Some((name, text)) = found.filter(|(name, _)| included.insert(name.clone())) {
                self.append(name, &text, source, included)?;
            }
        }
        self.copy(file, from..part.end, text);
        Ok(())
    }

    fn copy(&mut self, file: usize, part: Range<usize>, text: &str) {
        self.pieces.push(Piece { start: self.text.len(), file, from: part.start });
        self.text.push_str(&text[part]);
    }
}

/// Returns a path without `.` and without `..` after a folder, as MuJoCo does.
fn reduced(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split(['/', '\\']) {
        match part {
            "." => {}
            ".." if parts.last().is_some_and(|last| !matches!(*last, ".." | "")) => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.join("/")
}
