//! Streams: iceoryx2 publish-subscribe, one service for each incarnation and kind, written in place in the loan, read in place.
//!
//! Guarantees. A sample is either whole or not there: what its writer has not sent, nobody sees. A sample that a reader holds stays
//! readable after the death of its writer. A slow, stopped or dead reader never blocks a writer (safe overflow: the reader loses the oldest).
//! Nobody shares a service with an incarnation that died, so a zombie writes where nobody reads. Services are created by the supervisor,
//! engines only open them. Connecting and mapping happen in the usher, which then hands the port to the real-time thread.

use crate::loan::Loan;
use crate::station::Station;
use crate::system;
use hyst_messages::{Kind, Role, layout_hash};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use std::path::PathBuf;

type Variant = ipc_threadsafe::Service;
type Factory = iceoryx2::service::port_factory::publish_subscribe::PortFactory<Variant, [u64], ()>;

/// Samples that the reader of a state may hold: the state in use, the one before, and the one that is being received.
pub const MAX_HELD: usize = 4;
/// Samples that wait for a reader before the oldest is dropped.
pub const READER_BUFFER: usize = 2;
/// Readers of a tissue's state: every consumer but the workers, each with a successor that is warming up; a newcomer on trial and its judge.
pub const MAX_READERS: usize = 15;
/// Loans of a writer: the step being computed.
pub const MAX_LOANS: usize = 2;
/// Nodes that may open one service.
pub const MAX_NODES: usize = 40;
/// Room in shared memory that must be there before a reader or a client is opened, bytes: that takes some pages of it, and who touches one that there is not dies.
const LEAST_ROOM: u64 = 1 << 20;

/// Why a link cannot be had or used. The library's reason is part of the message.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The configuration of the station cannot be read.
    #[error("link configuration of station {station}: {reason}; is the station running?")]
    Configuration {
        /// Station.
        station: String,
        /// The library's reason.
        reason: String,
    },
    /// A service or port cannot be made or opened.
    #[error("stream {name}: {reason}")]
    Service {
        /// The service.
        name: String,
        /// The library's reason.
        reason: String,
    },
    /// Shared memory is too full for whoever reads or asks to begin with that.
    #[error("{name}: /dev/shm has {} KiB free, and it takes {}; look at `df /dev/shm`", free >> 10, LEAST_ROOM >> 10)]
    Room {
        /// The service.
        name: String,
        /// What there is.
        free: u64,
    },
    /// A loan, a send or a receive failed.
    #[error("stream {name}: {action} failed: {reason}")]
    Use {
        /// The service.
        name: String,
        /// What was tried.
        action: &'static str,
        /// The library's reason.
        reason: String,
    },
}

/// What the service of a kind is made for. A segment holds readers × (buffer + held) + history + loans messages, so each is no more than
/// its readers need; every reader counts twice, for its successor connects while it still reads.
struct Quality {
    readers: usize,
    buffer: usize,
    held: usize,
}

impl Quality {
    fn of(kind: Kind, workers: usize) -> Quality {
        match kind {
            Kind::TissueState => Quality { readers: MAX_READERS + 2 * workers, buffer: READER_BUFFER, held: MAX_HELD },
            // Only the newest one counts, and one is held: rendering, fluid, its spare and its guest, the workers.
            Kind::Topology => Quality { readers: 7 + 2 * workers, buffer: 1, held: 3 },
            // The present step's alone, dropped before the step ends: the workers' jobs, and their answers to tissue, its spare and its guest.
            Kind::CollisionJob => Quality { readers: 2 * workers.max(1), buffer: 1, held: 2 },
            Kind::Contacts => Quality { readers: 5, buffer: 1, held: 2 },
            // The newest one alone, for the console, the recorder, their successors and a judge.
            Kind::Picture => Quality { readers: 5, buffer: 1, held: 2 },
            // Its own chain and keeper, spare, guest, its judge, rendering; of the servos' records, the recorder.
            Kind::FluidState => Quality { readers: 10, buffer: READER_BUFFER, held: MAX_HELD },
            _ => Quality { readers: 4, buffer: READER_BUFFER, held: MAX_HELD },
        }
    }
}

/// The process's node in the station's iceoryx2 domain.
#[derive(Debug)]
pub struct Links {
    node: Node<Variant>,
    station: String,
    /// The folder of its pages, which lies in the file system of the segments.
    root: PathBuf,
    workers: usize,
}

