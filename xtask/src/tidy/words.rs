//! Refuses the words of a front in the library: flags, commands and calls of Python in string
//! literals. Errors state facts, and the command line and Python word their remedies. Refuses code
//! that reads our own messages, too.

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};

use super::{File, Problem, Tree};

/// Files whose literals a front does not word, with the reasons.
const EXEMPT: [(&str, &str); 6] = [
    ("crates/evidence/src/readme.rs", "commands of other tools"),
    ("crates/report/src/map.rs", "a property of CSS"),
    ("crates/results/src/schema.rs", "headings of the reference of JSON documents"),
    ("crates/world/src/containment/message.rs", "the word that starts the child process"),
    ("src/harden/trainer.rs", "arguments that the trainer of a user reads"),
    ("src/train/plan.rs", "the command that controller files record"),
];

/// Words of Python or of the command line besides flags and commands.
const PHRASES: [&str; 2] = ["in Python", "the flag"];

/// Python that looks into a message.
const PYTHON_LOOKS: [&str; 8] =
    ["re.", " in str(", ".startswith(", ".endswith(", ".find(", ".split(", ".replace(", ".partition("];

/// Methods of a Rust text that look into a message.
const RUST_LOOKS: [&str; 8] = [
    ".contains(",
    ".starts_with(",
    ".ends_with(",
    ".strip_prefix(",
    ".strip_suffix(",
    ".find(",
    ".split(",
    ".replace(",
];

/// Files that read messages of other libraries: ONNX Runtime and `serde_json`.
const FOREIGN_MESSAGES: [&str; 2] =
    ["python/mishandle/policies/onnx_policies.py", "crates/logs/src/json_lines.rs"];

pub fn check(tree: &Tree) -> Vec<Problem> {
    let mut found = Vec::new();
    for file in &tree.files {
        if is_library(&file.path) {
            let names = literals(&file.text).into_iter().filter(|(_, text)| names_front(text));
            let problems: Vec<Problem> =
                names.map(|(line, text)| literal_problem(file, line, &text)).collect();
            let is_exempt = EXEMPT.iter().any(|(path, _)| *path == file.path);
            match (is_exempt, problems.is_empty()) {
                (true, true) => found.push(Problem {
                    path: file.path.clone(),
                    line: 1,
                    what: "names no flag; remove it from the lists in xtask/src/tidy/words.rs".to_owned(),
                }),
                (true, false) => {}
                (false, _) => found.extend(problems),
            }
        }
        found.extend(readings(file));
    }
    found
}

/// Returns whether a file is library code: of the root package or a crate below the fronts.
fn is_library(path: &str) -> bool {
    let source = path.strip_prefix("src/").or_else(|| {
        let (name, rest) = path.strip_prefix("crates/")?.split_once('/')?;
        rest.strip_prefix("src/").filter(|_| name != "cli")
    });
    let name = path.rsplit('/').next().unwrap_or(path);
    source.is_some() && name.ends_with(".rs") && name != "tests.rs" && !name.ends_with("_tests.rs")
}

fn literal_problem(file: &File, line: usize, text: &str) -> Problem {
    let shown: String = text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(60).collect();
    Problem {
        path: file.path.clone(),
        line,
        what: format!("`{shown}` is the command line's: state the fact, and return a `Remedy`"),
    }
}

/// Returns whether a literal names a flag, a command or a call of Python.
fn names_front(text: &str) -> bool {
    let after = |at: usize| text[at..].chars().next();
    let before = |at: usize| text[..at].chars().next_back();
    let is_flag = text.match_indices("--").any(|(at, dashes)| {
        after(at + dashes.len()).is_some_and(|next| next.is_ascii_lowercase() || next == '{')
            && before(at).is_none_or(|last| !last.is_ascii_alphanumeric() && last != '-' && last != '!')
    });
    let is_command = text
        .match_indices("mishandle ")
        .any(|(at, word)| after(at + word.len()).is_some_and(|next| next.is_ascii_lowercase()));
    let is_call = text.match_indices("mishandle.").any(|(at, word)| {
        let rest = &text[at + word.len()..];
        rest.starts_with(|next: char| next.is_ascii_lowercase())
            && rest
                .trim_start_matches(|next: char| next.is_ascii_alphanumeric() || next == '_')
                .starts_with(['(', '`'])
    });
    is_flag || is_command || is_call || PHRASES.iter().any(|phrase| text.contains(phrase))
}

/// Returns the string literals of Rust code with their first lines, up to the module of tests.
/// Comments are skipped, also those that document. Code that cannot be read has none, because it
/// does not compile either.
fn literals(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    add_literals(before_tests(text).parse().unwrap_or_default(), &mut found);
    found
}

fn add_literals(tokens: TokenStream, found: &mut Vec<(usize, String)>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) if !is_documentation(&group) => add_literals(group.stream(), found),
            TokenTree::Literal(literal) => {
                let written = literal.to_string();
                // A quotation mark as a character is the only one.
                if let (Some(first), Some(last)) = (written.find('"'), written.rfind('"'))
                    && first < last
                {
                    found.push((literal.span().start().line, written[first + 1..last].to_owned()));
                }
            }
            _ => {}
        }
    }
}

