//! Proxies between the program and the emulator: a mocap link that falls behind, and a radio link that
//! records its packets.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread::{sleep, spawn};

use tello_io::clock::{Clock, SpanNs, TimeNs};
use tello_io::tello::protocol::{Action, HostPacket};

/// How a mocap link falls behind, from some time on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Lag {
    /// By so much, at once and for good. s
    Step(f64),
    /// By so much more in each second. s/s
    Growth(f64),
    /// It carries so many bytes per second, for five seconds; what waits then comes at once.
    Slow(f64),
}

/// For how long a link is slow. s
const SLOW_S: f64 = 5.0;

/// A TCP server that its clients get the poses from.
pub(crate) struct Poses {
    pub(crate) address: SocketAddr,
    clock: Clock,
    lag: Arc<Mutex<Option<(TimeNs, Lag)>>>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Poses {
    pub(crate) fn start(source: SocketAddr, clock: Clock) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let lag = Arc::new(Mutex::new(None));
        let clients_lag = Arc::clone(&lag);
        spawn(move || {
            for client in listener.incoming() {
                let Ok(mut source) = TcpStream::connect(source) else { return };
                let (to, from) = channel();
                let lag = Arc::clone(&clients_lag);
                let client = client.unwrap();
                client.set_nodelay(true).unwrap();
                spawn(move || release(clock, &from, client, &lag));
                spawn(move || {
                    let mut chunk = [0; 4096];
                    while let Ok(count @ 1..) = source.read(&mut chunk) {
                        if to.send((clock.now(), chunk[..count].to_vec())).is_err() {
                            return;
                        }
                    }
                });
            }
        });
        Self { address, clock, lag }
    }

    /// Falls behind from now on; the time of it.
    pub(crate) fn fall_behind(&self, lag: Lag) -> TimeNs {
        let now = self.clock.now();
        *self.lag.lock().unwrap() = Some((now, lag));
        now
    }
}

/// Hands over what came, as late as it shall be.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn release(
    clock: Clock,
    from: &Receiver<(TimeNs, Vec<u8>)>,
    mut client: TcpStream,
    lag: &Mutex<Option<(TimeNs, Lag)>>,
) {
    #[expect(clippy::cast_possible_truncation, reason = "some seconds")]
    let after = |at: TimeNs, s: f64| at.after(SpanNs((s * 1e9) as i64));
    let mut free_at = TimeNs(0);
    while let Ok((came_at, bytes)) = from.recv() {
        let due = match *lag.lock().unwrap() {
            Some((begin, lag)) if came_at >= begin => match lag {
                Lag::Step(s) => after(came_at, s),
                Lag::Growth(rate) => after(came_at, rate * came_at.since(begin).seconds()),
                Lag::Slow(bytes_per_s) => {
                    let took_s = bytes.len() as f64 / bytes_per_s;
                    free_at = after(free_at.max(came_at), took_s);
                    free_at.min(after(begin, SLOW_S)).max(came_at)
                }
            },
            _ => came_at,
        };
        sleep(due.since(clock.now()).duration());
        if client.write_all(&bytes).is_err() {
            return;
        }
    }
}

/// Packets sent to the drone, with their times.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Received {
    /// The last sticks that were not neutral.
    pub(crate) last_stick_at: Option<TimeNs>,
    pub(crate) first_landing_at: Option<TimeNs>,
}

/// A UDP socket that the program takes for the drone.
pub(crate) struct Radio {
    pub(crate) address: SocketAddr,
    heard: Arc<Mutex<Received>>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Radio {
    pub(crate) fn start(drone: SocketAddr, clock: Clock) -> Self {
        let near = UdpSocket::bind("127.0.0.1:0").unwrap();
        let far = UdpSocket::bind("127.0.0.1:0").unwrap();
        far.connect(drone).unwrap();
        let address = near.local_addr().unwrap();
        let heard = Arc::new(Mutex::new(Received::default()));
        let program: Arc<Mutex<Option<SocketAddr>>> = Arc::default();
        let (near_back, far_back) = (near.try_clone().unwrap(), far.try_clone().unwrap());
        let (noted, sender) = (Arc::clone(&heard), Arc::clone(&program));
        spawn(move || {
            let mut packet = [0; 2048];
            while let Ok((count, from)) = near.recv_from(&mut packet) {
                *sender.lock().unwrap() = Some(from);
                noted.lock().unwrap().note(&packet[..count], clock.now());
                // The emulator may be gone already.
                far.send(&packet[..count]).ok();
            }
        });
        spawn(move || {
            let mut packet = [0; 2048];
            while let Ok(count) = far_back.recv(&mut packet) {
                if let Some(program) = *program.lock().unwrap() {
                    near_back.send_to(&packet[..count], program).ok();
                }
            }
        });
        Self { address, heard }
    }

    pub(crate) fn heard(&self) -> Received {
        *self.heard.lock().unwrap()
    }
}

impl Received {
    fn note(&mut self, packet: &[u8], now: TimeNs) {
        match HostPacket::decode(packet) {
            Ok(HostPacket::Sticks { u, .. }) if u.amax() > 0.0 => self.last_stick_at = Some(now),
            Ok(HostPacket::Action { action: Action::Land, .. }) => {
                self.first_landing_at.get_or_insert(now);
            }
            _ => {}
        }
    }
}
