//! Meshes, textures and other files that a document refers to.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;

use roxmltree::{Attribute, Document, Node};

use crate::mjcf::compose::Composed;
use crate::mjcf::folder::Folder;
use crate::mjcf::splice::{Splices, escape};
use crate::mjcf::tree::{after_name, name, parse};
use crate::mjcf::{MjcfError, Source};

/// Attributes of the compiler that say where assets are.
pub(crate) const FOLDERS: [&str; 4] = ["meshdir", "texturedir", "assetdir", "strippath"];

/// Elements that refer to files by attributes that begin with `file`, and the folder of each.
const REFERRING: [(&str, usize); 5] =
    [("mesh", 0), ("hfield", 0), ("skin", 0), ("flexcomp", 0), ("texture", 1)];

/// Files by their names in the document.
#[derive(Debug, Default)]
pub(crate) struct Assets {
    names: BTreeMap<PathBuf, String>,
    /// Names in lower case, which MuJoCo may not distinguish.
    taken: BTreeMap<String, usize>,
    pub(crate) files: BTreeMap<String, Vec<u8>>,
}

impl Assets {
    /// Reads a file, once, and returns its name: that of the file without its folder and without
    /// letters that mean something in XML or a path, with a number before it if another file has
    /// that name.
    pub(crate) fn add(&mut self, path: PathBuf, folder: &mut Folder) -> Result<String, String> {
        let own = match self.names.entry(path) {
            Entry::Occupied(known) => return Ok(known.get().clone()),
            Entry::Vacant(own) => own,
        };
        let bytes = folder.read(own.key())?;
        let file = own.key().file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let is_plain = |letter: char| letter.is_alphanumeric() || matches!(letter, '.' | '_' | '-' | ' ');
        let file: String = file.chars().map(|letter| if is_plain(letter) { letter } else { '_' }).collect();
        let mut unique = file.clone();
        let mut number = 1;
        while self.taken.contains_key(&unique.to_lowercase()) {
            number += 1;
            unique = format!("{number}_{file}");
        }
        self.taken.insert(unique.to_lowercase(), number);
        self.files.insert(unique.clone(), bytes);
        own.insert(unique.clone());
        Ok(unique)
    }
}

/// Reads the assets of a document, in which their names replace their paths.
pub(crate) fn collect(composed: &Composed, folder: &mut Folder) -> Result<Source, MjcfError> {
    let document = parse(&composed.document, "")?;
    refuse(&document).map_err(|(at, message)| composed.error(at, message))?;
    let mut splices = Splices::default();
    let folders = folders(&document, &mut splices);
    let mut assets = Assets::default();
    for node in document.descendants().filter(Node::is_element) {
        let own = REFERRING.iter().find(|(kind, _)| *kind == name(node));
        for attribute in node.attributes().filter(|attribute| is_file(node, attribute)) {
            let error = |message: String| composed.error(attribute.range().start, message);
            let Some((_, kind)) = own else {
                let message = format!("`{}` refers to a file, which is not supported there", name(node));
                return Err(error(message));
            };
            let file = folders.path(*kind, attribute.value());
            let beside = format!("{}{file}", composed.folder_at(node.range().start));
            let Some((_, path)) = folder.find(&[file.clone(), beside]).map_err(error)? else {
                return Err(error(format!("the file `{file}` does not exist")));
            };
            let unique = assets
                .add(path, folder)
                .map_err(|reason| error(format!("cannot read `{file}`: {reason}")))?;
            // MuJoCo names an asset without a name after its file.
            let names_asset = attribute.name() == "file" && name(node) != "flexcomp";
            if names_asset && stem(&file) != stem(&unique) && node.attribute("name").is_none() {
                splices.insert(after_name(node), format!(" name=\"{}\"", escape(stem(&file))));
            }
            splices.replace(attribute.range_value(), unique);
        }
    }
    Ok(Source { document: splices.apply(&composed.document), assets: assets.files })
}

/// Returns the name of a file without its folder and its ending.
fn stem(file: &str) -> &str {
    let base = file.rsplit('/').next().unwrap_or(file);
    base.rsplit_once('.').map_or(base, |(stem, _)| stem)
}

/// Returns whether an attribute refers to a file.
pub(crate) fn is_file(node: Node<'_, '_>, attribute: &Attribute<'_, '_>) -> bool {
    // Of a texture's six sides: fileup, fileleft.
    let kind = attribute.name();
    kind == "file" || (name(node) == "texture" && kind.starts_with("file"))
}

/// Returns where and why a document cannot be used.
pub(crate) fn refuse(document: &Document<'_>) -> Result<(), (usize, String)> {
    for node in document.descendants().filter(Node::is_element) {
        let reason = match name(node) {
            "plugin" | "extension" => "plugins run code and are not loaded; remove them from the model",
            "model" | "attach" => {
                "attached models are not supported; save the composed model with MuJoCo (mj_saveXML)"
            }
            "include" => "includes are not possible here",
            _ => continue,
        };
        return Err((node.range().start, reason.to_string()));
    }
    Ok(())
}

/// Where a document says that its assets are.
struct Folders {
    of: [String; 2],
    strip: bool,
}

impl Folders {
    /// Returns the path of a file relative to that of the main file.
    fn path(&self, kind: usize, file: &str) -> String {
        let file = file.replace('\\', "/");
        let file = if self.strip { file.rsplit('/').next().unwrap_or_default() } else { &file };
        match self.of[kind].as_str() {
            _ if file.starts_with('/') => file.to_string(),
            "" => file.to_string(),
            folder => format!("{}/{file}", folder.trim_end_matches('/')),
        }
    }
}

/// Returns the folders of a document, of which the last compiler counts, and removes them.
fn folders(document: &Document<'_>, splices: &mut Splices) -> Folders {
    let mut folders = Folders { of: [String::new(), String::new()], strip: false };
    for compiler in crate::mjcf::tree::sections(document, "compiler") {
        let value = |key: &str| compiler.attribute(key).map(|value| value.replace('\\', "/"));
        let both = value("assetdir");
        for (folder, key) in folders.of.iter_mut().zip(["meshdir", "texturedir"]) {
            if let Some(own) = value(key).or_else(|| both.clone()) {
                // The root folder stays one.
                *folder =
                    if own.starts_with('/') && own.trim_matches('/').is_empty() { "/.".into() } else { own };
            }
        }
        folders.strip = value("strippath").map_or(folders.strip, |value| value == "true");
        for attribute in compiler.attributes().filter(|attribute| FOLDERS.contains(&attribute.name())) {
            splices.replace(attribute.range(), "");
        }
    }
    folders
}
