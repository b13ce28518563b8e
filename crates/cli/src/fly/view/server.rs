//! Which requests are answered, and with what.
//!
//! Owns the files of the page and the check of where a request comes from. A page of another origin must
//! neither read nor order: its browser names it in `Origin`, or, if it has pointed a name to this machine, in
//! `Host`.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{ConnectInfo, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{StatusCode, Uri};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tello_eval::telemetry::FlightHeader;
use tello_io::clock::Clock;
use tokio::sync::watch;

use super::orders::OrderAccess;
use super::viewer::{MESSAGE_BYTES_MAX, ViewerConnection};
use super::viewer_slots::ViewerSlots;
use crate::fly::connection_limit::{ConnectionLimit, LimitHandle, LimitedListener};
use crate::fly::live::Watched;

pub(super) const PAGE: &str = include_str!("page.html");
pub(super) const STYLE: &str = include_str!("page.css");
pub(super) const SCRIPT: &str = concat!(include_str!("draw.js"), include_str!("page.js"));

/// Last lines of the script of a live flight.
const BEGIN: &str = "listen();\nconnect();\n";

/// Nothing from anywhere but the files of the page, and a socket back to here.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// For connections that are not yet web sockets: each has one request and its answer.
const REQUESTS: ConnectionLimit = ConnectionLimit { count: 24, time: Some(Duration::from_secs(3)) };

/// Shown facts, and the receiver of orders.
#[derive(Debug, Clone)]
pub(super) struct Shown {
    pub(super) briefing: FlightHeader,
    pub(super) facts: Watched,
    pub(super) is_over: watch::Receiver<bool>,
    pub(super) access: Arc<OrderAccess>,
    pub(super) clock: Clock,
}

#[derive(Debug, Clone)]
struct ServerState {
    shown: Arc<Shown>,
    slots: Arc<ViewerSlots>,
}

/// Serves until the flight is over; viewers have `goodbye` to receive its end.
pub(super) async fn serve(listener: tokio::net::TcpListener, shown: Shown, goodbye: Duration) {
    let mut is_over = shown.is_over.clone();
    let slots = Arc::new(ViewerSlots::default());
    let state = ServerState { shown: Arc::new(shown), slots: Arc::clone(&slots) };
    let routes = Router::new()
        .route("/", get(|| async { file("text/html; charset=utf-8", PAGE.to_owned()) }))
        .route("/page.css", get(|| async { file("text/css; charset=utf-8", STYLE.to_owned()) }))
        .route(
            "/page.js",
            get(|| async { file("text/javascript; charset=utf-8", format!("{SCRIPT}{BEGIN}")) }),
        )
        .route("/live", get(watch_flight))
        .with_state(state)
        .layer(middleware::from_fn(guarded));
    let over = async move {
        // An error: the flight is gone altogether.
        is_over.wait_for(|is_over| *is_over).await.ok();
    };
    let routes = routes.into_make_service_with_connect_info::<LimitHandle>();
    let server = axum::serve(LimitedListener::new(listener, REQUESTS), routes);
    tokio::select! {
        // The server does not end by itself.
        served = server.into_future() => drop(served),
        () = over => {}
    }
    tokio::time::timeout(goodbye, slots.is_empty()).await.ok();
}

fn file(kind: &'static str, text: String) -> Response {
    ([(header::CONTENT_TYPE, HeaderValue::from_static(kind))], text).into_response()
}

async fn watch_flight(
    State(state): State<ServerState>,
    ConnectInfo(handle): ConnectInfo<LimitHandle>,
    upgrade: WebSocketUpgrade,
) -> Response {
    upgrade.max_message_size(MESSAGE_BYTES_MAX).max_frame_size(MESSAGE_BYTES_MAX).on_upgrade(
        async move |socket| {
            let (slot, goes) = state.slots.enter();
            // From here on the slots limit this connection.
            handle.release();
            let viewer = ViewerConnection::new(&state.shown, &slot);
            tokio::select! {
                () = viewer.attend(socket) => {}
                () = slot.is_over(goes) => {}
            }
        },
    )
}

/// Refuses what does not come from a page of ours, and sets the headers of a strict policy.
async fn guarded(request: Request, next: Next) -> Response {
    let mut response = match refusal(request.headers()) {
        Some(why) => (StatusCode::FORBIDDEN, why).into_response(),
        None => next.run(request).await,
    };
    let strict = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in strict {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    if response.status() != StatusCode::SWITCHING_PROTOCOLS {
        // One request per connection: the listener limits connections, and so requests.
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

/// Why a request with these headers is not answered.
fn refusal(headers: &HeaderMap) -> Option<&'static str> {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let Some(host) = text(header::HOST) else { return Some("no Host\n") };
    if !is_plain(host) {
        return Some("open the page by the number of its address, or as localhost\n");
    }
    match headers.get(header::ORIGIN).map(HeaderValue::as_bytes) {
        // A program that is no browser sends none.
        None => None,
        Some(origin) if origin.strip_prefix(b"http://") == Some(host.as_bytes()) => None,
        Some(_) => Some("only a page of this server may talk to it\n"),
    }
}

/// Whether `host` is a number or `localhost`: any other name may be pointed to this machine by another site.
fn is_plain(host: &str) -> bool {
    let Ok(authority) = host.parse::<Uri>().map(|uri| uri.host().map(str::to_owned)) else {
        return false;
    };
    authority.is_some_and(|name| {
        let number = name.trim_start_matches('[').trim_end_matches(']');
        name.eq_ignore_ascii_case("localhost") || number.parse::<IpAddr>().is_ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(host: &'static str, origin: Option<&'static str>) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_static(host));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, HeaderValue::from_static(origin));
        }
        refusal(&headers).is_some()
    }

    #[test]
    fn only_the_pages_own_origin_at_a_plain_address_is_answered() {
        for host in
            ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "192.168.1.7:80", "127.0.0.1"]
        {
            assert!(!refused(host, None), "{host}");
        }
        assert!(!refused("127.0.0.1:8080", Some("http://127.0.0.1:8080")));
        for (host, origin) in [
            // A name that was pointed to this machine, with and without its origin.
            ("evil.example:8080", None),
            ("evil.example:8080", Some("http://evil.example:8080")),
            ("127.0.0.1.evil.example", None),
            ("user@127.0.0.1:8080", Some("http://evil.example")),
            ("", None),
            // Another page in the same browser.
            ("127.0.0.1:8080", Some("http://evil.example")),
            ("127.0.0.1:8080", Some("https://127.0.0.1:8080")),
            ("127.0.0.1:8080", Some("http://127.0.0.1:9090")),
            ("127.0.0.1:8080", Some("http://localhost:8080")),
            ("127.0.0.1:8080", Some("null")),
        ] {
            assert!(refused(host, origin), "{host:?} {origin:?}");
        }
        assert!(refusal(&HeaderMap::new()).is_some());
    }
}
