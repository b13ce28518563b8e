mod bursts;
mod down_detection;
mod emergency_stop;
mod guard;
mod landing;
mod queries;
mod silence;
mod text;

use horizon_model::rows::Sticks;
use tello_flight::gate::{Gate, GateTable};

use self::bursts::Landings;
use super::*;
use crate::clock::CivilTime;
use crate::tello::protocol::{Action, DronePacket, FlightStatus, HostPacket};
use crate::tello::{DroneStatus, Protocol};

const VIDEO_PORT: u16 = 6038;

pub(super) fn ms(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

pub(super) fn approved(roll: f64) -> Approved {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 1.0 }, Protocol::Binary).unwrap();
    gate.pass(&Sticks::new(roll, 0.0, 0.0, 0.0), Some(0.0))
}

pub(super) fn bytes(packet: DronePacket) -> Vec<u8> {
    let mut bytes = Vec::new();
    packet.encode(&mut bytes);
    bytes
}

pub(super) fn status(is_flying: bool) -> Vec<u8> {
    bytes(DronePacket::Status { sequence: 0, status: FlightStatus::new(is_flying) })
}

/// A session and the story of what it sent, but for its questions and the LANDs that only a burst adds.
struct Fixture {
    session: Session,
    sent: Vec<(i64, Sent)>,
    landings: Landings,
}

/// A packet, without what is of no interest here.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sent {
    ConnReq,
    Roll(f64),
    Order(DroneOrder, u16),
    EmergencyStop,
    Limit(u16, u16),
    Answer,
}

impl Fixture {
    fn new(is_dry_run: bool) -> Self {
        let counters = Arc::new(LinkCounters::default());
        let session = Session::binary(0, None, is_dry_run, counters);
        Self { session, sent: Vec::new(), landings: Landings::default() }
    }

    /// A fixture whose drone reports at 0 ms that it stands.
    fn standing() -> Self {
        let mut fixture = Self::connected();
        fixture.receive(0, &status(false));
        fixture
    }

