use std::io::{Read, Write};
use std::sync::mpsc;

use super::*;

/// A guardian on a thread, the sender's end of its channel and the drone's socket.
struct Fixture {
    sender: UnixStream,
    drone: UdpSocket,
    clock: Clock,
    end: mpsc::Receiver<WatchEnd>,
}

impl Fixture {
    fn start() -> Self {
        let (sender, channel) = UnixStream::pair().unwrap();
        let drone = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = drone.local_addr().unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (outcome, end) = mpsc::channel();
        let post = GuardianSockets { socket, channel, address, protocol: Protocol::Text };
        thread::spawn(move || outcome.send(Guardian::start(post).unwrap().watch()).unwrap());
        let mut fixture = Self { sender, drone, clock: Clock::start(), end };
        assert_eq!(fixture.word(1.0), Some(READY));
        fixture
    }

    fn send(&mut self, state: SenderState) {
        self.sender.write_all(&[state as u8]).unwrap();
    }

    /// What the guardian sends within `within_s`, but for its answers to heartbeats.
    fn word(&mut self, within_s: f64) -> Option<u8> {
        let until_s = self.clock.now().seconds() + within_s;
        loop {
            match self.any_word((until_s - self.clock.now().seconds()).max(0.001)) {
                Some(HEARD) => {}
                word => return word,
            }
        }
    }

    fn any_word(&mut self, within_s: f64) -> Option<u8> {
        self.sender.set_read_timeout(Some(Duration::from_secs_f64(within_s))).unwrap();
        let mut byte = [0];
        self.sender.read_exact(&mut byte).ok().map(|()| byte[0])
    }

    /// The next packet within `within_s` and when it came, in s.
    fn packet(&self, within_s: f64) -> Option<(f64, String)> {
        self.drone.set_read_timeout(Some(Duration::from_secs_f64(within_s))).unwrap();
        let mut bytes = [0; 64];
        let count = self.drone.recv(&mut bytes).ok()?;
        Some((self.clock.now().seconds(), String::from_utf8_lossy(&bytes[..count]).into()))
    }

    /// The next two packets, which must be neutral sticks and a landing; when the latter came, in s.
    fn landing(&self, within_s: f64) -> f64 {
        let (_, neutral) = self.packet(within_s).expect("no neutral sticks");
        let (at_s, land) = self.packet(within_s).expect("no landing");
        assert_eq!((&*neutral, &*land), ("rc 0 0 0 0", "land"));
        at_s
    }
}

#[test]
fn silence_in_flight_lands_until_the_sender_goes_on_with_it_and_silence_then_lands_again() {
    let mut fixture = Fixture::start();
    fixture.send(SenderState::Steering);
    let since_s = fixture.clock.now().seconds();
    let first_s = fixture.landing(1.0);
    assert!((0.25..0.45).contains(&(first_s - since_s)), "{}", first_s - since_s);
    assert_eq!(fixture.word(0.1), Some(LANDING_ORDERED));
    // It does not know of the landing yet.
    fixture.send(SenderState::Steering);
    let second_s = fixture.landing(1.0);
    assert!((0.2..0.4).contains(&(second_s - first_s)), "{}", second_s - first_s);
    fixture.send(SenderState::Landing);
    let since_s = fixture.clock.now().seconds();
    let third_s = fixture.landing(1.0);
    assert!(third_s - since_s > 0.25, "it lands beside a sender that does: {third_s} {since_s}");
    fixture.send(SenderState::Over);
    assert_eq!(fixture.end.recv_timeout(Duration::from_secs(1)), Ok(WatchEnd::Over));
    assert_eq!(fixture.packet(0.1), None);
}

#[test]
fn a_sender_that_goes_on_with_the_landing_is_left_alone() {
    let mut fixture = Fixture::start();
    fixture.send(SenderState::Steering);
    fixture.landing(1.0);
    // Two and a half times as long as between two landings of the guardian.
    for _ in 0..15 {
        fixture.send(SenderState::Landing);
        assert_eq!(fixture.packet(0.04), None);
    }
    fixture.send(SenderState::Over);
    assert_eq!(fixture.end.recv_timeout(Duration::from_secs(1)), Ok(WatchEnd::Over));
}

#[test]
#[ignore = "seconds of real time: in .ci/run all"]
fn a_sender_that_steers_on_is_landed_all_the_same() {
    let mut fixture = Fixture::start();
    fixture.send(SenderState::Steering);
    let since_s = fixture.landing(1.0);
    let mut landings = 0;
    while fixture.clock.now().seconds() < since_s + 1.0 {
        fixture.send(SenderState::Steering);
        landings += usize::from(fixture.packet(0.04).is_some_and(|(_, text)| text == "land"));
    }
    assert!(landings >= 2, "{landings} more in 1 s");
}

