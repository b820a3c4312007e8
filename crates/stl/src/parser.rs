//! The parser: tokens to a formula in postfix order, by operator precedence with an explicit stack
//! (shunting yard).

use crate::clock::{Bound, Interval, TimeUnit};
use crate::error::{BACKQUOTES, FINITE, NO_UNIT, ParseError, Position, letter_hint};
use crate::foreign;
use crate::formula::{Definition, Formula, Node};
use crate::lexer::{Kind, Token, tokens};
use crate::name::{is_not_finite, is_reserved, is_truth_value, unescaped};
use crate::operator::{Operator, Shape};
use crate::spelling::nearest_within;
use crate::syntax::{Origin, Parameter};
use std::collections::{HashMap, HashSet};

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

const AT_TIME: &str = "a signal is read at its sample by its name alone, without `[t]`";

const NO_INTERVAL: &str = "an operand; only always, eventually, historically, once, until, release, unless and since \
                           take an interval";

/// Parses declarations, definitions and the final formula. The names of parameters are constants.
pub(crate) fn parse<'t>(text: &'t str, parameters: &'t [Parameter<'t>]) -> Result<Formula, ParseError> {
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
        used: HashSet::new(),
        in_definition: false,
        parameters,
    };
    for (index, parameter) in (0..).zip(parameters) {
        let origin = Origin { parameter: Some(index), ..Origin::default() };
        let constant =
            Postfix { nodes: vec![Node::Constant(parameter.value)], max_depth: 1, ..Postfix::default() };
        parser.named.insert(parameter.name, Postfix { origins: vec![origin], ..constant });
    }
    let Postfix { nodes, origins, .. } = parser.text()?;
    let used = &parser.used;
    let definition = |name: &&str| Definition { name: unescaped(name), is_used: used.contains(name) };
    let defined = parser.defined.iter().map(definition).collect();
    Ok(with_own_signals(nodes, origins, &parser.signals, defined))
}

/// Creates the formula of these nodes. Its signals are numbered by first appearance; signals of
/// unused definitions are dropped.
fn with_own_signals(
    mut nodes: Vec<Node>,
    origins: Vec<Origin>,
    names: &[&str],
    defined: Vec<Definition>,
) -> Formula {
    let mut own = vec![None; names.len()];
    let mut signals = Vec::new();
    for node in &mut nodes {
        if let Node::Signal(signal) = node {
            let name = *signal as usize;
            *signal = *own[name].get_or_insert_with(|| {
                signals.push(unescaped(names[name]));
                signals.len() as u32 - 1
            });
        }
    }
    Formula { signals, nodes, origins, defined }
}

struct Parser<'t> {
    tokens: &'t [Token<'t>],
    next: usize,
    /// The signals found so far, and the index of each in this list with the position of its first
    /// use. A name is its text inside of its backquotes, if it has some: plain words contain none.
    signals: Vec<&'t str>,
    indices: HashMap<&'t str, (u32, Position)>,
    /// Named constants and sub-formulas.
    named: HashMap<&'t str, Postfix>,
    /// All defined names, in order, and those of them that statements read.
    defined: Vec<&'t str>,
    used: HashSet<&'t str>,
    /// Whether the statement has the form `name = formula`, so that another one follows it.
    in_definition: bool,
    /// The number of nodes of all named constants and sub-formulas.
    expanded: usize,
    parameters: &'t [Parameter<'t>],
}

/// A formula under construction: nodes in postfix order, the current depth of the operand stack,
/// and its maximum.
#[derive(Default)]
struct Postfix {
    nodes: Vec<Node>,
    /// Where each node comes from.
    origins: Vec<Origin>,
    depth: usize,
    max_depth: usize,
    /// The number of nodes of the statements before.
    before: usize,
}

/// The parameters that are the bounds of an interval.
type Bounds = [Option<u32>; 2];

/// A formula, with the name before its `=` and the position of the name.
type Statement<'t> = (Option<(&'t str, Position)>, Postfix);

/// An operator or open bracket whose last operand is not complete.
enum Pending {
    Operator(Operator, Option<Interval>, Origin),
    Parenthesis(Position),
    /// A call and the number of commas still expected.
    Call(Operator, usize, Position),
}

