//! A TCP proxy between a mocap server and its client that stalls without closing the connection.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

/// How bytes go through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Flow {
    /// All of them, at once.
    Open,
    /// None: the other host is gone without a last message.
    HalfOpen,
    /// One per second.
    Trickle,
}

/// The server; its threads end with the connections.
pub(crate) struct StallingProxy {
    pub(crate) address: SocketAddr,
    flow: Arc<AtomicU8>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl StallingProxy {
    /// A proxy whose clients receive the bytes of `source`.
    pub(crate) fn start(source: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let flow = Arc::new(AtomicU8::new(Flow::Open as u8));
        let clients_flow = Arc::clone(&flow);
        thread::spawn(move || {
            for client in listener.incoming() {
                let flow = Arc::clone(&clients_flow);
                thread::spawn(move || carry(source, client.unwrap(), &flow));
            }
        });
        Self { address, flow }
    }

    /// From now on, also for who connects anew.
    pub(crate) fn set(&self, flow: Flow) {
        self.flow.store(flow as u8, Ordering::Relaxed);
    }
}

/// Carries bytes until either end closes.
fn carry(source: SocketAddr, mut client: TcpStream, flow: &AtomicU8) {
    let Ok(mut source) = TcpStream::connect(source) else { return };
    let mut chunk = [0; 4096];
    while let Ok(count @ 1..) = source.read(&mut chunk) {
        let flow = flow.load(Ordering::Relaxed);
        let fraction = match flow {
            _ if flow == Flow::Open as u8 => count,
            _ if flow == Flow::Trickle as u8 => {
                thread::sleep(Duration::from_secs(1));
                1
            }
            _ => 0,
        };
        if client.write_all(&chunk[..fraction]).is_err() {
            return;
        }
    }
}
