//! Encoding of event file records and protocol buffers.

/// Encodes a message as a record with both checksums.
pub(super) fn record(message: &[u8]) -> Vec<u8> {
    let length = (message.len() as u64).to_le_bytes();
    [&length[..], &masked_checksum(&length), message, &masked_checksum(message)].concat()
}

/// Returns the masked checksum of the TFRecord format: rotated, plus a constant.
pub(super) fn masked_checksum(bytes: &[u8]) -> [u8; 4] {
    checksum(bytes).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

/// Returns the CRC-32C (Castagnoli) checksum.
pub(super) fn checksum(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0x82f6_3b78;
    let shifted = |crc: u32| if crc & 1 == 1 { (crc >> 1) ^ POLYNOMIAL } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| shifted(crc)))
}

/// Wire types of protocol buffers.
mod wire {
    pub const VARINT: u8 = 0;
    pub const EIGHT_BYTES: u8 = 1;
    pub const LENGTH_THEN_BYTES: u8 = 2;
    pub const FOUR_BYTES: u8 = 5;
}

fn put_key(message: &mut Vec<u8>, field: u8, kind: u8) {
    message.push((field << 3) | kind);
}

fn put_varint(message: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        message.push(number as u8 | 0x80);
        number >>= 7;
    }
    message.push(number as u8);
}

pub(super) fn put_integer(message: &mut Vec<u8>, field: u8, number: u64) {
    put_key(message, field, wire::VARINT);
    put_varint(message, number);
}

pub(super) fn put_double(message: &mut Vec<u8>, field: u8, number: f64) {
    put_key(message, field, wire::EIGHT_BYTES);
    message.extend_from_slice(&number.to_le_bytes());
}

pub(super) fn put_float(message: &mut Vec<u8>, field: u8, number: f32) {
    put_key(message, field, wire::FOUR_BYTES);
    message.extend_from_slice(&number.to_le_bytes());
}

pub(super) fn put_bytes(message: &mut Vec<u8>, field: u8, bytes: &[u8]) {
    put_key(message, field, wire::LENGTH_THEN_BYTES);
    put_varint(message, bytes.len() as u64);
    message.extend_from_slice(bytes);
}
