//! Who may come in: a browser on this machine that was given the token. Promise: no page of another place on the net can read or do anything here,
//! whatever name it makes its own address go by (DNS rebinding: the Host is checked) and whatever it makes a browser send (the Origin is checked, and
//! nothing is changed by a GET).

use crate::desk::Desk;
use crate::door::Pass;
use axum::extract::{ConnectInfo, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use hyst_engine::Address;
use std::sync::Arc;

/// The port that HTTP has where none is named.
const USUAL_PORT: u16 = 80;

/// Looks at every request before anybody else does. Who may come in may stay.
pub async fn guard(
    State(desk): State<Arc<Desk>>,
    ConnectInfo(pass): ConnectInfo<Pass>,
    request: Request,
    next: Next,
) -> Response {
    let verdict = check(&desk.address, request.method(), request.uri(), request.headers());
    let mut response = match verdict {
        Ok(()) => {
            pass.show();
            next.run(request).await
        }
        Err((status, reason)) => refused(status, reason),
    };
    seal(response.headers_mut());
    response
}

/// What every answer says beside its content: it is for this page alone, for this moment alone, and the connection ends with it.
fn seal(headers: &mut HeaderMap) {
    let said = [
        (header::CONNECTION, "close"),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    for (name, value) in said {
        headers.insert(name, HeaderValue::from_static(value));
    }
}

/// An answer that refuses, with its reason in one line.
pub fn refused(status: StatusCode, reason: &str) -> Response {
    (status, format!("{reason}\n")).into_response()
}

/// What a browser calls this place: it leaves out the port that is usual.
fn names(port: u16) -> Vec<String> {
    let places = ["127.0.0.1", "localhost"];
    let without = places.into_iter().filter(|_| port == USUAL_PORT).map(str::to_string);
    places.into_iter().map(|place| format!("{place}:{port}")).chain(without).collect()
}

/// Whether a request may come in; else why not.
fn check(address: &Address, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<(), (StatusCode, &'static str)> {
    let names = names(address.port);
    let is_own = |name: &str| names.iter().any(|own| own.eq_ignore_ascii_case(name));
    let is_here = only(headers, header::HOST).is_some_and(is_own) && uri.authority().is_none_or(|named| is_own(named.as_str()));
    if !is_here {
        return Err((
            StatusCode::FORBIDDEN,
            "this page is at its own port of 127.0.0.1 alone; open it by the address that the station printed",
        ));
    }
    let origin = only(headers, header::ORIGIN).and_then(|origin| origin.strip_prefix("http://"));
    let is_from_here = if headers.contains_key(header::ORIGIN) { origin.is_some_and(is_own) } else { method.is_safe() };
    // Whoever follows a link to the page itself comes from elsewhere, and sees nothing without the token.
    let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
    let is_of_this_page = site.is_none_or(|site| site == b"same-origin" || site == b"none") || uri.path() == "/";
    if !is_from_here || !is_of_this_page {
        return Err((StatusCode::FORBIDDEN, "this is for the station's own page alone"));
    }
    // No cookie: a browser sends those to every port of this machine, and so to whoever listens there.
    let bearer = only(headers, header::AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer "));
    if query(uri, "token").into_iter().chain(bearer).any(|token| is_same(token, &address.token)) {
        return Ok(());
    }
    Err((
        StatusCode::UNAUTHORIZED,
        "the token is missing or wrong; open the address that the station printed, or `hystation status` shows",
    ))
}

/// The value of a header that is there once, as text.
fn only(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    let value = values.next().filter(|_| values.next().is_none())?;
    value.to_str().ok()
}

/// The value of a key in a request's query, as it was sent.
pub fn query<'a>(uri: &'a Uri, key: &str) -> Option<&'a str> {
    let mut pairs = uri.query()?.split('&').filter_map(|pair| pair.split_once('='));
    pairs.find(|(name, _)| *name == key).map(|(_, value)| value)
}

/// Whether two tokens are equal, in a time that depends on their lengths alone.
fn is_same(given: &str, token: &str) -> bool {
    let differing = given.bytes().zip(token.bytes()).fold(0u8, |seen, (one, other)| std::hint::black_box(seen | (one ^ other)));
    given.len() == token.len() && differing == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef0123456789abcdef";

    /// What a request is answered with: 200 if it may come in.
    fn verdict(method: Method, uri: &str, headers: &[(&'static str, &str)]) -> u16 {
        let address = Address { port: 8_642, token: TOKEN.into() };
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        check(&address, &method, &uri.parse().unwrap(), &map).map_or_else(|(status, _)| status.as_u16(), |()| 200)
    }

    fn with_token() -> String {
        format!("/?token={TOKEN}")
    }

    #[test]
    fn the_token_opens_by_query_or_header_and_nothing_else_does() {
        let host = ("host", "127.0.0.1:8642");
        let get = |uri: &str, said: &str| verdict(Method::GET, uri, &[host, ("authorization", said), ("cookie", TOKEN)]);
        assert_eq!(get(&with_token(), ""), 200);
        assert_eq!(get("/metrics", &format!("Bearer {TOKEN}")), 200);
        assert_eq!(get(&format!("/?x=1&token={TOKEN}"), "Bearer old"), 200);
        for (uri, said) in [
            ("/", ""),
            ("/?token=", ""),
            (&with_token()[..with_token().len() - 1], ""),
            (&format!("{}0", with_token())[..], ""),
            (&with_token().to_uppercase().replace("TOKEN", "token")[..], ""),
            ("/", TOKEN),
            ("/", &format!("Basic {TOKEN}")[..]),
            ("/", &format!("Bearer {TOKEN}x")[..]),
            ("/", "Bearer "),
        ] {
            assert_eq!(get(uri, said), 401, "{uri} {said}");
        }
        assert!(is_same("", "") && !is_same("", "a") && !is_same("ab", "a") && !is_same("ab", "ac"));
    }

    #[test]
    fn another_name_for_this_machine_is_refused_whatever_the_token() {
        let uri = with_token();
        let of = |hosts: &[&str]| verdict(Method::GET, &uri, &hosts.iter().map(|host| ("host", *host)).collect::<Vec<_>>());
        assert_eq!((of(&["127.0.0.1:8642"]), of(&["LocalHost:8642"])), (200, 200));
        for hosts in [&[][..], &["evil.example:8642"], &["127.0.0.1"], &["127.0.0.1:8643"], &["127.0.0.1:8642", "evil.example"]] {
            assert_eq!(of(hosts), 403, "{hosts:?}");
        }
        let absolute = format!("http://evil.example:8642{uri}");
        assert_eq!(verdict(Method::GET, &absolute, &[("host", "127.0.0.1:8642")]), 403);
    }

    /// Where the port was 80 a browser named none, and nobody came in.
    #[test]
    fn the_usual_port_need_not_be_named_and_any_other_must_be() {
        let may_come = |port: u16, name: &str| {
            let address = Address { port, token: TOKEN.into() };
            let said = [("host", name.to_string()), ("origin", format!("http://{name}"))];
            let headers =
                said.into_iter().map(|(key, value)| (HeaderName::from_static(key), HeaderValue::from_str(&value).unwrap()));
            check(&address, &Method::POST, &with_token().parse().unwrap(), &headers.collect()).is_ok()
        };
        assert_eq!([80, 8_642].map(|port| may_come(port, "127.0.0.1")), [true, false]);
        assert_eq!(
            ["localhost", "127.0.0.1:80", "evil.example", "127.0.0.1:8642"].map(|name| may_come(80, name)),
            [true, true, false, false]
        );
    }

    #[test]
    fn another_page_can_neither_ask_nor_change_anything() {
        let (host, uri) = (("host", "127.0.0.1:8642"), with_token());
        let own = ("origin", "http://127.0.0.1:8642");
        assert_eq!(verdict(Method::POST, &uri, &[host, own]), 200);
        assert_eq!(verdict(Method::GET, &uri, &[host, own]), 200);
        assert_eq!(verdict(Method::POST, &uri, &[host]), 403, "nobody said where it comes from");
        for origin in ["null", "http://evil.example", "https://127.0.0.1:8642", "http://127.0.0.1:80", "127.0.0.1:8642"] {
            assert_eq!(verdict(Method::POST, &uri, &[host, ("origin", origin)]), 403, "{origin}");
            assert_eq!(verdict(Method::GET, &uri, &[host, ("origin", origin)]), 403, "{origin}");
        }
        let events = uri.replace("/?", "/events?");
        let from = |uri: &str, site: &str| verdict(Method::GET, uri, &[host, ("sec-fetch-site", site)]);
        assert_eq!((from(&events, "same-origin"), from(&events, "none"), from(&uri, "cross-site")), (200, 200, 200));
        assert_eq!((from(&events, "same-site"), from(&events, "cross-site")), (403, 403));
    }
}
