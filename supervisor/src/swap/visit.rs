//! The judge of a console on probation: a helper process that reads the figures of its page again and again, as a monitor would. A console agrees if it
//! answers whoever has the token, and with figures of this station's present.

use super::judge::{Seen, tell};
use super::stated::MOST_AGE_TICKS;
use hyst_engine::Address;
use hyst_exchange::{Station, system};
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

/// What a visit shows.
#[derive(Debug, PartialEq)]
enum Visit {
    /// Figures so many ticks old.
    Figures(f64),
    /// No answer, or figures that stand still; in words.
    Silence(String),
    /// What is no answer, or none of this time; the same.
    Wrong(String),
}

/// The helper itself: writes a line of JSON after each visit until nobody reads it or the station stops.
pub fn visit(station: &Station) -> Result<(), String> {
    let clock = station.open().map_err(|error| error.to_string())?;
    let (mut seen, began_ns) = (Seen::default(), system::now_ns());
    while !clock.stop_requested() {
        let answer = figures(station);
        let shown = answer.map_or_else(Visit::Silence, |answer| read(&answer, clock.tick_at(system::now_ns()) as f64));
        let is_good = matches!(shown, Visit::Figures(_));
        if is_good || seen.compared > 0 || system::now_ns() - began_ns > BEGIN_NS {
            match shown {
                Visit::Figures(age) => seen.note((age / MOST_AGE_TICKS, format!("its page is {age} ticks old"))),
                Visit::Silence(why) => seen.note_silence(why),
                Visit::Wrong(why) => seen.note((f64::INFINITY, why)),
            }
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

/// What an answer shows at this tick.
fn read(answer: &str, present: f64) -> Visit {
    match tick_of(answer).map(|said| present - said) {
        Err(why) => Visit::Wrong(why),
        Ok(age) if age > MOST_AGE_TICKS => Visit::Silence(format!("its page is {age} ticks old")),
        Ok(age) if age < -MOST_AGE_TICKS => Visit::Wrong(format!("its page is of a tick that is {} ticks away", -age)),
        Ok(age) => Visit::Figures(age.abs()),
    }
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
    fn figures_that_stand_still_are_told_from_those_of_no_time_that_was() {
        let shown = |tick: f64| read(&format!("HTTP/1.0 200 OK\r\n\r\nhystation_tick {tick}\n# EOF\n"), 20_000.0);
        assert_eq!([shown(19_000.0), shown(20_010.0)], [Visit::Figures(1_000.0), Visit::Figures(10.0)]);
        assert_eq!(shown(14_000.0), Visit::Silence("its page is 6000 ticks old".into()));
        assert!(matches!(shown(26_000.0), Visit::Wrong(_)) && matches!(read("", 20_000.0), Visit::Wrong(_)));
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
