//! What a rendering on probation draws, as its stream of small pictures shows it.

use hyst_exchange::{Held, Links, Station, Subscriber};
use hyst_messages::{Kind, Message, Role};

/// Bytes of a pixel.
const RGB: usize = 3;
/// By how much the colours of a picture differ at least, in steps of a channel: no picture of tissue, and none with a line of text in it, has fewer.
const LEAST_CONTRAST: u8 = 8;
/// How far the scope has moved, m, when one picture cannot be that of before to the bit.
const MOVED_M: f32 = 5e-4;

/// The stream of a newcomer, opened as soon as that can be.
pub(super) struct Stream {
    links: Links,
    guest: u32,
    reader: Option<Subscriber>,
}

impl Stream {
    pub(super) fn of(station: &Station, guest: u32) -> Result<Stream, String> {
        let links = Links::join(station, "judge").map_err(|error| error.to_string())?;
        Ok(Stream { links, guest, reader: None })
    }

    /// The newest picture that was not yet looked at.
    pub(super) fn newest(&mut self) -> Option<Held> {
        if self.reader.is_none() {
            self.reader = self.links.subscriber(Role::Rendering, self.guest, Kind::Picture).ok();
            self.reader.as_ref()?.connect().ok()?;
        }
        self.reader.as_ref()?.newest().ok().flatten()
    }
}

/// The picture that was looked at last, where the scope was when it came first, and whether it has moved from there since.
#[derive(Debug, Default)]
pub(super) struct Gallery {
    last: Option<(Vec<u8>, [f32; 3], bool)>,
}

impl Gallery {
    /// What speaks against a picture, if anything does; `at_m`: where the scope is.
    pub(super) fn look(&mut self, message: Option<&[u8]>, at_m: [f32; 3]) -> Result<(), &'static str> {
        let message = message.ok_or("it sends no new picture")?;
        let message = Message::parse(message, Kind::Picture).map_err(|_| "what it sends is no picture")?;
        let [width, height] = message.header().words;
        let rgb = message.section::<u8>(0).map_err(|_| "what it sends is no picture")?;
        if rgb.is_empty() || rgb.len() as u64 != RGB as u64 * u64::from(width) * u64::from(height) {
            return Err("its picture has not the size that it says");
        }
        let contrast = |channel: usize| {
            let levels = || rgb.iter().skip(channel).step_by(RGB).copied();
            levels().max().unwrap_or(0) - levels().min().unwrap_or(0)
        };
        if (0..RGB).all(|channel| contrast(channel) < LEAST_CONTRAST) {
            return Err("its picture is all of one colour");
        }
        let Some((_, from_m, has_moved)) = self.last.as_mut().filter(|(last, ..)| last == rgb) else {
            self.last = Some((rgb.to_vec(), at_m, false));
            return Ok(());
        };
        // A hand that goes to and fro comes back to where it was.
        let moved_m = from_m.iter().zip(at_m).map(|(from, to)| (from - to).powi(2)).sum::<f32>().sqrt();
        *has_moved |= moved_m > MOVED_M;
        if *has_moved { Err("its pictures stand still while the scope moves") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{MessageMut, StreamHeader};

    /// A picture of 20 × 10 pixels.
    fn picture(words: [u32; 2], level: impl Fn(usize) -> u8) -> Vec<u8> {
        let sections = [600];
        let mut memory = vec![0u8; message_bytes(&sections)];
        let header = StreamHeader { tick: 41, words, ..StreamHeader::default() };
        let mut message = MessageMut::format(&mut memory, Kind::Picture, header, &sections).unwrap();
        for (at, byte) in message.section::<u8>(0).unwrap().iter_mut().enumerate() {
            *byte = level(at);
        }
        memory
    }

    #[test]
    fn a_picture_is_of_its_size_and_of_more_than_one_colour() {
        let look = |message: &[u8]| Gallery::default().look(Some(message), [0.0; 3]);
        assert_eq!(look(&picture([20, 10], |at| at as u8)), Ok(()));
        assert_eq!(look(&picture([20, 11], |at| at as u8)), Err("its picture has not the size that it says"));
        assert_eq!(look(&picture([20, 10], |_| 0)), Err("its picture is all of one colour"));
        // Each channel has a level of its own, but for a little noise.
        assert_eq!(look(&picture([20, 10], |at| 60 * (at % 3) as u8 + (at % 7) as u8)), Err("its picture is all of one colour"));
        assert_eq!(look(&picture([20, 10], |at| if at == 300 { 90 } else { 0 })), Ok(()), "one pixel");
        assert_eq!(look(&[1, 2, 3]), Err("what it sends is no picture"));
        assert_eq!(Gallery::default().look(None, [0.0; 3]), Err("it sends no new picture"));
    }

    #[test]
    fn one_that_shows_the_same_while_the_scope_moves_stands_still() {
        let mut gallery = Gallery::default();
        let mut look = |shift: usize, z_m: f32| gallery.look(Some(&picture([20, 10], |at| (at + shift) as u8)), [0.0, 0.0, z_m]);
        assert_eq!([look(0, 0.01), look(0, 0.0102)], [Ok(()); 2], "hardly moved");
        let still = Err("its pictures stand still while the scope moves");
        assert_eq!([look(0, 0.011), look(0, 0.012), look(0, 0.01)], [still; 3], "it went, and came back");
        assert_eq!([look(1, 0.012), look(1, 0.0121)], [Ok(()); 2], "another one");
    }
}
