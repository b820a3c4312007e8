//! The wire format of protocol buffers, in which ONNX models are stored: a message is a list of
//! numbered fields.
//!
//! The runtime's parser allocates the length that a field claims and recurses into subgraphs
//! without a limit. The reader here checks both before the runtime sees a file. The writer exists
//! because that of the runtime omits the names of graphs, which the ONNX standard requires.

use crate::OnnxProblem;

/// A field of a message.
pub(super) struct Field<'b> {
    /// The field's number in the message's definition.
    pub number: u64,
    /// The bytes of a text, a block of bytes or an embedded message; empty for a number.
    pub bytes: &'b [u8],
}

/// Iterates over the fields of a message.
pub(super) struct Fields<'b> {
    rest: &'b [u8],
}

impl<'b> Fields<'b> {
    pub(super) fn new(message: &'b [u8]) -> Fields<'b> {
        Fields { rest: message }
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.rest.split_first()?;
            self.rest = rest;
            value |= u64::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, length: u64) -> Option<&'b [u8]> {
        let (bytes, rest) = self.rest.split_at_checked(usize::try_from(length).ok()?)?;
        self.rest = rest;
        Some(bytes)
    }

    fn field(&mut self) -> Option<Field<'b>> {
        let key = self.varint()?;
        let bytes: &[u8] = match key & 7 {
            0 => {
                self.varint()?;
                &[]
            }
            1 => self.take(8).map(|_| &[][..])?,
            2 => {
                let length = self.varint()?;
                self.take(length)?
            }
            5 => self.take(4).map(|_| &[][..])?,
            _ => return None,
        };
        Some(Field { number: key >> 3, bytes })
    }
}

impl<'b> Iterator for Fields<'b> {
    type Item = Result<Field<'b>, OnnxProblem>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_none() {
            self.rest = &[];
        }
        let reason = "it is damaged or not in the format of protocol buffers".to_string();
        Some(field.ok_or(OnnxProblem::Format { reason }))
    }
}

/// Writes the fields of a message.
#[derive(Default)]
pub(super) struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    pub(super) fn integer(mut self, number: u64, value: i64) -> Message {
        self.varint(number << 3);
        self.varint(value as u64);
        self
    }

    pub(super) fn float(mut self, number: u64, value: f32) -> Message {
        self.varint(number << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn bytes(mut self, number: u64, bytes: &[u8]) -> Message {
        self.varint(number << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }

    pub(super) fn text(self, number: u64, text: &str) -> Message {
        self.bytes(number, text.as_bytes())
    }

    pub(super) fn message(self, number: u64, message: &Message) -> Message {
        self.bytes(number, &message.0)
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}