#[test]
fn every_heartbeat_is_answered_at_once_whatever_is_going_on() {
    let mut fixture = Fixture::start();
    for state in [SenderState::Idle, SenderState::Steering, SenderState::Landing] {
        fixture.send(state);
        assert_eq!(fixture.any_word(0.2), Some(HEARD), "{state:?}");
    }
    assert_eq!(fixture.any_word(1.0), Some(LANDING_ORDERED));
    fixture.send(SenderState::Landing);
    assert_eq!(fixture.any_word(0.2), Some(HEARD));
}

#[test]
fn a_sender_that_reads_nothing_does_not_hold_up_the_guardian() {
    let mut fixture = Fixture::start();
    fixture.sender.set_nonblocking(true).unwrap();
    for _ in 0..5_000 {
        fixture.sender.write_all(&[SenderState::Steering as u8]).ok();
        thread::yield_now();
    }
    fixture.landing(1.0);
}

#[test]
fn the_landing_is_reported_before_it_is_ordered() {
    let mut fixture = Fixture::start();
    fixture.send(SenderState::Steering);
    assert_eq!(fixture.any_word(0.2), Some(HEARD));
    fixture.packet(1.0).unwrap();
    fixture.sender.set_nonblocking(true).unwrap();
    let mut byte = [0];
    assert!(fixture.sender.read_exact(&mut byte).is_ok() && byte == [LANDING_ORDERED]);
}

#[test]
fn a_channel_that_closes_in_flight_lands_at_once() {
    for state in [SenderState::Steering, SenderState::Landing] {
        let mut fixture = Fixture::start();
        fixture.send(state);
        let since_s = fixture.clock.now().seconds();
        drop(std::mem::replace(&mut fixture.sender, UnixStream::pair().unwrap().0));
        let after_s = fixture.landing(1.0) - since_s;
        assert!(after_s < 0.2, "{state:?}: {after_s} s");
        assert_eq!(fixture.end.recv_timeout(Duration::from_secs(1)), Ok(WatchEnd::Abandoned));
    }
}

#[test]
#[ignore = "seconds of real time: in .ci/run all"]
fn without_a_drone_in_the_air_neither_silence_nor_an_end_sends_anything_to_it() {
    for last in [None, Some(SenderState::Idle), Some(SenderState::Over)] {
        let mut fixture = Fixture::start();
        for state in [SenderState::Steering, SenderState::Landing].into_iter().chain(last) {
            if last.is_some() {
                fixture.send(state);
            }
        }
        assert_eq!(fixture.packet(0.5), None, "{last:?}");
        drop(std::mem::replace(&mut fixture.sender, UnixStream::pair().unwrap().0));
        assert_eq!(
            fixture.end.recv_timeout(Duration::from_secs(1)),
            Ok(WatchEnd::Over),
            "{last:?}"
        );
        assert_eq!(fixture.packet(0.1), None, "{last:?}");
    }
}

#[test]
#[ignore = "15 s of real time: .ci/run all runs it"]
fn a_sender_that_stays_silent_is_given_up_after_15_s_and_its_end_is_reported() {
    let mut fixture = Fixture::start();
    fixture.send(SenderState::Steering);
    let first_s = fixture.landing(1.0);
    let mut last_s = first_s;
    for _ in 1..LANDINGS_MAX {
        last_s = fixture.landing(1.0);
    }
    assert!((14.5..17.0).contains(&(last_s - first_s)), "{}", last_s - first_s);
    assert_eq!(fixture.packet(0.6), None);
    drop(std::mem::replace(&mut fixture.sender, UnixStream::pair().unwrap().0));
    assert_eq!(fixture.end.recv_timeout(Duration::from_secs(1)), Ok(WatchEnd::OrderedLanding));
}

#[test]
fn a_timeout_and_a_signal_do_not_end_the_watch_and_other_errors_do() {
    for (kind, goes_on) in [
        (ErrorKind::WouldBlock, true),
        (ErrorKind::Interrupted, true),
        (ErrorKind::ConnectionReset, false),
        (ErrorKind::BrokenPipe, false),
    ] {
        assert_eq!(is_timeout_or_signal(&io::Error::from(kind)), goes_on, "{kind:?}");
    }
}
