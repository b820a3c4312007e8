//! Pages with tables, written as Markdown and as HTML from the same content. Values from files pass
//! through [`value`] or [`code`].

use mishandle_text::visible;

use crate::html::text as escaped;
use crate::page::Document;

/// A page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// Title.
    pub title: String,
    /// Content.
    pub blocks: Vec<Block>,
}

/// A part of a page. Texts may contain `code` between backticks.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// A heading below the title.
    Heading(String),
    /// A paragraph.
    Paragraph(String),
    /// A list.
    List(Vec<String>),
    /// A table.
    Table(Table),
    /// Charts as HTML with a heading and a paragraph. Markdown pages do not have them.
    Charts {
        /// The heading.
        heading: String,
        /// Says what the charts show.
        text: String,
        /// The charts.
        html: String,
    },
}

/// A table. The first `left` columns are aligned left, the others right.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Caption.
    pub caption: String,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Number of columns that are aligned left.
    pub left: usize,
    /// The cells.
    pub rows: Vec<Vec<String>>,
}

impl Page {
    /// Returns the page as Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("# {}\n", markdown(&self.title));
        for block in &self.blocks {
            if !matches!(block, Block::Charts { .. }) {
                text.push('\n');
            }
            match block {
                Block::Heading(heading) => text += &format!("## {}\n", markdown(heading)),
                Block::Paragraph(paragraph) => text += &format!("{}\n", markdown(paragraph)),
                Block::List(entries) => {
                    entries.iter().for_each(|entry| text += &format!("- {}\n", markdown(entry)));
                }
                Block::Table(table) => text += &table.markdown(),
                Block::Charts { .. } => {}
            }
        }
        text
    }

    /// Returns the page as one HTML file without scripts or external files.
    pub fn html(&self) -> String {
        let mut body = format!("<section>\n<h2>{}</h2>\n", inline(&self.title));
        for block in &self.blocks {
            body += &match block {
                Block::Heading(heading) => format!("<h3>{}</h3>\n", inline(heading)),
                Block::Paragraph(paragraph) => format!("<p>{}</p>\n", inline(paragraph)),
                Block::List(entries) => {
                    let entries: Vec<String> =
                        entries.iter().map(|entry| format!("<li>{}</li>\n", inline(entry))).collect();
                    format!("<ul>\n{}</ul>\n", entries.concat())
                }
                Block::Table(table) => table.html(),
                Block::Charts { heading, text, html } => {
                    format!("<h3>{}</h3>\n<p>{}</p>\n{html}", inline(heading), inline(text))
                }
            };
        }
        Document { title: &escaped(&self.title), up: None, body: &format!("{body}</section>\n") }.html()
    }
}

impl Table {
    /// Returns the table as Markdown.
    pub fn markdown(&self) -> String {
        // A bar ends a cell, also within code.
        let cell = |cell: &String| markdown(cell).replace('|', "\\|");
        let line =
            |cells: &[String]| format!("| {} |\n", cells.iter().map(cell).collect::<Vec<_>>().join(" | "));
        let rule: String =
            (0..self.columns.len()).map(|i| if i < self.left { "|---" } else { "|--:" }).collect();
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}\n\n{}{rule}|\n{rows}", markdown(&self.caption), line(&self.columns))
    }

    fn html(&self) -> String {
        let row = |cells: &[String], tag: &str| {
            let cell = |(i, cell): (usize, &String)| {
                let class = if i < self.left { "" } else { " class=\"n\"" };
                let scope = if tag == "th" { " scope=\"col\"" } else { "" };
                format!("<{tag}{class}{scope}>{}</{tag}>", inline(cell))
            };
            format!("<tr>{}</tr>\n", cells.iter().enumerate().map(cell).collect::<String>())
        };
        let rows: String = self.rows.iter().map(|cells| row(cells, "td")).collect();
        format!(
            "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"table\">\n<table class=\"numbers\">\n<caption>{}</caption>\n<thead>\n{}\
             </thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n",
            inline(&self.caption),
            row(&self.columns, "th")
        )
    }
}

/// Formats a value from a file as part of a text. A backtick would start code, so it becomes an
/// apostrophe.
pub fn value(text: &str) -> String {
    text.replace('`', "'")
}

/// Formats a value from a file as code.
pub fn code(text: &str) -> String {
    if text.is_empty() { "-".to_string() } else { format!("`{}`", value(text)) }
}

