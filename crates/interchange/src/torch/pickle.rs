//! Reads the pickle of a state dictionary as data.
//!
//! A pickle is a program for a stack machine, and its operation `REDUCE` calls any function by
//! name. This reader calls nothing. It recognizes the operations and the names that `torch.save`
//! writes for tensors in dictionaries, and builds a value from them. Any other operation or name is
//! an error.

use std::rc::Rc;

use crate::TorchProblem;

/// Deepest nesting of tuples, lists and dictionaries.
const MAX_DEPTH: usize = 16;

/// Largest number of bytes: names and shapes of 10,000 tensors take a tenth of it. A value takes up
/// to 40 times its bytes.
const MAX_BYTES: usize = 4 << 20;

/// Longest text, bytes: names of tensors and of storages, which are copied into messages and
/// compared often.
const MAX_TEXT: usize = 1024;

/// Largest number of dimensions of a tensor. A tuple can be the shape of any number of tensors,
/// each of which copies it.
const MAX_DIMENSIONS: usize = 8;

/// A value of a state dictionary.
#[derive(Clone, Debug)]
pub(super) enum Value {
    /// `None`, a boolean or a floating-point number, which no layer needs.
    Other,
    Integer(i64),
    Text(Rc<str>),
    /// A tuple or a list, with the depth of its nesting.
    Sequence(Rc<[Value]>, usize),
    /// A dictionary with the texts among its keys, with the depth of its nesting.
    Dictionary(Vec<(Rc<str>, Value)>, usize),
    Name(Name),
    /// The persistent identifier of a storage: type of its numbers, and name of its entry in the
    /// archive.
    Storage(Number, Rc<str>),
    Tensor(Rc<Reference>),
}

/// The names that a state dictionary may contain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Name {
    OrderedDictionary,
    RebuildTensor,
    RebuildParameter,
    Storage(Number),
}

/// The type of the numbers of a storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    F32,
    F64,
    /// 16 bits, which are not read.
    Half,
    /// A type of which weights do not consist.
    Other,
}

/// A tensor: a part of a storage.
#[derive(Debug)]
pub(super) struct Reference {
    pub number: Number,
    /// The name of the storage's entry in the archive.
    pub storage: Rc<str>,
    /// The first number, and the distance of neighbors along each axis.
    pub offset: usize,
    pub strides: Vec<usize>,
    pub shape: Vec<usize>,
}

fn name(module: &str, name: &str) -> Option<Name> {
    Some(match (module, name) {
        ("collections", "OrderedDict") => Name::OrderedDictionary,
        ("torch._utils", "_rebuild_tensor_v2") => Name::RebuildTensor,
        ("torch._utils", "_rebuild_parameter") => Name::RebuildParameter,
        ("torch", "FloatStorage") => Name::Storage(Number::F32),
        ("torch", "DoubleStorage") => Name::Storage(Number::F64),
        ("torch", "HalfStorage" | "BFloat16Storage") => Name::Storage(Number::Half),
        (
            "torch",
            "LongStorage" | "IntStorage" | "ShortStorage" | "CharStorage" | "ByteStorage" | "BoolStorage",
        ) => Name::Storage(Number::Other),
        _ => return None,
    })
}

impl Value {
    fn depth(&self) -> usize {
        match self {
            Value::Sequence(_, depth) | Value::Dictionary(_, depth) => *depth,
            _ => 0,
        }
    }

    /// Returns the numbers of a tuple of sizes.
    fn sizes(&self) -> Option<Vec<usize>> {
        let Value::Sequence(values, _) = self else { return None };
        if values.len() > MAX_DIMENSIONS {
            return None;
        }
        values.iter().map(Value::size).collect()
    }

    fn size(&self) -> Option<usize> {
        match self {
            Value::Integer(value) => usize::try_from(*value).ok(),
            _ => None,
        }
    }
}

/// Reads a pickle.
pub(super) fn read(bytes: &[u8]) -> Result<Value, TorchProblem> {
    if bytes.len() > MAX_BYTES {
        return Err(TorchProblem::Pickle {
            reason: format!("it has {} bytes; the limit is {MAX_BYTES}", bytes.len()),
        });
    }
    let mut machine = Machine { rest: bytes, stack: Vec::new(), marks: Vec::new(), memo: Vec::new() };
    loop {
        let at = bytes.len() - machine.rest.len();
        let operation = machine.take(1)?[0];
        if operation == b'.' {
            return machine.pop();
        }
        machine.step(operation, at)?;
    }
}

struct Machine<'b> {
    rest: &'b [u8],
    stack: Vec<Value>,
    /// Heights of the stack at which the arguments of an operation start.
    marks: Vec<usize>,
    /// Values that later operations repeat; `None` for lists and dictionaries, which are not
    /// repeated.
    memo: Vec<Option<Value>>,
}

