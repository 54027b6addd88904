//! Binary arrays of VTK's legacy files: from the line after their head on, big-endian, whatever machine wrote them.

use super::vtk_legacy::CURE;
use crate::error::{Place, ReadError, ReadErrorKind, quote};
use crate::text::Text;

/// So many whole numbers of a type.
pub(super) fn integers(text: &mut Text, count: usize, kind: &[u8], what: &str) -> Result<Vec<i64>, ReadError> {
    values(text, count, kind, what, |bytes| {
        let unused_bits = u64::BITS - 8 * bytes.len() as u32;
        let bits = joined(bytes) << unused_bits;
        // Of a type with a sign the highest bit fills those above it.
        if kind.starts_with(b"unsigned") { (bits >> unused_bits) as i64 } else { (bits as i64) >> unused_bits }
    })
}

/// So many numbers of a type.
pub(super) fn reals(text: &mut Text, count: usize, kind: &[u8], what: &str) -> Result<Vec<f64>, ReadError> {
    match kind.to_ascii_lowercase().as_slice() {
        b"float" => values(text, count, kind, what, |bytes| f64::from(f32::from_bits(joined(bytes) as u32))),
        b"double" => values(text, count, kind, what, |bytes| f64::from_bits(joined(bytes))),
        _ => integers(text, count, kind, what).map(|whole| whole.into_iter().map(|value| value as f64).collect()),
    }
}

fn values<T>(text: &mut Text, count: usize, kind: &[u8], what: &str, convert: impl Fn(&[u8]) -> T) -> Result<Vec<T>, ReadError> {
    text.skip_line();
    let size = size_of(kind).ok_or_else(|| {
        let found = format!("{what} of type {}", quote(&String::from_utf8_lossy(kind)));
        ReadError::new(ReadErrorKind::Unsupported, Place::Byte(text.at()), found, "char to long, float or double", CURE)
    })?;
    Ok(text.raw(count.saturating_mul(size), what)?.chunks_exact(size).map(convert).collect())
}

/// At most eight bytes, the highest first.
fn joined(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |value, byte| (value << 8) | u64::from(*byte))
}

/// Bytes of a number of a type. An id of VTK's own is written as an `int`.
fn size_of(kind: &[u8]) -> Option<usize> {
    Some(match kind.to_ascii_lowercase().as_slice() {
        b"char" | b"unsigned_char" => 1,
        b"short" | b"unsigned_short" => 2,
        b"int" | b"unsigned_int" | b"vtkidtype" | b"vtktypeint32" | b"float" => 4,
        b"long" | b"unsigned_long" | b"vtktypeint64" | b"double" => 8,
        _ => return None,
    })
}
