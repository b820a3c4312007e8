/// Escapes a text for XML, which allows no control characters.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::xml_text("a < \"b\"\u{1b}"), "a &lt; &quot;b&quot;\u{fffd}");
/// ```
pub fn xml_text(text: &str) -> String {
    let mut escaped = String::new();
    for character in text.chars() {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\n' => escaped.push('\n'),
            _ if character.is_control() || matches!(character, '\u{fffe}' | '\u{ffff}') => {
                escaped.push('\u{fffd}');
            }
            _ => escaped.push(character),
        }
    }
    escaped
}
