//! The parser: tokens to a formula in postfix order, by operator precedence with an explicit stack
//! (shunting yard).

use crate::clock::{Bound, Interval, TimeUnit};
use crate::error::{ParseError, Position};
use crate::formula::{Formula, Node};
use crate::lexer::{Kind, Token, tokens};
use crate::operator::{Operator, Shape};
use crate::spelling::nearest_within;
use std::collections::HashMap;

/// The maximum length of a text, bytes.
const MAX_TEXT: usize = 1 << 18;

/// The maximum depth of the operand stack. A monitor has a buffer of the trace's length for each
/// entry.
const MAX_STACK_DEPTH: usize = 64;

/// The maximum number of operators and operands of all statements together, after named
/// sub-formulas are expanded.
const MAX_NODES: usize = 1 << 17;

/// Words that start a declaration of a signal.
const TYPES: [&str; 3] = ["float", "int", "long"];

const OPERAND: &str = "a signal, a number, `(` or a prefix operator";

const NO_INTERVAL: &str = "an operand; only always, eventually, historically, once, until, release, unless and since \
                           take an interval";

/// Parses declarations, definitions and the final formula.
pub(crate) fn parse(text: &str) -> Result<Formula, ParseError> {
    if text.len() > MAX_TEXT {
        return Err(ParseError::TextTooLong {
            at: Position { line: 1, column: 1 },
            bytes: text.len(),
            limit: MAX_TEXT,
        });
    }
    let tokens = tokens(text)?;
    let mut parser = Parser {
        tokens: &tokens,
        expanded: 0,
        next: 0,
        signals: Vec::new(),
        indices: HashMap::new(),
        named: HashMap::new(),
        defined: Vec::new(),
    };
    let nodes = parser.text()?;
    let defined = parser.defined.iter().map(|name| (*name).to_owned()).collect();
    Ok(with_own_signals(nodes, &parser.signals, defined))
}

/// Creates the formula of these nodes. Its signals are numbered by first appearance; signals of
/// unused definitions are dropped.
fn with_own_signals(mut nodes: Vec<Node>, names: &[&str], defined: Vec<String>) -> Formula {
    let mut own = vec![None; names.len()];
    let mut signals = Vec::new();
    for node in &mut nodes {
        if let Node::Signal(signal) = node {
            let name = *signal as usize;
            *signal = *own[name].get_or_insert_with(|| {
                signals.push(names[name].to_owned());
                signals.len() as u32 - 1
            });
        }
    }
    Formula { signals, nodes, defined }
}

struct Parser<'t> {
    tokens: &'t [Token<'t>],
    next: usize,
    /// The signals found so far, and the index of each in this list.
    signals: Vec<&'t str>,
    indices: HashMap<&'t str, u32>,
    /// Named constants and sub-formulas.
    named: HashMap<&'t str, Postfix>,
    /// All defined names, in order.
    defined: Vec<&'t str>,
    /// The number of nodes of all named constants and sub-formulas.
    expanded: usize,
}

/// A formula under construction: nodes in postfix order, the current depth of the operand stack,
/// and its maximum.
#[derive(Default)]
struct Postfix {
    nodes: Vec<Node>,
    depth: usize,
    max_depth: usize,
    /// The number of nodes of the statements before.
    before: usize,
}

/// An operator or open bracket whose last operand is not complete.
enum Pending {
    Operator(Operator, Option<Interval>),
    Parenthesis(Position),
    /// A call and the number of commas still expected.
    Call(Operator, usize, Position),
}

