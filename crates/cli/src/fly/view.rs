//! The live page: a flight in a browser, and a few orders from there.
//!
//! Owns the thread of the server, its start and its end. It refuses to touch the flight: facts come from
//! the log's thread, orders go where keys go, and whatever fails here ends the page alone. The thread is
//! not that of the drone's sockets: a flood of requests must not hold up the link.

mod orders;
mod playback;
mod server;
mod viewer;
mod viewer_slots;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context, Result};
use tello_eval::telemetry::FlightHeader;
use tello_io::clock::Clock;
use tello_io::manual::Remote;
use tokio::sync::watch;

use self::orders::OrderAccess;
pub(crate) use self::playback::Playback;
use self::server::{Shown, serve};
use super::live::Watched;
use crate::{interrupt, stdio};

/// Where the page is unless an address is given.
const DEFAULT: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8080);

/// Time for the viewers to receive the end of the flight.
const GOODBYE: Duration = Duration::from_millis(500);

/// The running server. Dropped, it sends the viewers the end of the flight, and ends.
#[derive(Debug)]
pub(super) struct View {
    over: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl View {
    /// Serves the page at `address`; without one at [`DEFAULT`], or at any free port if that is taken. Prints its
    /// address.
    ///
    /// # Errors
    /// The address is taken or not of this machine; no random numbers; no thread.
    pub(super) fn open(
        address: Option<SocketAddr>,
        briefing: FlightHeader,
        facts: Watched,
        remote: Remote,
        clock: Clock,
    ) -> Result<Self> {
        let listener = bind(address)?;
        listener.set_nonblocking(true)?;
        let bound = listener.local_addr()?;
        let token = orders::token()?;
        announce(address.unwrap_or(DEFAULT), bound, &token);
        let (over, is_over) = watch::channel(false);
        let access = Arc::new(OrderAccess::new(&token, remote));
        let shown = Shown { briefing, facts, is_over, access, clock };
        let thread =
            thread::Builder::new().name("tello-view".into()).spawn(move || run(listener, shown))?;
        Ok(Self { over, thread: Some(thread) })
    }
}

impl Drop for View {
    fn drop(&mut self) {
        self.over.send_replace(true);
        if let Some(thread) = self.thread.take() {
            // A server that panicked is over, too.
            thread.join().ok();
        }
    }
}

/// Tries whether [`View::open`] could have its address.
///
/// # Errors
/// The address is taken or not of this machine.
pub(super) fn probe(address: Option<SocketAddr>) -> Result<()> {
    bind(address).map(drop)
}

/// A socket at `address`. What was asked for is taken or the flight ends: a tunnel to it would lead to another page.
fn bind(address: Option<SocketAddr>) -> Result<TcpListener> {
    let taken = |address: SocketAddr| {
        format!("cannot show the flight at {address}: choose another address for --view")
    };
    let bound = TcpListener::bind(address.unwrap_or(DEFAULT));
    match (bound, address) {
        (Err(error), None) if error.kind() == io::ErrorKind::AddrInUse => {
            let any_port = SocketAddr::new(DEFAULT.ip(), 0);
            TcpListener::bind(any_port).with_context(|| taken(any_port))
        }
        (bound, address) => bound.with_context(|| taken(address.unwrap_or(DEFAULT))),
    }
}

/// The token stands behind the `#`: a browser keeps that part to itself.
fn announce(asked: SocketAddr, bound: SocketAddr, token: &str) {
    let mut lines = format!("view http://{bound}/#{token}\n");
    if asked.port() != 0 && asked.port() != bound.port() {
        let (taken, port) = (asked.port(), bound.port());
        let moved = format!("port {taken} is taken by another program: the page is at {port}");
        lines.push_str("     ");
        lines.push_str(&moved);
        lines.push('\n');
    }
    if bound.ip().is_unspecified() {
        lines.push_str(
            "     (from elsewhere: the address of this machine in place of the first part)\n",
        );
    }
    if !bound.ip().is_loopback() {
        lines.push_str(
            "warning: every machine that reaches that port sees the flight; the token is not encrypted: \
             a reader of the network traffic can land the drone or stop its motors\n",
        );
    }
    stdio::note_raw(lines);
}

fn run(listener: TcpListener, shown: Shown) {
    let runtime = interrupt::runtime();
    let served = runtime.and_then(|runtime| {
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener)?
        };
        runtime.block_on(serve(listener, shown, GOODBYE));
        runtime.shutdown_background();
        Ok(())
    });
    if let Err(error) = served {
        stdio::note(format_args!("warning: the live page is not shown: {error}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_is_asked_for_is_taken_or_refused() {
        let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let error = bind(Some(taken.local_addr().unwrap())).unwrap_err().to_string();
        assert!(error.contains("choose another address for --view"), "{error}");
        // Another program may have the default one here: both ways there is a page.
        let (first, second) = (bind(None).unwrap(), bind(None).unwrap());
        assert_ne!(first.local_addr().unwrap(), second.local_addr().unwrap());
        assert!(bind(Some(DEFAULT)).is_err());
    }
}
