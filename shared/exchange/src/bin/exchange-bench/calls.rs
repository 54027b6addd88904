//! Rendezvous beside bare iceoryx2 request-response and bare channels, cells beside a plain copy under a seqlock, a promotion beside a bare
//! compare-and-swap: the cost of the calls themselves, both sides on one thread.

use crate::Failure;
use crate::measure::{Budget, Row, in_turns, timed};
use crate::partner::Site;
use hyst_exchange::rendezvous::{Client, MAX_BYTES, Server};
use hyst_exchange::stream::MAX_NODES;
use hyst_exchange::{Links, Roster};
use hyst_messages::page::haptic;
use hyst_messages::{ForceRecord, Kind, Role, Slot};
use iceoryx2::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering, fence};

const BLOCKS: usize = 40;
const CALLS: usize = 500;
const MESSAGE_BYTES: usize = 256;
/// Incarnation of server and servo.
const INCARNATION: u32 = 9;
/// Clients of one server, as the rendezvous has it.
const MAX_CLIENTS: usize = 8;
/// Cell operations that are timed together: one takes not much longer than a look at the clock.
const BATCH: usize = 64;

/// Adds the rows.
pub fn rows(site: &Site, budget: &Budget, rows: &mut Vec<Row>) -> Result<(), Failure> {
    rows.push(rendezvous(site, budget)?);
    rows.push(threads(budget)?);
    rows.push(cell(site, budget)?);
    rows.push(promotion(site, budget)?);
    Ok(())
}

/// A request and its answer, in either form; gives what it took, ns.
fn there_and_back(client: &mut impl Client, server: &mut impl Server, content: &[u8]) -> Result<f64, Failure> {
    timed(|| {
        client.begin(content)?;
        server.serve(&mut |request| request.to_vec())?;
        std::hint::black_box(client.poll()?.ok_or("no answer")?);
        Ok(())
    })
}

/// What one of a batch of operations takes, ns.
fn batched(mut operation: impl FnMut() -> Result<(), Failure>) -> Result<f64, Failure> {
    let batch_ns = timed(|| (0..BATCH).try_for_each(|_| operation()))?;
    Ok(batch_ns / BATCH as f64)
}

fn rendezvous(site: &Site, budget: &Budget) -> Result<Row, Failure> {
    let links = Links::join(&site.station, "bench")?;
    let _service = links.create_rendezvous(Role::Tissue, INCARNATION, Kind::Appearance)?;
    let mut server = links.server(Role::Tissue, INCARNATION, Kind::Appearance)?;
    let mut client = links.client(Role::Tissue, INCARNATION, Kind::Appearance)?;
    let node = NodeBuilder::new().create::<ipc_threadsafe::Service>()?;
    let bare = node
        .service_builder(&"bare/request".try_into()?)
        .request_response::<[u8], [u8]>()
        .max_servers(1)
        .max_clients(MAX_CLIENTS)
        .max_nodes(MAX_NODES)
        .max_active_requests_per_client(1)
        .max_response_buffer_size(1)
        .enable_safe_overflow_for_requests(true)
        .enable_safe_overflow_for_responses(true)
        .create()?;
    let bare_server = bare.server_builder().initial_max_slice_len(MAX_BYTES).create()?;
    let bare_client = bare.client_builder().initial_max_slice_len(MAX_BYTES).create()?;
    let content = [7u8; MESSAGE_BYTES];
    let mut own_turn = || there_and_back(&mut client, &mut server, &content);
    let mut bare_turn = || {
        timed(|| {
            let pending = bare_client.loan_slice_uninit(content.len())?.write_from_slice(&content).send()?;
            let request = bare_server.receive()?.ok_or("no request")?;
            // The answer takes the same way as ours: made by the server's author in memory of its own, read by the client's.
            let answer = request.payload().to_vec();
            request.loan_slice_uninit(answer.len())?.write_from_slice(&answer).send()?;
            std::hint::black_box(pending.receive()?.ok_or("no answer")?.payload().to_vec());
            Ok(())
        })
    };
    let [own, raw] = in_turns(budget, BLOCKS, CALLS, [&mut own_turn, &mut bare_turn])?;
    Ok(Row::new(format!("rendezvous, {MESSAGE_BYTES} B there and back"), "bare iceoryx2", &own, &raw, None))
}

