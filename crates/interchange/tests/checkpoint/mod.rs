//! Writes checkpoints as PyTorch does.

/// CRC-32, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| u32::from(byte >> bit & 1)));
    !bits.fold(!0, |crc, bit| if (crc ^ bit) & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
}

/// Returns an archive of stored entries, or with another method of compression in the directory.
pub fn archive(entries: &[(&str, &[u8])], method: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut directory = Vec::new();
    for (name, content) in entries {
        let offset = bytes.len() as u32;
        let sizes = [content.len() as u32; 2].map(u32::to_le_bytes).concat();
        let name_length = (name.len() as u16).to_le_bytes();
        bytes.extend(b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0");
        bytes.extend(&sizes);
        bytes.extend(name_length);
        bytes.extend([0, 0]);
        bytes.extend(name.as_bytes());
        bytes.extend(*content);
        directory.extend(b"PK\x01\x02\x14\0\x14\0\0\0");
        directory.extend(method.to_le_bytes());
        directory.extend([0; 4]);
        directory.extend(crc32(content).to_le_bytes());
        directory.extend(&sizes);
        directory.extend(name_length);
        directory.extend([0; 12]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = bytes.len() as u32;
    let count = (entries.len() as u16).to_le_bytes();
    let length = (directory.len() as u32).to_le_bytes();
    bytes.extend(directory);
    bytes.extend(
        [b"PK\x05\x06\0\0\0\0", &[count, count].concat()[..], &length, &start.to_le_bytes(), &[0, 0]]
            .concat(),
    );
    bytes
}

/// The operations for a text, and for a tensor of the storage `0` with the shape and the strides on
/// the stack.
pub fn text(text: &str) -> Vec<u8> {
    [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

pub fn storage(name: &str, kind: &str) -> Vec<u8> {
    let kind = format!("ctorch\n{kind}\n");
    [b"(", &text("storage")[..], kind.as_bytes(), &text(name), &text("cpu"), b"K\x03tQ"].concat()
}

/// A tensor: name, shape and numbers.
pub type Part = (String, Vec<usize>, Vec<f32>);

/// Returns an archive with a dictionary of tensors, as `torch.save` writes it.
pub fn state_dictionary(parts: &[Part]) -> Vec<u8> {
    let integer = |number: usize| [b"J", &(number as i32).to_le_bytes()[..]].concat();
    let tuple = |sizes: &[usize]| {
        [b"(", &sizes.iter().flat_map(|size| integer(*size)).collect::<Vec<u8>>()[..], b"t"].concat()
    };
    let mut items = Vec::new();
    let mut numbers = Vec::new();
    for (name, shape, values) in parts {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
        let strides: Vec<usize> = (0..shape.len()).map(|axis| shape[axis + 1..].iter().product()).collect();
        items.extend(text(name));
        items.extend(b"ctorch._utils\n_rebuild_tensor_v2\n(");
        items.extend([storage("0", "FloatStorage"), integer(numbers.len() / 4)].concat());
        items.extend([tuple(shape), tuple(&strides), b"tR".to_vec()].concat());
        numbers.extend(values.iter().flat_map(|number| number.to_le_bytes()));
    }
    let pickle = [&b"\x80\x02}("[..], &items, b"u."].concat();
    archive(&[("a/data.pkl", &pickle), ("a/data/0", &numbers)], 0)
}
