//! Binary arrays of VTK's XML files: base64 of a length and of the values, in either byte order.

use super::vtk_xml::{CURE, DAMAGED, place};
use crate::error::{ReadError, ReadErrorKind, quote};
use base64::Engine as _;
use roxmltree::Node;

/// How the file stores binary arrays.
#[derive(Clone, Copy)]
pub(super) struct Coding {
    pub big_endian: bool,
    /// Bytes of the length that stands before each array.
    pub header_bytes: usize,
    pub compressed: bool,
}

/// One number of an array.
#[derive(Clone, Copy)]
pub(super) enum Value {
    Whole(i64),
    Real(f64),
}

impl Value {
    pub fn as_f64(self) -> f64 {
        match self {
            Value::Whole(value) => value as f64,
            Value::Real(value) => value,
        }
    }
}

/// The numbers of an array with `format="binary"`: base64 of a length in bytes and of the values.
pub(super) fn binary(array: Node, coding: Coding) -> Result<Vec<Value>, ReadError> {
    let fault = |kind, found: String, expected: &str, cure| ReadError::new(kind, place(array), found, expected, cure);
    if coding.compressed {
        let found = "a compressed array".into();
        return Err(fault(ReadErrorKind::Unsupported, found, "an uncompressed one", CURE));
    }
    let bytes = base64_of(array.text().unwrap_or(""))
        .ok_or_else(|| fault(ReadErrorKind::Syntax, "something else".into(), "base64", DAMAGED))?;
    let kind = array.attribute("type").unwrap_or("none");
    let (size, convert) = number_type(kind).ok_or_else(|| {
        let found = format!("an array of type {}", quote(kind));
        fault(ReadErrorKind::Unsupported, found, "Int8 to UInt64, Float32 or Float64", CURE)
    })?;
    let length = bytes.get(..coding.header_bytes).map(|head| little(head, coding.big_endian));
    let data = bytes.get(coding.header_bytes..).unwrap_or(&[]);
    if length != Some(data.len() as u64) || !data.len().is_multiple_of(size) {
        let found = format!("{} bytes of data", data.len());
        let expected = format!("{} as its head says, in values of {size} bytes", length.unwrap_or(0));
        return Err(fault(ReadErrorKind::Truncated, found, &expected, DAMAGED));
    }
    Ok(data.chunks_exact(size).map(|value| convert(little(value, coding.big_endian))).collect())
}

/// Up to eight bytes as a number.
fn little(bytes: &[u8], big_endian: bool) -> u64 {
    let join = |value: u64, &byte: &u8| (value << 8) | u64::from(byte);
    if big_endian { bytes.iter().fold(0, join) } else { bytes.iter().rev().fold(0, join) }
}

type Convert = fn(u64) -> Value;

/// Size in bytes of a VTK number type, and what its bits mean.
fn number_type(kind: &str) -> Option<(usize, Convert)> {
    Some(match kind {
        "Int8" => (1, |bits| Value::Whole(bits as u8 as i8 as i64)),
        "UInt8" => (1, |bits| Value::Whole(bits as i64)),
        "Int16" => (2, |bits| Value::Whole(bits as u16 as i16 as i64)),
        "UInt16" => (2, |bits| Value::Whole(bits as i64)),
        "Int32" => (4, |bits| Value::Whole(bits as u32 as i32 as i64)),
        "UInt32" => (4, |bits| Value::Whole(bits as i64)),
        "Int64" => (8, |bits| Value::Whole(bits as i64)),
        "UInt64" => (8, |bits| Value::Whole(i64::try_from(bits).unwrap_or(i64::MAX))),
        "Float32" => (4, |bits| Value::Real(f64::from(f32::from_bits(bits as u32)))),
        "Float64" => (8, |bits| Value::Real(f64::from_bits(bits))),
        _ => return None,
    })
}

/// Decodes base64. Some writers encode head and data apart: each part ends in its own padding.
fn base64_of(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let packed: Vec<u8> = text.bytes().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let mut rest = packed.as_slice();
    while !rest.is_empty() {
        let body = rest.iter().position(|&byte| byte == b'=').unwrap_or(rest.len());
        let padding = rest[body..].iter().take_while(|&&byte| byte == b'=').count();
        let (part, after) = rest.split_at(body + padding);
        base64::engine::general_purpose::STANDARD.decode_vec(part, &mut bytes).ok()?;
        rest = after;
    }
    Some(bytes)
}
