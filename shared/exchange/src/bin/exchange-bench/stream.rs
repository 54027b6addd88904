//! Streams beside a bare iceoryx2 publisher of equal quality of service: write, send and receive, two ports in one process. The bare
//! publisher fills an uninitialised loan from a slice: the least that iceoryx2 can take for a message of this length.

use crate::Failure;
use crate::measure::{Arm, Budget, Row, in_turns, timed};
use crate::partner::Site;
use hyst_exchange::Links;
use hyst_exchange::stream::{MAX_HELD, MAX_LOANS, MAX_NODES, MAX_READERS, READER_BUFFER};
use hyst_messages::{Kind, Role};
use iceoryx2::prelude::*;

const BLOCKS: usize = 40;

/// Adds the rows.
pub fn rows(site: &Site, budget: &Budget, rows: &mut Vec<Row>) -> Result<(), Failure> {
    let links = Links::join(&site.station, "bench")?;
    let node = NodeBuilder::new().create::<ipc_threadsafe::Service>()?; // in the station's domain: the configuration is global
    for (incarnation, name, bytes, count) in [(1, "128 B", 128, 2_000), (2, "64 KiB", 65_536, 400), (3, "1 MiB", 1 << 20, 40)] {
        rows.push(size(&links, &node, budget, incarnation, name, bytes, count)?);
    }
    Ok(())
}

fn size(
    links: &Links,
    node: &Node<ipc_threadsafe::Service>,
    budget: &Budget,
    incarnation: u32,
    name: &str,
    bytes: usize,
    count: usize,
) -> Result<Row, Failure> {
    let _service = links.create_service(Role::Tissue, incarnation, Kind::TissueState)?;
    let publisher = links.publisher(Role::Tissue, incarnation, Kind::TissueState, bytes)?;
    let subscriber = links.subscriber(Role::Tissue, incarnation, Kind::TissueState)?;
    subscriber.connect()?;
    let bare = node
        .service_builder(&format!("bare/{incarnation}").as_str().try_into()?)
        .publish_subscribe::<[u64]>()
        .max_publishers(1)
        .max_subscribers(MAX_READERS)
        .max_nodes(MAX_NODES)
        .subscriber_max_buffer_size(READER_BUFFER)
        .subscriber_max_borrowed_samples(MAX_HELD)
        .history_size(1)
        .enable_safe_overflow(true)
        .create()?;
    let bare_publisher = bare.publisher_builder().initial_max_slice_len(bytes / 8).max_loaned_samples(MAX_LOANS).create()?;
    let bare_subscriber = bare.subscriber_builder().create()?;

    let words = bytes / 8;
    let content: Vec<u64> = (0..words as u64).map(|at| at * 31).collect();
    let content_bytes: &[u8] = bytemuck::cast_slice(&content);
    let mut own_turn = || {
        timed(|| {
            let mut loan = publisher.loan(bytes)?;
            loan.bytes_mut().copy_from_slice(content_bytes);
            loan.send()?;
            let held = subscriber.next()?.ok_or("nothing received")?;
            std::hint::black_box(held.bytes()[bytes - 1]);
            Ok(())
        })
    };
    let receive = || -> Result<(), Failure> {
        let sample = bare_subscriber.receive()?.ok_or("nothing received")?;
        std::hint::black_box(sample.payload()[words - 1]);
        Ok(())
    };
    let mut bare_turn = || {
        timed(|| {
            let loan = bare_publisher.loan_slice_uninit(words)?;
            loan.write_from_slice(&content).send()?;
            receive()
        })
    };
    let arms: [Arm; 2] = [&mut own_turn, &mut bare_turn];
    let [own, bare] = in_turns(budget, BLOCKS, count, arms)?;
    Ok(Row::new(format!("stream, {name}"), "bare iceoryx2, uninitialised loan", &own, &bare, Some(1.1)))
}
