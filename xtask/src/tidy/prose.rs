//! Refuses phrases that readers of the field do not know, and spellings that differ from the names in the API.

use super::{File, Problem, Tree};

/// A phrase that must not occur in sources and Markdown, and a plain replacement. Words are compared whole and without
/// case. The spaces are written as `_`, so that this file passes its own check.
const PHRASES: &[(&str, &str)] = &[
    ("hangs_on", "depends on"),
    ("hang_on", "depend on"),
    ("becomes_of", "happens to"),
    ("is_none", "does not exist"),
    ("there_is_none", "it does not exist"),
    ("that_which", "what"),
    ("for_ever", "permanently"),
    ("so_many", "a number of"),
    ("put_to_the_test", "tested"),
    ("is_otherwise", "differs"),
    ("is_to_be", "must be, or will be"),
    ("are_to_be", "must be, or will be"),
    ("was_begun", "was started"),
    ("is_begun", "is started"),
    ("not_begun", "not started"),
    ("is_told", "receives, or is reported"),
    ("are_told", "receive, or are reported"),
    ("was_told", "received, or was reported"),
    ("told_by", "reported by"),
    ("told_to", "reported to"),
    ("tells_the", "reports, or shows, the"),
    ("tells_how", "reports how"),
    ("tells_what", "reports what"),
    ("tells_whether", "reports whether"),
    ("has_to_be", "must be"),
    ("have_to_be", "must be"),
    ("step_length", "learning rate, or step size"),
    ("never-ending", "auto-resetting"),
    ("the_field_of", "the column of"),
];

/// The begin of a spelling that is not American, and the American one, split so that this file passes its own check. The
/// first is found inside identifiers too.
const SPELLINGS: &[([&str; 2], &str)] = &[
    (["behavi", "our"], "behavior"),
    (["col", "our"], "color"),
    (["neighb", "our"], "neighbor"),
    (["fav", "our"], "favor"),
    (["cen", "tre"], "center"),
    (["millime", "tre"], "millimeter"),
    (["centime", "tre"], "centimeter"),
    (["normal", "is"], "normaliz-"),
    (["initial", "is"], "initializ-"),
    (["optim", "is"], "optimiz-"),
    (["minim", "is"], "minimiz-"),
    (["maxim", "is"], "maximiz-"),
    (["standard", "is"], "standardiz-"),
    (["general", "is"], "generaliz-"),
    (["vector", "is"], "vectoriz-"),
    (["factor", "is"], "factoriz-"),
    (["serial", "is"], "serializ-"),
    (["parameter", "is"], "parameteriz-"),
    (["random", "is"], "randomiz-"),
    (["discret", "is"], "discretiz-"),
    (["material", "is"], "materializ-"),
    (["misspe", "lt"], "misspelled"),
    (["lear", "nt"], "learned"),
    (["label", "led"], "labeled"),
    (["travel", "led"], "traveled"),
    (["cancel", "led"], "canceled"),
    (["licen", "ce"], "license"),
];

pub fn check(tree: &Tree) -> Vec<Problem> {
    tree.files.iter().filter(|file| is_prose(&file.path)).flat_map(check_file).collect()
}

/// Sources and Markdown. Golden files hold the output of other programs.
fn is_prose(path: &str) -> bool {
    [".rs", ".md", ".py", ".toml", ".sh"].iter().any(|ending| path.ends_with(ending))
        && !path.contains("/golden/")
}

fn check_file(file: &File) -> impl Iterator<Item = Problem> {
    (1..).zip(file.text.lines()).flat_map(move |(line, text)| {
        let text = text.to_lowercase();
        let phrases = PHRASES.iter().filter_map(|(phrase, replacement)| {
            let phrase = phrase.replace('_', " ");
            has_words(&text, &phrase).then(|| format!("`{phrase}`: write `{replacement}`"))
        });
        let spellings = SPELLINGS.iter().filter_map(|(spelling, american)| {
            let spelling = spelling.concat();
            text.contains(&spelling).then(|| format!("`{spelling}`: write `{american}` (American spelling)"))
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
        let text = concat!("It Hangs", " on the seed.");
        check_text("docs/a.md", text, &["docs/a.md:1: `hangs on`: write `depends on`"]);
        check_text("docs/a.md", concat!("It overhangs", " one side."), &[]);
    }

    #[test]
    fn a_spelling_is_found_inside_identifiers() {
        let text = concat!("// fine\nfn run_normal", "iser() {}");
        let problem =
            format!("src/a.rs:2: `{0}`: write `normaliz-` (American spelling)", concat!("normal", "is"));
        check_text("src/a.rs", text, &[&problem]);
        check_text("src/a.rs", "let center = normalize(color);", &[]);
    }

    #[test]
    fn data_of_other_programs_is_not_checked() {
        check_text("crates/stl/tests/golden/a.md", concat!("cen", "tre"), &[]);
        check_text("controllers/a.json", concat!("cen", "tre"), &[]);
    }
}
