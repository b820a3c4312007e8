//! One document from a file and the files that it includes.

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use crate::mjcf::MjcfError;
use crate::mjcf::folder::Folder;
use crate::mjcf::tree::{inner, line_at, name as name_of, parse};

/// The largest depth of includes.
const DEPTH: usize = 32;

/// A document, and where its parts are from.
#[derive(Debug)]
pub(crate) struct Composed {
    pub(crate) document: String,
    pieces: Vec<Piece>,
    files: Vec<File>,
}

#[derive(Debug)]
struct File {
    /// Path for messages.
    name: String,
    /// Folder relative to that of the main file, empty or with a slash at its end.
    folder: String,
    text: Rc<str>,
}

/// A part of the document that begins at `start` and is from byte `from` of a file on.
#[derive(Debug)]
struct Piece {
    start: usize,
    file: usize,
    from: usize,
}

impl Composed {
    /// Reads the includes of a text of MJCF.
    pub(crate) fn new(path: &Path, text: String, folder: &mut Folder) -> Result<Composed, MjcfError> {
        let name = path.display().to_string();
        let main = File { name, folder: String::new(), text: text.into() };
        let length = main.text.len();
        let composed = Composed { document: String::new(), pieces: Vec::new(), files: vec![main] };
        let mut composer = Composer { composed, folder, included: path.canonicalize().into_iter().collect() };
        composer.append(0, 0..length, 0)?;
        Ok(composer.composed)
    }

    /// Makes an error about a byte of the document.
    pub(crate) fn error(&self, at: usize, message: impl Into<String>) -> MjcfError {
        let (file, from) = self.origin(at);
        MjcfError::new(&file.name, Some(line_at(&file.text, from)), message)
    }

    /// Returns the folder of the file that a byte of the document is from, relative to that of the
    /// main file.
    pub(crate) fn folder_at(&self, at: usize) -> &str {
        &self.origin(at).0.folder
    }

    fn origin(&self, at: usize) -> (&File, usize) {
        let index = self.pieces.partition_point(|piece| piece.start <= at).saturating_sub(1);
        let piece = &self.pieces[index];
        (&self.files[piece.file], piece.from + at - piece.start)
    }
}

struct Composer<'a> {
    composed: Composed,
    folder: &'a mut Folder,
    included: HashSet<PathBuf>,
}

impl Composer<'_> {
    /// Appends a part of a file, with its includes.
    fn append(&mut self, file: usize, part: Range<usize>, depth: usize) -> Result<(), MjcfError> {
        let text = self.composed.files[file].text.clone();
        let name = self.composed.files[file].name.clone();
        let document = parse(&text, &name)?;
        let error = |at: usize, message: String| MjcfError::new(&name, Some(line_at(&text, at)), message);
        let mut from = part.start;
        let within = |at: usize| part.contains(&at);
        let includes = document.descendants().filter(|node| within(node.range().start));
        for include in includes.filter(|node| name_of(*node) == "include") {
            let range = include.range();
            self.copy(file, from..range.start, &text);
            from = range.end;
            let Some(target) = include.attribute("file") else {
                return Err(error(range.start, "an include needs the attribute `file`".to_string()));
            };
            if depth == DEPTH {
                return Err(error(range.start, format!("includes are nested more than {DEPTH} deep")));
            }
            let target = target.replace('\\', "/");
            let candidates = [target.clone(), format!("{}{target}", self.composed.files[file].folder)];
            let found = self.folder.find(&candidates).map_err(|message| error(range.start, message))?;
            let Some((number, path)) = found else {
                return Err(error(range.start, format!("the included file `{target}` does not exist")));
            };
            if !self.included.insert(path.clone()) {
                return Err(error(
                    range.start,
                    format!("`{target}` is included a second time; MuJoCo includes a file once"),
                ));
            }
            let bytes = self.folder.read(&path);
            let bytes =
                bytes.map_err(|reason| error(range.start, format!("cannot read `{target}`: {reason}")))?;
            let text = String::from_utf8(bytes)
                .map_err(|_| error(range.start, format!("`{target}` is not UTF-8 text")))?;
            self.include(&candidates[number], text, depth + 1)?;
        }
        self.copy(file, from..part.end, &text);
        Ok(())
    }

    /// Appends what the root element of an included file contains.
    fn include(&mut self, target: &str, text: String, depth: usize) -> Result<(), MjcfError> {
        let part = inner(parse(&text, target)?.root_element()).unwrap_or(0..0);
        let folder = target.rfind('/').map_or(String::new(), |slash| target[..=slash].to_string());
        self.composed.files.push(File { name: target.to_string(), folder, text: text.into() });
        self.append(self.composed.files.len() - 1, part, depth)
    }

    fn copy(&mut self, file: usize, part: Range<usize>, text: &str) {
        let start = self.composed.document.len();
        self.composed.pieces.push(Piece { start, file, from: part.start });
        self.composed.document.push_str(&text[part]);
    }
}