/// Escapes what Markdown would take for HTML or a link, outside of code. A less-than sign before a
/// space is none.
fn markdown(text: &str) -> String {
    let plain = |text: &str| {
        let mut out = String::new();
        let mut rest = text.chars().peekable();
        while let Some(c) = rest.next() {
            let next = rest.peek().copied().unwrap_or(' ');
            match c {
                '<' if !next.is_whitespace() && !next.is_ascii_digit() => out.push_str("&lt;"),
                '&' if next.is_alphanumeric() || next == '#' => out.push_str("&amp;"),
                ']' if matches!(next, '(' | '[' | ':') => out.push_str("\\]"),
                c => out.push(c),
            }
        }
        out
    };
    let text = visible(text);
    let parts = text.split('`').enumerate();
    parts.map(|(i, part)| if i % 2 == 0 { plain(part) } else { format!("`{part}`") }).collect()
}

/// Escapes a text and marks what is between backticks as code.
pub(super) fn inline(text: &str) -> String {
    let parts = text.split('`').enumerate();
    parts
        .map(|(i, part)| match i % 2 {
            0 => escaped(part),
            _ => format!("<code>{}</code>", escaped(part)),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Page {
        let table = Table {
            caption: "Rates".to_string(),
            columns: ["task", "n"].map(String::from).to_vec(),
            left: 1,
            rows: vec![["`a<b`", "3"].map(String::from).to_vec()],
        };
        Page {
            title: "T & U".to_string(),
            blocks: vec![Block::Paragraph("x".to_string()), Block::Table(table)],
        }
    }

    #[test]
    fn a_table_is_the_same_in_both_formats() {
        assert!(page().markdown().contains("Rates\n\n| task | n |\n|---|--:|\n| `a<b` | 3 |\n"));
        let html = page().html();
        assert!(html.contains("<td><code>a&lt;b</code></td><td class=\"n\">3</td>"), "{html}");
        assert!(
            html.contains("<title>Mishandle: T &amp; U</title>") && html.contains("<caption>Rates</caption>")
        );
    }

    #[test]
    fn a_value_from_a_file_stays_text_in_both_formats() {
        let hostile = "a`<img src=x onerror=alert(1)>|&lt;[x](javascript:1)\n# b\u{202e}\u{1b}";
        let table = Table {
            caption: value(hostile),
            columns: vec!["n".to_string()],
            left: 0,
            rows: vec![vec![value(hostile)], vec![code(hostile)]],
        };
        let page = Page {
            title: value(hostile),
            blocks: vec![
                Block::Heading(value(hostile)),
                Block::Paragraph(value(hostile)),
                Block::List(vec![value(hostile)]),
                Block::Table(table),
            ],
        };
        let markdown = page.markdown();
        let outside: String = markdown.split('`').step_by(2).collect();
        for part in ["<img", "[x](", "&lt;[", "\u{202e}", "\u{1b}", "\n# b"] {
            assert!(!outside.contains(part), "{part}:\n{markdown}");
        }
        assert!(
            outside.contains(
                "a'&lt;img src=x onerror=alert(1)>|&amp;lt;[x\\](javascript:1)\\n# b\\u{202e}\\u{1b}"
            ),
            "{markdown}"
        );
        // Each row has one cell: two bars are not escaped.
        let rows: Vec<&str> =
            markdown.lines().filter(|line| line.starts_with("| a") || line.starts_with("| `")).collect();
        assert!(
            rows.len() == 2 && rows.iter().all(|row| row.replace("\\|", "").matches('|').count() == 2),
            "{rows:?}"
        );
        let html = page.html();
        assert!(!html.contains("<img") && !html.contains('\u{202e}') && !html.contains('\u{1b}'), "{html}");
        assert!(html.contains("<code>a&#39;&lt;img"), "{html}");
        assert!(html.contains("Content-Security-Policy") && html.contains("default-src 'none'"));
    }

    #[test]
    fn comparisons_and_intervals_stay_readable() {
        assert_eq!(
            markdown("p < 0.0001, <0.5, 98.0 [97.1, 99.0] & more"),
            "p < 0.0001, <0.5, 98.0 [97.1, 99.0] & more"
        );
    }

    #[test]
    fn html_needs_no_other_file() {
        for part in ["http:", "https:", "<script", "src=", "@import"] {
            assert!(!page().html().contains(part), "{part}");
        }
    }
}
