//! Escaped text, numbers and tables as HTML.

/// Largest number of characters of a text from a run file.
const MAX_TEXT: usize = 2000;

/// Escapes a sentence. What is between two backticks is code.
pub fn with_code(sentence: &str) -> String {
    let parts: Vec<&str> = sentence.split('`').collect();
    // A name can contain a backtick.
    if parts.len().is_multiple_of(2) {
        return text(sentence);
    }
    let part = |(index, part): (usize, &&str)| match index % 2 {
        0 => text(part),
        _ => format!("<code>{}</code>", text(part)),
    };
    parts.iter().enumerate().map(part).collect()
}

/// Escapes a text from a run file. Control characters and invisible characters become visible
/// escapes, so that no name can reorder the text around it. The middle of a very long text is left
/// out.
pub fn text(text: &str) -> String {
    let visible = visible(text);
    let mut out = String::with_capacity(visible.len());
    for c in visible.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// Escapes lines of text.
pub fn lines(lines: &[String]) -> String {
    lines.iter().map(|line| text(line)).collect::<Vec<_>>().join("\n")
}

/// Makes a text visible and short, for charts, which escape it themselves.
pub fn visible(text: &str) -> String {
    mishandle_text::visible(&mishandle_text::without_middle(text, MAX_TEXT))
}

/// Shortens a label to `length` characters.
pub fn short(label: &str, length: usize) -> String {
    mishandle_text::short(&visible(label), length)
}

/// Formats a number with about four significant digits.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        return "undefined".to_string();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.to_string();
    }
    let size = value.abs();
    let text = match size {
        0.0 => "0".to_string(),
        _ if !(1e-3..1e6).contains(&size) => format!("{value:.2e}"),
        _ if size >= 1000.0 => format!("{value:.0}"),
        _ if size >= 100.0 => format!("{value:.1}"),
        _ if size >= 10.0 => format!("{value:.2}"),
        _ if size >= 1.0 => format!("{value:.3}"),
        _ => format!("{value:.4}"),
    };
    let trimmed = if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    trimmed.replace('-', "−")
}

/// Formats a value with its unit.
pub fn with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", number(value)).trim_end().to_string()
}

/// Formats a share as percent.
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        p if p == 0.0 || p >= 10.0 => format!("{p:.0} %"),
        p if p >= 1.0 => format!("{p:.1} %"),
        p => format!("{p:.2} %"),
    }
}

/// Formats a p-value, as HTML.
pub fn p_value(p: f64) -> String {
    text(&mishandle_text::p_value_text(p))
}

/// Returns a table that scrolls on its own if the page is narrow. Cells are HTML.
pub fn table(caption: &str, head: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, cells: &[String]| -> String {
        cells.iter().map(|cell| format!("<{tag}>{cell}</{tag}>")).collect()
    };
    let head: String = head.iter().map(|cell| format!("<th scope=\"col\">{cell}</th>")).collect();
    let body: String = rows.iter().map(|row| format!("<tr>{}</tr>\n", cells("td", row))).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\"><table><caption>{caption}</caption><thead><tr>{head}\
         </tr></thead>\n<tbody>{body}</tbody></table></div>\n"
    )
}

/// Returns a figure: a chart with its caption, which is HTML.
pub fn figure(svg: &str, title: &str, caption: &str) -> String {
    format!("<figure><figcaption><b>{title}</b> {caption}</figcaption>{svg}</figure>\n")
}

/// Encodes bytes as base64.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for digit in 0..4 {
            if digit <= chunk.len() {
                out.push(char::from(DIGITS[(bits >> (18 - 6 * digit) & 63) as usize]));
            } else {
                out.push('=');
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        let encoded = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(encoded, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
    }

    #[test]
    fn formulas_in_sentences_are_code() {
        assert_eq!(with_code("`a < 1` fails & ends"), "<code>a &lt; 1</code> fails &amp; ends");
        assert_eq!(with_code("a ` <b>"), "a ` &lt;b&gt;");
    }

    #[test]
    fn markup_and_invisible_characters_are_escaped() {
        assert_eq!(
            text("<a href=\"x\">&'\u{202e}\u{1b}"),
            "&lt;a href=&quot;x&quot;&gt;&amp;&#39;\\u{202e}\\u{1b}"
        );
        let long = text(&"<".repeat(1_000_000));
        assert!(long.len() < 9000 && long.contains(" … "), "{}", long.len());
    }

    #[test]
    fn a_small_p_value_is_no_tag() {
        assert_eq!([1e-9, 0.25].map(p_value), ["&lt; 0.0001", "0.2500"]);
    }

    #[test]
    fn numbers_have_about_four_digits() {
        let texts = [0.0, -0.52571, 0.2, 12.346, 1234.5, 1e-7, f64::NEG_INFINITY, 3.0].map(number);
        assert_eq!(texts, ["0", "−0.5257", "0.2", "12.35", "1234", "1.00e−7", "−∞", "3"]);
        assert_eq!([0.0, 0.0049, 0.049, 0.51].map(percent), ["0 %", "0.49 %", "4.9 %", "51 %"]);
    }
}
