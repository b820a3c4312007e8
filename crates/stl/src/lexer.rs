//! The lexer: text to tokens with positions.

use crate::error::{BACKQUOTES, ParseError, Position};
use crate::explain::spelling_of_symbol;
use crate::foreign;
use crate::name;

/// The kind of a token; words and symbols keep their text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind<'t> {
    Number(f64),
    Word(&'t str),
    /// A name in backquotes: the text between them, in which backquotes are doubled.
    Quoted(&'t str),
    Symbol(&'static str),
    End,
}

/// A token and its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Token<'t> {
    pub kind: Kind<'t>,
    pub at: Position,
    pub text: &'t str,
    /// Whether a line break is between this token and the one before it.
    pub starts_line: bool,
}

impl<'t> Token<'t> {
    /// Returns the name that the token can be: the text inside of backquotes, or a word that is not
    /// reserved.
    pub(crate) fn name(&self) -> Option<&'t str> {
        match self.kind {
            Kind::Quoted(inside) => Some(inside),
            Kind::Word(word) if !name::is_reserved(word) => Some(word),
            _ => None,
        }
    }

    /// Returns the token as error messages show it.
    pub(crate) fn found(&self) -> String {
        match self.kind {
            Kind::End => "the end of the formula".to_owned(),
            Kind::Quoted(inside) => name::shown(&name::unescaped(inside)),
            _ => format!("`{}`", name::one_line(self.text)),
        }
    }

    pub(crate) fn is_symbol(&self, symbol: &str) -> bool {
        matches!(self.kind, Kind::Symbol(text) if text == symbol)
    }
}

/// All symbols; a symbol comes before its prefixes. `=>` and `<=>` have no meaning but hints.
const SYMBOLS: [&str; 30] = [
    "!==", "<->", "<=>", "=>", "<=", ">=", "==", "!=", "->", "&&", "||", "<", ">", "=", "!", "&", "|", "+",
    "-", "*", "/", "(", ")", "[", "]", ",", ":", ";", "@", ".",
];

/// Splits `text` into tokens, ending with [`Kind::End`]. Whitespace and comments (`// …`,
/// `/* … */`) separate tokens.
pub(crate) fn tokens(text: &str) -> Result<Vec<Token<'_>>, ParseError> {
    let mut lexer = Lexer { rest: text, at: Position { line: 1, column: 1 } };
    let mut tokens = Vec::new();
    loop {
        let starts_line = lexer.skip_blanks()?;
        let token = Token { starts_line, ..lexer.token()? };
        tokens.push(token);
        if token.kind == Kind::End {
            return Ok(tokens);
        }
    }
}

fn token<'t>(kind: Kind<'t>, at: Position, text: &'t str) -> Token<'t> {
    Token { kind, at, text, starts_line: false }
}

struct Lexer<'t> {
    rest: &'t str,
    at: Position,
}

impl<'t> Lexer<'t> {
    /// Consumes the next `bytes` bytes, which must end at a character boundary.
    fn take(&mut self, bytes: usize) -> &'t str {
        let (taken, rest) = self.rest.split_at(bytes);
        for character in taken.chars() {
            if character == '\n' {
                self.at = Position { line: self.at.line + 1, column: 1 };
            } else {
                self.at.column += 1;
            }
        }
        self.rest = rest;
        taken
    }

    /// Skips whitespace and comments. Returns whether a line break was among them.
    fn skip_blanks(&mut self) -> Result<bool, ParseError> {
        let mut breaks_line = false;
        loop {
            let blank = self.rest.len() - self.rest.trim_start().len();
            breaks_line |= self.take(blank).contains(is_line_break);
            if self.rest.starts_with("//") {
                let line = self.rest.find(is_line_break).unwrap_or(self.rest.len());
                self.take(line);
            } else if self.rest.starts_with("/*") {
                let at = self.at;
                let inside = self.rest[2..].find("*/").ok_or_else(|| ParseError::Unexpected {
                    at,
                    expected: "`*/` to end the comment that starts here".to_owned(),
                    found: "the end of the formula".to_owned(),
                    hint: None,
                })?;
                breaks_line |= self.take(inside + 4).contains(is_line_break);
            } else {
                return Ok(breaks_line);
            }
        }
    }

    fn token(&mut self) -> Result<Token<'t>, ParseError> {
        let at = self.at;
        let Some(first) = self.rest.chars().next() else {
            return Ok(token(Kind::End, at, ""));
        };
        if first == '`' {
            return self.quoted();
        }
        if first.is_ascii_digit() || (first == '.' && digits(&self.rest[1..], 10) > 0) {
            return self.number();
        }
        if is_word_start(first) {
            let end = self.rest.find(|c| !is_word_part(c)).unwrap_or(self.rest.len());
            let text = self.take(end);
            return Ok(token(Kind::Word(text), at, text));
        }
        if let Some(symbol) = SYMBOLS.iter().find(|symbol| self.rest.starts_with(**symbol)) {
            let text = self.take(symbol.len());
            return Ok(token(Kind::Symbol(symbol), at, text));
        }
        Err(ParseError::Unexpected {
            at,
            expected: "a name, a number or an operator".to_owned(),
            found: format!("the character `{}`", name::one_line(first.encode_utf8(&mut [0; 4]))),
            hint: Some(match spelling_of_symbol(first) {
                Some(spelling) => format!("did you mean `{spelling}`?").into(),
                None => foreign::character(first).unwrap_or(BACKQUOTES).into(),
            }),
        })
    }

    /// Reads a name in backquotes. A backquote inside is doubled.
    fn quoted(&mut self) -> Result<Token<'t>, ParseError> {
        let at = self.at;
        let mut length = 1;
        loop {
            let Some(inside) = self.rest[length..].find('`') else {
                return Err(ParseError::Unexpected {
                    at,
                    expected: "a backquote to end the name that starts here".to_owned(),
                    found: "the end of the formula".to_owned(),
                    hint: None,
                });
            };
            length += inside + 1;
            if !self.rest[length..].starts_with('`') {
                break;
            }
            length += 1;
        }
        let text = self.take(length);
        Ok(token(Kind::Quoted(&text[1..length - 1]), at, text))
    }

    /// Reads a number: digits with an optional fraction and exponent, or hexadecimal or binary
    /// digits after `0x` or `0b`. Digits may be separated by underscores.
    fn number(&mut self) -> Result<Token<'t>, ParseError> {
        let at = self.at;
        let prefixed = [("0x", 16), ("0X", 16), ("0b", 2), ("0B", 2)];
        let prefix = prefixed.iter().find(|(prefix, _)| self.rest.starts_with(prefix));
        let (text, value) = match prefix {
            Some((prefix, radix)) if digits(&self.rest[2..], *radix) > 0 => {
                let text = self.take(prefix.len() + digits(&self.rest[2..], *radix));
                let value = u64::from_str_radix(&text[2..].replace('_', ""), *radix);
                (text, value.ok().map(|value| value as f64))
            }
            _ => {
                let length = decimal_length(self.rest).map_err(|length| ParseError::BadNumber {
                    at,
                    text: name::one_line(&self.rest[..length]),
                    expected: "digits in the exponent".to_owned(),
                })?;
                let text = self.take(length);
                (text, text.replace('_', "").parse().ok())
            }
        };
        match value.filter(|value| value.is_finite()) {
            Some(value) => Ok(token(Kind::Number(value), at, text)),
            None => Err(ParseError::BadNumber {
                at,
                text: name::one_line(text),
                expected: "a number within the range of a 64-bit float".to_owned(),
            }),
        }
    }
}

