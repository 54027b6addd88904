//! Cells and rings of a page whose writer is killed with SIGKILL while it writes without a pause.

use crate::support::*;
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::device;
use hyst_messages::{InputRecord, Role};

const LIVES: u32 = 300;
/// The kill comes this long after the first write at most, ns.
const LONGEST_LIFE_NS: u64 = 500_000;

/// The number that the record bears in each of its words.
fn number_of(record: &InputRecord) -> u64 {
    let words: &[u64] = bytemuck::cast_slice(std::slice::from_ref(record));
    assert!(words.iter().all(|word| *word == words[0]), "torn: {words:x?}");
    words[0]
}

struct Reader {
    page: ReadPage,
    stamp: u64,
    number: u64,
    reads: u64,
}

impl Reader {
    /// Reads cell and ring once; whatever is read is whole and not older than what was read before.
    fn read(&mut self) -> bool {
        self.reads += 1;
        let end = self.page.ring_end(device::INPUTS);
        let newest = end.checked_sub(1).and_then(|key| self.page.ring(device::INPUTS, key).map(|record| (key, record)));
        if let Some((key, record)) = &newest {
            assert_eq!(number_of(record), *key, "an entry of the ring under the key of another");
        }
        let cell = self.page.cell(device::INPUT);
        if let Some((stamp, record)) = &cell {
            let number = number_of(record);
            assert!(*stamp >= self.stamp && number >= self.number, "went back from {} to {number}", self.number);
            (self.stamp, self.number) = (*stamp, number);
        }
        newest.is_some() && cell.is_some()
    }
}

#[test]
fn a_writer_killed_hundreds_of_times_leaves_a_whole_newest_value() {
    isolated(a_writer_killed_hundreds_of_times_leaves_a_whole_newest_value, |station| {
        let slot = slot(Role::Device);
        drop(station.create_slot(slot, 1).unwrap());
        let page = station.read_slot(slot, 1).unwrap();
        let mut reader = Reader { page, stamp: 0, number: 0, reads: 0 };
        let mut seeded = Seeded(2006);
        for life in 0..LIVES {
            let mut writer = Partner::start(station, "cells", 1, "live", 0);
            writer.expect("writing");
            let end_ns = system::now_ns() + seeded.below(LONGEST_LIFE_NS);
            let reads = reader.reads;
            while reader.reads == reads || system::now_ns() < end_ns {
                reader.read();
            }
            writer.kill();
            let before = reader.number;
            assert!(reader.read(), "life {life}: the dead writer's newest values cannot be read");
            assert!(reader.number >= before && reader.number > 0);
            assert_eq!(reader.page.cell_number(device::INPUT), reader.stamp, "the number of a write that was never finished");
        }
    });
}

#[test]
fn a_writer_that_stands_never_holds_up_a_reader() {
    isolated(a_writer_that_stands_never_holds_up_a_reader, |station| {
        let slot = slot(Role::Device);
        drop(station.create_slot(slot, 1).unwrap());
        let page = station.read_slot(slot, 1).unwrap();
        let mut reader = Reader { page, stamp: 0, number: 0, reads: 0 };
        let mut writer = Partner::start(station, "cells", 1, "live", 0);
        writer.expect("writing");
        for _ in 0..100 {
            writer.stop();
            // The entry before the newest is whole even if the newest is being written again; here the newest is never written twice.
            assert!(reader.read(), "a writer that stands in the middle of a write hides the value before");
            let seen = reader.number;
            assert!(reader.read() && reader.number == seen);
            writer.go_on();
            until(|| {
                reader.read();
                (reader.number > seen).then_some(())
            });
        }
    });
}
