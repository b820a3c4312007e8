//! Messages of ONNX models, for tests.

#![allow(dead_code, reason = "each test program uses a part")]

/// A field of a message of protocol buffers: bytes, or a number.
pub fn bytes(number: u8, content: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2][..], &varint(content.len() as u64), content].concat()
}

pub fn integer(number: u8, value: i64) -> Vec<u8> {
    [varint(u64::from(number) << 3), varint(value as u64)].concat()
}

pub fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// An operator without attributes.
pub fn node(operator: &str, inputs: &[&str], outputs: &[&str]) -> Vec<u8> {
    node_with(operator, inputs, outputs, &[])
}

/// A tensor of integers with one dimension.
pub fn integers(name: &str, values: &[i64]) -> Vec<u8> {
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let size = integer(1, values.len() as i64);
    bytes(5, &[size, integer(2, 7), bytes(8, name.as_bytes()), bytes(9, &raw)].concat())
}

/// A tensor of 32-bit numbers as input (11) or output (12).
pub fn value(number: u8, name: &str, shape: &[i64]) -> Vec<u8> {
    typed(number, name, shape, 1)
}

/// A tensor of a type as input (11) or output (12): 1 is 32-bit numbers, 2 bytes.
pub fn typed(number: u8, name: &str, shape: &[i64], kind: i64) -> Vec<u8> {
    let shape: Vec<u8> = shape.iter().flat_map(|size| bytes(1, &integer(1, *size))).collect();
    let tensor = [integer(1, kind), bytes(2, &shape)].concat();
    bytes(number, &[bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat())
}

/// A tensor of weights.
pub fn weights(name: &str, shape: &[i64], values: &[f32]) -> Vec<u8> {
    let sizes: Vec<u8> = shape.iter().flat_map(|size| integer(1, *size)).collect();
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    bytes(5, &[sizes, integer(2, 1), bytes(8, name.as_bytes()), bytes(9, &raw)].concat())
}

/// An operator with attributes: lists of integers, or one integer each.
pub fn node_with(operator: &str, inputs: &[&str], outputs: &[&str], attributes: &[Attribute<'_>]) -> Vec<u8> {
    let names = |number, names: &[&str]| -> Vec<u8> {
        names.iter().flat_map(|name| bytes(number, name.as_bytes())).collect()
    };
    let attribute = |(name, value): &Attribute<'_>| {
        let value = match value {
            Of::Number(number) => [integer(3, *number), integer(20, 2)].concat(),
            Of::Numbers(numbers) => {
                [numbers.iter().flat_map(|n| integer(8, *n)).collect(), integer(20, 7)].concat()
            }
            Of::Real(number) => [&[2 << 3 | 5][..], &number.to_le_bytes(), &integer(20, 1)].concat(),
            Of::Text(text) => [bytes(4, text.as_bytes()), integer(20, 3)].concat(),
        };
        bytes(5, &[bytes(1, name.as_bytes()), value].concat())
    };
    let attributes: Vec<u8> = attributes.iter().flat_map(attribute).collect();
    bytes(1, &[names(1, inputs), names(2, outputs), bytes(4, operator.as_bytes()), attributes].concat())
}

pub type Attribute<'a> = (&'a str, Of);

pub enum Of {
    Number(i64),
    Numbers(Vec<i64>),
    Real(f32),
    Text(&'static str),
}

/// A policy without an input for the observation, whose actions depend on every byte of the last
/// images in its input `i`. It predicts `length` actions of `actions` numbers.
pub fn seeing_policy([actions, length]: [usize; 2], history: usize, [width, height]: [usize; 2]) -> Vec<u8> {
    let [actions, length, width, height] = [actions, length, width, height].map(|size| size as i64);
    let inputs = history as i64 * 3 * width * height;
    let outputs = length * actions;
    let image = [3, height, width];
    let shape =
        if history == 1 { [&[1], &image[..]].concat() } else { [&[1, history as i64], &image[..]].concat() };
    let number = |i: i64| 0.2 * (1.7 * i as f32 + ((i * i) % 977) as f32).sin();
    let matrix: Vec<f32> = (0..inputs * outputs).map(number).collect();
    let chunk = [1, length, actions];
    let parts = [
        value(11, "i", &shape),
        weights("m", &[inputs, outputs], &matrix),
        integers("s", &chunk),
        node("Flatten", &["i"], &["f"]),
        node("MatMul", &["f", "m"], &["y"]),
        node("Reshape", &["y", "s"], &["a"]),
        value(12, "a", &chunk),
    ];
    [integer(1, 8), bytes(7, &parts.concat()), bytes(8, &integer(2, 13))].concat()
}
