//! Runs as Markdown, for a pull request or a README: verdict, rates, failure modes and success over
//! the values of the axes.

use mishandle::results::{AxisRates, Requirement};
use mishandle::verdict::verdict;
use mishandle_text::p_value_phrase;

use crate::axis_rates::{axis_label, interval, pairs_sentence, range_text, rate, sentence};
use crate::html::{number, percent, short, visible};
use crate::load::RunReport;
use crate::{tables, words};

/// Largest numbers of axes and failure modes.
const MAX_AXES: usize = 20;
const MAX_MODES: usize = 20;

/// Returns runs as Markdown, with a heading of the second level each. Sentences of the page are
/// HTML, which Markdown contains.
pub fn markdown(reports: &[RunReport]) -> String {
    reports.iter().map(run).collect::<Vec<_>>().join("\n")
}

fn run(report: &RunReport) -> String {
    let header = &report.header;
    let mut out = format!(
        "## {}\n\n{}: {}\n\n{}\n\n",
        plain(&words::headline(report)),
        escaped(&words::formula_label(report)),
        code(&header.formula),
        words::meaning(report).iter().map(|sentence| plain(sentence)).collect::<Vec<_>>().join(" ")
    );
    let verdict = report.answer.as_ref().and_then(verdict);
    let facts = verdict.iter().flat_map(|verdict| &verdict.facts);
    let facts: Vec<String> = facts
        .filter(|fact| fact.label != "requirement")
        .map(|fact| format!("- {}: {}\n", fact.label, escaped(&fact.text)))
        .collect();
    if !facts.is_empty() {
        out.push_str(&(facts.concat() + "\n"));
    }
    let row = |found: &Requirement| {
        let least = found.minimum_robustness.map_or("–".to_string(), |least| number(least.0));
        vec![escaped(&found.name), code(&found.formula), found.violated_text(), least]
    };
    let requirements: Vec<Vec<String>> = report.requirements.iter().map(row).collect();
    if !requirements.is_empty() {
        let head = ["requirement", "formula", "violated", "lowest robustness"];
        out.push_str(&table(&head, 2, &requirements));
    }
    let rates = tables::rate_rows(report);
    if !rates.is_empty() {
        out.push_str(&table(&["rate", "value", tables::interval_head(report), "simulations"], 1, &rates));
    }
    let rate_notes = tables::rate_notes(report);
    for note in rate_notes.iter().chain(&report.notes) {
        out.push_str(&format!("- {}\n", escaped(note)));
    }
    if !(rate_notes.is_empty() && report.notes.is_empty()) {
        out.push('\n');
    }
    let modes = &report.modes.modes;
    if !modes.is_empty() {
        let rows: Vec<Vec<String>> = modes
            .iter()
            .take(MAX_MODES)
            .map(|mode| {
                let failure = mode.representative();
                vec![
                    code(&failure.predicate),
                    mode.failures.len().to_string(),
                    mishandle_text::instant(mode.samples.0, header.control_dt),
                    format!("{} of trial {}", failure.number, failure.trial),
                ]
            })
            .collect();
        out.push_str("### Failure modes\n\n");
        out.push_str(&table(&["predicate", "failures", "from", "simulation"], 1, &rows));
    }
    if let Some(rates) = report.axis_rates() {
        out.push_str(&format!(
            "### Success over the range of the axes\n\n{}",
            axes(rates, tables::interval_head(report))
        ));
    }
    out.push_str(&format!(
        "Run file {}, seed {}, program {} {}.\n",
        code(&report.path),
        header.seed,
        escaped(&header.build.program_version),
        escaped(&commit(&header.build.git_commit)),
    ));
    out
}

/// Returns the start of a commit, and the mark of a changed working tree.
fn commit(commit: &str) -> String {
    match commit.split_once('-') {
        Some((hash, mark)) => format!("{}-{mark}", short(hash, 12)),
        None => short(commit, 12),
    }
}

