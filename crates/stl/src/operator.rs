//! The table of operators: spellings, precedence and operands.

/// An operator or function of the language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Operator {
    Negate,
    Abs,
    Sqrt,
    Exp,
    Ln,
    Pow,
    Multiply,
    Divide,
    Add,
    Subtract,
    LessOrEqual,
    GreaterOrEqual,
    Less,
    Greater,
    Equal,
    NotEqual,
    Not,
    Always,
    Eventually,
    Historically,
    Once,
    Previous,
    Next,
    StrongPrevious,
    StrongNext,
    Until,
    Release,
    Unless,
    Since,
    And,
    Or,
    Implies,
    Iff,
    Xor,
    Rise,
    Fall,
}

/// The position of an operator relative to its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// Before its only operand.
    Prefix,
    /// Between its two operands; all infix operators are left-associative.
    Infix,
    /// A name with this many operands in parentheses.
    Call(usize),
}

impl Shape {
    /// Returns whether both shapes are equal, ignoring the number of operands of a call.
    fn is_like(self, other: Shape) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// Whether the value at a sample depends on other samples, and whether the operator takes an
/// interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Time {
    Pointwise,
    Untimed,
    Timed,
}

use Operator::*;
use Shape::{Call, Infix, Prefix};
use Time::{Pointwise, Timed, Untimed};

type Row = (Operator, &'static [&'static str], Shape, u8, Time);

/// Spellings (the first is printed), shape, precedence (larger binds tighter), relation to time.
///
/// The precedence is that of RTAMT 0.4.10 with one correction: in RTAMT `*` binds tighter than `/`
/// and `+` tighter than `-`, so it parses `a - b + c` as `a - (b + c)`. Here both operators of each
/// pair have the same precedence. All infix operators, including `->`, are left-associative.
/// RTAMT's grammar has no `ln`, no `release`, and a unary minus only on numbers.
#[rustfmt::skip]
const TABLE: [Row; 36] = [
    (Negate,         &["-"],                       Prefix,  25, Pointwise),
    (Abs,            &["abs"],                     Call(1), 26, Pointwise),
    (Sqrt,           &["sqrt"],                    Call(1), 26, Pointwise),
    (Exp,            &["exp"],                     Call(1), 26, Pointwise),
    (Ln,             &["ln"],                      Call(1), 26, Pointwise),
    (Pow,            &["pow"],                     Call(2), 26, Pointwise),
    (Multiply,       &["*"],                       Infix,   24, Pointwise),
    (Divide,         &["/"],                       Infix,   24, Pointwise),
    (Add,            &["+"],                       Infix,   23, Pointwise),
    (Subtract,       &["-"],                       Infix,   23, Pointwise),
    (LessOrEqual,    &["<="],                      Infix,   22, Pointwise),
    (GreaterOrEqual, &[">="],                      Infix,   22, Pointwise),
    (Less,           &["<"],                       Infix,   22, Pointwise),
    (Greater,        &[">"],                       Infix,   22, Pointwise),
    (Equal,          &["=="],                      Infix,   22, Pointwise),
    (NotEqual,       &["!==", "!="],               Infix,   22, Pointwise),
    (Not,            &["not", "!"],                Prefix,  21, Pointwise),
    (Always,         &["always", "G"],             Prefix,  20, Timed),
    (Eventually,     &["eventually", "F"],         Prefix,  19, Timed),
    (Historically,   &["historically", "H"],       Prefix,  18, Timed),
    (Once,           &["once", "O"],               Prefix,  17, Timed),
    (Previous,       &["prev", "Y"],               Prefix,  16, Untimed),
    (Next,           &["next", "X"],               Prefix,  15, Untimed),
    (StrongPrevious, &["s_prev", "sY"],            Prefix,  14, Untimed),
    (StrongNext,     &["s_next", "sX"],            Prefix,  13, Untimed),
    (Until,          &["until", "U"],              Infix,   12, Timed),
    (Release,        &["release", "R"],            Infix,   12, Timed),
    (Unless,         &["unless", "W"],             Infix,   11, Timed),
    (Since,          &["since", "S"],              Infix,   10, Timed),
    (And,            &["and", "&", "&&"],          Infix,    9, Pointwise),
    (Or,             &["or", "|", "||"],           Infix,    8, Pointwise),
    (Implies,        &["implies", "->"],           Infix,    7, Pointwise),
    (Iff,            &["iff", "<->"],              Infix,    6, Pointwise),
    (Xor,            &["xor"],                     Infix,    5, Pointwise),
    (Rise,           &["rise"],                    Call(1), 26, Untimed),
    (Fall,           &["fall"],                    Call(1), 26, Untimed),
];