/// Returns whether a group is from the attribute that a comment that documents stands for.
fn is_documentation(group: &Group) -> bool {
    let first = group.stream().into_iter().next();
    group.delimiter() == Delimiter::Bracket
        && first.is_some_and(|token| matches!(token, TokenTree::Ident(name) if name == "doc"))
}

/// Returns the code up to the module of tests at the end of a file.
fn before_tests(text: &str) -> &str {
    text.split_once("\n#[cfg(test)]\nmod tests {").map_or(text, |(code, _)| code)
}

/// Returns the lines of the library and of the Python package that look into the text of an error.
fn readings(file: &File) -> Vec<Problem> {
    let reads: fn(&str) -> bool = match file.path.rsplit_once('.') {
        _ if FOREIGN_MESSAGES.contains(&&*file.path) => return Vec::new(),
        Some((path, "py")) if path.starts_with("python/mishandle/") => reads_in_python,
        Some((_, "rs")) if is_library(&file.path) => reads_in_rust,
        _ => return Vec::new(),
    };
    (1..)
        .zip(before_tests(&file.text).lines())
        .filter(|(_, line)| !line.trim_start().starts_with("//") && reads(line))
        .map(|(line, _)| Problem {
            path: file.path.clone(),
            line,
            what: "reads the text of an error; the error must carry what is read".to_owned(),
        })
        .collect()
}

fn reads_in_python(line: &str) -> bool {
    ["str(error)", "str(exception)", "str(caught)"].iter().any(|text| line.contains(text))
        && PYTHON_LOOKS.iter().any(|look| line.contains(look))
}

fn reads_in_rust(line: &str) -> bool {
    ["error", "problem", "cause"].iter().any(|name| {
        [".message", ".to_string()"]
            .iter()
            .any(|text| RUST_LOOKS.iter().any(|look| line.contains(&format!("{name}{text}{look}"))))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_are_told_from_comments_characters_and_lifetimes() {
        let text = r##"/// "no" --a
fn a<'a>(b: &'a str, c: char) { /* "no" /* " */ */
    let d = ('"', '\'', '\u{22}', "one \" two");
    let e = r#"three "four""#; let for_r = b"five";
    // "no"
    let f = "six
seven";
}

#[cfg(test)]
mod tests {
    const A: &str = "no";
}
"##;
        let found = literals(text);
        let found: Vec<(usize, &str)> = found.iter().map(|(line, text)| (*line, text.as_str())).collect();
        assert_eq!(found, [(3, "one \\\" two"), (4, "three \"four\""), (4, "five"), (6, "six\nseven")]);
    }

    #[test]
    fn flags_commands_and_calls_are_words_of_a_front() {
        for text in [
            "pass --period",
            "--out",
            "(--{flag} {})",
            "`mishandle list {name}`",
            "by `mishandle.replay`",
            "mishandle.replay({})",
            "replayed in Python",
            "leave the flag out",
        ] {
            assert!(names_front(text), "{text}");
        }
        for text in ["a -- b", "a--b", "<!--x-->", "----", "mishandle.org", "Mishandle 0.1", "mishandle"] {
            assert!(!names_front(text), "{text}");
        }
    }

    #[test]
    fn only_the_library_is_checked() {
        let text = "const A: &str = \"--out\";\n";
        let found = |path: &str| {
            check(&Tree::of(&[(path, text)])).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let message = "1: `--out` is the command line's: state the fact, and return a `Remedy`";
        for path in ["src/a.rs", "crates/logs/src/log.rs"] {
            assert_eq!(found(path), [format!("{path}:{message}")]);
        }
        for path in
            ["crates/cli/src/lib.rs", "crates/logs/tests/main.rs", "src/train/tests.rs", "studies/src/a.rs"]
        {
            assert_eq!(found(path), [""; 0], "{path}");
        }
        assert_eq!(found("src/harden/trainer.rs"), [""; 0]);
        let clean = check(&Tree::of(&[("src/harden/trainer.rs", "")]));
        assert!(clean[0].what.starts_with("names no flag"), "{}", clean[0]);
    }

    #[test]
    fn texts_of_errors_are_not_read() {
        let found = |path: &str, text: &str| check(&Tree::of(&[(path, text)])).len();
        assert_eq!(found("python/mishandle/a.py", "    if re.search(\"found\", str(error)):\n"), 1);
        assert_eq!(found("python/mishandle/a.py", "    raise InvalidValueError(str(error)) from None\n"), 0);
        let reads = "if error.to_string().contains(\"x\") {}\n";
        assert_eq!(found("crates/logs/src/a.rs", reads), 1);
        assert_eq!(found("crates/logs/src/a.rs", &format!("\n#[cfg(test)]\nmod tests {{\n{reads}}}\n")), 0);
    }
}
