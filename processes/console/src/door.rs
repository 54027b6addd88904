//! Where the page is: a port of 127.0.0.1 and a token, kept in the station's root so that a successor has both again, unless the port is somebody's by then; and who comes in: so many at a
//! time, each for a bounded time, whatever he sends, reads or does not read, and for a short one who does not show the token.

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use hyst_engine::{Address, Failure, Life};
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Sleep;

/// The port, unless somebody else has it or wants another one.
const USUAL_PORT: u16 = 8_642;
/// Connections at a time: five browsers with six each, as they open them. Whoever comes later waits until one of them ends.
pub const SEATS: usize = 32;
/// No connection lasts longer. What is asked for is answered before, if only by saying that it takes too long; a stream of events ends before by itself, and
/// browsers open it again.
pub const VISIT: Duration = Duration::from_secs(20);
/// Whoever has not shown the token by then goes: anybody on this machine can open connections, and those who say nothing would keep the seats for all of [`VISIT`].
pub const UNKNOWN: Duration = Duration::from_secs(3);
/// That all seats are taken is said once, and again when there was one for so long, ns.
const ROOMY_NS: u64 = 60_000_000_000;
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
    is_full: Arc<AtomicBool>,
}

impl Visitors {
    /// From now on connections are taken; within the runtime that serves them.
    pub fn welcome(listener: std::net::TcpListener) -> std::io::Result<Visitors> {
        listener.set_nonblocking(true)?;
        Ok(Visitors {
            listener: TcpListener::from_std(listener)?,
            seats: Arc::new(Semaphore::new(SEATS)),
            is_full: Arc::default(),
        })
    }

    /// Who looks whether there are too many.
    pub fn crowd(&self) -> Crowd {
        Crowd { is_full: Arc::clone(&self.is_full), roomy_at_ns: 0 }
    }
}

impl Listener for Visitors {
    type Io = Visit;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Visit, SocketAddr) {
        let seat = match Arc::clone(&self.seats).try_acquire_owned() {
            Ok(seat) => Some(seat),
            Err(_) => {
                self.is_full.store(true, Ordering::Relaxed);
                Arc::clone(&self.seats).acquire_owned().await.ok() // it is never closed
            }
        };
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => return (Visit::of(stream, seat), address),
                Err(_) => tokio::time::sleep(PAUSE).await, // gone again, or no file is left
            }
        }
    }

    fn local_addr(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Whether all seats are taken.
#[derive(Debug)]
pub struct Crowd {
    is_full: Arc<AtomicBool>,
    roomy_at_ns: u64,
}

impl Crowd {
    /// Whether all seats were taken since it was last asked, and that is to be said.
    pub fn is_news(&mut self, now_ns: u64) -> bool {
        let is_full = self.is_full.swap(false, Ordering::Relaxed);
        let is_news = is_full && now_ns >= self.roomy_at_ns;
        if is_full {
            self.roomy_at_ns = now_ns + ROOMY_NS;
        }
        is_news
    }
}

/// Whether whoever is at the other end of a connection has shown the token.
#[derive(Clone, Debug, Default)]
pub struct Pass(Arc<AtomicBool>);

impl Pass {
    /// He has: he may stay for all of [`VISIT`].
    pub fn show(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn is_shown(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl Connected<IncomingStream<'_, Visitors>> for Pass {
    fn connect_info(stream: IncomingStream<'_, Visitors>) -> Pass {
        stream.io().pass.clone()
    }
}

/// One connection: it ends when its time is over, in the middle of whatever it was about.
#[derive(Debug)]
pub struct Visit {
    stream: TcpStream,
    end: Pin<Box<Sleep>>,
    pass: Pass,
    known_by: Pin<Box<Sleep>>,
    /// He was unknown when that time was over.
    is_late: bool,
    _seat: Option<OwnedSemaphorePermit>,
}

impl Visit {
    fn of(stream: TcpStream, seat: Option<OwnedSemaphorePermit>) -> Visit {
        let [end, known_by] = [VISIT, UNKNOWN].map(|time| Box::pin(tokio::time::sleep(time)));
        Visit { stream, end, pass: Pass::default(), known_by, is_late: false, _seat: seat }
    }

    /// The connection while it may go on.
    fn stream(&mut self, context: &mut Context<'_>) -> std::io::Result<Pin<&mut TcpStream>> {
        if self.end.as_mut().poll(context).is_ready() {
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        Ok(Pin::new(&mut self.stream))
    }

    /// Whether he who says nothing more has been unknown for too long. Where this process itself comes late, what he said in time is read by now and not yet
    /// judged: so he is looked at once more.
    fn is_stranger(&mut self, context: &mut Context<'_>) -> bool {
        if self.pass.is_shown() || self.known_by.as_mut().poll(context).is_pending() {
            return false;
        }
        let was_late = std::mem::replace(&mut self.is_late, true);
        if !was_late {
            context.waker().wake_by_ref();
        }
        was_late
    }
}

impl AsyncRead for Visit {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<std::io::Result<()>> {
        let read = match self.stream(context) {
            Ok(stream) => stream.poll_read(context, buffer),
            Err(error) => Poll::Ready(Err(error)),
        };
        match read.is_pending() && self.is_stranger(context) {
            true => Poll::Ready(Err(std::io::ErrorKind::TimedOut.into())),
            false => read,
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
    use super::*;
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

    /// Of two looks at a silent connection, whose time to show the token is over, those in which it may go on.
    async fn looks(listener: &TcpListener, is_shown: bool) -> [bool; 2] {
        let _peer = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let mut visit = Visit::of(listener.accept().await.unwrap().0, None);
        visit.known_by = Box::pin(tokio::time::sleep(Duration::from_millis(1)));
        visit.known_by.as_mut().await;
        if is_shown {
            visit.pass.show();
        }
        std::future::poll_fn(|context| {
            let mut look = || Pin::new(&mut visit).poll_read(context, &mut ReadBuf::new(&mut [0; 8])).is_pending();
            Poll::Ready([look(), look()])
        })
        .await
    }

    #[test]
    fn who_is_unknown_when_his_time_is_over_is_looked_at_once_more_and_who_has_shown_the_token_stays() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
            assert_eq!(looks(&listener, false).await, [true, false], "what he has said is judged between the two");
            assert_eq!(looks(&listener, true).await, [true, true]);
        });
    }

    #[test]
    fn that_all_seats_are_taken_is_said_once_for_as_long_as_it_goes_on() {
        let is_full = Arc::new(AtomicBool::new(false));
        let mut crowd = Crowd { is_full: Arc::clone(&is_full), roomy_at_ns: 0 };
        let mut asked = |was_full: bool, now_ns: u64| {
            is_full.store(was_full, Ordering::Relaxed);
            crowd.is_news(now_ns)
        };
        assert_eq!(
            [(false, 1), (true, 2), (false, 3), (true, 4)].map(|(full, now_ns)| asked(full, now_ns)),
            [false, true, false, false]
        );
        assert!(!asked(true, ROOMY_NS + 3), "it is not a minute since they were taken");
        assert!(!asked(false, 3 * ROOMY_NS) && asked(true, 3 * ROOMY_NS + 1));
    }
}
