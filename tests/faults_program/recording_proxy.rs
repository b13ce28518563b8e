//! A UDP proxy before the drone that records the packets of the program, or its guardian, with their times.

use std::net::{SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::thread;

use tello_io::clock::{Clock, SpanNs, TimeNs};
use tello_io::tello::protocol::{Action, HostPacket};

/// Proxy that records the packets to the drone, by its clock; its threads end with the test.
pub(crate) struct RecordingProxy {
    pub(crate) address: SocketAddr,
    pub(crate) clock: Clock,
    sent: Arc<Mutex<Vec<(TimeNs, HostPacket)>>>,
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
impl RecordingProxy {
    /// A port whose packets go to `drone`, and back.
    pub(crate) fn start(drone: SocketAddr) -> Self {
        let any_port = "127.0.0.1:0";
        let front = UdpSocket::bind(any_port).unwrap();
        let back = UdpSocket::bind(any_port).unwrap();
        back.connect(drone).unwrap();
        let address = front.local_addr().unwrap();
        let (clock, sent) = (Clock::start(), Arc::new(Mutex::new(Vec::new())));
        let program = Arc::new(Mutex::new(None));
        let (to_front, from_back) = (front.try_clone().unwrap(), back.try_clone().unwrap());
        let (notes, its_port) = (Arc::clone(&sent), Arc::clone(&program));
        thread::spawn(move || {
            let mut bytes = [0; 2048];
            while let Ok((count, from)) = front.recv_from(&mut bytes) {
                let at = clock.now();
                *its_port.lock().unwrap() = Some(from);
                if let Ok(packet) = HostPacket::decode(&bytes[..count]) {
                    notes.lock().unwrap().push((at, packet));
                }
                back.send(&bytes[..count]).ok();
            }
        });
        thread::spawn(move || {
            let mut bytes = [0; 2048];
            while let Ok(count) = from_back.recv(&mut bytes) {
                if let Some(program) = *program.lock().unwrap() {
                    to_front.send_to(&bytes[..count], program).ok();
                }
            }
        });
        Self { address, clock, sent }
    }

    /// Packets sent after `from`.
    fn since(&self, from: TimeNs) -> Vec<(TimeNs, HostPacket)> {
        let sent = self.sent.lock().unwrap();
        sent.iter().filter(|(at, _)| *at > from).copied().collect()
    }

    /// When the drone was first ordered to land after `from`, if it was. s
    pub(crate) fn landing_s(&self, from: TimeNs) -> Option<f64> {
        let sent = self.since(from);
        let first = sent.iter().find(|(_, packet)| is_landing(packet));
        first.map(|(at, _)| at.since(from).seconds())
    }

    /// From the first landing after `from` on nothing moves the drone, and there are at least `count` landings.
    pub(crate) fn assert_only_landings(&self, from: TimeNs, count: usize) {
        let sent = self.since(from);
        let begin = sent.iter().position(|(_, packet)| is_landing(packet)).expect("no landing");
        let moving = sent[begin..].iter().find(|(_, packet)| moves(packet));
        assert!(moving.is_none(), "{moving:?} follows the landing");
        let landings = sent.iter().filter(|(_, packet)| is_landing(packet)).count();
        assert!(landings >= count, "{landings} landings");
    }

    /// Each landing after `from` comes directly behind neutral sticks.
    pub(crate) fn assert_neutral_before_landings(&self, from: TimeNs) {
        let sent = self.since(from);
        for pair in sent.windows(2).filter(|pair| is_landing(&pair[1].1)) {
            let is_neutral = matches!(pair[0].1, HostPacket::Sticks { u, .. } if u.amax() == 0.0);
            assert!(is_neutral, "{pair:?}");
        }
    }

    /// Whether the drone was ever ordered to take off.
    pub(crate) fn is_taken_off(&self) -> bool {
        let is_take_off = |packet: &HostPacket| {
            matches!(packet, HostPacket::Action { action: Action::TakeOff, .. })
        };
        self.since(TimeNs(0)).iter().any(|(_, packet)| is_take_off(packet))
    }

    /// Whether anything moved the drone in the last half second.
    pub(crate) fn is_steered(&self) -> bool {
        let from = self.clock.now().after(SpanNs::from_ms(-500));
        self.since(from).iter().any(|(_, packet)| moves(packet))
    }
}

fn is_landing(packet: &HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. })
}

fn moves(packet: &HostPacket) -> bool {
    match packet {
        HostPacket::Sticks { u, .. } => u.amax() > 0.0,
        HostPacket::Action { action, .. } => *action == Action::TakeOff,
        _ => false,
    }
}