    /// A fixture whose drone has acknowledged the connection at 0 ms.
    fn connected() -> Self {
        let mut fixture = Self::new(false);
        fixture.run(0, 0);
        fixture.receive(0, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
        fixture.sent.clear();
        fixture
    }

    /// Takes what is to be sent. Neutral sticks and the LAND directly behind them are one entry.
    fn note(&mut self, now_ms: i64) {
        for packet in self.session.drain() {
            let Message::Binary(packet) = packet else { panic!("text in the binary protocol") };
            let sent = match packet {
                HostPacket::ConnReq { .. } => Sent::ConnReq,
                HostPacket::Sticks { u, is_fast: false, .. } => {
                    Sent::Roll(u[horizon_model::rows::stick::ROLL])
                }
                HostPacket::Action { action: Action::TakeOff, sequence } => {
                    Sent::Order(DroneOrder::TakeOff, sequence)
                }
                HostPacket::Action { action: Action::Land, sequence } => {
                    self.sent.pop_if(|before| *before == (now_ms, Sent::Roll(0.0)));
                    if !self.landings.keep(now_ms) {
                        continue;
                    }
                    Sent::Order(DroneOrder::Land, sequence)
                }
                HostPacket::EmergencyStop => Sent::EmergencyStop,
                HostPacket::AltitudeLimit { limit_m, sequence } => Sent::Limit(limit_m, sequence),
                HostPacket::Query { .. } => continue,
                _ => Sent::Answer,
            };
            self.sent.push((now_ms, sent));
        }
    }

    /// Wakes the session at its deadlines, as the socket task does.
    fn run(&mut self, from_ms: i64, to_ms: i64) {
        for now_ms in from_ms..=to_ms {
            if ms(now_ms) >= self.session.next_deadline() {
                self.session.advance(ms(now_ms));
                let next = self.session.next_deadline();
                assert!(next > ms(now_ms), "{next:?} at {now_ms} ms would keep the task busy");
            }
            self.note(now_ms);
        }
    }

    fn receive(&mut self, now_ms: i64, datagram: &[u8]) -> Option<DroneStatus> {
        let status = self.session.receive(datagram, ms(now_ms));
        self.note(now_ms);
        status
    }

    /// Both sources report that the drone is down.
    fn stand(&mut self, now_ms: i64) {
        self.observe_pose(now_ms, Some(false));
        self.receive(now_ms, &status(false));
    }

    fn approve(&mut self, now_ms: i64, roll: f64) {
        self.session.approve(approved(roll), ms(now_ms), ms(now_ms));
        self.note(now_ms);
    }

    fn order(&mut self, now_ms: i64, order: DroneOrder) {
        self.session.order(order, ms(now_ms));
        self.note(now_ms);
    }

    fn observe_pose(&mut self, now_ms: i64, is_airborne: Option<bool>) {
        self.session.observe_pose(is_airborne, ms(now_ms));
        self.note(now_ms);
    }

    fn times(&self, wanted: impl Fn(Sent) -> bool) -> Vec<i64> {
        self.sent.iter().filter(|(_, sent)| wanted(*sent)).map(|(now_ms, _)| *now_ms).collect()
    }
}

fn is_roll(sent: Sent) -> bool {
    matches!(sent, Sent::Roll(_))
}

fn is_landing(sent: Sent) -> bool {
    matches!(sent, Sent::Order(DroneOrder::Land, _))
}

#[test]
fn a_connection_is_asked_for_every_2_s_until_it_is_acknowledged() {
    let mut fixture = Fixture::new(false);
    fixture.run(0, 9_000);
    assert_eq!(fixture.times(|sent| sent == Sent::ConnReq), [0, 2_000, 4_000, 6_000, 8_000]);
    assert!(!fixture.session.counters.is_connected());
    fixture.receive(9_001, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    assert!(fixture.session.counters.is_connected());
    fixture.sent.clear();
    fixture.run(9_002, 11_000);
    assert_eq!(fixture.sent, []);
}

#[test]
fn a_silent_drone_is_lost_after_2_s_and_asked_for_again() {
    let mut fixture = Fixture::connected();
    fixture.run(0, 1_500);
    fixture.receive(1_500, &status(true));
    fixture.run(1_500, 3_499);
    assert!(fixture.session.counters.is_connected());
    assert_eq!(fixture.sent, []);
    fixture.run(3_500, 6_000);
    assert!(!fixture.session.counters.is_connected());
    assert_eq!(fixture.times(|sent| sent == Sent::ConnReq), [3_500, 5_500]);
}

#[test]
fn new_sticks_go_at_once_and_are_repeated_every_20_ms() {
    let mut fixture = Fixture::connected();
    fixture.approve(7, 0.5);
    fixture.run(7, 60);
    fixture.approve(61, -0.5);
    fixture.run(61, 81);
    let expected = [(7, 0.5), (27, 0.5), (47, 0.5), (61, -0.5), (81, -0.5)];
    assert_eq!(fixture.sent, expected.map(|(at, roll)| (at, Sent::Roll(roll))));
}

#[test]
fn sticks_wait_for_the_first_connection_but_outlive_a_silent_downlink() {
    let mut fixture = Fixture::new(false);
    fixture.approve(0, 0.5);
    fixture.run(0, 90);
    assert_eq!(fixture.times(is_roll), [0; 0]);
    fixture.receive(90, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    for now_ms in (100..4_000).step_by(20) {
        fixture.approve(now_ms, 0.5);
    }
    assert_eq!(fixture.times(is_roll).len(), 195, "one per approval, lost downlink or not");
}

#[test]
fn a_take_off_is_sent_once_and_followed_by_sticks() {
    let mut fixture = Fixture::standing();
    fixture.order(10, DroneOrder::TakeOff);
    fixture.run(10, 40);
    fixture.approve(50, 0.5);
    let expected =
        [(10, Sent::Order(DroneOrder::TakeOff, 1)), (30, Sent::Roll(0.0)), (50, Sent::Roll(0.5))];
    assert_eq!(fixture.sent, expected);
}

fn take_offs(fixture: &Fixture) -> Vec<i64> {
    fixture.times(|sent| matches!(sent, Sent::Order(DroneOrder::TakeOff, _)))
}

#[test]
fn a_take_off_that_was_lost_is_sent_again_only_to_a_drone_that_reports_standing() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.order(2_600, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0], "it has not sent for 2 s that it stands");
    fixture.receive(2_700, &status(false));
    fixture.order(2_700, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0, 2_700], "it was not even acknowledged");
    fixture.receive(2_800, &bytes(DronePacket::Ack { action: Action::TakeOff, sequence: 2 }));
    fixture.receive(60_000, &status(false));
    fixture.order(60_000, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0, 2_700], "acknowledged, so it was not lost");
}

