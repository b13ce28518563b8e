//! A flight live in Foxglove and Lichtblick: what goes into the log also goes to them.
//!
//! Owns the WebSocket server of the crate `foxglove` and the thread that it runs on, apart from the one of
//! the drone's sockets. It sends what the log has and takes no orders. The log's thread puts
//! each message into a bounded queue per client, the oldest give way: a slow client misses some.
//!
//! The server of the crate accepts any number of connections. So it listens at a random address of this machine's
//! loopback network, and clients connect to a listener that limits them and relays their bytes.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result};
use axum::serve::Listener as _;
use foxglove::{Context, PartialMetadata, RawChannel, Schema, WebSocketServer};
use tello_io::log::{Channel, LogWriter, Tap};
use tello_io::{StopSignal, Stopper};
use tokio::io::copy_bidirectional;
use tokio::net::TcpStream;
use tokio::runtime;
use tokio::task::JoinSet;

use super::connection_limit::{ConnectionLimit, LimitedListener, LimitedStream};
use crate::stdio;

/// For clients: a viewer has one connection for as long as it likes.
const CLIENTS: ConnectionLimit = ConnectionLimit { count: 8, time: None };

/// Time for clients to receive the end of the flight.
const FAREWELL: Duration = Duration::from_millis(200);

/// Sends `log` to viewers at `address` as well, if there is one. An address that cannot be served is a warning, and
/// the flight goes on.
pub(super) fn show_at(address: Option<SocketAddr>, log: &mut LogWriter, channels: &[Channel]) {
    match address.map(|address| FoxgloveServer::start(address, channels)) {
        Some(Ok((server, bound))) => {
            stdio::note(format_args!("Foxglove and Lichtblick: open connection ws://{bound}"));
            log.add_tap(Box::new(server));
        }
        Some(Err(error)) => stdio::note(format_args!("warning: {error:#}")),
        None => {}
    }
}

/// A server that lives as long as the log that it sends.
struct FoxgloveServer {
    channels: Vec<(&'static str, Arc<RawChannel>)>,
    /// Channels are there as long as this is.
    _context: Arc<Context>,
    _stopper: Stopper,
}

impl FoxgloveServer {
    /// Serves `channels` at `address`, and where that is.
    ///
    /// # Errors
    /// The address is taken or not of this machine.
    fn start(address: SocketAddr, channels: &[Channel]) -> Result<(Self, SocketAddr)> {
        let context = Context::new();
        let channels = channels
            .iter()
            .map(|channel| Ok((channel.topic, advertise(&context, channel)?)))
            .collect::<Result<_>>()?;
        let server = context.websocket_server().name("tello-ctl");
        let listener = TcpListener::bind(address)
            .with_context(|| format!("cannot serve Foxglove and Lichtblick at {address}"))?;
        listener.set_nonblocking(true)?;
        let bound = listener.local_addr()?;
        let inside = loopback_address()?;
        let (stopper, stop) = Stopper::new();
        thread::Builder::new().name("tello-foxglove".into()).spawn(move || {
            if let Err(error) = serve(server.bind(inside.to_string(), 0), inside, listener, stop) {
                stdio::note(format_args!("warning: the flight is not shown live: {error:#}"));
            }
        })?;
        Ok((Self { channels, _context: context, _stopper: stopper }, bound))
    }
}

impl Tap for FoxgloveServer {
    fn receive(&mut self, topic: &str, log_time_ns: u64, bytes: &[u8]) {
        if let Some((_, channel)) = self.channels.iter().find(|(known, _)| *known == topic) {
            channel.log_with_meta(bytes, PartialMetadata::with_log_time(log_time_ns));
        }
    }
}

fn advertise(context: &Arc<Context>, channel: &Channel) -> Result<Arc<RawChannel>> {
    let Channel { topic, schema_name, schema } = channel;
    let builder = context.channel_builder(*topic).message_encoding(schema.message_encoding());
    let data = schema.data().into_owned();
    Ok(builder.schema(Schema::new(*schema_name, schema.schema_encoding(), data)).build_raw()?)
}

/// An address of this machine that no other can reach and no page in a browser can guess.
fn loopback_address() -> Result<IpAddr> {
    let mut host = [0; 3];
    getrandom::fill(&mut host)?;
    let [a, b, c] = host;
    Ok(Ipv4Addr::new(127, a, b, c.clamp(1, 254)).into())
}

/// Runs `server`, which listens at `inside`, behind `listener` until it is stopped.
fn serve(
    server: WebSocketServer,
    inside: IpAddr,
    listener: TcpListener,
    mut stop: StopSignal,
) -> Result<()> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let server = server.start().await?;
        let inside = SocketAddr::new(inside, server.port());
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let mut listener = LimitedListener::new(listener, CLIENTS);
        let mut relays = JoinSet::new();
        loop {
            tokio::select! {
                (client, _) = listener.accept() => drop(relays.spawn(relay(client, inside))),
                Some(_ended) = relays.join_next() => {}
                () = stop.ordered() => break,
            }
        }
        let farewell = async {
            server.stop().wait().await;
            while relays.join_next().await.is_some() {}
        };
        // A client that does not close its connection is left.
        tokio::time::timeout(FAREWELL, farewell).await.ok();
        Ok(())
    })
}

/// Carries bytes between a client and the server until either closes, or the limit closes the client's connection.
async fn relay(mut client: LimitedStream, server: SocketAddr) {
    let Ok(mut server) = TcpStream::connect(server).await else { return };
    server.set_nodelay(true).ok();
    copy_bidirectional(&mut client, &mut server).await.ok();
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::net::TcpStream as Client;

    use tokio_tungstenite::tungstenite::client;
    use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

    use super::*;

    /// A viewer at `address` that has received the first message of the server.
    fn viewer(address: SocketAddr) -> Option<String> {
        let stream = Client::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut request = format!("ws://{address}").into_client_request().unwrap();
        let protocol = "foxglove.sdk.v1".parse().unwrap();
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocol);
        let (mut socket, _) = client(request, stream).ok()?;
        socket.read().ok()?.into_text().ok().map(|text| text.to_string())
    }

    #[test]
    fn idle_connections_are_closed_and_keep_no_viewer_out() {
        let (_server, address) =
            FoxgloveServer::start("127.0.0.1:0".parse().unwrap(), &[]).unwrap();
        let idle: Vec<_> =
            (0..3 * CLIENTS.count).map(|_| Client::connect(address).unwrap()).collect();
        let info = viewer(address).unwrap();
        assert!(info.contains("serverInfo"), "{info}");
        let is_closed = |mut client: &Client| {
            client.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
            // A timeout is an error.
            io::Read::read(&mut client, &mut [0]).is_ok_and(|count| count == 0)
        };
        let closed = idle.iter().filter(|client| is_closed(client)).count();
        assert!(closed > idle.len() - CLIENTS.count, "{closed} of {}", idle.len());
    }
}
