//! A rendering whose page says all that a good one's says, and whose pictures are made up.

use hyst_engine::{Failure, Life};
use hyst_exchange::{Links, system};
use hyst_messages::page::{ProcessState, header, rendering};
use hyst_messages::stream::message_bytes;
use hyst_messages::{Kind, MessageMut, RenderingStatus, Role, StreamHeader};

/// Size of a picture, px, and the time between two, ns: it is faster than a good one.
const PICTURE_PX: [u32; 2] = [320, 240];
pub const PICTURE_NS: u64 = 20_000_000;

/// Its whole life, with pictures of these levels, byte by byte and picture by picture.
pub fn draw(life: &Life, every_ns: u64, level: fn(usize, u64) -> u8) -> Result<(), Failure> {
    let sections = [3 * (PICTURE_PX[0] * PICTURE_PX[1]) as usize];
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let stream = links.publisher(Role::Rendering, life.incarnation, Kind::Picture, message_bytes(&sections))?;
    life.ports_are_open();
    life.page.set_state(ProcessState::Live);
    for frames in 1.. {
        if life.clock.stop_requested() {
            break;
        }
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        let status = RenderingStatus { frames, shown_tick: life.tick(), size_px: PICTURE_PX, ..RenderingStatus::default() };
        life.page.write(rendering::STATUS, &status);
        let mut loan = stream.loan(message_bytes(&sections))?;
        let header = StreamHeader { tick: life.tick(), incarnation: life.incarnation, words: PICTURE_PX, ..Default::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Picture, header, &sections)?;
        message.section::<u8>(0)?.iter_mut().enumerate().for_each(|(at, byte)| *byte = level(at, frames));
        loan.send()?;
        system::sleep_ns(every_ns);
    }
    Ok(())
}

/// Another picture each time.
pub fn changing(at: usize, frames: u64) -> u8 {
    (at as u64 + 40 * frames) as u8
}
