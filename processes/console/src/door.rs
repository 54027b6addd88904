//! Where the page is: a port of 127.0.0.1 and a token, kept in the station's root so that a successor has both again, unless the port is somebody's by then; and who comes in: so many at a
//! time, each for a bounded time, whatever he sends, reads or does not read.

use axum::serve::Listener;
use hyst_engine::{Address, Failure, Life};
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Sleep;

/// The port, unless somebody else has it or wants another one.
const USUAL_PORT: u16 = 8_642;
/// Connections at a time: five browsers with six each, as they open them. Whoever comes later waits until one of them ends.
const SEATS: usize = 32;
/// No connection lasts longer. What is asked for is answered before, if only by saying that it takes too long; a stream of events ends before by itself, and
/// browsers open it again.
pub const VISIT: Duration = Duration::from_secs(20);
/// Before the next try when no connection can be taken: the process may open no more files.
const PAUSE: Duration = Duration::from_millis(100);

/// The port that is listened at, and where that is.
#[derive(Debug)]
pub struct Door {
    /// The port.
    pub listener: std::net::TcpListener,
    /// Its number, and the token.
    pub address: Address,
}

fn listen(port: u16) -> std::io::Result<std::net::TcpListener> {
    std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, port))
}

/// Said where none can be had at all, as in a network namespace of its own in which nobody brought the loopback interface up.
fn no_port(error: &std::io::Error) -> String {
    format!(
        "no port of 127.0.0.1 can be had ({error}), so there is no operator's page: bring that interface up (`ip link set lo up`), or run with \
         --set console=off"
    )
}

impl Door {
    /// The door that this station's page had, or one that is free.
    pub fn open(life: &Life) -> Result<Door, Failure> {
        let usual = life.settings.number("console_port", f64::from(USUAL_PORT), 0.0..=65_535.0, "0 to 65535")? as u16;
        let kept = Address::read(&life.station);
        let wanted = kept.as_ref().map_or(usual, |address| address.port);
        let listener = match listen(wanted) {
            Ok(listener) => listener,
            Err(error) => {
                life.say(&format!("port {wanted} cannot be had ({error}): the operator's page is at another one"));
                listen(0).map_err(|error| Failure::Broken(no_port(&error)))?
            }
        };
        let port = listener.local_addr()?.port();
        // A page that is still open says the token to whoever has its port now.
        let same = kept.as_ref().filter(|address| address.port == port);
        let token = same.map_or_else(random_letters, |address| Ok(address.token.clone()))?;
        let address = Address { port, token };
        if kept.as_ref() != Some(&address) {
            let refused =
                |error: std::io::Error| format!("the page's address cannot be written into the station's root: {error}");
            address.write(&life.station).map_err(|error| Failure::Broken(refused(error)))?;
        }
        life.say(&format!("the operator's page is at port {port}"));
        Ok(Door { listener, address })
    }
}

/// 128 random bits, hexadecimal.
pub fn random_letters() -> std::io::Result<String> {
    let mut bytes = [0u8; hyst_engine::address::TOKEN_LETTERS / 2];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Those who come in.
#[derive(Debug)]
pub struct Visitors {
    listener: TcpListener,
    seats: Arc<Semaphore>,
}

impl Visitors {
    /// From now on connections are taken; within the runtime that serves them.
    pub fn welcome(listener: std::net::TcpListener) -> std::io::Result<Visitors> {
        listener.set_nonblocking(true)?;
        Ok(Visitors { listener: TcpListener::from_std(listener)?, seats: Arc::new(Semaphore::new(SEATS)) })
    }
}

impl Listener for Visitors {
    type Io = Visit;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Visit, SocketAddr) {
        let seat = Arc::clone(&self.seats).acquire_owned().await.ok(); // it is never closed
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    return (Visit { stream, end: Box::pin(tokio::time::sleep(VISIT)), _seat: seat }, address);
                }
                Err(_) => tokio::time::sleep(PAUSE).await, // gone again, or no file is left
            }
        }
    }

    fn local_addr(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// One connection: it ends when its time is over, in the middle of whatever it was about.
#[derive(Debug)]
pub struct Visit {
    stream: TcpStream,
    end: Pin<Box<Sleep>>,
    _seat: Option<OwnedSemaphorePermit>,
}

impl Visit {
    /// The connection while it may go on.
    fn stream(&mut self, context: &mut Context<'_>) -> std::io::Result<Pin<&mut TcpStream>> {
        if self.end.as_mut().poll(context).is_ready() {
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        Ok(Pin::new(&mut self.stream))
    }
}

impl AsyncRead for Visit {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<std::io::Result<()>> {
        match self.stream(context) {
            Ok(stream) => stream.poll_read(context, buffer),
            Err(error) => Poll::Ready(Err(error)),
        }
    }
}

impl AsyncWrite for Visit {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<std::io::Result<usize>> {
        match self.stream(context) {
            Ok(stream) => stream.poll_write(context, bytes),
            Err(error) => Poll::Ready(Err(error)),
        }
    }
    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        match self.stream(context) {
            Ok(stream) => stream.poll_flush(context),
            Err(error) => Poll::Ready(Err(error)),
        }
    }
    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        match self.stream(context) {
            Ok(stream) => stream.poll_shutdown(context),
            Err(error) => Poll::Ready(Err(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{no_port, random_letters};
    use hyst_engine::address::TOKEN_LETTERS;

    #[test]
    fn where_there_is_no_port_at_all_the_cure_is_named() {
        let said = no_port(&std::io::ErrorKind::AddrNotAvailable.into());
        assert!(said.contains("ip link set lo up") && said.contains("--set console=off"), "{said}");
    }

    #[test]
    fn a_token_is_as_long_as_an_address_wants_it_and_no_two_are_equal() {
        let (one, other) = (random_letters().unwrap(), random_letters().unwrap());
        assert!(one.len() == TOKEN_LETTERS && one.bytes().all(|byte| byte.is_ascii_hexdigit()), "{one}");
        assert_ne!(one, other);
    }
}