/// Returns the length of the decimal number at the start of `text`. The error is the length up to
/// an exponent without digits.
fn decimal_length(text: &str) -> Result<usize, usize> {
    let mut length = digits(text, 10);
    if text[length..].starts_with('.') {
        length += 1;
        length += digits(&text[length..], 10);
    }
    if text[length..].starts_with(['e', 'E']) {
        length += 1;
        length += usize::from(text[length..].starts_with(['+', '-']));
        match digits(&text[length..], 10) {
            0 => return Err(length),
            exponent => length += exponent,
        }
    }
    Ok(length)
}

/// Returns the number of digits at the start of `text`, counting underscores between digits.
fn digits(text: &str, radix: u32) -> usize {
    if !text.starts_with(|c: char| c.is_digit(radix)) {
        return 0;
    }
    let end = text.find(|c: char| !c.is_digit(radix) && c != '_').unwrap_or(text.len());
    text[..end].trim_end_matches('_').len()
}

/// The characters that end a line: those of files, and others that editors show as line breaks.
fn is_line_break(c: char) -> bool {
    matches!(c, '\n' | '\r' | '\u{b}' | '\u{c}' | '\u{85}' | '\u{2028}' | '\u{2029}')
}

pub(crate) fn is_word_start(c: char) -> bool {
    c.is_alphabetic() || c == '_' || c == '$'
}

pub(crate) fn is_word_part(c: char) -> bool {
    is_word_start(c) || c.is_numeric() || c == '.'
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: &str) {
        let tokens = tokens(text).unwrap();
        let shown: Vec<&str> = tokens.iter().map(|token| token.text).collect();
        assert_eq!(shown.join(" "), format!("{expected} "), "{text}");
    }

    #[test]
    fn tokens_are_as_long_as_possible() {
        check("a<->b", "a <-> b");
        check("a<-1", "a < - 1");
        check("a!==b!=c", "a !== b != c");
        check("a-1e-3.5", "a - 1e-3 .5");
        check("x/0", "x / 0");
        check("pose.x_1>=.5", "pose.x_1 >= .5");
        check("a // to the end\n/* b\n c */ d", "a d");
        check("[1s:2ms]", "[ 1 s : 2 ms ]");
        check("`a b`>`c``/d```", "`a b` > `c``/d```");
        check("``+ ```` -`a\nb`", "`` + ```` - `a\nb`");
    }

    #[test]
    fn a_token_knows_whether_it_starts_a_line() {
        for (text, expected) in [
            ("a b", false),
            ("a\nb", true),
            ("a // c\n b", true),
            ("a // c\r b", true),
            ("a /* c\r\n */ b", true),
            ("a /* c */ b", false),
            ("a\u{2028}b", true),
            ("`a\n` b", false),
        ] {
            assert_eq!(tokens(text).unwrap()[1].starts_line, expected, "{text:?}");
        }
    }

    #[test]
    fn numbers_are_parsed_to_their_value() {
        let cases =
            [("1_000", 1000.0), ("1.", 1.0), (".5", 0.5), ("1E+3", 1000.0), ("0x1F", 31.0), ("0b11", 3.0)];
        for (text, value) in cases {
            assert_eq!(tokens(text).unwrap()[0].kind, Kind::Number(value), "{text}");
        }
    }

    #[test]
    fn lines_and_columns_count_characters() {
        let tokens = tokens("größe >\n  1").unwrap();
        let positions: Vec<_> = tokens.iter().map(|token| (token.at.line, token.at.column)).collect();
        assert_eq!(positions, [(1, 1), (1, 7), (2, 3), (2, 4)]);
    }
}
