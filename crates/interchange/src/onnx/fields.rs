//! Reads the fields of a message: the wire format of protocol buffers, in which ONNX models are
//! stored.
//!
//! The runtime's parser allocates the length that a field claims and recurses into subgraphs
//! without a limit. This reader checks both before the runtime sees a file.

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