#[test]
fn a_drone_in_the_air_is_never_ordered_to_take_off() {
    let mut first = Fixture::connected();
    first.receive(0, &status(true));
    first.order(1, DroneOrder::TakeOff);
    let mut again = Fixture::standing();
    again.order(0, DroneOrder::TakeOff);
    for now_ms in 1..20_000 {
        again.approve(now_ms, 0.0);
        again.receive(now_ms, &status(now_ms > 500));
        again.order(now_ms, DroneOrder::TakeOff);
    }
    assert_eq!((take_offs(&first), take_offs(&again)), (vec![], vec![0]));
}

#[test]
fn only_a_drone_that_reports_now_that_it_stands_is_ordered_to_take_off() {
    let mut fixture = Fixture::connected();
    fixture.order(10, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0; 0], "it has not sent anything");
    fixture.receive(20, &status(true));
    fixture.receive(30, &status(false));
    fixture.order(2_031, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0; 0], "2 s ago it stood");
    fixture.receive(2_100, &status(false));
    fixture.receive(2_200, &status(true));
    fixture.order(2_201, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [0; 0], "it flies");
    fixture.receive(2_300, &status(false));
    fixture.order(4_300, DroneOrder::TakeOff);
    assert_eq!(take_offs(&fixture), [4_300]);
}

#[test]
fn a_drone_whose_acknowledgement_is_lost_but_that_reports_is_steered() {
    let mut fixture = Fixture::new(false);
    fixture.run(0, 0);
    fixture.receive(5, &status(false));
    assert!(fixture.session.counters.is_connected());
    fixture.approve(10, 0.5);
    assert_eq!(fixture.times(is_roll), [10]);
    for now_ms in (100..5_000).step_by(100) {
        fixture.receive(now_ms, &status(false));
        fixture.run(now_ms, now_ms + 99);
    }
    assert_eq!(fixture.times(|sent| sent == Sent::ConnReq), [0], "it knows us");
}

#[test]
fn a_drone_that_starts_anew_in_flight_is_asked_for_and_not_steered_on_by_old_sticks() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    for now_ms in (0..3_000).step_by(20) {
        fixture.approve(now_ms, 0.5);
        fixture.run(now_ms, now_ms + 19);
    }
    let requests = |fixture: &Fixture| fixture.times(|sent| sent == Sent::ConnReq);
    assert_eq!(requests(&fixture), [2_000], "silent while it starts");
    fixture.receive(3_000, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    fixture.stand(3_001);
    fixture.order(3_002, DroneOrder::Land);
    fixture.run(3_002, 4_900);
    assert_eq!(fixture.times(is_landing), [3_002], "it stands");
}

