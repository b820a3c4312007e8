//! Measured figures in Markdown, and the sources that pages name for them.
//!
//! A paragraph, list or table with figures contains `<!-- from: SOURCE -->`, or links to a study.
//! In a table whose last column is `measured`, that cell is the source of its row. `cargo xtask
//! readme` runs sources that are commands, so those take seconds.

use crate::markdown::{lines, links};

/// Levels of confidence and of tests, which are not measured, percent.
const LEVELS: [&str; 5] = ["2.5", "5", "95", "97.5", "99"];

/// Units of costs. A number with one is a figure after a word of [`SPENDS`].
const COSTS: [&str; 7] = ["µs", "ms", "s", "minutes", "hours", "MB", "GB"];
const SPENDS: [&str; 5] = ["take", "takes", "took", "cost", "costs"];

/// Words before or after a depth in mm, which is then a figure.
const DEPTHS: [&str; 7] = ["depth", "depths", "deep", "deeper", "penetration", "penetrate", "penetrates"];

/// Number of words in which a cost or a depth follows its word.
const REACH: usize = 4;

/// Comments that name a source.
const COMMENTS: [&str; 2] = ["<!-- from: ", "<!-- table of "];

/// Folders of dated studies and of records, which carry their commits.
const STUDIES: [&str; 2] = ["studies/", "controllers/README.md"];

/// Text whose figures have one source.
pub struct Sourced {
    /// Line of the page, from 1.
    pub line: usize,
    pub figures: Vec<String>,
    pub source: Option<String>,
}

impl Sourced {
    /// Returns the source as a command of the program, if it is one without placeholders.
    pub fn command(&self) -> Option<&str> {
        let command = self.source.as_deref()?.trim_start_matches('`').split('`').next()?;
        let is_placeholder =
            |word: &str| word.len() > 1 && word.chars().all(|letter| letter.is_ascii_uppercase());
        let is_whole = !command.split_whitespace().any(is_placeholder);
        (command.starts_with("mishandle ") && is_whole).then_some(command)
    }
}

/// Returns all text of a page that has figures.
pub fn sourced(page: &str) -> Vec<Sourced> {
    let mut found = Vec::new();
    let mut block: Vec<(usize, &str)> = Vec::new();
    for (number, line, is_code) in lines(page) {
        if is_code || line.trim().is_empty() {
            found.extend(of_block(&block));
            block.clear();
        } else {
            block.push((number, line));
        }
    }
    found.extend(of_block(&block));
    found.retain(|part: &Sourced| !part.figures.is_empty());
    found
}

fn of_block(block: &[(usize, &str)]) -> Vec<Sourced> {
    let Some((line, first)) = block.first() else { return Vec::new() };
    if first.trim_end().ends_with("| measured |") {
        return block[1..].iter().filter_map(|(line, row)| of_row(*line, row)).collect();
    }
    let text = block.iter().map(|(_, line)| *line).collect::<Vec<_>>().join("\n");
    let comment = COMMENTS.iter().find_map(|start| text.split_once(start)?.1.split(" -->").next());
    let is_study = |link: &&str| STUDIES.iter().any(|study| link.contains(study));
    let source = comment.or_else(|| links(&text).map(|(_, link)| link).find(is_study)).map(str::to_owned);
    vec![Sourced { line: *line, figures: figures(&without_comments(&text)), source }]
}

/// Returns a row of a table whose last cell is the source.
fn of_row(line: usize, row: &str) -> Option<Sourced> {
    let (cells, source) = row.trim_end().strip_suffix('|')?.rsplit_once('|')?;
    Some(Sourced { line, figures: figures(cells), source: Some(source.trim().to_owned()) })
}

fn without_comments(text: &str) -> String {
    let mut parts = text.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |prose, part| prose + part.split_once("-->").map_or("", |(_, rest)| rest))
}

