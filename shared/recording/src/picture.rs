//! A picture of rendering's stream as browsers and recordings have it: JPEG (ITU-T T.81); and as a message of a recording, with what it was taken for.
//! Promise: what is not a picture gives none.

use crate::messages::Time;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hyst_messages::stream::MOST_PICTURE_PX;
use hyst_messages::{Kind, Message};
use jpeg_encoder::{ColorType, Encoder};
use serde::{Deserialize, Serialize};

/// Quality of the pictures, 1 to 100: no blocks are seen in tissue, and a picture has some ten thousand bytes.
const QUALITY: u8 = 85;
/// Bytes of a pixel.
const RGB: usize = 3;
/// How a file of that kind begins and ends.
const BEGIN: [u8; 2] = [0xff, 0xd8];
const END: [u8; 2] = [0xff, 0xd9];

/// A picture of rendering's stream as a file, and the tick at which it was drawn; `None` if the message is none, or not of the size that it says.
pub fn jpeg(message: &[u8]) -> Option<(u64, Vec<u8>)> {
    let message = Message::parse(message, Kind::Picture).ok()?;
    let header = message.header();
    let [width, height] = header.words;
    let rgb = message.section::<u8>(0).ok()?;
    let fits = (1..=MOST_PICTURE_PX[0]).contains(&width) && (1..=MOST_PICTURE_PX[1]).contains(&height);
    if !fits || rgb.len() != RGB * (width * height) as usize {
        return None;
    }
    let mut jpeg = Vec::new();
    Encoder::new(&mut jpeg, QUALITY).encode(rgb, width as u16, height as u16, ColorType::Rgb).ok()?;
    Some((header.tick, jpeg))
}

/// A picture, and what it was taken for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Tick at which it was drawn.
    pub tick: u64,
    /// Tick of what happened: some tenths of a second earlier.
    pub event_tick: u64,
    /// What happened.
    pub words: String,
    /// The file.
    pub jpeg: Vec<u8>,
}

/// Message of `/pictures`.
#[derive(Serialize, Deserialize)]
pub(crate) struct PictureMessage {
    timestamp: Time,
    frame_id: String,
    format: String,
    data: String,
    tick: u64,
    event_tick: u64,
    words: String,
}

impl PictureMessage {
    pub(crate) fn of(picture: &Picture) -> PictureMessage {
        PictureMessage {
            timestamp: Time::of(picture.tick),
            frame_id: "camera".into(),
            format: "jpeg".into(),
            data: BASE64_STANDARD.encode(&picture.jpeg),
            tick: picture.tick,
            event_tick: picture.event_tick,
            words: picture.words.clone(),
        }
    }

    pub(crate) fn picture(self) -> Result<Picture, String> {
        let jpeg = BASE64_STANDARD.decode(&self.data).map_err(|error| format!("has a picture that is none: {error}"))?;
        if self.format != "jpeg" || !jpeg.starts_with(&BEGIN) || !jpeg.ends_with(&END) {
            return Err("has a picture that is no JPEG".into());
        }
        Ok(Picture { tick: self.tick, event_tick: self.event_tick, words: self.words, jpeg })
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
        let (tick, jpeg) = jpeg(&message([20, 10], 600, Kind::Picture)).unwrap();
        assert!(tick == 41 && jpeg.starts_with(&BEGIN) && jpeg.ends_with(&END));
        // Start of frame: length, 8 bits, height, width, big-endian.
        let frame = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        assert_eq!(jpeg[frame + 4..frame + 9], [8, 0, 10, 0, 20]);
    }

    #[test]
    fn what_is_no_picture_gives_none() {
        for (words, bytes) in
            [([20, 10], 599), ([0, 10], 0), ([20, 0], 0), ([401, 1], 1_203), ([1, 301], 903), ([u32::MAX; 2], 3)]
        {
            assert_eq!(jpeg(&message(words, bytes, Kind::Picture)), None, "{words:?}");
        }
        assert_eq!(jpeg(&message([20, 10], 600, Kind::Force)), None);
        assert_eq!(jpeg(&[1, 2, 3]), None);
    }

    #[test]
    fn a_message_that_holds_no_picture_is_damage() {
        let (tick, jpeg) = jpeg(&message([20, 10], 600, Kind::Picture)).unwrap();
        let picture = Picture { tick, event_tick: 30, words: "a piece".into(), jpeg };
        assert_eq!(PictureMessage::of(&picture).picture(), Ok(picture.clone()));
        let spoilt = |spoil: fn(&mut PictureMessage)| {
            let mut message = PictureMessage::of(&picture);
            spoil(&mut message);
            message.picture().unwrap_err()
        };
        assert!(spoilt(|message| message.data.push('!')).contains("a picture that is none"));
        assert!(spoilt(|message| message.data = BASE64_STANDARD.encode("<svg>")).contains("no JPEG"));
        assert!(spoilt(|message| message.format = "png".into()).contains("no JPEG"));
    }
}
