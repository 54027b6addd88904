//! What a browser can ask for. What is read comes from the desk; what is changed goes to the supervisor, as `hystation swap` and `hystation fault` send
//! it, and its answer goes back. Promise: no request makes this process wait, grow or end.

use crate::ask::{ANSWER_WITHIN, ask};
use crate::desk::Desk;
use crate::door::{Pass, VISIT, Visitors, random_letters};
use crate::guard::{self, query, refused};
use crate::metrics;
use crate::picture::Picture;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream;
use hyst_engine::kept;
use hyst_messages::Role;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, broadcast};
use tokio::task::JoinError;
use tokio::time::Instant;

/// The page: one file, which loads nothing from anywhere else.
const PAGE: &str = include_str!("page.html");
/// What stands in it for the word without which a browser runs none of its scripts.
const NONCE: &str = "%NONCE%";
/// Longest body of a request, bytes: a role and a path, or a fault.
const MOST_BODY_BYTES: usize = 8 * 1024;
/// How long a stream of events lasts: it ends by itself before its connection is ended, and the browser comes again.
const STREAM: Duration = VISIT.saturating_sub(Duration::from_secs(5));
/// How long an engine may take to be verified, twice, and copied: the supervisor is asked then, and there is time left to answer the browser.
const KEPT_WITHIN: Duration = VISIT.saturating_sub(ANSWER_WITHIN).saturating_sub(Duration::from_secs(2));
/// How long a request for a picture waits for one.
const PICTURE_WITHIN: Duration = Duration::from_secs(1);

/// Answers browsers for as long as the console lives.
pub async fn serve(visitors: Visitors, desk: Arc<Desk>) {
    let _ = axum::serve(visitors, routes(desk).into_make_service_with_connect_info::<Pass>()).await; // it does not end
}

fn routes(desk: Arc<Desk>) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/events", get(events))
        .route("/history", get(history))
        .route("/kinds", get(kinds))
        .route("/picture.jpg", get(picture))
        .route("/metrics", get(figures))
        .route("/swap", post(swap))
        .route("/fault", post(fault))
        .fallback(nothing)
        .layer(DefaultBodyLimit::max(MOST_BODY_BYTES))
        .layer(axum::middleware::from_fn_with_state(Arc::clone(&desk), guard::guard))
        .with_state(desk)
}

async fn nothing() -> Response {
    refused(StatusCode::NOT_FOUND, "there is nothing here; the page is at /")
}

fn as_json<T: Serialize>(value: &T) -> Response {
    let text = serde_json::to_string(value).unwrap_or_else(|_| "null".into());
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// What the supervisor said.
fn answered(answer: Result<Value, String>) -> Response {
    match answer {
        Ok(value) => as_json(&value),
        Err(reason) => refused(StatusCode::CONFLICT, &reason),
    }
}

async fn page() -> Response {
    let Ok(nonce) = random_letters() else {
        return refused(StatusCode::SERVICE_UNAVAILABLE, "the console can open no file; try again");
    };
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src 'self' blob: data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'"
    );
    let said = [(header::CONTENT_TYPE, "text/html; charset=utf-8".to_string()), (header::CONTENT_SECURITY_POLICY, policy)];
    (said, PAGE.replace(NONCE, &nonce)).into_response()
}

/// A stream of events on its way to a browser.
struct Feed {
    first: VecDeque<Bytes>,
    news: broadcast::Receiver<Bytes>,
    until: Instant,
}

impl Feed {
    /// The next message; `None` at the end, or if the browser does not keep up: it comes again, and gets what it missed.
    async fn next(&mut self) -> Option<Bytes> {
        match self.first.pop_front() {
            Some(message) => Some(message),
            None => tokio::time::timeout_at(self.until, self.news.recv()).await.ok()?.ok(),
        }
    }
}

async fn events(State(desk): State<Arc<Desk>>, headers: HeaderMap) -> Response {
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse().ok());
    let (first, news) = desk.subscribe(last.unwrap_or(0));
    let feed = Feed { first, news, until: Instant::now() + STREAM };
    let messages = stream::unfold(feed, |mut feed| async move {
        let message = feed.next().await?;
        Some((Ok::<Bytes, Infallible>(message), feed))
    });
    ([(header::CONTENT_TYPE, "text/event-stream")], Body::from_stream(messages)).into_response()
}

async fn history(State(desk): State<Arc<Desk>>) -> Response {
    as_json(&desk.history())
}