fn damaged() -> TorchProblem {
    TorchProblem::Pickle { reason: "it is damaged or not the pickle of a state dictionary".to_string() }
}

impl<'b> Machine<'b> {
    fn step(&mut self, operation: u8, at: usize) -> Result<(), TorchProblem> {
        match operation {
            // The version of the protocol.
            0x80 => {
                self.take(1)?;
            }
            b'(' => self.marks.push(self.stack.len()),
            b'N' | 0x88 | 0x89 => self.stack.push(Value::Other),
            b'G' => {
                self.take(8)?;
                self.stack.push(Value::Other);
            }
            b'K' => {
                let value = i64::from(self.take(1)?[0]);
                self.stack.push(Value::Integer(value));
            }
            b'M' => {
                let value = i64::from(u16::from_le_bytes(self.array()?));
                self.stack.push(Value::Integer(value));
            }
            b'J' => {
                let value = i64::from(i32::from_le_bytes(self.array()?));
                self.stack.push(Value::Integer(value));
            }
            0x8A => self.long()?,
            b'X' => {
                let length = u32::from_le_bytes(self.array()?) as usize;
                if length > MAX_TEXT {
                    return Err(TorchProblem::Pickle {
                        reason: format!("it has a text of {length} bytes; the limit is {MAX_TEXT}"),
                    });
                }
                let text = std::str::from_utf8(self.take(length)?).map_err(|_| damaged())?;
                self.stack.push(Value::Text(text.into()));
            }
            b'c' => self.name()?,
            b'q' => {
                let index = self.take(1)?[0];
                self.store(usize::from(index))?;
            }
            b'r' => {
                let index = u32::from_le_bytes(self.array()?);
                self.store(index as usize)?;
            }
            b'h' => {
                let index = self.take(1)?[0];
                self.load(usize::from(index))?;
            }
            b'j' => {
                let index = u32::from_le_bytes(self.array()?);
                self.load(index as usize)?;
            }
            b')' => self.sequence(0)?,
            0x85 => self.sequence(1)?,
            0x86 => self.sequence(2)?,
            0x87 => self.sequence(3)?,
            b't' => {
                let count = self.marked()?;
                self.sequence(count)?;
            }
            b']' => self.sequence(0)?,
            b'a' => self.append(1)?,
            b'e' => {
                let count = self.marked()?;
                self.append(count)?;
            }
            b'}' => self.stack.push(Value::Dictionary(Vec::new(), 1)),
            b's' => self.set_items(2)?,
            b'u' => {
                let count = self.marked()?;
                self.set_items(count)?;
            }
            b'Q' => self.storage()?,
            b'R' => self.reduce()?,
            // The attributes of a dictionary, such as the versions of modules.
            b'b' => {
                self.pop()?;
                if !matches!(self.stack.last(), Some(Value::Dictionary(..))) {
                    return Err(damaged());
                }
            }
            _ => {
                return Err(TorchProblem::Pickle {
                    reason: format!(
                        "it has the operation {operation:#04x} at byte {at}, which the pickle of a state dictionary does not need"
                    ),
                });
            }
        }
        Ok(())
    }

