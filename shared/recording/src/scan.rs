//! JSON as this recorder writes it, read field after field: without a look for the fields' names, and without room of its own. The messages that come with each
//! tick are read so, some 3 GB of an hour. What stands otherwise (a number that is not there, another order, an older recorder) is not read here: it goes the
//! way of any JSON, which also says what is wrong with it.
//!
//! Promise: what is read here is to the bit what `serde_json` reads of the same text. A number is what its digits make over a power of ten, both exact as one of
//! 64 bits, rounded to one of 32: that is right unless the first rounding ended half way between two of these (Clinger, How to read floating point numbers
//! accurately, 1990), or below the normal ones, and there the standard library reads it.

/// Most digits that are a number of 64 bits whatever they are.
const MOST_DIGITS: usize = 19;
/// Below this a whole number is one of 64 bits with a point exactly.
const EXACT: u64 = 1 << f64::MANTISSA_DIGITS;
/// The bits that a number of 64 has beyond one of 32, and how they stand half way between two of these.
const BEYOND: u64 = (1 << (f64::MANTISSA_DIGITS - f32::MANTISSA_DIGITS)) - 1;
const HALF_WAY: u64 = BEYOND / 2 + 1;

/// The powers of ten that are exact; the product of each with ten is, too.
static POWERS: [f64; 23] = {
    let mut powers = [1.0; 23];
    let mut at = 1;
    while at < powers.len() {
        powers[at] = 10.0 * powers[at - 1];
        at += 1;
    }
    powers
};

/// What is still to be read of a message. Each step gives `None` where something else stands.
pub(crate) struct Scan<'a> {
    rest: &'a [u8],
}

impl<'a> Scan<'a> {
    /// Of a message.
    pub(crate) fn of(text: &'a [u8]) -> Scan<'a> {
        Scan { rest: text }
    }

    /// Goes past these characters.
    #[inline]
    pub(crate) fn past<const N: usize>(&mut self, text: &[u8; N]) -> Option<()> {
        let (head, rest) = self.rest.split_first_chunk::<N>()?;
        if head != text {
            return None;
        }
        self.rest = rest;
        Some(())
    }

    /// The whole number that follows these characters.
    #[inline]
    pub(crate) fn count<const N: usize>(&mut self, before: &[u8; N]) -> Option<u64> {
        self.past(before)?;
        let (value, end) = digits(self.rest, 0, 0);
        let (number, rest) = self.rest.split_at(end);
        if !(1..=MOST_DIGITS).contains(&end) || (end > 1 && number.starts_with(b"0")) {
            return None;
        }
        self.rest = rest;
        Some(value)
    }

    /// The same of one that has 32 bits.
    #[inline]
    pub(crate) fn small<const N: usize>(&mut self, before: &[u8; N]) -> Option<u32> {
        self.count(before)?.try_into().ok()
    }

    /// The sixteen hexadecimal digits that follow these characters.
    pub(crate) fn hash<const N: usize>(&mut self, before: &[u8; N]) -> Option<u64> {
        self.past(before)?;
        let (digits, rest) = self.rest.split_first_chunk::<16>()?;
        let mut value = 0;
        for digit in digits {
            value = (value << 4) | u64::from(char::from(*digit).to_digit(16)?);
        }
        self.rest = rest;
        Some(value)
    }

    /// The number with a point or a power that follows these characters.
    #[inline]
    pub(crate) fn number<const N: usize>(&mut self, before: &[u8; N]) -> Option<f32> {
        self.past(before)?;
        let text = self.rest;
        let first = usize::from(text.first() == Some(&b'-'));
        let (whole, point) = digits(text, first, 0);
        let (all, end) = if text.get(point) == Some(&b'.') { digits(text, point + 1, whole) } else { (whole, point) };
        let is_sound = point > first && (point == first + 1 || text[first] != b'0') && end != point + 1;
        let (power, after) = power(text, end).filter(|(_, after)| is_sound && *after > point)?;
        let places = end.saturating_sub(point + 1);
        let is_short = point - first + places <= MOST_DIGITS;
        let value = if is_short { exact(all, power - places as i32) } else { None };
        let value = match value {
            Some(value) if first == 1 => -value,
            Some(value) => value,
            None => std::str::from_utf8(&text[..after]).ok()?.parse().ok()?,
        };
        self.rest = &text[after..];
        Some(value).filter(|value| value.is_finite())
    }

    /// What stands before these characters, if they are the last.
    pub(crate) fn up_to<const N: usize>(&self, end: &[u8; N]) -> Option<&'a [u8]> {
        self.rest.strip_suffix(end)
    }

    /// Goes past these characters, which are the last.
    pub(crate) fn end<const N: usize>(&mut self, text: &[u8; N]) -> Option<()> {
        self.past(text).filter(|()| self.rest.is_empty())
    }
}

/// A value followed by the digits from a place on, and where they end; nonsense of more than [`MOST_DIGITS`].
#[inline]
fn digits(text: &[u8], mut at: usize, mut value: u64) -> (u64, usize) {
    while let Some(eight) = text.get(at..).and_then(|rest| rest.first_chunk::<8>()).and_then(eight) {
        value = value.wrapping_mul(100_000_000).wrapping_add(eight);
        at += 8;
    }
    while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|digit| *digit < 10) {
        value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        at += 1;
    }
    (value, at)
}