/// A service that is held open so that it exists while an incarnation lives.
#[derive(Debug)]
pub struct HeldService {
    _factory: Factory,
}

impl Links {
    /// Joins the station's domain. The first thing that a process does with the link: the configuration is global to the process.
    pub fn join(station: &Station, process: &str) -> Result<Links, LinkError> {
        iceoryx2::prelude::set_log_level(LogLevel::Fatal);
        let configuration = |reason: String| LinkError::Configuration { station: station.name().to_string(), reason };
        let path = station.link_config();
        let path = FilePath::new(path.as_os_str().as_encoded_bytes()).map_err(|e| configuration(format!("{e:?}")))?;
        let config = Config::setup_global_config_from_file(&path).map_err(|e| configuration(format!("{e:?}")))?;
        // The library keeps the first configuration of a process for good and says nothing when a second one is asked for.
        if config.global.prefix.to_string() != station.prefix() {
            return Err(configuration(format!(
                "this process has joined the domain {} before; use one process for each station",
                config.global.prefix
            )));
        }
        let name = NodeName::new(process).map_err(|e| configuration(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Variant>()
            .map_err(|e| configuration(format!("{e:?}")))?;
        let workers = station.open().map_or(0, |page| page.workers());
        Ok(Links { node, station: station.name().to_string(), root: station.root().to_path_buf(), workers })
    }

    /// Name of a service: station, role, incarnation, kind and layout. Another layout is another name, so it is never opened.
    pub fn service_name(&self, role: Role, incarnation: u32, kind: Kind) -> String {
        format!("{}/{}/{incarnation}/{}/{:016x}", self.station, role.name(), kind.name(), layout_hash())
    }

    fn builder(
        &self,
        name: &str,
        kind: Kind,
    ) -> Result<iceoryx2::service::builder::publish_subscribe::Builder<[u64], (), Variant>, LinkError> {
        let fail = |reason: String| LinkError::Service { name: name.to_string(), reason };
        let service = ServiceName::new(name).map_err(|e| fail(format!("{e:?}")))?;
        let quality = Quality::of(kind, self.workers);
        Ok(self
            .node
            .service_builder(&service)
            .publish_subscribe::<[u64]>()
            .max_publishers(1)
            .max_subscribers(quality.readers)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(quality.buffer)
            .subscriber_max_borrowed_samples(quality.held)
            .history_size(1)
            .enable_safe_overflow(true))
    }

    /// Creates the service of an incarnation; the supervisor holds it while the incarnation lives.
    pub fn create_service(&self, role: Role, incarnation: u32, kind: Kind) -> Result<HeldService, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        let factory = self.builder(&name, kind)?.create();
        factory
            .map(|factory| HeldService { _factory: factory })
            .map_err(|e| LinkError::Service { name, reason: format!("{e:?}") })
    }

    /// Holds a service that exists already: a supervisor that was restarted does this for the incarnations that it finds alive.
    pub fn hold_service(&self, role: Role, incarnation: u32, kind: Kind) -> Result<HeldService, LinkError> {
        let factory = self.open_service(&self.service_name(role, incarnation, kind), kind)?;
        Ok(HeldService { _factory: factory })
    }

    fn open_service(&self, name: &str, kind: Kind) -> Result<Factory, LinkError> {
        self.builder(name, kind)?.open().map_err(|e| LinkError::Service { name: name.to_string(), reason: format!("{e:?}") })
    }

    /// Opens the one writer of a service. `bytes` is the longest message.
    pub fn publisher(&self, role: Role, incarnation: u32, kind: Kind, bytes: usize) -> Result<Publisher, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        let factory = self.open_service(&name, kind)?;
        let inner = factory
            .publisher_builder()
            .initial_max_slice_len(bytes.div_ceil(8))
            .max_loaned_samples(MAX_LOANS)
            .create()
            .map_err(|e| LinkError::Service { name: name.clone(), reason: format!("{e:?}") })?;
        Ok(Publisher { inner, name, bytes, _factory: factory })
    }

    /// Looks for room for one who begins to read or to ask. A system that does not say how much there is has enough.
    pub(crate) fn look_for_room(&self, name: &str) -> Result<(), LinkError> {
        match system::free_bytes(&self.root) {
            Ok(free) if free < LEAST_ROOM => Err(LinkError::Room { name: name.to_string(), free }),
            _ => Ok(()),
        }
    }

