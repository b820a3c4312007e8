//! Writes the fields of a message: the wire format of protocol buffers, in which ONNX models are
//! stored. The writer of the runtime omits the names of graphs, which the ONNX standard requires.

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