impl Pending {
    fn is_bracket(&self) -> bool {
        !matches!(self, Pending::Operator(..))
    }
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
        let expected = expected.into();
        let found = token.found();
        Err(ParseError::Unexpected { at: token.at, expected, found, hint: None })
    }

    /// The error where an operand must be.
    fn no_operand<T>(&self) -> Result<T, ParseError> {
        let token = self.peek();
        let is_part_of_name = ["/", ".", ":", "@"].iter().any(|symbol| token.is_symbol(symbol));
        let hint = match token.kind {
            Kind::Word(word) if is_not_finite(word) => Some(FINITE.into()),
            Kind::Word(word) if Operator::by_letter(word, Shape::Infix).is_some() => Some(letter_hint(word)),
            Kind::Symbol("[") if self.ahead(1).is_symbol("]") => Some("`[]` is `always`".into()),
            Kind::Symbol("<") if self.ahead(1).is_symbol(">") => Some("`<>` is `eventually`".into()),
            _ => is_part_of_name.then(|| BACKQUOTES.into()),
        };
        let expected = OPERAND.to_owned();
        let found = token.found();
        Err(ParseError::Unexpected { at: token.at, expected, found, hint })
    }

    fn expect(&mut self, symbol: &str, why: &str) -> Result<(), ParseError> {
        if self.accept(symbol) { Ok(()) } else { self.unexpected(format!("`{symbol}` {why}")) }
    }

    /// Parses statements up to the end of the text; the last one is the formula.
    fn text(&mut self) -> Result<Postfix, ParseError> {
        loop {
            while self.accept(";") {}
            let Some((definition, formula)) = self.statement()? else {
                self.end_declaration()?;
                continue;
            };
            let has_end = self.peek().is_symbol(";");
            while self.accept(";") {}
            let is_last = self.peek().kind == Kind::End;
            let Some((name, at)) = definition else {
                return match () {
                    () if is_last => Ok(formula),
                    () if has_end => {
                        self.unexpected("the end of the formula; only the last statement may omit `name =`")
                    }
                    () => self.unexpected("an operator or the end of the formula"),
                };
            };
            if is_last && formula.is_number() {
                return Err(ParseError::NamesNumber { at, name: unescaped(name) });
            }
            if is_last {
                self.used.insert(name);
                self.check_new(name, at)?;
                return Ok(formula);
            }
            self.define(name, at, formula)?;
        }
    }

    /// Checks that no operator follows a declaration.
    fn end_declaration(&mut self) -> Result<(), ParseError> {
        if self.infix().is_none() {
            return Ok(());
        }
        self.unexpected("`;` after a declaration, which has no operators; a constant is one number")
    }

    /// Parses one statement: `None` for a declaration, otherwise a formula with the name before its
    /// `=` and its position, if any.
    fn statement(&mut self) -> Result<Option<Statement<'t>>, ParseError> {
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
        self.check_reserved()?;
        let definition = self.name_of_statement().map(|name| (name, self.peek().at));
        if let Some((name, _)) = definition {
            self.defined.push(name);
            self.next += 2;
        }
        self.in_definition = definition.is_some();
        Ok(Some((definition, self.formula()?)))
    }

    /// Checks that the next tokens do not define a word that has a meaning.
    fn check_reserved(&self) -> Result<(), ParseError> {
        match self.peek() {
            Token { kind: Kind::Word(word), at, .. } if is_reserved(word) && self.ahead(1).is_symbol("=") => {
                Err(ParseError::Reserved { at, name: word.to_owned() })
            }
            _ => Ok(()),
        }
    }

    fn at_word(&self, word: &str) -> bool {
        self.peek().kind == Kind::Word(word)
    }

    /// Returns whether the token `n` after the next one can be a name.
    fn is_name(&self, n: usize) -> bool {
        self.ahead(n).name().is_some()
    }

    /// Returns the name of the statement that starts here with `name =`.
    fn name_of_statement(&self) -> Option<&'t str> {
        self.peek().name().filter(|_| self.ahead(1).is_symbol("="))
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
        self.check_reserved()?;
        let Token { at, .. } = self.peek();
        let Some(name) = self.advance().name() else {
            self.next -= 1;
            return self.unexpected("the constant's name");
        };
        self.expect("=", "and the constant's value")?;
        let sign = if self.accept("-") { -1.0 } else { 1.0 };
        let Kind::Number(value) = self.peek().kind else {
            return self.unexpected("the constant's value, a number");
        };
        self.next += 1;
        self.defined.push(name);
        let mut formula = Postfix { before: self.expanded, ..Postfix::default() };
        formula.push_one(Node::Constant(sign * value + 0.0), at)?;
        self.define(name, at, formula)
    }

    fn define(&mut self, name: &'t str, at: Position, formula: Postfix) -> Result<(), ParseError> {
        self.check_new(name, at)?;
        self.expanded += formula.nodes.len();
        self.named.insert(name, formula);
        Ok(())
    }

    /// Checks that no statement before defines or reads this name.
    fn check_new(&self, name: &str, at: Position) -> Result<(), ParseError> {
        if self.named.contains_key(name) {
            return Err(ParseError::DefinedTwice { at, name: unescaped(name) });
        }
        match self.indices.get(name) {
            Some((_, first)) => Err(ParseError::DefinedAfterUse { at, name: unescaped(name), first: *first }),
            None => Ok(()),
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
            self.check_reserved()?;
            // A minus sign, or an operator that can be a name as well.
            if self.can_end(&pending) && (self.peek().is_symbol("-") || self.is_name(0)) {
                return self.ambiguous(self.peek());
            }
            let at = self.advance().at;
            let (interval, bounds) = self.interval(operator)?;
            reduce(&mut operands, &mut pending, operator.precedence());
            pending.push(Pending::Operator(operator, interval, Origin { bounds, ..Origin::at(at) }));
        }
        self.finish(&mut operands, &mut pending)?;
        Ok(operands)
    }

    /// Returns whether the definition can end before the next token, because a line starts there.
    fn can_end(&self, pending: &[Pending]) -> bool {
        self.in_definition && self.peek().starts_line && !pending.iter().any(Pending::is_bracket)
    }

    fn ambiguous<T>(&self, token: Token<'_>) -> Result<T, ParseError> {
        Err(ParseError::Ambiguous { at: token.at, found: token.found() })
    }

    /// Returns the infix operator at the next token, if any. A name before `=` starts the next
    /// statement instead.
    fn infix(&self) -> Option<Operator> {
        match self.peek().kind {
            Kind::Word(_) if self.name_of_statement().is_some() => None,
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
                    return operands.push_one(Node::Constant(value), token.at);
                }
                Kind::Symbol("(") => {
                    self.next += 1;
                    pending.push(Pending::Parenthesis(token.at));
                    continue;
                }
                Kind::Symbol("[") if self.next > 0 => return self.unexpected(NO_INTERVAL),
                Kind::Symbol(text) | Kind::Word(text) => text,
                Kind::Quoted(_) => return self.name(operands),
                Kind::End => return self.no_operand(),
            };
            if let Some(operator) = Operator::by_spelling(text, Shape::Prefix) {
                self.next += 1;
                let is_letter = Operator::by_letter(text, Shape::Prefix).is_some();
                if is_letter {
                    self.check_after_letter(text)?;
                }
                let (interval, bounds) = self.interval(operator)?;
                let origin = Origin { bounds, is_letter, ..Origin::at(token.at) };
                pending.push(Pending::Operator(operator, interval, origin));
            } else if let Some(operator) = self.call() {
                self.next += 1;
                // The name `ln`, or the function.
                if operator == Operator::Ln && self.can_end(pending) {
                    return self.ambiguous(self.peek());
                }
                self.expect("(", &format!("after `{text}`"))?;
                pending.push(Pending::Call(operator, operator.arity() - 1, token.at));
            } else {
                return self.name(operands);
            }
        }
    }

    /// Checks that the next token starts a formula and not a number: `X - 1` is meant as a signal
    /// `X` and not as `next(-1)`.
    fn check_after_letter(&self, letter: &str) -> Result<(), ParseError> {
        let token = self.peek();
        let is_operator = |word: &str| {
            [Shape::Prefix, Shape::Call(0)].iter().any(|shape| Operator::by_spelling(word, *shape).is_some())
        };
        let starts_formula = match token.kind {
            Kind::Symbol(symbol) => ["(", "[", "!"].contains(&symbol),
            Kind::Word(word) => is_operator(word) || is_truth_value(word) || token.name().is_some(),
            Kind::Quoted(_) => true,
            Kind::Number(_) | Kind::End => false,
        };
        if starts_formula {
            return Ok(());
        }
        let expected = format!("`(`, `[`, `!`, a name or an operator after the operator `{letter}`");
        let hint = Some(letter_hint(letter));
        Err(ParseError::Unexpected { at: token.at, expected, found: token.found(), hint })
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
            return operands.push_one(Node::Constant(value), token.at);
        }
        let Some(name) = token.name() else { return self.no_operand() };
        self.next += 1;
        if let Some(part) = self.named.get(name) {
            self.used.insert(name);
            return operands.push(part, token.at);
        }
        let (index, _) = *self.indices.entry(name).or_insert_with(|| {
            self.signals.push(name);
            (self.signals.len() as u32 - 1, token.at)
        });
        operands.push_one(Node::Signal(index), token.at)
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
            Some(Pending::Parenthesis(_)) => {
                if let Some(origin) = operands.origins.last_mut() {
                    origin.in_parentheses = true;
                }
            }
            Some(Pending::Call(operator, 0, at)) => operands.apply(operator, None, Origin::at(at)),
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
            None if self.in_definition && self.peek().starts_line => {
                "an operator or the next statement".to_owned()
            }
            None if self.in_definition => {
                "an operator, or `;` or a line break before the next statement".to_owned()
            }
            None if self.peek().starts_line => {
                "an operator or the end of the formula, since only the last statement may omit `name =`"
                    .to_owned()
            }
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
        let token = self.peek();
        let is_index = token.is_symbol("[") && self.ahead(2).is_symbol("]");
        let is_part_of_name = is_index || [".", ":", "@"].iter().any(|symbol| token.is_symbol(symbol));
        let follows_number = self.before().is_some_and(|before| matches!(before.kind, Kind::Number(_)));
        let function = self.before().and_then(|before| foreign::function(before.text));
        let hint = match self.suggested_operator() {
            _ if function.is_some() => function.map(Into::into),
            _ if is_index && self.ahead(1).kind == Kind::Word("t") => Some(AT_TIME.into()),
            Some(operator) => Some(format!("did you mean `{operator}`?").into()),
            None if follows_number && matches!(token.kind, Kind::Word(_)) => Some(NO_UNIT.into()),
            None => is_part_of_name.then(|| BACKQUOTES.into()),
        };
        Err(ParseError::Unexpected { at: token.at, expected, found: token.found(), hint })
    }

    /// Returns a suggestion where an operator was expected: the infix operator most similar to the
    /// next token, or the operator most similar to the name before it, which was parsed as an
    /// operand: a prefix operator, or at the start of a line an infix operator.
    fn suggested_operator(&self) -> Option<&'static str> {
        let before = self.before();
        let is_word = |token: &&Token<'_>| matches!(token.kind, Kind::Word(_));
        let of_others = [
            foreign::operator(self.peek().text),
            before.filter(is_word).and_then(|token| foreign::operator(token.text)),
        ];
        if let Some(operator) = of_others.into_iter().flatten().next() {
            return Some(operator);
        }
        let operator = |token: &Token<'_>, shapes: &[Shape]| match token.kind {
            Kind::Word(word) if !is_reserved(word) => nearest_operator(word, shapes),
            _ => None,
        };
        let shapes = |token: &Token<'_>| {
            if token.starts_line {
                [Shape::Prefix, Shape::Call(0), Shape::Infix]
            } else {
                [Shape::Prefix, Shape::Call(0), Shape::Prefix]
            }
        };
        operator(&self.peek(), &[Shape::Infix])
            .or_else(|| before.and_then(|token| operator(token, &shapes(token))))
    }

    /// Returns the token before the next one.
    fn before(&self) -> Option<&Token<'t>> {
        self.next.checked_sub(1).map(|index| &self.tokens[index])
    }

    /// Returns whether the statement can end before the next token, which cannot continue it.
    fn ends_statement(&self) -> bool {
        let token = self.peek();
        token.kind == Kind::End
            || token.is_symbol(";")
            || self.name_of_statement().is_some()
            || self.in_definition && token.starts_line && starts_statement(token)
    }

    /// Parses the optional interval of `operator`, and returns the parameters that are its bounds.
    fn interval(&mut self, operator: Operator) -> Result<(Option<Interval>, Bounds), ParseError> {
        let at = self.peek().at;
        if !operator.takes_interval() || !self.accept("[") {
            return Ok((None, [None; 2]));
        }
        let (mut begin, begin_parameter) = self.bound()?;
        if !begin.value.is_finite() {
            self.next -= 1;
            return self.unexpected("a finite begin");
        }
        if !self.accept(":") && !self.accept(",") {
            let unit = if begin.unit.is_none() { "a unit (s, ms, us, ns), " } else { "" };
            return self.unexpected(format!("{unit}`:` or `,` and the interval's end"));
        }
        let (mut end, end_parameter) = self.bound()?;
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
            let begin = begin.to_string();
            let end = end.to_string();
            return Err(ParseError::BeginAfterEnd { at, begin, end });
        }
        Ok((Some(interval), [begin_parameter, end_parameter]))
    }

    /// Parses a bound: a number, a constant or `inf`, with an optional unit.
    fn bound(&mut self) -> Result<(Bound, Option<u32>), ParseError> {
        let mut parameter = None;
        let value = match self.peek().kind {
            Kind::Number(value) => Some(value),
            Kind::Word(name) | Kind::Quoted(name) => {
                let named = self.named.get(name);
                match named.map(|part| part.nodes.as_slice()) {
                    Some([Node::Constant(value)]) => {
                        self.used.insert(name);
                        parameter = named.and_then(|part| part.origins.first()?.parameter);
                        Some(*value)
                    }
                    Some(_) => None,
                    None => self.at_word("inf").then_some(f64::INFINITY),
                }
            }
            _ => None,
        };
        let Some(value) = value.filter(|value| *value >= 0.0) else {
            return self.unexpected("a bound: a nonnegative number, a constant or `inf`");
        };
        self.next += 1;
        let unit = TimeUnit::ALL.into_iter().find(|unit| self.at_word(unit.symbol()));
        self.next += usize::from(unit.is_some());
        let own = parameter.and_then(|index| self.parameters[index as usize].unit);
        Ok((Bound { value, unit: unit.or(own) }, parameter))
    }
}

