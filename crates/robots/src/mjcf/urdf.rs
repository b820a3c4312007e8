//! URDF: meshes of links.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashSet};
use std::path::PathBuf;

use roxmltree::Node;

use crate::mjcf::folder::Folder;
use crate::mjcf::splice::Splices;
use crate::mjcf::tree::{elements, lenient, line_at, name, parse};
use crate::mjcf::{MjcfError, Source};

/// Meshes by their names in the document.
#[derive(Debug, Default)]
struct Assets {
    names: BTreeMap<PathBuf, String>,
    /// Names in lower case, which MuJoCo may not distinguish.
    taken: HashSet<String>,
    files: BTreeMap<String, Vec<u8>>,
}

impl Assets {
    /// Reads a file, once, and returns its name: that of the file without its folder and without
    /// letters that mean something in XML or a path, with a number before it if another file has
    /// that name. MuJoCo drops the folders of meshes, so those of two files would be one.
    fn add(&mut self, path: PathBuf, folder: &mut Folder) -> Result<String, String> {
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
        while !self.taken.insert(unique.to_lowercase()) {
            number += 1;
            unique = format!("{number}_{file}");
        }
        self.files.insert(unique.clone(), bytes);
        own.insert(unique.clone());
        Ok(unique)
    }
}

/// The prefix of a path that begins with the name of a package.
const PACKAGE: &str = "package://";

/// Reads the meshes of a URDF document. Those that are only seen may be missing: MuJoCo discards
/// them unless the document says otherwise.
pub(crate) fn collect(file: &str, text: &str, folder: &mut Folder) -> Result<Source, MjcfError> {
    let lenient = lenient(text);
    let document = parse(&lenient, file)?;
    let error = |at: usize, message: String| MjcfError::new(file, Some(line_at(text, at)), message);
    let mut splices = Splices::default();
    let mut meshdir = String::new();
    for part in document.descendants().filter(Node::is_element) {
        if part.tag_name().namespace().is_some_and(|space| space.contains("xacro")) {
            return Err(error(
                part.range().start,
                "this is a xacro file; expand it with `xacro` before".to_string(),
            ));
        }
    }
    for extension in elements(document.root_element()).filter(|node| name(*node) == "mujoco") {
        for compiler in elements(extension).filter(|node| name(*node) == "compiler") {
            for attribute in compiler.attributes() {
                match attribute.name() {
                    "meshdir" | "assetdir" => {
                        meshdir = format!("{}/", attribute.value().trim_end_matches('/'));
                    }
                    "texturedir" => {}
                    _ => continue,
                }
                splices.replace(attribute.range(), "");
            }
        }
    }
    let mut assets = Assets::default();
    for mesh in document.descendants().filter(|node| name(*node) == "mesh") {
        let Some(attribute) = mesh.attribute_node("filename") else { continue };
        let at = attribute.range().start;
        let path = attribute.value().replace('\\', "/");
        let mut candidates = candidates(&path, &meshdir, folder.allows_outside());
        candidates.extend(folder.in_ancestor(path.strip_prefix(PACKAGE).unwrap_or_default()));
        let found = candidates.iter().find_map(|name| folder.find(name).transpose()).transpose();
        match found.map_err(|message| error(at, message))? {
            Some(path) => {
                let unique = assets.add(path, folder).map_err(|reason| error(at, reason))?;
                splices.replace(attribute.range_value(), unique);
            }
            None if mesh.ancestors().any(|node| name(node) == "visual") => {}
            None => {
                let above = if path.starts_with(PACKAGE) && !folder.allows_outside() {
                    "; if files outside the folder are allowed, the package is looked up above it, too"
                } else {
                    ""
                };
                return Err(error(at, format!("found no file `{}`{above}", candidates.join("`, no `"))));
            }
        }
    }
    Ok(Source { document: splices.apply(text), assets: assets.files })
}

/// Returns where a mesh may be, relative to the folder of the document: where MuJoCo looks, and in
/// a package that the folder belongs to.
fn candidates(path: &str, meshdir: &str, allow_outside: bool) -> Vec<String> {
    let path = path.strip_prefix("file://").unwrap_or(path);
    let Some(in_packages) = path.strip_prefix(PACKAGE) else {
        let base = path.rsplit('/').next().unwrap_or(path);
        return vec![format!("{meshdir}{base}"), format!("{meshdir}{path}"), path.to_string()];
    };
    let in_package = in_packages.split_once('/').map_or(in_packages, |(_, rest)| rest);
    let base = path.rsplit('/').next().unwrap_or(path);
    let mut all = vec![
        format!("{meshdir}{base}"),
        format!("{meshdir}{in_packages}"),
        in_packages.to_string(),
        in_package.to_string(),
    ];
    if allow_outside {
        // The document is usually in the folder `urdf` of its package.
        all.extend([format!("../{in_package}"), format!("../{in_packages}"), format!("../../{in_packages}")]);
    }
    all
}
