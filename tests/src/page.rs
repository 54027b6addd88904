//! The operator's page as a plain client asks for it, one request for each connection.

use crate::{RECOVERY_LIMIT, Station, wait_for};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

/// An answer takes milliseconds; this long is given to one on a machine that compiles beside it. All seats are free again after 20 s.
pub const ANSWER_LIMIT: Duration = Duration::from_secs(60);

/// Where a station's page is.
#[derive(Debug)]
pub struct Page {
    /// At 127.0.0.1.
    pub port: u16,
    /// Who has it may come in.
    pub token: String,
}

/// What was answered.
#[derive(Debug)]
pub struct Answer {
    /// The code.
    pub status: u16,
    /// First line and headers.
    pub head: String,
    /// What follows.
    pub body: Vec<u8>,
}

impl Answer {
    /// The body, as text.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
    /// A header's value; names are in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().filter_map(|line| line.split_once(": ")).find(|(key, _)| *key == name).map(|(_, value)| value)
    }
}

/// What came back; `None` if it is no whole answer. Those of these tests are not cut into chunks, but for the events.
fn parse(bytes: &[u8]) -> Option<Answer> {
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let status = head.split(' ').nth(1)?.parse().ok()?;
    Some(Answer { status, head, body: bytes[end + 4..].to_vec() })
}

impl Page {
    /// That of a station, once it has one.
    pub fn of(station: &Station) -> Page {
        let url = wait_for(RECOVERY_LIMIT, || station.status()["console"].as_str().map(str::to_string)).expect("a page");
        let (port, token) =
            url.strip_prefix("http://127.0.0.1:").and_then(|rest| rest.split_once("/?token=")).expect("an address");
        Page { port: port.parse().expect("a port"), token: token.to_string() }
    }

    /// A connection that has said nothing yet; `None` if nobody is there.
    pub fn connect(&self) -> Option<TcpStream> {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).ok()?;
        stream.set_read_timeout(Some(ANSWER_LIMIT)).expect("a limit");
        Some(stream)
    }

    /// Sends some bytes and reads until the connection ends; `None` if nobody is there.
    pub fn exchange(&self, request: &str) -> Option<Answer> {
        let mut stream = self.connect()?;
        stream.write_all(request.as_bytes()).ok()?;
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes); // who is refused in the middle of what he sends is answered, and then cut off
        parse(&bytes)
    }

    /// A request with these lines beside Host and the token.
    pub fn request(&self, line: &str, lines: &str, body: &str) -> String {
        let Page { port, token } = self;
        let length = body.len();
        format!(
            "{line} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAuthorization: Bearer {token}\r\n{lines}Content-Length: {length}\r\n\r\n{body}"
        )
    }

    /// The answer to a request that reads.
    pub fn get(&self, path: &str) -> Answer {
        self.exchange(&self.request(&format!("GET {path}"), "", "")).expect("an answer")
    }

    /// The answer to a request that changes something, as the page itself sends it.
    pub fn post(&self, path: &str, body: &str) -> Answer {
        let origin = format!("Origin: http://127.0.0.1:{}\r\n", self.port);
        self.exchange(&self.request(&format!("POST {path}"), &origin, body)).expect("an answer")
    }

    /// Reads events until one of them is what is looked for.
    pub fn event(&self, name: &str, found: impl Fn(&Value) -> bool) -> Option<Value> {
        wait_for(RECOVERY_LIMIT, || {
            let mut stream = self.connect()?;
            stream.write_all(self.request("GET /events", "", "").as_bytes()).ok()?;
            let (mut text, mut buffer) = (String::new(), [0u8; 4096]);
            // A stream of events ends by itself.
            while let Ok(count @ 1..) = stream.read(&mut buffer) {
                text.push_str(&String::from_utf8_lossy(&buffer[..count]));
                let mut messages = text.split("\n\n").filter(|message| message.contains(&format!("event: {name}\n")));
                let value = messages.find_map(|message| {
                    let data = message.lines().find_map(|line| line.strip_prefix("data: "))?;
                    serde_json::from_str::<Value>(data).ok().filter(&found)
                });
                if value.is_some() {
                    return value;
                }
            }
            None
        })
    }
}