impl Operator {
    /// Returns all operators in the order of the table.
    pub(crate) fn all() -> impl Iterator<Item = Operator> {
        TABLE.iter().map(|row| row.0)
    }

    /// Returns the operator of this shape with the spelling `text`.
    pub(crate) fn by_spelling(text: &str, shape: Shape) -> Option<Operator> {
        TABLE.iter().find(|row| row.2.is_like(shape) && row.1.contains(&text)).map(|row| row.0)
    }

    /// Returns all spellings of the operators of these shapes.
    pub(crate) fn words(shapes: &[Shape]) -> impl Iterator<Item = &'static str> {
        let has_shape = |row: &&Row| shapes.iter().any(|shape| row.2.is_like(*shape));
        TABLE.iter().filter(has_shape).flat_map(|row| row.1).copied()
    }

    /// Returns the row of the operator. Rows are in the order of the variants, which a test checks.
    fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// Returns the printed spelling.
    pub(crate) fn name(self) -> &'static str {
        self.row().1[0]
    }

    pub(crate) fn spellings(self) -> &'static [&'static str] {
        self.row().1
    }

    pub(crate) fn shape(self) -> Shape {
        self.row().2
    }

    /// Returns the operator of this shape that `text` abbreviates with a letter, such as `X`, which
    /// is the name of many signals, too.
    pub(crate) fn by_letter(text: &str, shape: Shape) -> Option<Operator> {
        let is_letter = |operator: &Operator| {
            operator.name() != text && text.chars().all(|letter| letter.is_ascii_alphabetic())
        };
        Operator::by_spelling(text, shape).filter(is_letter)
    }

    /// Returns the letter that abbreviates the operator.
    pub(crate) fn letter(self) -> Option<&'static str> {
        self.spellings().iter().copied().find(|text| Operator::by_letter(text, self.shape()).is_some())
    }

    /// Returns the number of operands.
    pub(crate) fn arity(self) -> usize {
        match self.shape() {
            Prefix => 1,
            Infix => 2,
            Call(operands) => operands,
        }
    }

    /// Returns the precedence; larger binds tighter.
    pub(crate) fn precedence(self) -> u8 {
        self.row().3
    }

    /// Returns whether the value at a sample depends on other samples.
    pub(crate) fn is_temporal(self) -> bool {
        self.row().4 != Pointwise
    }

    /// Returns whether the operator is `<=`, `>=`, `<` or `>`.
    pub(crate) fn is_order(self) -> bool {
        matches!(self, LessOrEqual | GreaterOrEqual | Less | Greater)
    }

    /// Returns whether the operator compares two numbers.
    pub(crate) fn is_comparison(self) -> bool {
        self.is_order() || matches!(self, Equal | NotEqual)
    }

    /// Returns whether the result is a number without a truth value.
    pub(crate) fn is_term(self) -> bool {
        self.is_arithmetic() || matches!(self, Negate | Abs)
    }

    /// Returns whether the operator is arithmetic that can have no finite value.
    pub(crate) fn is_arithmetic(self) -> bool {
        matches!(self, Sqrt | Exp | Ln | Pow | Multiply | Divide | Add | Subtract)
    }

    /// Returns whether an interval may follow the operator.
    pub(crate) fn takes_interval(self) -> bool {
        self.row().4 == Timed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_in_the_order_of_the_variants() {
        for (index, operator) in Operator::all().enumerate() {
            assert_eq!(operator as usize, index, "{operator:?}");
        }
    }

    #[test]
    fn every_spelling_is_on_the_reference_page() {
        let page = include_str!("../../../docs/reference/formulas.md").replace("&#124;", "|");
        for text in Operator::all().flat_map(Operator::spellings) {
            let is_there = ["`", "<code>"].iter().any(|quote| page.contains(&format!("{quote}{text}")));
            assert!(is_there, "{text}");
        }
    }

    #[test]
    fn no_two_operators_of_one_shape_share_a_spelling() {
        for operator in Operator::all() {
            for text in operator.spellings() {
                assert_eq!(Operator::by_spelling(text, operator.shape()), Some(operator), "{text}");
            }
        }
    }
}
