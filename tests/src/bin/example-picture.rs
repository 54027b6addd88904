//! How little an engine without a state takes: a Vision Engine that shows the surface of the tissue as points, as the scope sees them, the nearer the brighter.
//! It reads pages and streams, keeps a pace and writes its pictures in place; it opens no window, and of the station's own engines it links nothing.
//! `hystation swap rendering target/release/example-picture` puts it in the place of the real one.

use hyst_engine::{Failure, Life, Pace, realtime};
use hyst_exchange::usher::{Departure, Port, Wanted, usher};
use hyst_exchange::{Held, Horizon, Links, ReadPage, Subscriber, system};
use hyst_messages::page::{ProcessState, hardware, rendering};
use hyst_messages::stream::message_bytes;
use hyst_messages::{Kind, Message, MessageMut, Pose, RenderingStatus, Role, StreamHeader};

/// Of a picture, px: 90 degrees from side to side. 30 of them in a second.
const SIZE_PX: [u32; 2] = [320, 240];
const PERIOD_TICKS: u64 = 33;
/// How far from the tip a point is seen, m. The longest step of a tissue, ticks: no state is farther ahead of the present.
const SEEN_M: std::ops::Range<f32> = 0.001..0.08;
const LONGEST_STEP: u64 = 4;

/// Epoch and tick of a state; none of what was computed beside the role.
fn key_of(held: &Held) -> Option<(u32, u64)> {
    let header = *Message::parse(held.bytes(), Kind::TissueState).ok()?.header();
    (!header.is_shadow()).then_some((header.epoch, header.tick))
}

fn cross([a, b, c]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

/// The points before the tip: anterior is up, the patient's right on the left.
fn draw(points_m: &[[f32; 3]], pose: &Pose, rgb: &mut [u8]) {
    let ([width, height], [x, y, z, w]) = (SIZE_PX.map(|px| px as f32), pose.orientation);
    rgb.fill(0);
    for point_m in points_m {
        let from_m: [f32; 3] = std::array::from_fn(|axis| point_m[axis] - pose.position_m[axis]);
        // Turned back into the scope's frame.
        let twice = cross(from_m, [x, y, z]).map(|part| 2.0 * part);
        let across = cross(twice, [x, y, z]);
        let [left_m, up_m, ahead_m]: [f32; 3] = std::array::from_fn(|axis| from_m[axis] + w * twice[axis] + across[axis]);
        let (column, row) = (width / 2.0 * (1.0 - left_m / ahead_m), height / 2.0 - width / 2.0 * up_m / ahead_m);
        if SEEN_M.contains(&ahead_m) && (0.0..width).contains(&column) && (0.0..height).contains(&row) {
            let at = 3 * (row as usize * SIZE_PX[0] as usize + column as usize);
            let level = ((255.0 * (1.0 - ahead_m / SEEN_M.end)) as u8).max(rgb[at]);
            rgb[at..at + 3].fill(level);
        }
    }
}

fn run(life: &Life) -> Result<(), Failure> {
    let sections = [3 * (SIZE_PX[0] * SIZE_PX[1]) as usize];
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let pictures = links.publisher(Role::Rendering, life.incarnation, Kind::Picture, message_bytes(&sections))?;
    let interests = vec![(Role::Hardware, Wanted::Page), (Role::Tissue, Wanted::Stream(Kind::TissueState))];
    let (mut inbox, horizon) =
        (usher(&life.station, Some(links), life.incarnation, interests)?, Horizon::open(&life.station, Role::Tissue)?);
    let (mut hand, mut state): (Option<ReadPage>, Option<Held>) = (None, None);
    let mut tissues: [Option<Subscriber>; 3] = Default::default(); // holder, spare, a newcomer on trial
    let mut status = RenderingStatus { scale: 1.0, size_px: SIZE_PX, ..Default::default() };
    life.ports_are_open();
    let mut pace = Pace::new(life, PERIOD_TICKS, 0);
    while let Some(tick) = pace.wait() {
        let begun_ns = system::now_ns();
        life.misbehave();
        while let Some(arrival) = inbox.take() {
            let before = match arrival.port {
                Port::Page(page) => hand.replace(page).map(Departure::Page),
                Port::Stream(_, stream) => tissues[arrival.slot.index()].replace(stream).map(Departure::Stream),
                Port::Client(..) => None, // none was asked for
            };
            before.into_iter().for_each(|before| _ = inbox.retire(before));
        }
        for held in tissues.iter().flatten().filter_map(|stream| stream.newest().ok()?) {
            let can_be = |key: (u32, u64)| !horizon.is_passed_by(key, LONGEST_STEP, &life.clock);
            if key_of(&held).is_some_and(can_be) && key_of(&held) > state.as_ref().and_then(key_of) {
                state = Some(held);
            }
        }
        let shown = state.as_ref().and_then(|held| Message::parse(held.bytes(), Kind::TissueState).ok());
        let points_m = shown.and_then(|shown| shown.section::<[f32; 3]>(3).ok()).unwrap_or(&[]);
        let sample = hand.as_ref().and_then(|page| page.cell(hardware::SAMPLE)).map(|(_, sample)| sample).unwrap_or_default();
        let mut loan = pictures.loan(message_bytes(&sections))?;
        let header = StreamHeader { tick, incarnation: life.incarnation, words: SIZE_PX, ..Default::default() };
        draw(points_m, &sample.pose, MessageMut::format(loan.bytes_mut(), Kind::Picture, header, &sections)?.section::<u8>(0)?);
        life.drag(begun_ns);
        loan.send()?;
        let (frame_ms, shown_tick) = ((system::now_ns() - begun_ns) as f32 * 1e-6, shown.map_or(0, |shown| shown.header().tick));
        status = RenderingStatus { frames: status.frames + 1, frame_ms, shown_tick, ..status };
        life.page.write(rendering::STATUS, &status);
        if status.frames == 1 {
            realtime::draw(life); // from now on it gives way to the hand
            life.page.set_state(ProcessState::Live);
        }
        pace.end();
    }
    Ok(())
}

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Rendering, run)
}