async fn kinds(State(desk): State<Arc<Desk>>) -> Response {
    answered(ask(&desk.control(), &json!({ "do": "kinds" })).await)
}

/// A picture other than that of the tick `after`; waits a moment for it, so that browsers ask as often as there is one.
async fn picture(State(desk): State<Arc<Desk>>, uri: Uri) -> Response {
    let after: Option<u64> = query(&uri, "after").and_then(|tick| tick.parse().ok());
    let mut pictures = desk.pictures();
    let is_news = |picture: &Option<Arc<Picture>>| {
        picture.as_ref().is_some_and(|picture| picture.is_fresh() && Some(picture.tick) != after)
    };
    let found = match tokio::time::timeout(PICTURE_WITHIN, pictures.wait_for(is_news)).await {
        Ok(Ok(picture)) => picture.clone(),
        _ => None,
    };
    let Some(picture) = found else { return StatusCode::NO_CONTENT.into_response() };
    let said = [("content-type", "image/jpeg".to_string()), ("x-picture-tick", picture.tick.to_string())];
    (said, picture.jpeg.clone()).into_response()
}

async fn figures(State(desk): State<Arc<Desk>>) -> Response {
    ([(header::CONTENT_TYPE, metrics::CONTENT_TYPE)], metrics::text(&desk.look())).into_response()
}

/// Another engine for a role.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Swap {
    role: String,
    binary: String,
}

async fn swap(State(desk): State<Arc<Desk>>, body: Bytes) -> Response {
    let Swap { role, binary } = match serde_json::from_slice(&body) {
        Ok(swap) => swap,
        Err(error) => return refused(StatusCode::BAD_REQUEST, &format!("no swap: {error}")),
    };
    let Some(known) = Role::from_name(&role) else {
        return refused(StatusCode::BAD_REQUEST, &format!("{role:?} is no role"));
    };
    if !Path::new(&binary).is_absolute() {
        return refused(StatusCode::BAD_REQUEST, "give the whole path of the engine's binary, from / on");
    }
    // As `hystation swap` does it: verified and copied by an ordinary process, before the supervisor hears of it.
    let station = desk.station().clone();
    let turns = Arc::clone(desk.verifying());
    let keeping = move || kept::keep(&station, Path::new(&binary), known, &|| turns.is_closed());
    let Some(kept) = in_turn(desk.verifying(), Instant::now() + KEPT_WITHIN, keeping).await else {
        let text = format!(
            "the binary is not verified and copied after {} s, and nothing was swapped; is the machine busy, or another swap under way? \
             `hystation swap` waits longer",
            KEPT_WITHIN.as_secs()
        );
        return refused(StatusCode::SERVICE_UNAVAILABLE, &text);
    };
    match kept {
        Ok(Ok(kept)) => {
            let request = json!({ "do": "swap", "role": role, "binary": kept.binary() });
            let answer = ask(&desk.control(), &request).await;
            drop(kept); // the supervisor has written down what it is for
            answered(answer)
        }
        Ok(Err(reason)) => refused(StatusCode::CONFLICT, &reason),
        Err(_) => refused(StatusCode::SERVICE_UNAVAILABLE, "the binary could not be verified; try again"),
    }
}

/// Has work done that waits for others, by a thread of its own and in its turn; `None` if it is not done by then. What has not begun by then never does, so
/// that what hangs leaves no queue of what nobody waits for.
async fn in_turn<T: Send + 'static>(
    turns: &Arc<Semaphore>,
    until: Instant,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<Result<T, JoinError>> {
    let turn = tokio::time::timeout_at(until, Arc::clone(turns).acquire_owned()).await.ok()?.ok()?;
    let done = tokio::task::spawn_blocking(move || {
        let _turn = turn; // until the work ends, though nobody may wait for it any more
        work()
    });
    tokio::time::timeout_at(until, done).await.ok()
}

/// A fault, with the options that the page offers; the command line has all of them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fault {
    kind: String,
    target: String,
    #[serde(rename = "for")]
    for_s: Option<f64>,
    factor: Option<f64>,
    #[serde(rename = "where")]
    place: Option<String>,
}

impl Fault {
    /// What the supervisor is asked to do, at once.
    fn request(self) -> Value {
        let mut request = json!({ "do": "fault", "kind": self.kind, "target": self.target, "tick": 0 });
        let options = [
            ("for", self.for_s.map(Value::from)),
            ("factor", self.factor.map(Value::from)),
            ("where", self.place.map(Value::from)),
        ];
        for (name, value) in options {
            if let Some(value) = value {
                request[name] = value;
            }
        }
        request
    }
}