/// Returns the measured figures of text: percentages that are not a level of confidence, counts `n
/// of m`, ratios `n times as`, costs in time and memory, and depths of contact. Code is not read.
fn figures(text: &str) -> Vec<String> {
    let prose = text.split('`').step_by(2).collect::<Vec<_>>().join(" ");
    let words: Vec<&str> = prose.split_whitespace().map(bare).collect();
    let word = |at: usize| words.get(at).copied().unwrap_or_default();
    let is_figure = |at: usize| {
        let is_list = |word: &&&str| number(word).is_some() || matches!(**word, "to" | "and" | "or");
        let rest = words[at + 1..].iter().take_while(is_list).count();
        let unit = word(at + 1 + rest);
        let is_single = rest == 0 && (at == 0 || !matches!(word(at - 1), "to" | "and" | "or"));
        let of = if word(at + 2) == "all" { at + 3 } else { at + 2 };
        let before = &words[at.saturating_sub(REACH)..at];
        unit.starts_with('%') && !(is_single && LEVELS.contains(&word(at)))
            || word(at + 1) == "of" && number(word(of)).is_some()
            || word(at + 1) == "times" && word(at + 2) == "as"
            || COSTS.contains(&unit) && before.iter().any(|word| SPENDS.contains(word))
            || unit == "mm" && before.iter().chain([&word(at + 2 + rest)]).any(|word| DEPTHS.contains(word))
    };
    let numbers = (0..words.len()).filter(|at| number(word(*at)).is_some());
    numbers.filter(|at| is_figure(*at)).map(|at| word(at).to_owned()).collect()
}

/// Returns a word without the marks around it.
fn bare(word: &str) -> &str {
    word.trim_matches(|mark: char| matches!(mark, ',' | '.' | ';' | ':' | '(' | ')' | '[' | ']' | '*' | '|'))
}

fn number(word: &str) -> Option<f64> {
    word.starts_with(|first: char| first.is_ascii_digit()).then(|| word.replace(',', "").parse().ok())?
}

/// Returns whether output has a number that rounds to the figure.
pub fn is_printed(figure: &str, output: &str) -> bool {
    let decimals = figure.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let printed = output.split_whitespace().filter_map(|word| number(bare(word)));
    printed.map(|value| format!("{value:.decimals$}")).any(|value| value == figure.replace(',', ""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_counts_ratios_and_costs_are_figures_and_constants_are_not() {
        for (text, expected) in [
            ("fails in 30 % of them, and 4.5 %.", &["30", "4.5"][..]),
            ("1.5, 0.0 and 3 %; 96 to 100 %", &["1.5", "0.0", "3", "96", "100"]),
            ("with 95 % confidence, a test at 5 %, 97.5 %", &[]),
            ("in 41 of 300 and 20 of all 1,000, one of 30", &["41", "20"]),
            ("is 8 times as fast, 60 times a second", &["8"]),
            ("it takes about 1 s and costs 1 to 10 ms", &["1", "1", "10"]),
            ("a mean over 50 ms for 5 s, at most 64 MB", &[]),
            ("penetration of at most 0.8 mm, and 1 to 3 mm deep", &["0.8", "1", "3"]),
            ("a wall of 20 mm, 5 mm apart", &[]),
            ("`echo 30 %` of 5 axes", &[]),
            ("| a | 93.3 % at 0.1 |", &["93.3"]),
        ] {
            assert_eq!(figures(text), expected, "{text}");
        }
    }

    #[test]
    fn a_comment_a_study_or_a_last_cell_is_the_source() {
        let page = "It fails in 3 %.\n\n<!-- from: mishandle evaluate a -->\nIt fails\nin 3 %.\n\n\
                    [3 %](../../studies/notebook/a.md)\n\n```\n3 %\n```\n\n\
                    | a | measured |\n|---|---|\n| 3 % | `mishandle evaluate TASK` |\n| 4 % | `a.rs` |\n| b | |\n";
        let found: Vec<_> = sourced(page).into_iter().map(|part| (part.line, part.source)).collect();
        let some = |text: &str| Some(text.to_owned());
        let expected = [
            (1, None),
            (3, some("mishandle evaluate a")),
            (7, some("../../studies/notebook/a.md")),
            (15, some("`mishandle evaluate TASK`")),
            (16, some("`a.rs`")),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_command_without_placeholders_can_be_run() {
        let command = |source: &str| {
            let part = Sourced { line: 1, figures: Vec::new(), source: Some(source.into()) };
            part.command().map(str::to_owned)
        };
        let whole = "mishandle evaluate a -k b=1";
        assert_eq!(command(whole).as_deref(), Some(whole));
        assert_eq!(command(&format!("`{whole}`, seed 1")).as_deref(), Some(whole));
        assert_eq!(command("`mishandle evaluate TASK`"), None);
        assert_eq!(command("studies/notebook/a.md"), None);
    }

    #[test]
    fn a_figure_is_printed_if_a_number_rounds_to_it() {
        let output = "success rate  93.46 %  [88.1, 96.2]  n 1,000";
        for (figure, expected) in [("93.5", true), ("93", true), ("93.4", false), ("1000", true)] {
            assert_eq!(is_printed(figure, output), expected, "{figure}");
        }
    }
}
