//! Pages with tables, written as Markdown and as HTML from the same content.

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
        let mut text = format!("# {}\n", self.title);
        for block in &self.blocks {
            text.push('\n');
            match block {
                Block::Heading(heading) => text += &format!("## {heading}\n"),
                Block::Paragraph(paragraph) => text += &format!("{paragraph}\n"),
                Block::List(entries) => entries.iter().for_each(|entry| text += &format!("- {entry}\n")),
                Block::Table(table) => text += &table.markdown(),
            }
        }
        text
    }

    /// Returns the page as one HTML file without scripts or external files.
    pub fn html(&self) -> String {
        let mut body = format!("<h1>{}</h1>\n", inline(&self.title));
        for block in &self.blocks {
            body += &match block {
                Block::Heading(heading) => format!("<h2>{}</h2>\n", inline(heading)),
                Block::Paragraph(paragraph) => format!("<p>{}</p>\n", inline(paragraph)),
                Block::List(entries) => {
                    let entries: Vec<String> =
                        entries.iter().map(|entry| format!("<li>{}</li>\n", inline(entry))).collect();
                    format!("<ul>\n{}</ul>\n", entries.concat())
                }
                Block::Table(table) => table.html(),
            };
        }
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
             content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <main>\n{body}</main>\n</body>\n</html>\n",
            escaped(&self.title)
        )
    }
}

/// Style of the HTML pages: light and dark, wide tables scroll on a narrow screen.
const STYLE: &str = "\
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0; }
main { max-width: 80rem; margin: 0 auto; padding: 1rem; }
p, li { max-width: 48rem; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.875rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: 0.25rem 0; }
th, td { padding: 0.25rem 0.6rem; border-bottom: 1px solid #8884; text-align: right; white-space: nowrap; }
th { border-bottom: 2px solid #8888; white-space: normal; vertical-align: bottom; }
.l { text-align: left; }
code { font-size: 0.9em; }
@media print { .wide { overflow: visible; } table { font-size: 0.6rem; } }
";

impl Table {
    fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule: String =
            (0..self.columns.len()).map(|i| if i < self.left { "|---" } else { "|--:" }).collect();
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}\n\n{}{rule}|\n{rows}", self.caption, line(&self.columns))
    }

    fn html(&self) -> String {
        let row = |cells: &[String], tag: &str| {
            let cell = |(i, cell): (usize, &String)| {
                let class = if i < self.left { " class=\"l\"" } else { "" };
                let scope = if tag == "th" { " scope=\"col\"" } else { "" };
                format!("<{tag}{class}{scope}>{}</{tag}>", inline(cell))
            };
            format!("<tr>{}</tr>\n", cells.iter().enumerate().map(cell).collect::<String>())
        };
        let rows: String = self.rows.iter().map(|cells| row(cells, "td")).collect();
        format!(
            "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"table\">\n<table>\n<caption>{}</caption>\n<thead>\n{}\
             </thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n",
            inline(&self.caption),
            row(&self.columns, "th")
        )
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Escapes a text and marks what is between backticks as code.
fn inline(text: &str) -> String {
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
        assert!(html.contains("<td class=\"l\"><code>a&lt;b</code></td><td>3</td>"), "{html}");
        assert!(html.contains("<title>T &amp; U</title>") && html.contains("<caption>Rates</caption>"));
    }

    #[test]
    fn html_needs_no_other_file() {
        for part in ["http:", "https:", "<script", "src=", "@import"] {
            assert!(!page().html().contains(part), "{part}");
        }
    }
}
