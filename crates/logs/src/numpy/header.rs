//! The header of an array: the type of its elements and its shape. The format is described in
//! `numpy/lib/format.py` of NumPy (NEP 1).

use std::io::Read;

use crate::cell::Cell;
use crate::error::{Result, content};
use crate::half::half;

const MAGIC: &[u8] = b"\x93NUMPY";

/// Largest size of a header. That of 80,000 named fields has 2 MB.
const MAX_HEADER: usize = 16 << 20;

/// Largest size of a row.
const MAX_ROW: usize = 64 << 20;

/// Deepest nesting of types.
const MAX_DEPTH: usize = 16;

/// The header of an array.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// The parts of an element; one without a name if it is a number.
    pub(super) fields: Vec<Field>,
    /// Size of an element in bytes.
    pub(super) item_bytes: usize,
    pub(super) shape: Vec<usize>,
    /// Whether columns are stored one after the other.
    pub(super) is_fortran: bool,
}

/// A part of an element.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The type as the file states it, such as `<f8`.
    pub(super) code: String,
    is_big: bool,
    /// Position of its first byte in the element.
    pub(super) offset: usize,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// A floating-point number of this many bytes.
    Float(usize),
    /// A signed integer.
    Signed(usize),
    /// An unsigned integer, or a truth value.
    Unsigned(usize),
    /// `datetime64` or `timedelta64`: a number of units of this many attoseconds.
    Time(i128, i32),
    /// A type other than a number.
    Other,
}

impl Header {
    pub(super) fn read(source: &mut impl Read) -> Result<Header> {
        let mut start = [0; 8];
        let is_array = source.read_exact(&mut start).is_ok() && start.starts_with(MAGIC);
        if !is_array {
            return Err(content("it is not an array in NumPy's format"));
        }
        let mut length = [0; 4];
        let size = if start[6] == 1 { 2 } else { 4 };
        source.read_exact(&mut length[..size]).map_err(|_| damaged())?;
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_HEADER {
            return Err(damaged());
        }
        let mut text = Vec::new();
        source.take(length as u64).read_to_end(&mut text)?;
        if text.len() < length {
            return Err(damaged());
        }
        // Version 3 is UTF-8, the others Latin-1, of which names beyond ASCII are approximated.
        let text = String::from_utf8_lossy(&text);
        Header::of(&text).ok_or_else(damaged)
    }

    fn of(text: &str) -> Option<Header> {
        let mut parser = Parser { rest: text.trim(), depth: 0 };
        let Literal::Dict(entries) = parser.literal()? else { return None };
        let entry = |name: &str| entries.iter().find(|(key, _)| key == name).map(|(_, value)| value);
        let mut fields = Vec::new();
        let mut item_bytes = 0;
        add_fields(entry("descr")?, "", &mut fields, &mut item_bytes)?;
        let Literal::Bool(is_fortran) = *entry("fortran_order")? else { return None };
        let Literal::List(shape) = entry("shape")? else { return None };
        let shape = shape.iter().map(Literal::integer).collect::<Option<Vec<usize>>>()?;
        let row = shape.iter().skip(1).try_fold(item_bytes, |size, width| size.checked_mul(*width))?;
        let is_possible = row <= MAX_ROW && shape.first().is_none_or(|rows| rows.checked_mul(row).is_some());
        is_possible.then_some(Header { fields, item_bytes, shape, is_fortran })
    }
}

fn damaged() -> crate::LogError {
    content("the header of the array is damaged, or its rows are too long")
}

/// Appends the fields of a type, and its size.
fn add_fields(descr: &Literal, name: &str, fields: &mut Vec<Field>, size: &mut usize) -> Option<()> {
    match descr {
        Literal::Text(code) => {
            let (kind, is_big, bytes) = Kind::of(code)?;
            let code = code.clone();
            fields.push(Field { name: name.to_owned(), kind, code, is_big, offset: *size });
            *size = size.checked_add(bytes)?;
        }
        Literal::List(parts) => {
            for part in parts {
                let Literal::List(part) = part else { return None };
                let (key, descr) = match &part[..] {
                    [Literal::Text(key), descr, ..] => (key, descr),
                    // A title and a name.
                    [Literal::List(titled), descr, ..] => match &titled[..] {
                        [_, Literal::Text(key)] => (key, descr),
                        _ => return None,
                    },
                    _ => return None,
                };
                let inner = if name.is_empty() { key.clone() } else { format!("{name}/{key}") };
                let Some(Literal::List(shape)) = part.get(2) else {
                    add_fields(descr, &inner, fields, size)?;
                    continue;
                };
                let count = shape.iter().try_fold(1_usize, |count, n| count.checked_mul(n.integer()?))?;
                if count > MAX_ROW {
                    return None;
                }
                for index in 0..count {
                    add_fields(descr, &format!("{inner}[{index}]"), fields, size)?;
                    if *size > MAX_ROW || fields.len() > MAX_ROW {
                        return None;
                    }
                }
            }
        }
        _ => return None,
    }
    (*size <= MAX_ROW).then_some(())
}

