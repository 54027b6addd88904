//! Asking a supervisor over its control socket.

use super::{ANSWER_WITHIN, Request};
use hyst_exchange::Station;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;

/// Longest answer that a client takes: a report with some thousands of faults.
const MOST_ANSWER_BYTES: usize = 16 * 1024 * 1024;
/// Times that a client asks: in a flood it may be the one that made room.
const TRIES: usize = 5;

/// Why somebody who asked has no good answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// It was refused; nothing was done.
    #[error("{0}")]
    Refused(String),
    /// It was done to some of those whom it was for.
    #[error("{0}")]
    Half(String),
    /// Nobody said. What was asked for may have been begun, by one who died or had to make room before he could say so, or may be yet.
    #[error("{0}")]
    Unanswered(String),
}

/// Asks the supervisor of a station; the error says why there is no answer. What does nothing is asked for again.
pub fn ask(station: &Station, request: &Request) -> Result<serde_json::Value, String> {
    let is_deed = matches!(request, Request::Swap { .. } | Request::Fault(_) | Request::Suffered(_));
    let mut answer = ask_once(station, request);
    for _ in 1..if is_deed { 1 } else { TRIES } {
        if !matches!(answer, Err(NoAnswer::Unanswered(_))) {
            break;
        }
        answer = ask_once(station, request);
    }
    answer.map_err(|error| error.to_string())
}

/// Asks once.
pub fn ask_once(station: &Station, request: &Request) -> Result<serde_json::Value, NoAnswer> {
    let path = station.control_socket();
    let name = station.name();
    let gone = |error: std::io::Error| {
        let cure = format!("`hystation --name {name} status` says whether it runs");
        NoAnswer::Refused(format!("station {name}: no supervisor answers at {}: {error}; {cure}", path.display()))
    };
    let mut stream = UnixStream::connect(&path).map_err(gone)?;
    stream.set_read_timeout(Some(2 * ANSWER_WITHIN)).map_err(gone)?;
    let line = serde_json::to_string(request).map_err(|e| NoAnswer::Refused(e.to_string()))?;
    let silent = |why: &str| NoAnswer::Unanswered(format!("station {name}: {why}"));
    stream.write_all(format!("{line}\n").as_bytes()).map_err(|error| silent(&error.to_string()))?;
    let mut text = String::new();
    let read = stream.take(MOST_ANSWER_BYTES as u64).read_to_string(&mut text);
    if text.is_empty() {
        return Err(silent("it closed the connection without an answer"));
    }
    read.map_err(|error| silent(&error.to_string()))?;
    let answer: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| silent(&format!("the answer is damaged: {error}")))?;
    let reason = || answer["error"].as_str().unwrap_or("refused").to_string();
    match (answer["ok"].as_bool(), answer["unanswered"].as_bool()) {
        (Some(true), _) => Ok(answer["value"].clone()),
        (_, Some(true)) => Err(silent(&reason())),
        _ if answer["half"] == true => Err(NoAnswer::Half(reason())),
        _ => Err(NoAnswer::Refused(reason())),
    }
}
