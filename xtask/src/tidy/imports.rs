//! The paths that a Rust file takes from the root of its crate: what it imports from other modules.

/// A path in the code of a file, from the root of the crate.
#[derive(Debug, PartialEq, Eq)]
pub struct Import {
    /// Line, from 1.
    pub line: usize,
    /// Names of modules and of the imported item.
    pub path: Vec<String>,
    /// Whether the code writes it from `crate`, not from `super`.
    pub is_absolute: bool,
}

/// Returns the paths of the file of `module` that start with `crate` or `super`, also within groups
/// of `use`. Comments and the module of tests at the end of a file do not count, as dependencies of
/// tests do not count for a crate.
pub fn imports(module: &[&str], text: &str) -> Vec<Import> {
    let code = code(text);
    let mut found = Vec::new();
    for (start, root) in code.match_indices("crate::").chain(code.match_indices("super::")) {
        let is_continued = |c: char| c.is_alphanumeric() || matches!(c, '_' | ':' | '$');
        if code[..start].ends_with(is_continued) {
            continue;
        }
        let mut rest = &code[start..];
        let mut base = module;
        if root == "crate::" {
            base = &[];
            rest = &rest[root.len()..];
        }
        while let Some(above) = rest.strip_prefix("super::") {
            base = base.split_last().map_or(base, |(_, above)| above);
            rest = above;
        }
        let line = 1 + code[..start].matches('\n').count();
        let base: Vec<String> = base.iter().map(ToString::to_string).collect();
        let mut paths = Vec::new();
        expand(rest, base, &mut paths);
        let is_absolute = root == "crate::";
        found.extend(paths.into_iter().map(|path| Import { line, path, is_absolute }));
    }
    found
}

/// Returns the module of a file whose path starts at the folder of the crate's sources:
/// `run/mod.rs` and `run.rs` are `run`.
pub fn module(path: &str) -> Vec<&str> {
    let parts = path.strip_suffix(".rs").unwrap_or(path).split('/');
    let mut parts: Vec<&str> = parts.collect();
    if parts.last() == Some(&"mod") {
        parts.pop();
    }
    parts
}

/// Returns the text with empty lines instead of comments, up to the module of tests.
fn code(text: &str) -> String {
    let end = text.find("\n#[cfg(test)]\nmod tests {").unwrap_or(text.len());
    let is_code = |line: &&str| !line.trim_start().starts_with("//");
    text[..end].lines().map(|line| Some(line).filter(is_code).unwrap_or_default().to_owned() + "\n").collect()
}

/// Adds the paths of a tree of names, such as `a::b` or `{a, b::{c, d}}`, below `base`.
fn expand(tree: &str, mut base: Vec<String>, paths: &mut Vec<Vec<String>>) {
    let tree = tree.trim_start();
    if let Some(group) = tree.strip_prefix('{') {
        items(group).into_iter().for_each(|item| expand(item, base.clone(), paths));
        return;
    }
    let end = tree.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(tree.len());
    let (name, rest) = tree.split_at(end);
    if !name.is_empty() && name != "self" {
        base.push(name.to_owned());
    }
    match rest.strip_prefix("::") {
        Some(rest) => expand(rest, base, paths),
        None => paths.push(base),
    }
}

/// Returns the items of a group up to its closing brace.
fn items(group: &str) -> Vec<&str> {
    let mut depth = 0;
    let mut start = 0;
    let mut items = Vec::new();
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            '}' | ',' if depth == 0 => {
                items.push(&group[start..at]);
                start = at + 1;
            }
            _ => {}
        }
        if c == '}' && start == at + 1 {
            break;
        }
    }
    items.retain(|item| !item.trim().is_empty());
    items
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(path: &str, text: &str, expected: &[(usize, &str)]) {
        let found: Vec<_> = imports(&module(path), text)
            .into_iter()
            .map(|import| (import.line, import.path.join("::")))
            .collect();
        let expected: Vec<_> = expected.iter().map(|(line, path)| (*line, (*path).to_owned())).collect();
        assert_eq!(found, expected, "{text}");
    }

    #[test]
    fn groups_are_expanded_to_single_paths() {
        check(
            "run/mod.rs",
            "use crate::plan::{Plan, read::{self, Key}};\nlet x = crate::build();\n",
            &[(1, "plan::Plan"), (1, "plan::read"), (1, "plan::read::Key"), (2, "build")],
        );
        check(
            "run/mod.rs",
            "use crate::{\n    plan::{A},\n    run,\n};\nuse x::crate_y;",
            &[(1, "plan::A"), (1, "run")],
        );
    }

    #[test]
    fn paths_from_super_start_at_the_module_of_the_file() {
        check("run/mod.rs", "use super::plan::Plan;", &[(1, "plan::Plan")]);
        check("run.rs", "use super::plan::Plan;", &[(1, "plan::Plan")]);
        check("run/a.rs", "use super::b::B;\nuse super::super::plan;", &[(1, "run::b::B"), (2, "plan")]);
        check("run/a/b.rs", "fn f() { super::c() }", &[(1, "run::a::c")]);
    }

    #[test]
    fn comments_and_tests_do_not_count() {
        let text = "//! See crate::run.\n/// [a](crate::run::a)\nfn f() {}\n\n#[cfg(test)]\nmod tests {\n    use crate::run;\n}\n";
        check("plan/mod.rs", text, &[]);
        check("plan/mod.rs", "macro_rules! m { () => { $crate::run::x() } }", &[]);
    }
}
