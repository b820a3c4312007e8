//! Refuses phrases that readers of the field do not know, spellings that differ from the names in
//! the API, and turns of phrase in comments and Markdown that read as a translation.

use super::{File, Problem, Tree};

/// A phrase that must not occur in sources and Markdown, and a plain replacement. Words are
/// compared whole and without case. This file itself is not checked.
const PHRASES: &[(&str, &str)] = &[
    ("begun", "started"),
    ("tells", "reports, or shows"),
    ("told", "reported, or received"),
    ("wanted", "expected, or required"),
    ("goes_on", "continues"),
    ("carry_on", "resume"),
    ("asked_for", "requested"),
    ("as_yet", "so far"),
    ("in_the_end", "finally"),
    ("gives_back", "returns"),
    ("anew", "again"),
    ("with_profit", "usefully"),
    ("hangs_on", "depends on"),
    ("hang_on", "depend on"),
    ("becomes_of", "happens to"),
    ("there_is_none", "it does not exist"),
    ("that_which", "what"),
    ("for_ever", "permanently"),
    ("so_many", "a number of"),
    ("put_to_the_test", "tested"),
    ("is_otherwise", "differs"),
    ("is_to_be", "must be, or will be"),
    ("are_to_be", "must be, or will be"),
    ("has_to_be", "must be"),
    ("have_to_be", "must be"),
    ("step_length", "learning rate, or step size"),
    ("the_field_of", "the column of"),
    ("stranger", "untrusted"),
    ("strangers", "untrusted"),
    ("sample_of_the_others", "audit sample, or name the simulations"),
];

/// The begin of a spelling that is not American, and the American one, found inside identifiers
/// too.
const SPELLINGS: &[(&str, &str)] = &[
    ("behaviour", "behavior"),
    ("colour", "color"),
    ("neighbour", "neighbor"),
    ("favour", "favor"),
    ("centre", "center"),
    ("millimetre", "millimeter"),
    ("centimetre", "centimeter"),
    ("normalis", "normaliz-"),
    ("initialis", "initializ-"),
    ("optimis", "optimiz-"),
    ("minimis", "minimiz-"),
    ("maximis", "maximiz-"),
    ("standardis", "standardiz-"),
    ("generalis", "generaliz-"),
    ("vectoris", "vectoriz-"),
    ("factoris", "factoriz-"),
    ("serialis", "serializ-"),
    ("parameteris", "parameteriz-"),
    ("randomis", "randomiz-"),
    ("discretis", "discretiz-"),
    ("materialis", "materializ-"),
    ("misspelt", "misspelled"),
    ("learnt", "learned"),
    ("labelled", "labeled"),
    ("travelled", "traveled"),
    ("cancelled", "canceled"),
    ("licence", "license"),
];

/// Files with reward terms in an older spelling. The terms enter the task hash, which controllers
/// and runs record.
const HASHED_TEXTS: [&str; 4] = [
    "crates/tasks/src/ball_balancing/mod.rs",
    "crates/tasks/src/cloth_placing/mod.rs",
    "crates/tasks/src/cube_stacking/mod.rs",
    "crates/tasks/src/peg_in_hole/reward.rs",
];

/// Words after `is no` that make it right, as in `is no longer`.
const RIGHT: [&str; 10] =
    ["longer", "more", "less", "better", "worse", "larger", "smaller", "faster", "slower", "such"];

pub fn check(tree: &Tree) -> Vec<Problem> {
    tree.files.iter().filter(|file| is_prose(&file.path)).flat_map(check_file).collect()
}

/// Sources and Markdown, except golden files, which hold the output of other programs, and this
/// file.
fn is_prose(path: &str) -> bool {
    [".rs", ".md", ".py", ".toml", ".sh"].iter().any(|ending| path.ends_with(ending))
        && !path.contains("/golden/")
        && path != "xtask/src/tidy/prose.rs"
}

fn check_file(file: &File) -> impl Iterator<Item = Problem> {
    (1..).zip(file.text.lines()).flat_map(move |(line, original)| {
        let text = original.to_lowercase();
        let phrases = PHRASES.iter().filter_map(|(phrase, replacement)| {
            let phrase = phrase.replace('_', " ");
            has_words(&text, &phrase).then(|| format!("`{phrase}`: write `{replacement}`"))
        });
        let spellings = SPELLINGS.iter().filter_map(|(spelling, american)| {
            let is_hashed = HASHED_TEXTS.contains(&file.path.as_str());
            (text.contains(spelling) && !is_hashed)
                .then(|| format!("`{spelling}`: write `{american}` (American spelling)"))
        });
        let translated = comment(&file.path, original).map(translations).unwrap_or_default();
        let found: Vec<String> = phrases.chain(spellings).chain(translated).collect();
        found.into_iter().map(move |what| Problem { path: file.path.clone(), line, what })
    })
}