impl Postfix {
    /// Returns whether the nodes contain no signal and no truth value.
    fn is_number(&self) -> bool {
        let is_finite = |node: &Node| matches!(node, Node::Constant(value) if value.is_finite());
        self.nodes.iter().all(|node| is_finite(node) || matches!(node, Node::Apply(..)))
    }

    /// Appends a signal or a number.
    fn push_one(&mut self, node: Node, at: Position) -> Result<(), ParseError> {
        self.check(1, 1, at)?;
        self.nodes.push(node);
        self.origins.push(Origin::at(at));
        self.depth += 1;
        Ok(())
    }

    /// Appends a named constant or sub-formula.
    fn push(&mut self, part: &Postfix, at: Position) -> Result<(), ParseError> {
        self.check(part.max_depth, part.nodes.len(), at)?;
        self.nodes.extend_from_slice(&part.nodes);
        self.origins.extend_from_slice(&part.origins);
        if let Some(last) = self.origins.last_mut() {
            // The name stands where the parentheses would.
            *last = Origin { at: Some(at), in_parentheses: true, ..*last };
        }
        self.depth += 1;
        Ok(())
    }

    /// Checks the limits before an operand of `nodes` nodes that itself needs a stack depth of
    /// `depth`.
    fn check(&mut self, depth: usize, nodes: usize, at: Position) -> Result<(), ParseError> {
        self.max_depth = self.max_depth.max(self.depth + depth);
        if self.max_depth > MAX_STACK_DEPTH {
            return Err(ParseError::TooDeep { at, limit: MAX_STACK_DEPTH });
        }
        if self.before + self.nodes.len() + nodes > MAX_NODES {
            return Err(ParseError::TooLong { at, limit: MAX_NODES });
        }
        Ok(())
    }