    /// Opens a reader of a service, if there is room for it; not on a real-time thread.
    pub fn subscriber(&self, role: Role, incarnation: u32, kind: Kind) -> Result<Subscriber, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        self.look_for_room(&name)?;
        let factory = self.open_service(&name, kind)?;
        let inner = factory
            .subscriber_builder()
            .create()
            .map_err(|e| LinkError::Service { name: name.clone(), reason: format!("{e:?}") })?;
        Ok(Subscriber { inner, name, incarnation, _factory: factory })
    }

    /// Removes what dead nodes left. The supervisor alone does this, after a reap; takes 4 to 30 ms for each.
    pub fn clean_up_dead(&self) {
        self.node.try_cleanup_dead_nodes();
    }

    /// The node, for the rendezvous.
    pub(crate) fn node(&self) -> &Node<Variant> {
        &self.node
    }
}

/// The one writer of a stream.
#[derive(Debug)]
pub struct Publisher {
    inner: iceoryx2::port::publisher::Publisher<Variant, [u64], ()>,
    name: String,
    bytes: usize,
    _factory: Factory,
}

impl Publisher {
    /// A block of at most the length given at creation, rounded up to whole 64-bit words and aligned to them. What an older message left
    /// lies in it: whoever takes it writes all of it.
    pub fn loan(&self, bytes: usize) -> Result<Loan, LinkError> {
        let fail = |reason: String| LinkError::Use { name: self.name.clone(), action: "loan", reason };
        if bytes > self.bytes {
            return Err(fail(format!("{bytes} bytes where at most {} were announced", self.bytes)));
        }
        let sample = self.inner.loan_slice_uninit(bytes.div_ceil(8)).map_err(|e| fail(format!("{e:?}")))?;
        Ok(Loan::as_lent(sample))
    }
    /// Loans a block and never gives it back: a leak, for tests of what then happens. False if none was left.
    pub fn lose(&self, bytes: usize) -> bool {
        self.loan(bytes).map(std::mem::forget).is_ok()
    }
    /// Connects readers that came since; gives them the newest message. Not on a real-time thread.
    pub fn announce(&self) -> Result<(), LinkError> {
        self.inner.update_connections().map_err(|e| LinkError::Use {
            name: self.name.clone(),
            action: "announce",
            reason: format!("{e:?}"),
        })
    }
}

/// A reader of a stream.
#[derive(Debug)]
pub struct Subscriber {
    inner: iceoryx2::port::subscriber::Subscriber<Variant, [u64], ()>,
    name: String,
    incarnation: u32,
    _factory: Factory,
}

/// A message that is held and read in place; its memory is not reused while it is held.
#[derive(Debug)]
pub struct Held {
    sample: Sample<Variant, [u64], ()>,
}

impl Held {
    /// The message.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self.sample.payload())
    }
}

impl Subscriber {
    /// The next message, if there is one.
    pub fn next(&self) -> Result<Option<Held>, LinkError> {
        self.inner.receive().map(|sample| sample.map(|sample| Held { sample })).map_err(|e| LinkError::Use {
            name: self.name.clone(),
            action: "receive",
            reason: format!("{e:?}"),
        })
    }
    /// The newest message, if there is one that was not yet read. Bounded by the buffer. Where a later one cannot be received, because too many are held or
    /// its writer cannot be mapped, it is the newest of those that were: it would be given back unread, and a state be lost that its reader goes on from.
    pub fn newest(&self) -> Result<Option<Held>, LinkError> {
        let mut newest = None;
        for _ in 0..=READER_BUFFER {
            match self.next() {
                Ok(Some(held)) => newest = Some(held),
                Ok(None) => break,
                Err(_) if newest.is_some() => break, // what still fails at the next look is said then
                Err(error) => return Err(error),
            }
        }
        Ok(newest)
    }
    /// Maps the writer's memory if the writer is there. Not on a real-time thread.
    pub fn connect(&self) -> Result<(), LinkError> {
        self.inner.update_connections().map_err(|e| LinkError::Use {
            name: self.name.clone(),
            action: "connect",
            reason: format!("{e:?}"),
        })
    }
    /// Incarnation of the writer.
    pub fn incarnation(&self) -> u32 {
        self.incarnation
    }
    /// Name of the service.
    pub fn name(&self) -> &str {
        &self.name
    }
}
