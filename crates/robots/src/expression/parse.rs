//! The syntax of expressions: that of Python's arithmetic, with names, calls, lists and slices.

use std::ops::Range;

use crate::expression::ExpressionError;
use crate::expression::token::{Kind, Token, tokens};

/// Largest length of a text, bytes.
const MAX_LENGTH: usize = 20_000;

/// Largest number of operators and indices in a row: each of them makes the tree deeper.
const MAX_LINKS: usize = 200;

/// Largest depth of brackets.
const MAX_DEPTH: usize = 40;

/// A part of an expression with the bytes of the text that it covers.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The part.
    pub kind: NodeKind,
    /// Its bytes.
    pub span: Range<usize>,
}

/// Kind of a part of an expression.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeKind {
    /// A number.
    Number(f64),
    /// A quoted text.
    Text(String),
    /// A name.
    Name(String),
    /// A call of a function by its name. Operators are calls of the functions of their symbols.
    Call(String, Vec<Node>),
    /// A list; a part with a star is expanded.
    List(Vec<(bool, Node)>),
    /// One number of a vector.
    Index(Box<Node>, Box<Node>),
    /// A range of a vector: first, and end (excluded).
    Slice(Box<Node>, Option<Box<Node>>, Option<Box<Node>>),
}

/// Parses an expression.
///
/// # Errors
/// If the text is not an expression, or is too long or too deeply nested.
///
/// # Example
/// ```
/// use mishandle_robots::expression::{NodeKind, parse};
/// let tree = parse("-height ** 2").unwrap();
/// assert!(matches!(tree.kind, NodeKind::Call(name, _) if name == "negative"));
/// assert!(parse("height +").is_err());
/// ```
pub fn parse(text: &str) -> Result<Node, ExpressionError> {
    if text.len() > MAX_LENGTH {
        let message = format!("the expression has {} bytes, more than {MAX_LENGTH}", text.len());
        return Err(ExpressionError::new(0..0, message));
    }
    let mut parser = Parser { tokens: tokens(text)?, at: 0, depth: 0, links: 0 };
    let node = parser.expression()?;
    match parser.peek() {
        Kind::End => Ok(node),
        _ => Err(parser.unexpected("the end or an operator")),
    }
}

struct Parser<'a> {
    tokens: Vec<Token<'a>>,
    at: usize,
    depth: usize,
    links: usize,
}