    /// Applies an operator to the last operands. The minus sign of a constant becomes part of the
    /// constant, unless it is a parameter.
    fn apply(&mut self, operator: Operator, interval: Option<Interval>, origin: Origin) {
        let is_parameter = self.origins.last().is_some_and(|last| last.parameter.is_some());
        if let (Operator::Negate, Some(Node::Constant(value)), false) =
            (operator, self.nodes.last_mut(), is_parameter)
        {
            // Not −0.0, since a number that is not negative holds.
            *value = 0.0 - *value;
            return;
        }
        self.depth -= operator.arity() - 1;
        self.nodes.push(Node::Apply(operator, interval));
        self.origins.push(origin);
    }
}

/// Applies the pending operators that bind at least as tightly as `precedence`, up to the innermost
/// open bracket.
fn reduce(operands: &mut Postfix, pending: &mut Vec<Pending>, precedence: u8) {
    while let Some(&Pending::Operator(operator, interval, origin)) = pending.last() {
        if operator.precedence() < precedence {
            break;
        }
        pending.pop();
        operands.apply(operator, interval, origin);
    }
}

/// Returns the spelling of an operator of these shapes that is most similar to `word`: an edit
/// distance of at most a third of its letters. Spellings of one letter are not suggested, since
/// every letter is similar to them.
fn nearest_operator(word: &str, shapes: &[Shape]) -> Option<&'static str> {
    let words = Operator::words(shapes).filter(|word| word.len() > 1);
    nearest_within(word.chars().count() / 3, word, words)
}

/// Returns whether a statement can start with this token; the others are errors of the statement
/// before it.
fn starts_statement(token: Token<'_>) -> bool {
    match token.kind {
        Kind::Symbol(symbol) => {
            ["(", "@"].contains(&symbol) || Operator::by_spelling(symbol, Shape::Prefix).is_some()
        }
        _ => true,
    }
}