async fn fault(State(desk): State<Arc<Desk>>, body: Bytes) -> Response {
    if !desk.test_mode {
        return refused(StatusCode::FORBIDDEN, "faults are refused outside of test mode; start the station with --test-mode");
    }
    match serde_json::from_slice::<Fault>(&body) {
        Ok(fault) => answered(ask(&desk.control(), &fault.request()).await),
        Err(error) => refused(StatusCode::BAD_REQUEST, &format!("no fault: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{PUMP_ALARMS, PUMP_NOTICES};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc::channel;

    #[test]
    fn a_fault_is_asked_for_as_the_command_line_does_it() {
        let request = |text: &str| serde_json::from_str::<Fault>(text).map(Fault::request).map_err(|error| error.to_string());
        assert_eq!(
            request("{\"kind\":\"kill\",\"target\":\"haptic:active\"}"),
            Ok(json!({ "do": "fault", "kind": "kill", "target": "haptic:active", "tick": 0 }))
        );
        let slow = request("{\"kind\":\"slow\",\"target\":\"fluid\",\"for\":0.5,\"factor\":3,\"where\":null}").unwrap();
        assert_eq!((slow["for"].as_f64(), slow["factor"].as_f64(), slow.get("where")), (Some(0.5), Some(3.0), None));
        assert!(
            request("{\"kind\":\"kill\",\"target\":\"a\",\"do\":\"stop\"}").is_err(),
            "it is no way to ask for anything else"
        );
        assert!(request("{\"kind\":\"kill\"}").is_err());
    }

    #[test]
    fn work_that_hangs_keeps_its_turn_and_what_nobody_waits_for_any_more_is_never_begun() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let (turns, begun) = (Arc::new(Semaphore::new(1)), Arc::new(AtomicBool::new(false)));
        let (release, hangs) = channel::<()>();
        let soon = || Instant::now() + Duration::from_millis(20);
        let of_other = Arc::clone(&begun);
        let last = runtime.block_on(async {
            let hung = in_turn(&turns, soon(), move || hangs.recv().is_ok()).await;
            let other = in_turn(&turns, soon(), move || of_other.store(true, Ordering::Relaxed)).await;
            assert!(hung.is_none() && other.is_none(), "there is one turn, and it is taken");
            drop(release);
            in_turn(&turns, Instant::now() + Duration::from_secs(60), || 7).await
        });
        assert_eq!(last.and_then(Result::ok), Some(7), "the turn of what has ended is the next one's");
        assert!(!begun.load(Ordering::Relaxed));
    }

    #[test]
    fn each_alarm_of_the_pump_is_told_with_the_meaning_and_the_cure_that_the_handbook_gives_it() {
        let handbook = include_str!("../../../docs/handbook.md");
        for (_, name) in PUMP_ALARMS.iter().filter(|(bit, _)| bit & PUMP_NOTICES == 0) {
            let row = handbook.lines().find_map(|line| line.strip_prefix(&format!("| {name} | "))).unwrap();
            let mut cells = row.split(" |").map(str::trim);
            let (meaning, cure) = (cells.next().unwrap(), cells.next().unwrap());
            assert!(PAGE.contains(&format!("'{name}': ['{meaning}', '{cure}'],")), "{name}: {meaning}, {cure}");
        }
    }

    /// A page that was loaded through a tunnel that had just died waited for the points of its plots, and then for nothing else.
    #[test]
    fn the_page_waits_for_no_answer_without_an_end() {
        let asking: Vec<&str> = PAGE.lines().filter(|line| line.contains("fetch(")).collect();
        assert!(asking.len() == 1 && asking[0].contains("fetch(path, { signal: AbortSignal.timeout(DEAD_MS), "), "{asking:?}");
    }

    #[test]
    fn the_page_loads_nothing_from_elsewhere_and_runs_nothing_without_its_word() {
        assert!(PAGE.matches(NONCE).count() == 2 && PAGE.matches("<script").count() == 1 && PAGE.matches("<style").count() == 1);
        for elsewhere in ["http://", "https://", "src=\"/", "@import", "url(", "innerHTML", " style=", " onclick="] {
            let without_names = PAGE.replace("http://www.w3.org/2000/svg", "");
            assert!(!without_names.contains(elsewhere), "{elsewhere}");
        }
    }
}