impl<'a> Parser<'a> {
    fn peek(&self) -> Kind<'a> {
        self.tokens[self.at].kind
    }

    fn span(&self) -> Range<usize> {
        self.tokens[self.at].span.clone()
    }

    fn skip(&mut self) {
        self.at = (self.at + 1).min(self.tokens.len() - 1);
    }

    /// Skips a symbol or a word if it is next.
    fn take(&mut self, expected: &str) -> bool {
        let is_next = matches!(self.peek(), Kind::Symbol(found) | Kind::Name(found) if found == expected);
        if is_next {
            self.skip();
        }
        is_next
    }

    fn expect(&mut self, expected: &'static str) -> Result<(), ExpressionError> {
        if self.take(expected) { Ok(()) } else { Err(self.unexpected(&format!("`{expected}`"))) }
    }

    fn unexpected(&self, expected: &str) -> ExpressionError {
        let found = match self.peek() {
            Kind::End => "the end".to_string(),
            Kind::Number(number) => format!("`{number}`"),
            Kind::Name(text) => format!("`{text}`"),
            Kind::Text(text) => format!("'{text}'"),
            Kind::Symbol(text) => format!("`{text}`"),
        };
        ExpressionError::new(self.span(), format!("expected {expected}, found {found}"))
    }

    /// Counts an operator or an index.
    fn link(&mut self) -> Result<(), ExpressionError> {
        self.links += 1;
        if self.links > MAX_LINKS {
            let message =
                format!("the expression has more than {MAX_LINKS} operators; divide it into named constants");
            Err(ExpressionError::new(self.span(), message))
        } else {
            Ok(())
        }
    }

    /// Parses a nested expression.
    fn expression(&mut self) -> Result<Node, ExpressionError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            let message = format!("the expression is nested more than {MAX_DEPTH} times");
            return Err(ExpressionError::new(self.span(), message));
        }
        let node = self.choice();
        self.depth -= 1;
        node
    }

    fn choice(&mut self) -> Result<Node, ExpressionError> {
        let value = self.disjunction()?;
        if !self.take("if") {
            return Ok(value);
        }
        let condition = self.disjunction()?;
        self.expect("else")?;
        let other = self.expression()?;
        Ok(call("where", vec![condition, value, other]))
    }

    fn disjunction(&mut self) -> Result<Node, ExpressionError> {
        self.chain(&["or"], Parser::conjunction)
    }

    fn conjunction(&mut self) -> Result<Node, ExpressionError> {
        self.chain(&["and"], Parser::negation)
    }

    fn negation(&mut self) -> Result<Node, ExpressionError> {
        let mut starts = Vec::new();
        while matches!(self.peek(), Kind::Name("not")) {
            starts.push(self.span().start);
            self.link()?;
            self.skip();
        }
        let value = self.comparison()?;
        Ok(starts.into_iter().rev().fold(value, |value, start| prefix("not", start, value)))
    }

    /// `a < b < c` is `a < b and b < c`.
    fn comparison(&mut self) -> Result<Node, ExpressionError> {
        let mut left = self.sum()?;
        let mut all: Option<Node> = None;
        while let Kind::Symbol(symbol @ ("<" | "<=" | ">" | ">=" | "==" | "!=")) = self.peek() {
            let symbol = symbol.to_string();
            self.link()?;
            self.skip();
            let right = self.sum()?;
            let compared = call(&symbol, vec![left, right.clone()]);
            all = Some(match all {
                Some(all) => call("and", vec![all, compared]),
                None => compared,
            });
            left = right;
        }
        Ok(all.unwrap_or(left))
    }

    fn sum(&mut self) -> Result<Node, ExpressionError> {
        self.chain(&["+", "-"], Parser::product)
    }

    fn product(&mut self) -> Result<Node, ExpressionError> {
        self.chain(&["*", "/", "%"], Parser::signed)
    }

    /// Parses operators of one precedence, from the left.
    fn chain(
        &mut self,
        symbols: &[&str],
        part: fn(&mut Self) -> Result<Node, ExpressionError>,
    ) -> Result<Node, ExpressionError> {
        let mut left = part(self)?;
        while let Some(symbol) = symbols.iter().find(|symbol| self.take(symbol)) {
            self.link()?;
            let right = part(self)?;
            left = call(symbol, vec![left, right]);
        }
        Ok(left)
    }

    fn signed(&mut self) -> Result<Node, ExpressionError> {
        let start = self.span().start;
        let mut negative = false;
        loop {
            if self.take("-") {
                negative = !negative;
            } else if !self.take("+") {
                break;
            }
        }
        let value = self.power()?;
        Ok(if negative { prefix("negative", start, value) } else { value })
    }

    /// A power binds more tightly than a sign to its left, and less than one to its right.
    fn power(&mut self) -> Result<Node, ExpressionError> {
        let base = self.part()?;
        if !self.take("**") {
            return Ok(base);
        }
        self.link()?;
        let exponent = self.signed()?;
        Ok(call("**", vec![base, exponent]))
    }

    fn part(&mut self) -> Result<Node, ExpressionError> {
        let mut node = self.atom()?;
        while self.take("[") {
            self.link()?;
            let first =
                if matches!(self.peek(), Kind::Symbol(":")) { None } else { Some(self.expression()?) };
            let is_slice = self.take(":");
            let end = match self.peek() {
                Kind::Symbol("]") => None,
                _ if is_slice => Some(self.expression()?),
                _ => return Err(self.unexpected("`]`")),
            };
            let span = node.span.start..self.span().end;
            self.expect("]")?;
            let boxed = |node: Option<Node>| node.map(Box::new);
            let kind = match (is_slice, first) {
                (false, Some(index)) => NodeKind::Index(Box::new(node), Box::new(index)),
                (_, first) => NodeKind::Slice(Box::new(node), boxed(first), boxed(end)),
            };
            node = Node { kind, span };
        }
        Ok(node)
    }

    fn atom(&mut self) -> Result<Node, ExpressionError> {
        let span = self.span();
        let kind = match self.peek() {
            Kind::Number(value) => NodeKind::Number(value),
            Kind::Text(text) => NodeKind::Text(text.to_string()),
            Kind::Name("if" | "else" | "and" | "or" | "not") => {
                return Err(self.unexpected("a number, a name or `(`"));
            }
            Kind::Name(name) => {
                let name = name.to_string();
                self.skip();
                if !self.take("(") {
                    return Ok(Node { kind: NodeKind::Name(name), span });
                }
                let arguments = self.list(")", Parser::expression)?;
                let span = span.start..self.tokens[self.at - 1].span.end;
                return Ok(Node { kind: NodeKind::Call(name, arguments), span });
            }
            Kind::Symbol("(") => {
                self.skip();
                let node = self.expression()?;
                self.expect(")")?;
                return Ok(node);
            }
            Kind::Symbol("[") => {
                self.skip();
                let parts = self.list("]", |parser| Ok((parser.take("*"), parser.expression()?)))?;
                let span = span.start..self.tokens[self.at - 1].span.end;
                return Ok(Node { kind: NodeKind::List(parts), span });
            }
            _ => return Err(self.unexpected("a number, a name or `(`")),
        };
        self.skip();
        Ok(Node { kind, span })
    }

    /// Parses parts that are separated by commas, and the closing bracket.
    fn list<T>(
        &mut self,
        close: &'static str,
        part: fn(&mut Self) -> Result<T, ExpressionError>,
    ) -> Result<Vec<T>, ExpressionError> {
        let mut parts = Vec::new();
        while !self.take(close) {
            if !parts.is_empty() && !self.take(",") {
                return Err(self.unexpected(&format!("`,` or `{close}`")));
            }
            if self.take(close) {
                break;
            }
            parts.push(part(self)?);
        }
        Ok(parts)
    }
}

fn call(name: &str, arguments: Vec<Node>) -> Node {
    let start = arguments.iter().map(|node| node.span.start).min().unwrap_or_default();
    let end = arguments.iter().map(|node| node.span.end).max().unwrap_or_default();
    Node { kind: NodeKind::Call(name.to_string(), arguments), span: start..end }
}

fn prefix(name: &str, start: usize, value: Node) -> Node {
    let span = start..value.span.end;
    Node { kind: NodeKind::Call(name.to_string(), vec![value]), span }
}