/// The thread form beside a pair of bare crossbeam channels.
fn threads(budget: &Budget) -> Result<Row, Failure> {
    let (mut client, mut server) = hyst_exchange::rendezvous::rendezvous();
    let (ask, asked) = crossbeam::channel::bounded::<Vec<u8>>(1);
    let (answer, answered) = crossbeam::channel::bounded::<Vec<u8>>(1);
    let content = [7u8; MESSAGE_BYTES];
    let mut own_turn = || there_and_back(&mut client, &mut server, &content);
    let mut bare_turn = || {
        timed(|| {
            ask.try_send(content.to_vec())?;
            answer.try_send(asked.try_recv()?.to_vec())?;
            std::hint::black_box(answered.try_recv()?);
            Ok(())
        })
    };
    let [own, raw] = in_turns(budget, BLOCKS, CALLS, [&mut own_turn, &mut bare_turn])?;
    Ok(Row::new(format!("rendezvous of threads, {MESSAGE_BYTES} B"), "bare crossbeam channels", &own, &raw, None))
}

/// A promotion in the roster beside the compare-and-swap that it is. (The usher has no row: it is an ordinary thread that works before anything is used.)
fn promotion(site: &Site, budget: &Budget) -> Result<Row, Failure> {
    let roster = Roster::open(&site.station)?;
    let word = AtomicU64::new(0);
    let mut own_turn = || {
        batched(|| {
            let holder = roster.holder(Role::Tissue);
            let taken = roster.promote(Role::Tissue, std::hint::black_box(holder), INCARNATION);
            std::hint::black_box(taken.map_err(|_| "another was faster")?);
            Ok(())
        })
    };
    let mut bare_turn = || {
        batched(|| {
            let seen = std::hint::black_box(word.load(Ordering::Acquire));
            let swapped = word.compare_exchange(seen, seen + 1, Ordering::AcqRel, Ordering::Acquire);
            std::hint::black_box(swapped.map_err(|_| "another was faster")?);
            Ok(())
        })
    };
    let [own, raw] = in_turns(budget, BLOCKS, CALLS, [&mut own_turn, &mut bare_turn])?;
    Ok(Row::new("roster, a look and a promotion".into(), "bare compare-and-swap", &own, &raw, None))
}

const RECORD_WORDS: usize = size_of::<ForceRecord>() / 8;

/// The plain seqlock: one copy, no checksum; a reader waits for a writer, and for ever for one that died in the middle.
struct Seqlock {
    sequence: AtomicU64,
    words: [AtomicU64; RECORD_WORDS],
}

impl Seqlock {
    fn write(&self, record: &ForceRecord) {
        let sequence = self.sequence.load(Ordering::Relaxed);
        self.sequence.store(sequence + 1, Ordering::Relaxed);
        fence(Ordering::Release);
        let values: &[u64] = bytemuck::cast_slice(std::slice::from_ref(record));
        for (word, value) in self.words.iter().zip(values) {
            word.store(*value, Ordering::Relaxed);
        }
        self.sequence.store(sequence + 2, Ordering::Release);
    }
    fn read(&self) -> ForceRecord {
        let mut record = ForceRecord::default();
        loop {
            let before = self.sequence.load(Ordering::Acquire);
            let values: &mut [u64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut record));
            for (value, word) in values.iter_mut().zip(&self.words) {
                *value = word.load(Ordering::Relaxed);
            }
            fence(Ordering::Acquire);
            if before.is_multiple_of(2) && self.sequence.load(Ordering::Relaxed) == before {
                return record;
            }
            std::hint::spin_loop();
        }
    }
}

fn cell(site: &Site, budget: &Budget) -> Result<Row, Failure> {
    let slot = Slot::first(Role::Haptic);
    let owner = site.station.create_slot(slot, INCARNATION)?;
    let reader = site.station.read_slot(slot, INCARNATION)?;
    let plain = Seqlock { sequence: AtomicU64::new(0), words: std::array::from_fn(|_| AtomicU64::new(0)) };
    let record = ForceRecord { tick: 1, ..Default::default() };
    let mut own_turn = || {
        batched(|| {
            owner.write(haptic::FORCE, std::hint::black_box(&record));
            std::hint::black_box(reader.cell(haptic::FORCE).ok_or("no value")?);
            Ok(())
        })
    };
    let mut plain_turn = || {
        batched(|| {
            plain.write(std::hint::black_box(&record));
            std::hint::black_box(plain.read());
            Ok(())
        })
    };
    let [own, raw] = in_turns(budget, BLOCKS, CALLS, [&mut own_turn, &mut plain_turn])?;
    Ok(Row::new(format!("cell of {} B, write and read", size_of::<ForceRecord>()), "seqlock without checksum", &own, &raw, None))
}
