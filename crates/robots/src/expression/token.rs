//! Tokens of an expression.

use std::ops::Range;

use crate::expression::ExpressionError;

/// A token with the bytes that it covers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Token<'a> {
    pub kind: Kind<'a>,
    pub span: Range<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind<'a> {
    Number(f64),
    Name(&'a str),
    Text(&'a str),
    Symbol(&'static str),
    End,
}

/// Operators and brackets, longer ones first.
const SYMBOLS: [&str; 21] = [
    "**", "<=", ">=", "==", "!=", "+", "-", "*", "/", "%", "<", ">", "(", ")", "[", "]", ",", ":", "=", "{",
    "}",
];

/// Splits a text into tokens; the last one is the end.
pub(crate) fn tokens(text: &str) -> Result<Vec<Token<'_>>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if first.is_ascii_digit()
            || (first == '.' && rest[1..].starts_with(|c: char| c.is_ascii_digit()))
        {
            number(rest, at)?
        } else if first.is_alphabetic() || first == '_' {
            let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
            (Kind::Name(&rest[..length]), length)
        } else if first == '\'' || first == '"' {
            let end = rest[1..].find(first);
            let end =
                end.ok_or_else(|| ExpressionError::new(at..text.len(), "the quotation mark is not closed"))?;
            (Kind::Text(&rest[1..=end]), end + 2)
        } else if let Some(symbol) = SYMBOLS.iter().find(|symbol| rest.starts_with(**symbol)) {
            (Kind::Symbol(symbol), symbol.len())
        } else {
            let message = format!("the character `{}` has no meaning here", first.escape_default());
            return Err(ExpressionError::new(at..at + first.len_utf8(), message));
        };
        tokens.push(Token { kind, span: at..at + length });
        at += length;
    }
    tokens.push(Token { kind: Kind::End, span: text.len()..text.len() });
    Ok(tokens)
}

fn number(rest: &str, at: usize) -> Result<(Kind<'_>, usize), ExpressionError> {
    let bytes = rest.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut length = digits(0);
    if bytes.get(length) == Some(&b'.') {
        length += 1 + digits(length + 1);
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        let exponent = digits((length + 1 + sign).min(bytes.len()));
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    let error = |message: String| ExpressionError::new(at..at + length, message);
    let value: f64 = rest[..length].parse().map_err(|_| error("this is not a number".to_string()))?;
    if !value.is_finite() {
        return Err(error("the number is too large".to_string()));
    }
    if rest[length..].starts_with(|c: char| c.is_alphanumeric() || c == '_') {
        return Err(error(format!("a number is followed by a name; write `{} * ...`", &rest[..length])));
    }
    Ok((Kind::Number(value), length))
}