impl Kind {
    /// Reads a type such as `<f8`: its kind, whether its bytes are big-endian, and their number.
    fn of(code: &str) -> Option<(Kind, bool, usize)> {
        let is_big = code.starts_with('>');
        let code = code.trim_start_matches(['<', '>', '|', '=']);
        let letter = code.chars().next()?;
        let (count, unit) =
            code[letter.len_utf8()..].split_once('[').unwrap_or((&code[letter.len_utf8()..], ""));
        let count: usize = if letter == 'O' { 8 } else { count.parse().ok()? };
        let bytes = if letter == 'U' { count.checked_mul(4)? } else { count };
        let kind = match (letter, count) {
            ('f', 2 | 4 | 8) => Kind::Float(count),
            ('i', 1 | 2 | 4 | 8) => Kind::Signed(count),
            ('u', 1 | 2 | 4 | 8) | ('b', 1) => Kind::Unsigned(count),
            ('M' | 'm', 8) => match unit {
                "s]" => Kind::Time(10_i128.pow(18), 0),
                "ms]" => Kind::Time(10_i128.pow(15), -3),
                "us]" => Kind::Time(10_i128.pow(12), -6),
                "ns]" => Kind::Time(10_i128.pow(9), -9),
                _ => Kind::Other,
            },
            _ => Kind::Other,
        };
        Some((kind, is_big, bytes))
    }
}

impl Field {
    /// Reads the value at the start of these bytes.
    pub(super) fn cell(&self, bytes: &[u8]) -> Option<Cell<'static>> {
        let size = match self.kind {
            Kind::Float(size) | Kind::Signed(size) | Kind::Unsigned(size) => size,
            Kind::Time(..) => 8,
            Kind::Other => return Some(Cell::Missing),
        };
        let mut number = [0; 8];
        number[..size].copy_from_slice(bytes.get(..size)?);
        if self.is_big {
            number[..size].reverse();
        }
        let bits = u64::from_le_bytes(number);
        let signed = (bits << (64 - 8 * size)).cast_signed() >> (64 - 8 * size);
        Some(match self.kind {
            Kind::Float(2) => Cell::Number(half(bits as u16)),
            Kind::Float(4) => Cell::Single(f32::from_bits(bits as u32)),
            Kind::Float(_) => Cell::Number(f64::from_bits(bits)),
            Kind::Signed(_) => Cell::Integer(signed.into()),
            Kind::Unsigned(_) => Cell::Integer(bits.into()),
            Kind::Time(..) if signed == i64::MIN => Cell::Missing,
            Kind::Time(unit, last_digit) => Cell::Time(i128::from(signed) * unit, last_digit),
            Kind::Other => Cell::Missing,
        })
    }
}

/// A literal of Python.
#[derive(Clone, Debug, PartialEq)]
enum Literal {
    Text(String),
    Integer(usize),
    Bool(bool),
    /// A list or a tuple.
    List(Vec<Literal>),
    Dict(Vec<(String, Literal)>),
}

impl Literal {
    fn integer(&self) -> Option<usize> {
        match self {
            Literal::Integer(value) => Some(*value),
            _ => None,
        }
    }
}

struct Parser<'a> {
    rest: &'a str,
    depth: usize,
}

