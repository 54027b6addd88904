//! The Rendezvous between processes: iceoryx2 request-response, one service for each incarnation of a server, polled by both sides.

use super::{Client, MAX_BYTES, MAX_SERVED, RendezvousError, Server, check_length};
use crate::stream::{LinkError, Links, MAX_NODES};
use hyst_messages::{Kind, Role};
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::prelude::*;

type Variant = ipc_threadsafe::Service;
type Factory = iceoryx2::service::port_factory::request_response::PortFactory<Variant, [u8], (), [u8], ()>;
type Pending = PendingResponse<Variant, [u8], (), [u8], ()>;
type Builder = iceoryx2::service::builder::request_response::Builder<[u8], (), [u8], (), Variant>;

/// Clients of one server.
const MAX_CLIENTS: usize = 8;

/// A rendezvous service that is held open while its server's incarnation lives.
#[derive(Debug)]
pub struct HeldRendezvous {
    _factory: Factory,
}

/// The side that asks.
#[derive(Debug)]
pub struct ProcessClient {
    inner: iceoryx2::port::client::Client<Variant, [u8], (), [u8], ()>,
    open: Option<Pending>,
    _factory: Factory,
}

/// The side that answers.
#[derive(Debug)]
pub struct ProcessServer {
    inner: iceoryx2::port::server::Server<Variant, [u8], (), [u8], ()>,
    _factory: Factory,
}

fn link(reason: impl std::fmt::Debug) -> RendezvousError {
    RendezvousError::Link(format!("{reason:?}"))
}

impl Links {
    fn rendezvous_builder(&self, name: &str) -> Result<Builder, LinkError> {
        let fail = |reason: String| LinkError::Service { name: name.to_string(), reason };
        let service = ServiceName::new(name).map_err(|e| fail(format!("{e:?}")))?;
        Ok(self
            .node()
            .service_builder(&service)
            .request_response::<[u8], [u8]>()
            .max_servers(1)
            .max_clients(MAX_CLIENTS)
            .max_nodes(MAX_NODES)
            .max_active_requests_per_client(1)
            .max_response_buffer_size(1)
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true))
    }

    /// Creates the rendezvous of an incarnation; the supervisor holds it while the incarnation lives.
    pub fn create_rendezvous(&self, role: Role, incarnation: u32, kind: Kind) -> Result<HeldRendezvous, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        let made = self.rendezvous_builder(&name)?.create();
        made.map(|factory| HeldRendezvous { _factory: factory })
            .map_err(|e| LinkError::Service { name, reason: format!("{e:?}") })
    }

    /// Holds a rendezvous that exists already.
    pub fn hold_rendezvous(&self, role: Role, incarnation: u32, kind: Kind) -> Result<HeldRendezvous, LinkError> {
        let factory = self.open_rendezvous(&self.service_name(role, incarnation, kind))?;
        Ok(HeldRendezvous { _factory: factory })
    }

    fn open_rendezvous(&self, name: &str) -> Result<Factory, LinkError> {
        let opened = self.rendezvous_builder(name)?.open();
        opened.map_err(|e| LinkError::Service { name: name.to_string(), reason: format!("{e:?}") })
    }

    /// Opens the one server of a rendezvous.
    pub fn server(&self, role: Role, incarnation: u32, kind: Kind) -> Result<ProcessServer, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        let factory = self.open_rendezvous(&name)?;
        let inner = factory
            .server_builder()
            .initial_max_slice_len(MAX_BYTES)
            .create()
            .map_err(|e| LinkError::Service { name, reason: format!("{e:?}") })?;
        Ok(ProcessServer { inner, _factory: factory })
    }

    /// Opens a client of a rendezvous.
    pub fn client(&self, role: Role, incarnation: u32, kind: Kind) -> Result<ProcessClient, LinkError> {
        let name = self.service_name(role, incarnation, kind);
        self.look_for_room(&name)?;
        let factory = self.open_rendezvous(&name)?;
        let inner = factory
            .client_builder()
            .initial_max_slice_len(MAX_BYTES)
            .create()
            .map_err(|e| LinkError::Service { name, reason: format!("{e:?}") })?;
        Ok(ProcessClient { inner, open: None, _factory: factory })
    }
}

impl Client for ProcessClient {
    fn begin(&mut self, request: &[u8]) -> Result<(), RendezvousError> {
        check_length(request)?;
        self.open = None; // the answer to an earlier request has nowhere to go
        let loan = self.inner.loan_slice_uninit(request.len()).map_err(link)?;
        let pending = loan.write_from_slice(request).send().map_err(link)?;
        if pending.number_of_server_connections() == 0 {
            return Err(RendezvousError::ServerGone);
        }
        self.open = Some(pending);
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Vec<u8>>, RendezvousError> {
        let Some(pending) = &self.open else { return Ok(None) };
        let answer = pending.receive().map_err(link)?.map(|response| response.payload().to_vec());
        if answer.is_some() {
            self.open = None;
        } else if !pending.is_connected() {
            self.open = None;
            return Err(RendezvousError::ServerGone);
        }
        Ok(answer)
    }
}

impl Server for ProcessServer {
    fn serve(&mut self, answer: &mut dyn FnMut(&[u8]) -> Vec<u8>) -> Result<usize, RendezvousError> {
        let mut served = 0;
        while served < MAX_SERVED {
            let Some(request) = self.inner.receive().map_err(link)? else { break };
            let bytes = answer(request.payload());
            check_length(&bytes)?;
            // A client that has gone loses its answer, the server nothing.
            if let Ok(loan) = request.loan_slice_uninit(bytes.len()) {
                let _ = loan.write_from_slice(&bytes).send();
            }
            served += 1;
        }
        Ok(served)
    }
}
