/// Quotes a word for a POSIX shell. A word without special characters is returned unchanged.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::shell_quote("runs/a.sqlite"), "runs/a.sqlite");
/// assert_eq!(mishandle_text::shell_quote("my run.sqlite"), "'my run.sqlite'");
/// ```
pub fn shell_quote(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_string();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_restores_the_quoted_word() {
        for word in ["runs/a-b_1.sqlite", "two words", "it's", "$HOME;ls", "", "*", "a\nb", "~x", "größe"] {
            let line = format!("printf %s {}", shell_quote(word));
            let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word, "{line}");
        }
        assert_eq!(shell_quote("runs/a-b_1.sqlite"), "runs/a-b_1.sqlite");
    }
}