impl<'t> Parser<'t> {
    fn peek(&self) -> Token<'t> {
        self.ahead(0)
    }

    /// Returns the token `n` after the next one; the end token if there are fewer.
    fn ahead(&self, n: usize) -> Token<'t> {
        self.tokens[(self.next + n).min(self.tokens.len() - 1)]
    }

    fn advance(&mut self) -> Token<'t> {
        let token = self.peek();
        self.next += 1;
        token
    }

    fn accept(&mut self, symbol: &str) -> bool {
        let found = self.peek().is_symbol(symbol);
        self.next += usize::from(found);
        found
    }

    fn unexpected<T>(&self, expected: impl Into<String>) -> Result<T, ParseError> {
        let token = self.peek();
        let (expected, found) = (expected.into(), token.found());
        Err(ParseError::Unexpected { at: token.at, expected, found, nearest: None })
    }

    fn expect(&mut self, symbol: &str, why: &str) -> Result<(), ParseError> {
        if self.accept(symbol) { Ok(()) } else { self.unexpected(format!("`{symbol}` {why}")) }
    }

    /// Parses statements up to the end of the text; the last one is the formula.
    fn text(&mut self) -> Result<Vec<Node>, ParseError> {
        loop {
            while self.accept(";") {}
            let Some((name, formula)) = self.statement()? else { continue };
            let has_end = self.peek().is_symbol(";");
            while self.accept(";") {}
            if self.peek().kind == Kind::End {
                return match name {
                    Some(token) if formula.is_number() => {
                        Err(ParseError::NamesNumber { at: token.at, name: token.text.to_owned() })
                    }
                    _ => Ok(formula.nodes),
                };
            }
            match name {
                Some(token) => self.define(token, formula)?,
                None if has_end => {
                    return self
                        .unexpected("the end of the formula; only the last statement may omit `name =`");
                }
                None => return self.unexpected("an operator or the end of the formula"),
            }
        }
    }

    /// Parses one statement: `None` for a declaration, otherwise a formula with the name before its
    /// `=`, if any.
    fn statement(&mut self) -> Result<Option<(Option<Token<'t>>, Postfix)>, ParseError> {
        if self.peek().is_symbol("@") || (self.at_word("from") && self.is_name(1)) {
            return self.unexpected("a formula; RTAMT's ROS annotations and imports are not supported");
        }
        if self.at_word("specification") && self.is_name(1) {
            self.next += 2;
            return Ok(None);
        }
        if self.at_word("const") && self.is_name(1) {
            self.constant()?;
            return Ok(None);
        }
        if self.declares() && !self.ahead(1).is_symbol("=") {
            self.next += 1;
            return Ok(None);
        }
        let name = self.names_statement().then(|| self.peek());
        if let Some(token) = name {
            self.defined.push(token.text);
            self.next += 2;
        }
        Ok(Some((name, self.formula()?)))
    }

    fn at_word(&self, word: &str) -> bool {
        self.peek().kind == Kind::Word(word)
    }

    /// Returns whether the token `n` after the next one can be a name.
    fn is_name(&self, n: usize) -> bool {
        matches!(self.ahead(n).kind, Kind::Word(word) if !is_reserved(word))
    }

    /// Returns whether a statement starts here with `name =`.
    fn names_statement(&self) -> bool {
        self.is_name(0) && self.ahead(1).is_symbol("=")
    }

    /// Skips the direction and type (`input float`) if a declaration starts here; the next token is
    /// then its name.
    fn declares(&mut self) -> bool {
        let direction = usize::from((self.at_word("input") || self.at_word("output")) && self.is_name(1));
        let is_type = matches!(self.ahead(direction).kind, Kind::Word(word) if TYPES.contains(&word));
        let found = is_type && self.is_name(direction + 1);
        self.next += if found { direction + 1 } else { 0 };
        found
    }

    /// Parses a constant: `const float limit = 0.3`.
    fn constant(&mut self) -> Result<(), ParseError> {
        self.next += 1;
        if !matches!(self.peek().kind, Kind::Word(word) if TYPES.contains(&word)) {
            return self.unexpected(format!("the constant's type: {}", TYPES.join(", ")));
        }
        self.next += 1;
        if !self.is_name(0) {
            return self.unexpected("the constant's name");
        }
        let name = self.advance();
        self.expect("=", "and the constant's value")?;
        let sign = if self.accept("-") { -1.0 } else { 1.0 };
        let Kind::Number(value) = self.peek().kind else {
            return self.unexpected("the constant's value, a number");
        };
        self.next += 1;
        self.defined.push(name.text);
        let mut formula = Postfix { before: self.expanded, ..Postfix::default() };
        formula.push(&[Node::Constant(sign * value)], 1, name.at)?;
        self.define(name, formula)
    }

    fn define(&mut self, name: Token<'t>, formula: Postfix) -> Result<(), ParseError> {
        self.expanded += formula.nodes.len();
        match self.named.insert(name.text, formula) {
            None => Ok(()),
            Some(_) => Err(ParseError::DefinedTwice { at: name.at, name: name.text.to_owned() }),
        }
    }

    /// Parses a formula, up to the first token that cannot belong to it.
    fn formula(&mut self) -> Result<Postfix, ParseError> {
        let mut operands = Postfix { before: self.expanded, ..Postfix::default() };
        let mut pending = Vec::new();
        loop {
            self.operand(&mut operands, &mut pending)?;
            while self.accept_closing(&mut operands, &mut pending)? {}
            if self.accept_comma(&mut operands, &mut pending) {
                continue;
            }
            let Some(operator) = self.infix() else { break };
            self.next += 1;
            let interval = self.interval(operator)?;
            reduce(&mut operands, &mut pending, operator.precedence());
            pending.push(Pending::Operator(operator, interval));
        }
        self.finish(&mut operands, &mut pending)?;
        Ok(operands)
    }

    /// Returns the infix operator at the next token, if any. A name before `=` starts the next
    /// statement instead.
    fn infix(&self) -> Option<Operator> {
        match self.peek().kind {
            Kind::Word(_) if self.names_statement() => None,
            Kind::Word(word) => Operator::by_spelling(word, Shape::Infix),
            Kind::Symbol(symbol) => Operator::by_spelling(symbol, Shape::Infix),
            _ => None,
        }
    }

    /// Parses one operand, after any number of opening brackets and prefix operators.
    fn operand(&mut self, operands: &mut Postfix, pending: &mut Vec<Pending>) -> Result<(), ParseError> {
        loop {
            let token = self.peek();
            let text = match token.kind {
                Kind::Number(value) => {
                    self.next += 1;
                    return operands.push(&[Node::Constant(value)], 1, token.at);
                }
                Kind::Symbol("(") => {
                    self.next += 1;
                    pending.push(Pending::Parenthesis(token.at));
                    continue;
                }
                Kind::Symbol("[") if self.next > 0 => return self.unexpected(NO_INTERVAL),
                Kind::Symbol(text) | Kind::Word(text) => text,
                Kind::End => return self.unexpected(OPERAND),
            };
            if let Some(operator) = Operator::by_spelling(text, Shape::Prefix) {
                self.next += 1;
                let interval = self.interval(operator)?;
                pending.push(Pending::Operator(operator, interval));
            } else if let Some(operator) = self.call() {
                self.next += 1;
                self.expect("(", &format!("after `{text}`"))?;
                pending.push(Pending::Call(operator, operator.arity() - 1, token.at));
            } else {
                return self.name(operands);
            }
        }
    }

    /// Returns the function called at the next token, if any. `ln` without a following `(` is an
    /// ordinary name.
    fn call(&self) -> Option<Operator> {
        let operator = Operator::by_spelling(self.peek().text, Shape::Call(0))?;
        (operator != Operator::Ln || self.ahead(1).is_symbol("(")).then_some(operator)
    }

    /// Parses a truth value, a constant, a named sub-formula or a signal.
    fn name(&mut self, operands: &mut Postfix) -> Result<(), ParseError> {
        let token = self.peek();
        let truth = match token.text {
            "true" | "TRUE" => Some(f64::INFINITY),
            "false" | "FALSE" => Some(f64::NEG_INFINITY),
            _ => None,
        };
        if let Some(value) = truth {
            self.next += 1;
            return operands.push(&[Node::Constant(value)], 1, token.at);
        }
        if !self.is_name(0) {
            return self.unexpected(OPERAND);
        }
        self.next += 1;
        if let Some(part) = self.named.get(token.text) {
            return operands.push(&part.nodes, part.max_depth, token.at);
        }
        let index = *self.indices.entry(token.text).or_insert_with(|| {
            self.signals.push(token.text);
            self.signals.len() as u32 - 1
        });
        operands.push(&[Node::Signal(index)], 1, token.at)
    }

    /// Consumes a `)` that closes a parenthesis or a call of this formula.
    fn accept_closing(
        &mut self,
        operands: &mut Postfix,
        pending: &mut Vec<Pending>,
    ) -> Result<bool, ParseError> {
        if !self.peek().is_symbol(")") {
            return Ok(false);
        }
        reduce(operands, pending, 0);
        match pending.pop() {
            Some(Pending::Parenthesis(_)) => {}
            Some(Pending::Call(operator, 0, _)) => operands.apply(operator, None),
            Some(Pending::Call(operator, ..)) => {
                return self.unexpected(format!("`,` and another operand of `{}`", operator.name()));
            }
            _ => return self.unexpected("an operator or the end of the formula"),
        }
        self.next += 1;
        Ok(true)
    }

    /// Consumes a `,` between two operands of a call.
    fn accept_comma(&mut self, operands: &mut Postfix, pending: &mut Vec<Pending>) -> bool {
        if !self.peek().is_symbol(",") {
            return false;
        }
        reduce(operands, pending, 0);
        match pending.last_mut() {
            Some(Pending::Call(_, commas, _)) if *commas > 0 => {
                *commas -= 1;
                self.next += 1;
                true
            }
            _ => false,
        }
    }

    /// Applies the pending operators at the end of a formula, where no bracket may be open.
    fn finish(&self, operands: &mut Postfix, pending: &mut Vec<Pending>) -> Result<(), ParseError> {
        reduce(operands, pending, 0);
        let expected = match pending.last() {
            None if self.ends_statement() => return Ok(()),
            None => "an operator or the end of the formula".to_owned(),
            Some(Pending::Parenthesis(at)) => format!("an operator or `)` to match the `(` at {at}"),
            Some(Pending::Call(operator, 0, at)) => {
                format!("an operator or `)` to end the `{}(` at {at}", operator.name())
            }
            Some(Pending::Call(operator, _, at)) => {
                format!("an operator or `,` in the `{}(` at {at}", operator.name())
            }
            // `reduce` applies every pending operator above a bracket.
            Some(Pending::Operator(..)) => return Ok(()),
        };
        let (token, nearest) = (self.peek(), self.suggested_operator());
        Err(ParseError::Unexpected { at: token.at, expected, found: token.found(), nearest })
    }

    /// Returns a suggestion where an operator was expected: the infix operator most similar to the
    /// next token, or the prefix operator most similar to the name before it, which was parsed as
    /// an operand.
    fn suggested_operator(&self) -> Option<&'static str> {
        if self.peek().is_symbol("=") {
            return Some("==");
        }
        let operator = |token: &Token<'_>, shapes: &[Shape]| match token.kind {
            Kind::Word(word) if !is_reserved(word) => nearest_operator(word, shapes),
            _ => None,
        };
        let before = self.next.checked_sub(1).map(|index| &self.tokens[index]);
        operator(&self.peek(), &[Shape::Infix])
            .or_else(|| before.and_then(|token| operator(token, &[Shape::Prefix, Shape::Call(0)])))
    }

    fn ends_statement(&self) -> bool {
        let token = self.peek();
        token.kind == Kind::End || token.is_symbol(";") || self.names_statement()
    }

    /// Parses the optional interval of `operator`.
    fn interval(&mut self, operator: Operator) -> Result<Option<Interval>, ParseError> {
        let at = self.peek().at;
        if !operator.takes_interval() || !self.accept("[") {
            return Ok(None);
        }
        let mut begin = self.bound()?;
        if !begin.value.is_finite() {
            self.next -= 1;
            return self.unexpected("a finite begin");
        }
        if !self.accept(":") && !self.accept(",") {
            let unit = if begin.unit.is_none() { "a unit (s, ms, us, ns), " } else { "" };
            return self.unexpected(format!("{unit}`:` or `,` and the interval's end"));
        }
        let mut end = self.bound()?;
        if end.value.is_infinite() {
            end.unit = begin.unit;
        }
        if begin.unit.is_some() && end.unit.is_none() {
            return self.unexpected("a unit (s, ms, us, ns) at the interval's end, since its begin has one");
        }
        if !self.peek().is_symbol("]") && end.unit.is_none() {
            return self.unexpected("a unit (s, ms, us, ns) or `]`");
        }
        self.expect("]", "to end the interval")?;
        begin.unit = begin.unit.or(end.unit);
        let interval = Interval { begin, end };
        if interval.is_reversed() {
            let (begin, end) = (begin.to_string(), end.to_string());
            return Err(ParseError::BeginAfterEnd { at, begin, end });
        }
        Ok(Some(interval))
    }

    /// Parses a bound: a number, a constant or `inf`, with an optional unit.
    fn bound(&mut self) -> Result<Bound, ParseError> {
        let value = match self.peek().kind {
            Kind::Number(value) => Some(value),
            Kind::Word(word) => match self.named.get(word).map(|part| part.nodes.as_slice()) {
                Some([Node::Constant(value)]) => Some(*value),
                Some(_) => None,
                None => (word == "inf").then_some(f64::INFINITY),
            },
            _ => None,
        };
        let Some(value) = value.filter(|value| *value >= 0.0) else {
            return self.unexpected("a bound: a nonnegative number, a constant or `inf`");
        };
        self.next += 1;
        let unit = TimeUnit::ALL.into_iter().find(|unit| self.at_word(unit.symbol()));
        self.next += usize::from(unit.is_some());
        Ok(Bound { value, unit })
    }
}

