//! The judge of a console on probation: a helper process that reads the figures of its page again and again, as a monitor would. A console agrees if it
//! answers whoever has the token, and with figures of this station's present.

use super::judge::{Seen, tell};
use super::stated::MOST_AGE_TICKS;
use hyst_engine::Address;
use hyst_exchange::{Station, StationPage, system};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::time::Duration;

/// Between two visits, ns; and after one that was in vain: what a stall makes of three of them at once is no verdict on a console.
const VISIT_NS: u64 = 100_000_000;
const VAIN_NS: u64 = 1_000_000_000;
/// For how long one that has just begun may say nothing of the present, ns: it must ask the supervisor first.
const BEGIN_NS: u64 = 5_000_000_000;
/// How long an answer may take. A console gives way to everybody.
const ANSWER_WITHIN: Duration = Duration::from_secs(3);
/// Most bytes of an answer that are read.
const MOST_BYTES: u64 = 1 << 20;

/// The helper itself: writes a line of JSON after each visit until nobody reads it or the station stops.
pub fn visit(station: &Station) -> Result<(), String> {
    let clock = station.open().map_err(|error| error.to_string())?;
    let (mut seen, began_ns) = (Seen::default(), system::now_ns());
    while !clock.stop_requested() {
        let found = figures(station).and_then(|answer| age_ticks(&answer, &clock));
        let is_good = found.as_ref().is_ok_and(|age| *age <= MOST_AGE_TICKS);
        if is_good || seen.compared > 0 || system::now_ns() - began_ns > BEGIN_NS {
            let said = found.map(|age| (age / MOST_AGE_TICKS, format!("its page is {age} ticks old")));
            seen.note(said.unwrap_or_else(|why| (f64::INFINITY, why)));
        }
        if !tell(&seen)? {
            return Ok(());
        }
        system::sleep_ns(if is_good { VISIT_NS } else { VAIN_NS });
    }
    Ok(())
}

/// What the page at the station's address answers to a monitor.
fn figures(station: &Station) -> Result<String, String> {
    let address = Address::read(station).ok_or("it has no address")?;
    let failed = |error: std::io::Error| format!("its page at port {} does not answer: {error}", address.port);
    let place = SocketAddr::from((Ipv4Addr::LOCALHOST, address.port));
    let mut stream = TcpStream::connect_timeout(&place, ANSWER_WITHIN).map_err(failed)?;
    stream.set_read_timeout(Some(ANSWER_WITHIN)).map_err(failed)?;
    stream.set_write_timeout(Some(ANSWER_WITHIN)).map_err(failed)?;
    let Address { port, token } = &address;
    let request = format!("GET /metrics HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\nAuthorization: Bearer {token}\r\n\r\n");
    stream.write_all(request.as_bytes()).map_err(failed)?;
    let mut answer = Vec::new();
    stream.take(MOST_BYTES).read_to_end(&mut answer).map_err(failed)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

fn age_ticks(answer: &str, clock: &StationPage) -> Result<f64, String> {
    let said = tick_of(answer)?;
    Ok((clock.tick_at(system::now_ns()) as f64 - said).abs())
}

/// The tick that a whole answer with the page's figures says.
fn tick_of(answer: &str) -> Result<f64, String> {
    let (head, body) = answer.split_once("\r\n\r\n").ok_or("its page sends no whole answer")?;
    let line = head.lines().next().unwrap_or_default();
    if line.split(' ').nth(1) != Some("200") {
        return Err(format!("its page answers {line:?}"));
    }
    if !body.ends_with("# EOF\n") {
        return Err("its page cuts its figures off".into());
    }
    let tick = body.lines().find_map(|line| line.strip_prefix("hystation_tick ")?.trim().parse().ok());
    tick.filter(|tick: &f64| tick.is_finite()).ok_or_else(|| "its page says no tick".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn only_a_whole_answer_with_a_tick_is_one() {
        let head = "HTTP/1.0 200 OK\r\ncontent-type: text/plain\r\n\r\n";
        assert_eq!(tick_of(&format!("{head}# TYPE hystation_tick gauge\nhystation_tick 1234.0\n# EOF\n")), Ok(1_234.0));
        let why = |answer: &str| tick_of(answer).unwrap_err();
        assert!(why("").contains("no whole answer"));
        assert!(why("HTTP/1.0 401 Unauthorized\r\n\r\nno\n").contains("401"));
        assert!(why(&format!("{head}hystation_tick 1234.0\n")).contains("cuts"));
        assert!(why(&format!("{head}# EOF\n")).contains("no tick"));
        assert!(why(&format!("{head}hystation_tick NaN\n# EOF\n")).contains("no tick"));
        assert!(why(&"x".repeat(4_096)).contains("no whole answer"));
    }

    #[test]
    fn a_page_is_asked_with_its_token_and_one_that_is_not_there_is_said() {
        let station = Station::named(&format!("t{}-visit", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(figures(&station), Err("it has no address".into()));
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = Address { port: listener.local_addr().unwrap().port(), token: "0123456789abcdef".repeat(2) };
        address.write(&station).unwrap();
        let serving = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut asked = Vec::new();
            while !asked.ends_with(b"\r\n\r\n") {
                let mut byte = [0];
                assert_eq!(stream.read(&mut byte).unwrap(), 1);
                asked.push(byte[0]);
            }
            stream.write_all(b"HTTP/1.0 200 OK\r\n\r\nhystation_tick 7\n# EOF\n").unwrap();
            String::from_utf8(asked).unwrap()
        });
        assert_eq!(figures(&station).and_then(|answer| tick_of(&answer)), Ok(7.0));
        let asked = serving.join().unwrap();
        assert!(asked.contains(&format!("Authorization: Bearer {}\r\n", address.token)), "{asked}");
        assert!(figures(&station).unwrap_err().contains("does not answer"), "the listener is gone");
        station.wipe();
    }
}
