/// A word as it has to be typed into a shell: in single quotes, where it holds anything that a shell may read otherwise.
pub fn shell_word(word: &str) -> String {
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
    fn a_shell_gives_the_word_back() {
        for word in ["runs/a-b_1.sqlite", "two words", "it's", "$HOME;ls", "", "*", "a\nb", "~x", "größe"] {
            let line = format!("printf %s {}", shell_word(word));
            let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word, "{line}");
        }
        assert_eq!(shell_word("runs/a-b_1.sqlite"), "runs/a-b_1.sqlite");
    }
}