impl Postfix {
    /// Returns whether the nodes contain no signal and no truth value.
    fn is_number(&self) -> bool {
        let is_finite = |node: &Node| matches!(node, Node::Constant(value) if value.is_finite());
        self.nodes.iter().all(|node| is_finite(node) || matches!(node, Node::Apply(..)))
    }

    /// Appends an operand that itself needs a stack depth of `depth`.
    fn push(&mut self, nodes: &[Node], depth: usize, at: Position) -> Result<(), ParseError> {
        self.max_depth = self.max_depth.max(self.depth + depth);
        if self.max_depth > MAX_STACK_DEPTH {
            return Err(ParseError::TooDeep { at, limit: MAX_STACK_DEPTH });
        }
        if self.before + self.nodes.len() + nodes.len() > MAX_NODES {
            return Err(ParseError::TooLong { at, limit: MAX_NODES });
        }
        self.nodes.extend_from_slice(nodes);
        self.depth += 1;
        Ok(())
    }

    /// Applies an operator to the last operands. The minus sign of a constant becomes part of the
    /// constant.
    fn apply(&mut self, operator: Operator, interval: Option<Interval>) {
        if let (Operator::Negate, Some(Node::Constant(value))) = (operator, self.nodes.last_mut()) {
            *value = -*value;
            return;
        }
        self.depth -= operator.arity() - 1;
        self.nodes.push(Node::Apply(operator, interval));
    }
}