    fn take(&mut self, length: usize) -> Result<&'b [u8], TorchProblem> {
        let (bytes, rest) = self.rest.split_at_checked(length).ok_or_else(damaged)?;
        self.rest = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], TorchProblem> {
        self.take(N)?.try_into().map_err(|_| damaged())
    }

    fn line(&mut self) -> Result<&'b str, TorchProblem> {
        let length = self.rest.iter().take(MAX_TEXT).position(|byte| *byte == b'\n').ok_or_else(damaged)?;
        let line = std::str::from_utf8(self.take(length)?).map_err(|_| damaged())?;
        self.take(1)?;
        Ok(line)
    }

    fn pop(&mut self) -> Result<Value, TorchProblem> {
        self.stack.pop().ok_or_else(damaged)
    }

    /// Removes the last `count` values of the stack, all of them above the last mark.
    fn pop_many(&mut self, count: usize) -> Result<Vec<Value>, TorchProblem> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let start =
            self.stack.len().checked_sub(count).filter(|start| *start >= floor).ok_or_else(damaged)?;
        Ok(self.stack.split_off(start))
    }

    /// Removes the last mark; returns the number of values above it.
    fn marked(&mut self) -> Result<usize, TorchProblem> {
        let mark = self.marks.pop().ok_or_else(damaged)?;
        self.stack.len().checked_sub(mark).ok_or_else(damaged)
    }

    /// A whole number of at most 8 bytes.
    fn long(&mut self) -> Result<(), TorchProblem> {
        let length = usize::from(self.take(1)?[0]);
        let bytes = self.take(length)?;
        let mut all = [if bytes.last().is_some_and(|byte| *byte >= 0x80) { 0xFF } else { 0 }; 8];
        all.get_mut(..length).ok_or_else(damaged)?.copy_from_slice(bytes);
        self.stack.push(Value::Integer(i64::from_le_bytes(all)));
        Ok(())
    }

    fn name(&mut self) -> Result<(), TorchProblem> {
        let module = self.line()?;
        let text = self.line()?;
        let name =
            name(module, text).ok_or_else(|| TorchProblem::Code { name: format!("{module}.{text}") })?;
        self.stack.push(Value::Name(name));
        Ok(())
    }

    fn store(&mut self, index: usize) -> Result<(), TorchProblem> {
        // Python numbers them from 0 without gaps; a repeated index would be a value that changes.
        if index != self.memo.len() {
            return Err(damaged());
        }
        let value = self.stack.last().ok_or_else(damaged)?;
        self.memo.push((!matches!(value, Value::Dictionary(..))).then(|| value.clone()));
        Ok(())
    }

    fn load(&mut self, index: usize) -> Result<(), TorchProblem> {
        let value = self.memo.get(index).cloned().flatten().ok_or_else(damaged)?;
        self.stack.push(value);
        Ok(())
    }

    fn sequence(&mut self, count: usize) -> Result<(), TorchProblem> {
        let values = self.pop_many(count)?;
        let depth = depth_above(&values)?;
        self.stack.push(Value::Sequence(values.into(), depth));
        Ok(())
    }

    /// Appends to a list. What it contains is not needed: only options of optimizers are lists.
    fn append(&mut self, count: usize) -> Result<(), TorchProblem> {
        self.pop_many(count)?;
        if !matches!(self.stack.last(), Some(Value::Sequence(..))) {
            return Err(damaged());
        }
        Ok(())
    }

    fn set_items(&mut self, count: usize) -> Result<(), TorchProblem> {
        let items = self.pop_many(count)?;
        let above = depth_above(&items)?;
        let Some(Value::Dictionary(dictionary, depth)) = self.stack.last_mut() else {
            return Err(damaged());
        };
        *depth = above.max(*depth);
        let mut items = items.into_iter();
        while let Some(key) = items.next() {
            let value = items.next().ok_or_else(damaged)?;
            // The states of an optimizer have numbers as keys.
            if let Value::Text(key) = key {
                dictionary.push((key, value));
            }
        }
        Ok(())
    }

    /// Reads `("storage", type, entry, device, count)`.
    fn storage(&mut self) -> Result<(), TorchProblem> {
        let Value::Sequence(parts, _) = self.pop()? else { return Err(damaged()) };
        let [Value::Text(kind), Value::Name(Name::Storage(number)), Value::Text(entry), _, _] = &parts[..]
        else {
            return Err(damaged());
        };
        if &**kind != "storage" {
            return Err(damaged());
        }
        self.stack.push(Value::Storage(*number, entry.clone()));
        Ok(())
    }

    /// Recognizes an empty dictionary, a tensor or a parameter.
    fn reduce(&mut self) -> Result<(), TorchProblem> {
        let arguments = self.pop()?;
        let function = self.pop()?;
        let (Value::Name(function), Value::Sequence(arguments, _)) = (function, arguments) else {
            return Err(damaged());
        };
        let value = match (function, &arguments[..]) {
            (Name::OrderedDictionary, []) => Value::Dictionary(Vec::new(), 1),
            (Name::RebuildTensor, [Value::Storage(number, storage), offset, shape, strides, ..]) => {
                let reference = Reference {
                    number: *number,
                    storage: storage.clone(),
                    offset: offset.size().ok_or_else(damaged)?,
                    strides: strides.sizes().ok_or_else(damaged)?,
                    shape: shape.sizes().ok_or_else(damaged)?,
                };
                Value::Tensor(Rc::new(reference))
            }
            (Name::RebuildParameter, [tensor @ Value::Tensor(_), ..]) => tensor.clone(),
            _ => return Err(damaged()),
        };
        self.stack.push(value);
        Ok(())
    }
}

/// Returns the depth of a container of these values.
fn depth_above(values: &[Value]) -> Result<usize, TorchProblem> {
    let depth = 1 + values.iter().map(Value::depth).max().unwrap_or(0);
    if depth > MAX_DEPTH {
        return Err(TorchProblem::Pickle { reason: format!("it is nested more than {MAX_DEPTH} deep") });
    }
    Ok(depth)
}
