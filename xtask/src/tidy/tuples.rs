//! Refuses functions that take a parameter apart as a tuple, `(a, b): (A, B)`, which hides how many
//! parameters there are. Closures may: they get the pairs of iterators.

use super::{Problem, Tree};

pub fn check(tree: &Tree) -> Vec<Problem> {
    let mut found = Vec::new();
    for file in tree.files.iter().filter(|file| file.path.ends_with(".rs")) {
        found.extend(functions(&file.text).into_iter().map(|(line, name)| Problem {
            path: file.path.clone(),
            line,
            what: format!("`{name}` takes a tuple apart: write two parameters, or a struct"),
        }));
    }
    found
}

/// Returns the functions that take a tuple apart, with their lines.
fn functions(text: &str) -> Vec<(usize, &str)> {
    let declared = text.match_indices("fn ").filter(|(at, _)| {
        let line = text[..*at].rsplit('\n').next().unwrap_or_default();
        !line.trim_start().starts_with("//") && !line.ends_with(char::is_alphanumeric)
    });
    let found = declared.filter_map(|(at, keyword)| {
        let rest = &text[at + keyword.len()..];
        let name = rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
        let declaration = &rest[name.len()..];
        (declaration.starts_with(['(', '<']) && takes_tuple_apart(declaration))
            .then(|| (1 + text[..at].matches('\n').count(), name))
    });
    found.collect()
}

/// Returns whether a parameter starts with a parenthesis. `declaration` starts after the name.
fn takes_tuple_apart(declaration: &str) -> bool {
    let mut depth = 0;
    let mut is_in_list = false;
    let mut starts = false;
    let mut before = ' ';
    for c in declaration.chars() {
        match c {
            '(' if starts => return true,
            '(' if depth == 0 => (is_in_list, starts, depth) = (true, true, 1),
            ',' if depth == 1 && is_in_list => starts = true,
            '(' | '[' | '<' => depth += 1,
            '>' if before == '-' => {}
            ')' | ']' | '>' => depth -= 1,
            _ => {}
        }
        if depth == 0 && (is_in_list || matches!(c, '{' | ';')) {
            return false;
        }
        starts &= matches!(c, '(' | ',' | '&') || c.is_whitespace();
        before = c;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_functions_that_take_tuples_apart_are_found() {
        let text = "f! a(&self, x: (u8, u8), y: Vec<(u8, u8)>) -> (u8, u8) {
    |(x, y)| f((x, y))
}
f! b<F: Fn((u8, u8)) -> u8>(f: F, x: HashMap<u8, (u8, u8)>, [y, z]: [u8; 2]);
// f! c((x, y): (u8, u8))
    f! d<const N: usize>(
        &self,
        (x, y): (u8, u8),
    ) {}
f! e(x: fn(u8, (u8, u8)), &(y, z): &(u8, u8)) {}"
            .replace("f!", "fn");
        assert_eq!(functions(&text), [(6, "d"), (10, "e")]);
    }

    #[test]
    fn each_function_is_a_problem_of_its_file() {
        let file = |parameters: &str| format!("fn a({parameters}) {{}}");
        let tree = [("a.rs", file("(x, y): (u8, u8)")), ("b.rs", file("x: u8, y: u8"))];
        let found = check(&Tree::of(&tree.each_ref().map(|(path, text)| (*path, &**text))));
        assert_eq!(found.len(), 1);
        assert!(found[0].path == "a.rs" && found[0].what.contains("`a`"));
    }
}