fn axes(rates: &AxisRates, interval_head: &str) -> String {
    let mut out = format!("{}\n\n", sentence(rates, "the random simulations"));
    let mut rows = Vec::new();
    for axis in rates.axes.iter().take(MAX_AXES) {
        for (index, bin) in axis.bins.iter().enumerate() {
            let bold = |text: String| if bin.differs { format!("**{text}**") } else { text };
            rows.push(vec![
                if index == 0 { escaped(&axis_label(axis)) } else { String::new() },
                escaped(&range_text(&bin.values)),
                bold(rate(bin.success_rate)),
                interval(bin.success_rate),
                bin.success_rate.n.to_string(),
            ]);
        }
    }
    out.push_str(&table(&["axis", "values", "success rate", interval_head, "simulations"], 2, &rows));
    let rest = rates.axes.len().saturating_sub(MAX_AXES);
    if rest > 0 {
        out.push_str(&format!("{rest} more axes are not shown.\n\n"));
    }
    if rates.pairs_tested == 0 {
        return out;
    }
    out.push_str(&format!("{}\n\n", pairs_sentence(rates)));
    for pair in rates.pairs.iter().filter(|pair| pair.interacts()) {
        let [first, second] = pair.axes.each_ref().map(|name| escaped(&short(name, 40)));
        out.push_str(&format!(
            "{first} (rows) and {second} (columns), interaction {} of the variance, {}:\n\n",
            percent(pair.interaction),
            p_value_phrase(pair.p_value)
        ));
        let head: Vec<String> = pair.bins[1].iter().map(|bin| escaped(&range_text(bin))).collect();
        let head: Vec<&str> = std::iter::once("").chain(head.iter().map(String::as_str)).collect();
        let cell = |cell: &mishandle::results::Estimate| match cell.value {
            Some(_) => format!("{} ({})", rate(*cell), interval(*cell)),
            None => "–".to_string(),
        };
        let rows: Vec<Vec<String>> = pair.bins[0]
            .iter()
            .zip(&pair.cells)
            .map(|(bin, cells)| {
                std::iter::once(escaped(&range_text(bin))).chain(cells.iter().map(cell)).collect()
            })
            .collect();
        out.push_str(&table(&head, 1, &rows));
    }
    out
}

/// Returns a table whose first `left` columns are aligned to the left. Cells are Markdown.
pub fn table(head: &[&str], left: usize, rows: &[Vec<String>]) -> String {
    let line = |cells: Vec<&str>| format!("| {} |\n", cells.join(" | "));
    let rule: String = (0..head.len()).map(|column| if column < left { "|---" } else { "|--:" }).collect();
    let rows: String = rows.iter().map(|row| line(row.iter().map(String::as_str).collect())).collect();
    format!("{}{rule}|\n{rows}\n", line(head.to_vec()))
}

/// Escapes a text from a run file, so that it is neither a tag nor a link nor a cell.
pub fn escaped(text: &str) -> String {
    plain(&crate::html::text(text))
}

/// Escapes what Markdown takes for its own signs in HTML. An underscore within a word is none.
fn plain(html: &str) -> String {
    let mut out = String::with_capacity(html.len());
    let mut rest = html.chars().peekable();
    let mut last = ' ';
    while let Some(c) = rest.next() {
        let next = rest.peek().copied().unwrap_or(' ');
        let is_sign = match c {
            '\\' | '`' | '*' | '[' | ']' | '|' | '~' => true,
            '_' => !(last.is_alphanumeric() && next.is_alphanumeric()),
            // Of a number of an entity.
            '#' => last != '&',
            _ => false,
        };
        if is_sign {
            out.push('\\');
        }
        out.push(c);
        last = c;
    }
    out
}

/// Returns a text as code. A backtick would end it, and a bar the cell.
pub fn code(text: &str) -> String {
    format!("`{}`", visible(text).replace('`', "'").replace('|', "\\|").replace(['\n', '\r'], " "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_neither_a_tag_nor_a_link_nor_a_cell() {
        assert_eq!(escaped("<b>[x](y)|z"), "&lt;b&gt;\\[x\\](y)\\|z");
        assert_eq!(escaped("it's"), "it&#39;s");
        assert_eq!(escaped("ball_x _x_"), "ball_x \\_x\\_");
        assert_eq!(code("a`b|c"), "`a'b\\|c`");
    }
}