/// Applies the pending operators that bind at least as tightly as `precedence`, up to the innermost
/// open bracket.
fn reduce(operands: &mut Postfix, pending: &mut Vec<Pending>, precedence: u8) {
    while let Some(&Pending::Operator(operator, interval)) = pending.last() {
        if operator.precedence() < precedence {
            break;
        }
        pending.pop();
        operands.apply(operator, interval);
    }
}

/// Returns the spelling of an operator of these shapes that is most similar to `word`: an edit
/// distance of at most a third of its letters. Spellings of one letter are not suggested, since
/// every letter is similar to them.
fn nearest_operator(word: &str, shapes: &[Shape]) -> Option<&'static str> {
    let words = Operator::words(shapes).filter(|word| word.len() > 1);
    nearest_within(word.chars().count() / 3, word, words)
}

/// Returns whether `word` cannot name a signal or a sub-formula. `R`, `release` and `ln` are names
/// in RTAMT, so their position decides whether they are operators.
fn is_reserved(word: &str) -> bool {
    let decided_by_position = [Operator::Release, Operator::Ln];
    let is_operator =
        |operator: Operator| operator.spellings().contains(&word) && !decided_by_position.contains(&operator);
    ["true", "TRUE", "false", "FALSE"].contains(&word) || Operator::all().any(is_operator)
}
