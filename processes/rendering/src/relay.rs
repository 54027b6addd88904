//! What others see of the pictures: now and then a small one, as a stream, written in place, and only while somebody asks. The console says in its page
//! until when it wants them for the operator's, the recorder in its own when something happened; and while this process is on trial, its judge wants them. While
//! nobody does, that costs three loads in a frame.

use crate::sources::Sources;
use hyst_engine::{Failure, Life};
use hyst_exchange::{Links, Publisher, system};
use hyst_messages::page::header;
use hyst_messages::stream::{MOST_PICTURE_PX, message_bytes};
use hyst_messages::{Kind, MessageMut, Role, StreamHeader};
use rendering::{RenderError, Renderer};

/// Time between two pictures, ns: each is read back from the device, which takes milliseconds of the engines' cores where that is software.
const INTERVAL_NS: u64 = 200_000_000;
/// The next one is due after so many times as long as the last one took, if that is longer: where the processor draws and has little time for it, five in a
/// second would take most of what the pictures themselves have.
const REST: u64 = 8;
/// Not longer than this, ns: a page that waits longer shows that it has none.
const LONGEST_NS: u64 = 1_000_000_000;
/// Bytes of a pixel that is sent.
const RGB: usize = 3;
/// Bytes of a pixel that is read.
const RGBA: usize = 4;

/// The stream's writer.
#[derive(Debug)]
pub struct Relay {
    publisher: Publisher,
    due_ns: u64,
}

impl Relay {
    /// Opens the stream; before others may connect.
    pub fn open(life: &Life, links: &Links) -> Result<Relay, Failure> {
        let most = message_bytes(&[RGB * (MOST_PICTURE_PX[0] * MOST_PICTURE_PX[1]) as usize]);
        Ok(Relay { publisher: links.publisher(Role::Rendering, life.incarnation, Kind::Picture, most)?, due_ns: 0 })
    }

    /// Sends the present picture if it is asked for and due.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`].
    pub fn show(&mut self, life: &Life, sources: &Sources, tick: u64, renderer: &mut Renderer) -> Result<(), RenderError> {
        let now_ns = system::now_ns();
        let is_on_trial = life.clock.swap(Role::Rendering).is_on_trial(life.incarnation);
        let is_asked = is_on_trial || sources.want_pictures(now_ns);
        if !is_asked || now_ns < self.due_ns {
            return Ok(());
        }
        let size = renderer.size_px();
        let rgba = renderer.read_rgba()?;
        // What is not sent is not missed: the next one is as good.
        if let Some(bytes) = self.send(life, tick, size, rgba) {
            life.page.add64(header::STREAM_BYTES, bytes as u64);
            life.page.add64(header::COPIED_BYTES, rgba.len() as u64);
        }
        let took_ns = system::now_ns().saturating_sub(now_ns);
        self.due_ns = now_ns + if is_on_trial { INTERVAL_NS } else { interval_ns(took_ns) };
        Ok(())
    }

    /// Makes a picture small in the loan and sends it; gives the bytes of the message.
    fn send(&self, life: &Life, tick: u64, size: [u32; 2], rgba: &[u8]) -> Option<usize> {
        let factor = factor(size);
        let small = size.map(|px| px / factor);
        let bytes = RGB * (small[0] * small[1]) as usize;
        if bytes == 0 || rgba.len() != RGBA * (size[0] * size[1]) as usize {
            return None;
        }
        let length = message_bytes(&[bytes]);
        let mut loan = self.publisher.loan(length).ok()?;
        let header = StreamHeader { tick, incarnation: life.incarnation, words: small, ..Default::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Picture, header, &[bytes]).ok()?;
        shrink(rgba, size[0] as usize, factor as usize, small[0] as usize, message.section::<u8>(0).ok()?);
        loan.send().ok().map(|_| length)
    }
}

/// Time between a picture that took so long to be sent and the next one, ns.
fn interval_ns(took_ns: u64) -> u64 {
    took_ns.saturating_mul(REST).clamp(INTERVAL_NS, LONGEST_NS)
}

/// The least whole number by which a picture is divided so that it is small enough.
fn factor(size: [u32; 2]) -> u32 {
    size[0].div_ceil(MOST_PICTURE_PX[0]).max(size[1].div_ceil(MOST_PICTURE_PX[1])).max(1)
}

/// Each pixel of `rgb`, `small_width` in a row, is the mean of a square of `factor` × `factor` pixels of `rgba`, `width` in a row.
fn shrink(rgba: &[u8], width: usize, factor: usize, small_width: usize, rgb: &mut [u8]) {
    let count = (factor * factor) as u32;
    for (index, pixel) in rgb.chunks_exact_mut(RGB).enumerate() {
        let (left, top) = (index % small_width * factor, index / small_width * factor);
        let mut sums = [0u32; RGB];
        for row in top..top + factor {
            let begin = RGBA * (row * width + left);
            for texel in rgba[begin..begin + RGBA * factor].chunks_exact(RGBA) {
                for (sum, channel) in sums.iter_mut().zip(texel) {
                    *sum += u32::from(*channel);
                }
            }
        }
        for (channel, sum) in pixel.iter_mut().zip(sums) {
            *channel = (sum / count) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_take_long_to_be_sent_come_more_seldom_but_one_in_a_second() {
        let wanted_ms = [(0, 200), (4, 200), (25, 200), (40, 320), (125, 1_000), (3_000, 1_000)];
        for (took_ms, interval_ms) in wanted_ms {
            assert_eq!(interval_ns(took_ms * 1_000_000), interval_ms * 1_000_000, "{took_ms} ms");
        }
        assert_eq!(interval_ns(u64::MAX), LONGEST_NS);
    }

    #[test]
    fn a_picture_is_divided_by_the_least_number_that_makes_it_small_enough() {
        assert_eq!([[640, 480], [400, 300], [401, 300], [1_920, 1_080], [16, 16]].map(factor), [2, 1, 2, 5, 1]);
    }

    #[test]
    fn a_small_pixel_is_the_mean_of_its_square_by_hand() {
        // 5 × 3 pixels, red is the column, green the row, blue 9; by 2: two columns, one row, and the rest is left out.
        let rgba: Vec<u8> = (0..15).flat_map(|at| [10 * (at % 5), 20 * (at / 5), 9, 255]).collect();
        let mut rgb = [77u8; 6];
        shrink(&rgba, 5, 2, 2, &mut rgb);
        assert_eq!(rgb, [5, 10, 9, 25, 10, 9]);
    }
}