/// Whether `text` contains `phrase` between characters that belong to no word.
fn has_words(text: &str, phrase: &str) -> bool {
    let is_edge = |c: Option<char>| c.is_none_or(|c| !(c.is_alphanumeric() || c == '_'));
    text.match_indices(phrase).any(|(at, _)| {
        is_edge(text[..at].chars().next_back()) && is_edge(text[at + phrase.len()..].chars().next())
    })
}

/// Returns the comment of a line of Rust, or a line of Markdown.
fn comment<'a>(path: &str, line: &'a str) -> Option<&'a str> {
    let start = line.trim_start();
    match path.rsplit_once('.') {
        Some((_, "md")) => Some(line),
        Some((_, "rs")) if start.starts_with("//") => Some(start),
        Some((_, "rs")) => line.find(" // ").map(|at| &line[at + 1..]),
        _ => None,
    }
}

fn translations(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    if text.starts_with("/// What ") || text.starts_with("//! What ") {
        found.push("a doc comment starts with `What`: name the thing".to_owned());
    }
    let text = text.trim_start_matches(['/', '!']).to_lowercase();
    let words: Vec<&str> = text.split_whitespace().collect();
    for (at, pair) in words.windows(2).enumerate() {
        // The first word of a line may follow a `there` on the line before.
        let after_there = at == 0 || words[at - 1].trim_start_matches(['(', '"', '*']) == "there";
        let is_right =
            words.get(at + 2).is_some_and(|word| RIGHT.contains(&word.trim_matches([',', '.', ':'])));
        if matches!(pair, ["is" | "are", "no"]) && !after_there && !is_right {
            found.push(format!("`{} no`: write `{} not a`", pair[0], pair[0]));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_text(path: &str, text: &str, expected: &[&str]) {
        let problems = check(&Tree::of(&[(path, text)]));
        assert_eq!(problems.iter().map(ToString::to_string).collect::<Vec<_>>(), expected, "{text}");
    }

    #[test]
    fn a_phrase_is_found_as_whole_words_in_any_case() {
        let text = "It Hangs on the seed.";
        check_text("docs/a.md", text, &["docs/a.md:1: `hangs on`: write `depends on`"]);
        check_text("docs/a.md", "It overhangs one side.", &[]);
    }

    #[test]
    fn a_spelling_is_found_inside_identifiers() {
        let text = "// fine\nfn run_normaliser() {}";
        check_text("src/a.rs", text, &["src/a.rs:2: `normalis`: write `normaliz-` (American spelling)"]);
        check_text("src/a.rs", "let center = normalize(color);", &[]);
    }

    #[test]
    fn data_of_other_programs_is_not_checked() {
        check_text("crates/stl/tests/golden/a.md", "centre", &[]);
        check_text("controllers/a.json", "centre", &[]);
    }

    #[test]
    fn translated_phrases_are_found_in_comments_and_markdown() {
        let name = "crates/stl/src/a.rs:1: a doc comment starts with `What`: name the thing";
        check_text("crates/stl/src/a.rs", "    /// What is allowed.", &[name]);
        check_text("docs/a.md", "What is allowed.", &[]);
        check_text("docs/a.md", "This is no proof.", &["docs/a.md:1: `is no`: write `is not a`"]);
        check_text("docs/a.md", "There is no proof. It is no longer so, and it is no better.", &[]);
        let untrusted = "docs/a.md:1: `stranger`: write `untrusted`";
        check_text("docs/a.md", "The file of a stranger.", &[untrusted]);
        let others = "docs/a.md:1: `sample of the others`: write `audit sample, or name the simulations`";
        check_text("docs/a.md", "A sample of the others; the others are nominal.", &[others]);
    }

    #[test]
    fn code_is_not_checked_for_translated_phrases() {
        check_text("crates/stl/src/a.rs", "let text = \"this is no proof\";", &[]);
        check_text(
            "crates/stl/src/a.rs",
            concat!("let a = 1; /", "/ This is no proof."),
            &["crates/stl/src/a.rs:1: `is no`: write `is not a`"],
        );
        check_text("crates/stl/src/a.rs", concat!("/// If there\n", "/// is no proof.\n"), &[]);
    }
}
