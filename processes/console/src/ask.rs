//! The supervisor's control socket, as `hystation` uses it: one line of JSON asks, one line of JSON answers. Promise: an answer, an error that says what
//! to do, or, after a bounded time, that there is none.

use crate::desk::Desk;
use crate::look::Status;
use crate::outcomes;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::UnixStream;
use tokio::time::MissedTickBehavior;

/// Between two looks at the processes: each costs the supervisor about a millisecond.
const LOOK: Duration = Duration::from_secs(1);
/// How long the supervisor may take: it answers within milliseconds, or says within 5 s itself that it is busy.
pub const ANSWER_WITHIN: Duration = Duration::from_secs(6);
/// Longest answer that is read, bytes; that about the processes has some thousands.
const MOST_BYTES: u64 = 1 << 20;

/// Asks the supervisor.
pub async fn ask(socket: &Path, request: &Value) -> Result<Value, String> {
    match tokio::time::timeout(ANSWER_WITHIN, exchange(socket, request)).await {
        Ok(Ok(text)) => answer(&text),
        Ok(Err(error)) => Err(format!("no supervisor answers at {}: {error}", socket.display())),
        Err(_) => Err(format!("the supervisor does not answer within {} s", ANSWER_WITHIN.as_secs())),
    }
}

async fn exchange(socket: &Path, request: &Value) -> std::io::Result<Vec<u8>> {
    let mut stream = UnixStream::connect(socket).await?;
    stream.write_all(format!("{request}\n").as_bytes()).await?;
    let mut text = Vec::new();
    stream.take(MOST_BYTES).read_to_end(&mut text).await?;
    Ok(text)
}

/// What an answer says.
fn answer(text: &[u8]) -> Result<Value, String> {
    let mut answer: Value =
        serde_json::from_slice(text).map_err(|error| format!("the supervisor's answer is damaged: {error}"))?;
    if answer["ok"] == true {
        return Ok(answer["value"].take());
    }
    Err(answer["error"].as_str().unwrap_or("the supervisor refused, and did not say why").to_string())
}

/// Asks for the processes for as long as the console lives, and looks what came of faults where they may be injected.
pub async fn follow(desk: Arc<Desk>) {
    let mut look = tokio::time::interval(LOOK);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        look.tick().await;
        let answer = ask(&desk.control(), &json!({ "do": "status" })).await;
        if desk.test_mode {
            desk.note_faults(outcomes::read(desk.station()));
        }
        desk.note(answer.and_then(Status::read));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_a_value_or_a_reason_and_nonsense_is_a_reason() {
        assert_eq!(answer(b"{\"ok\":true,\"value\":{\"number\":3}}\n"), Ok(json!({ "number": 3 })));
        assert_eq!(answer(b"{\"ok\":true}\n"), Ok(Value::Null));
        assert_eq!(answer(b"{\"ok\":false,\"error\":\"busy\"}\n"), Err("busy".to_string()));
        for nonsense in [&b""[..], b"{\"ok\"", b"[]", b"7", b"{\"ok\":\"true\"}", b"\xff\n"] {
            assert!(answer(nonsense).is_err(), "{nonsense:?}");
        }
    }
}
