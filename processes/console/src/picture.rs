//! A picture of rendering's stream as a browser takes it: JPEG (ITU-T T.81). Promise: what is not a picture gives none.

use axum::body::Bytes;
use hyst_exchange::system;
use hyst_messages::stream::MOST_PICTURE_PX;
use hyst_messages::{Kind, Message};
use jpeg_encoder::{ColorType, Encoder};

/// Quality of the pictures, 1 to 100: no blocks are seen in tissue, and a picture has some ten thousand bytes.
const QUALITY: u8 = 85;
/// A picture that is older is not shown, ns: rendering sends one five times a second.
const FRESH_NS: u64 = 2_000_000_000;

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Tick at which it was drawn.
    pub tick: u64,
    /// When it was received, CLOCK_MONOTONIC ns.
    pub at_ns: u64,
    /// The file.
    pub jpeg: Bytes,
}

impl Picture {
    /// From a message; `None` if it is none, or not of the size that it says.
    pub fn encode(message: &[u8]) -> Option<Picture> {
        let message = Message::parse(message, Kind::Picture).ok()?;
        let header = message.header();
        let [width, height] = header.words;
        let rgb = message.section::<u8>(0).ok()?;
        let fits = (1..=MOST_PICTURE_PX[0]).contains(&width) && (1..=MOST_PICTURE_PX[1]).contains(&height);
        if !fits || rgb.len() != 3 * (width * height) as usize {
            return None;
        }
        let mut jpeg = Vec::new();
        Encoder::new(&mut jpeg, QUALITY).encode(rgb, width as u16, height as u16, ColorType::Rgb).ok()?;
        Some(Picture { tick: header.tick, at_ns: system::now_ns(), jpeg: Bytes::from(jpeg) })
    }

    /// Whether it is still to be shown.
    pub fn is_fresh(&self) -> bool {
        system::now_ns().saturating_sub(self.at_ns) < FRESH_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{MessageMut, StreamHeader};

    fn message(words: [u32; 2], bytes: usize, kind: Kind) -> Vec<u8> {
        let mut memory = vec![0u8; message_bytes(&[bytes])];
        let header = StreamHeader { tick: 41, words, ..Default::default() };
        let mut message = MessageMut::format(&mut memory, kind, header, &[bytes]).unwrap();
        message.section::<u8>(0).unwrap().fill(200);
        memory
    }

    #[test]
    fn a_picture_becomes_a_jpeg_of_its_size() {
        let picture = Picture::encode(&message([20, 10], 600, Kind::Picture)).unwrap();
        let jpeg = &picture.jpeg[..];
        assert!(picture.tick == 41 && picture.is_fresh() && jpeg.starts_with(&[0xff, 0xd8]) && jpeg.ends_with(&[0xff, 0xd9]));
        // Start of frame: length, 8 bits, height, width, big-endian.
        let frame = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        assert_eq!(jpeg[frame + 4..frame + 9], [8, 0, 10, 0, 20]);
    }

    #[test]
    fn what_is_no_picture_gives_none() {
        for (words, bytes) in
            [([20, 10], 599), ([0, 10], 0), ([20, 0], 0), ([401, 1], 1_203), ([1, 301], 903), ([u32::MAX; 2], 3)]
        {
            assert_eq!(Picture::encode(&message(words, bytes, Kind::Picture)), None, "{words:?}");
        }
        assert_eq!(Picture::encode(&message([20, 10], 600, Kind::Force)), None);
        assert_eq!(Picture::encode(&[1, 2, 3]), None);
    }
}