#[test]
fn an_altitude_limit_is_repeated_on_the_way_until_it_is_confirmed() {
    let mut fixture = Fixture::new(false);
    let counters = Arc::clone(&fixture.session.counters);
    fixture.session = Session::binary(0, Some(3), false, counters);
    fixture.run(0, 0);
    fixture.receive(0, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    for now_ms in (100..=2_400).step_by(100) {
        fixture.receive(now_ms, &status(false));
        fixture.run(now_ms, now_ms + 99);
    }
    assert_eq!(fixture.sent[1..], [(0, Sent::Limit(3, 1)), (2_000, Sent::Limit(3, 2))]);
    let setting = crate::tello::protocol::Setting::AltitudeLimit;
    fixture.receive(2_500, &bytes(DronePacket::SettingAck { setting, sequence: 2 }));
    for now_ms in (2_500..=8_000).step_by(100) {
        fixture.receive(now_ms, &status(false));
        fixture.run(now_ms, now_ms + 99);
    }
    assert_eq!(fixture.sent.len(), 3, "{:?}", fixture.sent);
}

#[test]
fn only_the_newest_order_is_acknowledged() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    let acks = |fixture: &Fixture| fixture.session.counters.acks.get();
    fixture.receive(5, &bytes(DronePacket::Ack { action: Action::TakeOff, sequence: 9 }));
    fixture.receive(6, &bytes(DronePacket::Ack { action: Action::Land, sequence: 1 }));
    assert_eq!(acks(&fixture), 0);
    fixture.receive(7, &bytes(DronePacket::Ack { action: Action::TakeOff, sequence: 1 }));
    fixture.receive(8, &bytes(DronePacket::Ack { action: Action::TakeOff, sequence: 1 }));
    assert_eq!(acks(&fixture), 1);
}

#[test]
fn a_dry_run_talks_but_neither_steers_nor_orders() {
    let mut fixture = Fixture::new(true);
    fixture.run(0, 0);
    fixture.receive(0, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    fixture.receive(0, &status(false));
    fixture.order(1, DroneOrder::TakeOff);
    for now_ms in 2..1_500 {
        fixture.approve(now_ms, 0.5);
    }
    fixture.order(1_500, DroneOrder::Land);
    fixture.receive(1_600, &bytes(DronePacket::DateTimeRequest { sequence: 0 }));
    fixture.run(1_600, 1_900);
    assert_eq!(fixture.sent, [(0, Sent::ConnReq), (1_600, Sent::Answer)]);
    assert_eq!(fixture.session.counters.sticks.get() + fixture.session.counters.orders.get(), 0);
}

#[test]
fn the_drones_questions_are_answered() {
    let mut fixture = Fixture::new(false);
    let utc_start_ns = 1_795_249_366_000_000_000;
    let counters = Arc::clone(&fixture.session.counters);
    fixture.session = Session::binary(utc_start_ns, None, false, counters);
    fixture.session.receive(&bytes(DronePacket::DateTimeRequest { sequence: 4 }), ms(500));
    let header = DronePacket::LogHeader { sequence: 5, header_id: 0x1234 };
    fixture.session.receive(&bytes(header), ms(500));
    let answers: Vec<_> = fixture.session.drain().collect();
    let time = CivilTime::from_unix_ns(utc_start_ns + 500_000_000);
    let expected = [
        Message::Binary(HostPacket::DateTime { sequence: 4, time }),
        Message::Binary(HostPacket::LogHeaderAck { sequence: 5, header_id: 0x1234 }),
    ];
    assert_eq!(answers, expected);
}

#[test]
fn a_status_is_handed_on_with_its_time_and_garbage_is_counted() {
    let mut fixture = Fixture::connected();
    let flight = FlightStatus { battery_pct: 87, height_dm: 12, ..FlightStatus::new(true) };
    let sent = bytes(DronePacket::Status { sequence: 3, status: flight });
    let status = fixture.receive(20, &sent).unwrap();
    assert_eq!((status.received_at, status.battery_pct), (ms(20), 87));
    assert_eq!(status.height_m, Some(12.0 * 0.1));
    assert!(status.is_flying && !status.is_on_ground && status.is_battery_low == Some(false));
    assert_eq!(fixture.receive(21, b"ok"), None);
    assert_eq!(fixture.receive(22, &sent[..20]), None);
    // A frame of a message that is not read shows that the drone is there.
    assert_eq!(fixture.receive(1_900, b"\xcc\x58\x00\x7c\x48\x45\x00\x06\x00\xe9\x62"), None);
    fixture.run(1_900, 3_000);
    let counters = &fixture.session.counters;
    assert_eq!((counters.malformed.get(), counters.packets.get()), (2, 3));
    assert!(counters.is_connected());
}
