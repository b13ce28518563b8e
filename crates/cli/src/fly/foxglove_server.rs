//! A flight live in Foxglove and Lichtblick: what goes into the log also goes to them.
//!
//! Owns the WebSocket server of the crate `foxglove` and the thread that it runs on, apart from the one of
//! the drone's sockets. It sends what the log has and takes no orders. The log's thread puts
//! each message into a bounded queue per client, the oldest give way: a slow client misses some.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result};
use foxglove::{Context, PartialMetadata, RawChannel, Schema, WebSocketServer};
use tello_io::log::{Channel, LogWriter, Tap};
use tello_io::{StopSignal, Stopper};
use tokio::runtime;

/// Time for clients to receive the end of the flight.
const FAREWELL: Duration = Duration::from_millis(200);

/// Sends `log` to viewers at `address` as well, if there is one. An address that cannot be served is a warning, and
/// the flight goes on.
pub(super) fn show_at(address: Option<SocketAddr>, log: &mut LogWriter, channels: &[Channel]) {
    match address.map(|address| FoxgloveServer::start(address, channels)) {
        Some(Ok(server)) => log.add_tap(Box::new(server)),
        // No terminal, no reader.
        Some(Err(error)) => drop(writeln!(io::stderr(), "warning: {error:#}")),
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
    /// Serves `channels` at `address`, and says where.
    ///
    /// # Errors
    /// The address is taken or not of this machine.
    fn start(address: SocketAddr, channels: &[Channel]) -> Result<Self> {
        let context = Context::new();
        let channels = channels
            .iter()
            .map(|channel| Ok((channel.topic, advertise(&context, channel)?)))
            .collect::<Result<_>>()?;
        let (stopper, stop) = Stopper::new();
        let (answer, answers) = mpsc::sync_channel(1);
        let server = context.websocket_server().name("tello-ctl");
        thread::Builder::new().name("tello-foxglove".into()).spawn(move || {
            let end = serve(server, address, stop, &answer);
            // The caller may have left.
            end.map_err(|error| answer.send(Err(error))).ok();
        })?;
        let address = answers
            .recv()?
            .with_context(|| format!("cannot serve Foxglove and Lichtblick at {address}"))?;
        // No terminal, no reader.
        writeln!(io::stderr(), "Foxglove and Lichtblick: open connection ws://{address}").ok();
        Ok(Self { channels, _context: context, _stopper: stopper })
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

/// Runs the server until it is stopped; answers with its address once it listens.
fn serve(
    server: WebSocketServer,
    address: SocketAddr,
    mut stop: StopSignal,
    answer: &mpsc::SyncSender<Result<SocketAddr>>,
) -> Result<()> {
    // The address of an IPv6 host is written in brackets.
    let text = address.to_string();
    let host = text.rsplit_once(':').map_or("", |(host, _)| host);
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let server = server.bind(host, address.port()).start().await?;
        answer.send(Ok(SocketAddr::new(address.ip(), server.port())))?;
        stop.ordered().await;
        // A client that does not close its connection is left.
        tokio::time::timeout(FAREWELL, server.stop().wait()).await.ok();
        Ok(())
    })
}