/// The number of eight digits, if they are all digits: pairs, then fours, then all of them at once (Lemire, Number parsing at a gigabyte per second, 2021).
#[inline]
fn eight(text: &[u8; 8]) -> Option<u64> {
    const OF_FOUR: u64 = 0x0000_00ff_0000_00ff;
    const UPPER: u64 = 100 + (1_000_000 << 32);
    const LOWER: u64 = 1 + (10_000 << 32);
    let word = u64::from_le_bytes(*text);
    let from_zero = word.wrapping_sub(0x3030_3030_3030_3030);
    // Above 9 the one has its highest bit, below 0 the other.
    if (word.wrapping_add(0x4646_4646_4646_4646) | from_zero) & 0x8080_8080_8080_8080 != 0 {
        return None;
    }
    let pairs = from_zero.wrapping_mul(10).wrapping_add(from_zero >> 8);
    let upper = (pairs & OF_FOUR).wrapping_mul(UPPER);
    let lower = ((pairs >> 16) & OF_FOUR).wrapping_mul(LOWER);
    Some(upper.wrapping_add(lower) >> 32)
}

/// The power of ten that follows a number's digits, 0 if none is said, and where it ends.
#[inline]
fn power(text: &[u8], at: usize) -> Option<(i32, usize)> {
    if !matches!(text.get(at), Some(b'e' | b'E')) {
        return Some((0, at));
    }
    let sign = text.get(at + 1).copied().filter(|sign| matches!(sign, b'+' | b'-'));
    let first = at + 1 + usize::from(sign.is_some());
    let (value, end) = digits(text, first, 0);
    let value = i32::try_from(value).ok().filter(|_| (1..=3).contains(&(end - first)))?;
    Some((if sign == Some(b'-') { -value } else { value }, end))
}

/// Digits times a power of ten, if it is sure how that is rounded.
#[inline]
fn exact(digits: u64, power: i32) -> Option<f32> {
    let ten = *POWERS.get(power.unsigned_abs() as usize)?;
    let value = if power < 0 { digits as f64 / ten } else { digits as f64 * ten };
    let is_normal = digits == 0 || value >= f64::from(f32::MIN_POSITIVE);
    (digits < EXACT && is_normal && value.to_bits() & BEYOND != HALF_WAY).then_some(value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<f32> {
        let message = format!("a{text},");
        let mut scan = Scan::of(message.as_bytes());
        let value = scan.number(b"a")?;
        scan.end(b",").map(|()| value)
    }

    /// Words that follow each other without a pattern (Marsaglia, Xorshift RNGs, 2003).
    fn next(word: &mut u64) -> u64 {
        *word ^= *word << 13;
        *word ^= *word >> 7;
        *word ^= *word << 17;
        *word
    }

    #[test]
    fn a_number_is_read_as_the_bits_that_serde_json_reads() {
        let mut word = 0x9e37_79b9_7f4a_7c15;
        let is_as_ever = |text: &str| {
            let value: f32 = serde_json::from_str(text).unwrap();
            assert_eq!(read(text).map(f32::to_bits), Some(value.to_bits()), "{text}");
        };
        for _ in 0..200_000 {
            let bits = next(&mut word);
            // Of any size, and such as a hand and a force have.
            let value = f32::from_bits(bits as u32);
            let usual = (bits >> 40) as f32 / 16_777_216.0 * [1e-6, 1e-3, 0.05, 1.0, 30.0][(bits % 5) as usize];
            for value in [value, usual, -usual].into_iter().filter(|value| value.is_finite()) {
                is_as_ever(&serde_json::to_string(&value).unwrap());
            }
            // Digits that no number of 32 bits has as its shortest ones.
            is_as_ever(&format!("{}.{:09}e{}", bits % 1_000, next(&mut word) % 1_000_000_000, (bits >> 20) % 35));
            is_as_ever(&format!("0.{}e-{}", next(&mut word), (bits >> 20) % 60));
        }
        // Half way between two, and a little beside.
        ["16777217.0", "16777217.00000000001", "16777216.99999999999", "33554435.0e0"].into_iter().for_each(is_as_ever);
        ["1.00000005960464477539", "1.1754944e-38", "1.1754942e-38", "3.4028235e38"].into_iter().for_each(is_as_ever);
        ["0.0", "-0.0", "0e0", "1e-45", "-1e-46", "7e-7", "8.5E+2"].into_iter().for_each(is_as_ever);
    }

    #[test]
    fn what_is_no_number_with_a_point_is_left_to_others() {
        let whole = ["", "-", "1", "-1", "null", "NaN", "1e39", "-1e39"];
        let odd = ["01.0", "-01.0", "+1.0", ".5", "1.", "1.e5", "1e", "1e+", "1.0e", "1.0e9999", "1.0 ", "1.0.0"];
        for text in whole.into_iter().chain(odd) {
            assert_eq!(read(text), None, "{text:?}");
        }
    }

    #[test]
    fn whole_numbers_are_read_up_to_nineteen_digits_and_without_zeros_before_them() {
        let count = |text: &str| Scan::of(format!("n{text}").as_bytes()).count(b"n");
        let mut word = 7;
        for shift in (0..64).cycle().take(20_000) {
            let value = next(&mut word) >> shift;
            let expected = Some(value).filter(|value| *value < 10_000_000_000_000_000_000);
            assert_eq!(count(&value.to_string()), expected);
        }
        assert_eq!(["0", "00", "07", "", "-1", "x", "12x"].map(count), [Some(0), None, None, None, None, None, Some(12)]);
        let small = |text: &str| Scan::of(text.as_bytes()).small(b"");
        assert_eq!((small("4294967295"), small("4294967296")), (Some(u32::MAX), None));
    }

    #[test]
    fn a_hash_has_sixteen_digits() {
        let hash = |text: &str| Scan::of(text.as_bytes()).hash(b"h");
        assert_eq!(hash("h00ff00ff00ff00fe"), Some(0x00ff_00ff_00ff_00fe));
        assert_eq!([hash("h00ff"), hash("h00ff00ff00ff00fg"), hash("h+0ff00ff00ff00ff")], [None; 3]);
    }
}