impl Parser<'_> {
    fn take(&mut self, token: &str) -> bool {
        let found = self.rest.trim_start().strip_prefix(token);
        self.rest = found.unwrap_or(self.rest);
        found.is_some()
    }

    fn literal(&mut self) -> Option<Literal> {
        self.rest = self.rest.trim_start();
        let first = self.rest.chars().next()?;
        match first {
            '\'' | '"' => Some(Literal::Text(self.text(first)?)),
            '(' | '[' => {
                self.deeper()?;
                self.take(if first == '(' { "(" } else { "[" });
                let end = if first == '(' { ")" } else { "]" };
                let mut items = Vec::new();
                while !self.take(end) {
                    items.push(self.literal()?);
                    if !self.take(",") && !self.rest.trim_start().starts_with(end) {
                        return None;
                    }
                }
                self.depth -= 1;
                Some(Literal::List(items))
            }
            '{' => {
                self.deeper()?;
                self.take("{");
                let mut entries = Vec::new();
                while !self.take("}") {
                    let Literal::Text(key) = self.literal()? else { return None };
                    if !self.take(":") {
                        return None;
                    }
                    entries.push((key, self.literal()?));
                    if !self.take(",") && !self.rest.trim_start().starts_with('}') {
                        return None;
                    }
                }
                self.depth -= 1;
                Some(Literal::Dict(entries))
            }
            '0'..='9' => {
                let end = self.rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.rest.len());
                let value = self.rest[..end].parse().ok()?;
                // Python 2 wrote 3L.
                self.rest = self.rest[end..].trim_start_matches('L');
                Some(Literal::Integer(value))
            }
            _ if self.take("True") => Some(Literal::Bool(true)),
            _ if self.take("False") => Some(Literal::Bool(false)),
            _ => None,
        }
    }

    fn deeper(&mut self) -> Option<()> {
        self.depth += 1;
        (self.depth <= MAX_DEPTH).then_some(())
    }

    fn text(&mut self, quote: char) -> Option<String> {
        let mut found = String::new();
        let mut characters = self.rest.char_indices().skip(1);
        while let Some((at, character)) = characters.next() {
            match character {
                '\\' => found.push(characters.next()?.1),
                _ if character == quote => {
                    self.rest = &self.rest[at + quote.len_utf8()..];
                    return Some(found);
                }
                _ => found.push(character),
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(text: &str) -> Header {
        Header::of(text).expect("a header")
    }

    #[test]
    fn headers_are_those_that_numpy_writes() {
        // numpy.lib.format.header_data_from_array_1_0 of arrays with these types.
        let plain = header("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }          \n");
        assert_eq!((plain.shape, plain.item_bytes, plain.is_fortran), (vec![3], 8, false));
        let fields = header(
            "{'descr': [('time', '<i8'), ('d', '>f4'), ('q', '<f8', (2,)), ('name', '<U5')], 'fortran_order': False, 'shape': (7,), }",
        );
        let names: Vec<(&str, usize)> = fields.fields.iter().map(|f| (f.name.as_str(), f.offset)).collect();
        assert_eq!(names, [("time", 0), ("d", 8), ("q[0]", 12), ("q[1]", 20), ("name", 28)]);
        assert_eq!(fields.item_bytes, 48);
        let nested = header(
            "{'descr': [('pose', [('x', '<f8')]), ('t', '<M8[ns]')], 'fortran_order': True, 'shape': (2, 3), }",
        );
        assert_eq!(nested.fields[0].name, "pose/x");
        assert_eq!(nested.fields[1].kind, Kind::Time(10_i128.pow(9), -9));
        assert_eq!(header("{'descr': '|b1', 'fortran_order': False, 'shape': (), }").shape.len(), 0);
    }

    #[test]
    fn damaged_headers_are_refused() {
        for text in [
            "",
            "{",
            "{'descr': '<f8'}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,), }",
            "{'descr': [('a', '<f8', (99999999999,))], 'fortran_order': False, 'shape': (1,), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 4611686018427387904), }",
        ] {
            assert!(Header::of(text).is_none(), "{text}");
        }
        assert!(Header::of(&"[".repeat(100_000)).is_none());
    }

    #[test]
    fn numbers_of_all_types_are_read() {
        let cell = |code: &str, bytes: &[u8]| {
            let (kind, is_big, _) = Kind::of(code).expect("a type");
            Field { name: String::new(), kind, code: code.to_owned(), is_big, offset: 0 }.cell(bytes)
        };
        assert_eq!(cell("<i2", &[0xff, 0xff]), Some(Cell::Integer(-1)));
        assert_eq!(cell("|u1", &[0xff]), Some(Cell::Integer(255)));
        assert_eq!(cell("<f2", &[0x00, 0x42]), Some(Cell::Number(3.0)));
        assert_eq!(cell(">f2", &[0xc2, 0x00]), Some(Cell::Number(-3.0)));
        assert_eq!(cell(">f8", &2.5_f64.to_be_bytes()), Some(Cell::Number(2.5)));
        assert_eq!(cell("<f4", &0.1_f32.to_le_bytes()), Some(Cell::Single(0.1)));
        assert_eq!(cell("<M8[ns]", &i64::MIN.to_le_bytes()), Some(Cell::Missing));
        assert_eq!(cell("<m8[ms]", &5_i64.to_le_bytes()), Some(Cell::Time(5 * 10_i128.pow(15), -3)));
        assert_eq!(cell("<f8", &[0; 4]), None);
    }
}
