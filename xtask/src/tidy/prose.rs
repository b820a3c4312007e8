//! Refuses phrases that readers of the field do not know, and spellings that differ from the names
//! in the API.

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
    (1..).zip(file.text.lines()).flat_map(move |(line, text)| {
        let text = text.to_lowercase();
        let phrases = PHRASES.iter().filter_map(|(phrase, replacement)| {
            let phrase = phrase.replace('_', " ");
            has_words(&text, &phrase).then(|| format!("`{phrase}`: write `{replacement}`"))
        });
        let spellings = SPELLINGS.iter().filter_map(|(spelling, american)| {
            let is_hashed = HASHED_TEXTS.contains(&file.path.as_str());
            (text.contains(spelling) && !is_hashed)
                .then(|| format!("`{spelling}`: write `{american}` (American spelling)"))
        });
        let found: Vec<String> = phrases.chain(spellings).collect();
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
}
