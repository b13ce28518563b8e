use horizon_model::rows::pose;
use tello_io::tello::text::Field;

use super::*;
use crate::firmware::{CancelledBy, DroneTable, FlyingFlag, PLAIN};
use crate::world::World;
use crate::world::tests::table;
use crate::{Profile, SimStart, SimTable};

/// A drone without chance on the floor, and SDK mode.
struct Fixture {
    world: World,
    sdk: Sdk,
    replies: Vec<String>,
}

impl Fixture {
    fn new(version: SdkVersion, battery_pct: f64) -> Self {
        Self::of(PLAIN, version, battery_pct)
    }

    fn of(drone: DroneTable, version: SdkVersion, battery_pct: f64) -> Self {
        let start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.3 };
        let mut table =
            SimTable { profile: Profile::Clean, has_spread: false, start, battery_pct, ..table() };
        table.drone = drone;
        table.plant.disturbance_h_mps = 0.0;
        table.plant.disturbance_v_mps = 0.0;
        let world = World::new(&table, 1).unwrap();
        Self { world, sdk: Sdk::new(version, 0.3), replies: Vec::new() }
    }

    /// A drone that hovers after a take-off.
    fn hovering() -> Self {
        Self::hovering_as(|_| ())
    }

    /// One with other switches.
    fn hovering_as(change: impl FnOnce(&mut DroneTable)) -> Self {
        let mut drone = PLAIN;
        change(&mut drone);
        let mut fixture = Self::of(drone, SdkVersion::V1_3, 90.0);
        assert_eq!(fixture.run("takeoff"), "ok");
        fixture
    }

    fn send(&mut self, text: &str) -> Vec<String> {
        self.sdk.receive(text.as_bytes(), self.world.drone_mut(), &mut self.replies);
        std::mem::take(&mut self.replies)
    }

    fn wait(&mut self, steps: u32) -> Vec<String> {
        for _ in 0..steps {
            self.world.advance();
            self.sdk.advance(self.world.drone_mut(), &mut self.replies);
        }
        std::mem::take(&mut self.replies)
    }

    /// The first reply to `text`, at most 25 s later.
    fn run(&mut self, text: &str) -> String {
        let mut replies = self.send(text);
        for _ in 0..1_250 {
            if let Some(reply) = replies.pop() {
                return reply;
            }
            replies = self.wait(1);
        }
        panic!("no reply to {text}");
    }

    fn pose(&self) -> horizon_model::rows::Pose {
        self.world.truth().pose
    }

    fn state(&self, field: Field) -> Option<f64> {
        self.sdk.state_line(&self.world.reported()).get(field)
    }
}

#[test]
fn a_take_off_is_answered_at_the_hover_and_a_landing_on_the_floor() {
    let mut fixture = Fixture::new(SdkVersion::V1_3, 90.0);
    assert_eq!(fixture.send("command"), ["ok"]);
    assert_eq!(fixture.send("takeoff"), [""; 0]);
    assert_eq!(fixture.send("land"), [""; 0], "not heard early in a take-off");
    assert_eq!(fixture.wait(100), [""; 0]);
    assert_eq!(fixture.send("battery?"), [""; 0], "one command at a time");
    assert_eq!(fixture.send("takeoff"), ["error Not joystick"]);
    assert_eq!(fixture.wait(150), ["ok"]);
    assert!(fixture.pose()[pose::Z] > 0.8, "{:?}", fixture.pose());
    assert_eq!((fixture.state(Field::Time), fixture.state(Field::Bat)), (Some(4.0), Some(90.0)));
    assert_eq!(fixture.send("takeoff"), ["error"]);
    assert_eq!(fixture.send("land"), [""; 0]);
    assert_eq!(fixture.send("land"), [""; 0]);
    assert_eq!(fixture.wait(300), ["ok"]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Grounded);
    assert_eq!(fixture.state(Field::Tof), Some(10.0));
}

#[test]
fn movements_end_at_their_target() {
    let mut fixture = Fixture::hovering();
    fixture.wait(100);
    // Forward is where the nose points: theta is 0.3.
    let (sin, cos) = 0.3_f64.sin_cos();
    for (command, forward_m, left_m, up_m, turn_deg) in [
        ("forward 100", 1.0, 0.0, 0.0, 0.0),
        ("back 50", -0.5, 0.0, 0.0, 0.0),
        ("left 60", 0.0, 0.6, 0.0, 0.0),
        ("right 100", 0.0, -1.0, 0.0, 0.0),
        ("up 40", 0.0, 0.0, 0.4, 0.0),
        ("down 30", 0.0, 0.0, -0.3, 0.0),
        ("go 50 50 20 50", 0.5, 0.5, 0.2, 0.0),
        ("ccw 90", 0.0, 0.0, 0.0, 90.0),
        ("cw 90", 0.0, 0.0, 0.0, -90.0),
    ] {
        let before = fixture.pose();
        assert_eq!(fixture.run(command), "ok", "{command}");
        let moved = fixture.pose() - before;
        let forward = cos * moved[pose::X] + sin * moved[pose::Y];
        let left = cos * moved[pose::Y] - sin * moved[pose::X];
        let turned_deg = moved[pose::THETA].to_degrees();
        let errors = [forward - forward_m, left - left_m, moved[pose::Z] - up_m];
        assert!(errors.iter().all(|error| error.abs() < 0.15), "{command}: {errors:?} m");
        assert!((turned_deg - turn_deg).abs() < 6.0, "{command}: {turned_deg} degrees");
    }
}

#[test]
fn what_cannot_be_done_is_refused_in_the_words_of_the_sdk() {
    let mut fixture = Fixture::new(SdkVersion::V1_3, 90.0);
    assert_eq!(fixture.send("forward 30"), ["error Motor stop"]);
    assert_eq!(fixture.send("up 3"), ["out of range"]);
    assert_eq!(fixture.send("sdk?"), ["unknown command: sdk?"]);
    assert_eq!(fixture.send("port 8891 11111"), ["unknown command: port 8891 11111"]);
    assert_eq!(fixture.send("fly me"), ["unknown command: fly me"]);
    assert_eq!(fixture.send("rc 0 0 0 0"), [""; 0]);
    fixture.wait(20);
    assert_eq!(fixture.send("takeoff"), ["error Not joystick"], "0.4 s after sticks");
    fixture.wait(5);
    assert_eq!(fixture.send("takeoff"), [""; 0]);
    assert_eq!(Fixture::new(SdkVersion::V1_3, 9.0).send("takeoff"), ["error Motor stop"]);
    let mut later = Fixture::new(SdkVersion::V3_0, 90.0);
    assert_eq!(later.send("sdk?"), ["30"]);
    assert_eq!(later.send("port 8891 11111"), ["ok"]);
    assert_eq!(later.sdk.state_port, 8891);
}

#[test]
fn a_landing_ends_a_movement_and_an_emergency_stop_ends_everything() {
    let mut fixture = Fixture::hovering();
    assert_eq!(fixture.send("forward 300"), [""; 0]);
    fixture.wait(50);
    assert_eq!(fixture.send("forward 20"), ["error Not joystick"]);
    assert_eq!(fixture.send("land"), ["error Auto land"]);
    fixture.wait(10);
    assert_eq!(fixture.send("emergency"), [""; 0]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Falling);
    assert_eq!(fixture.wait(60), [""; 0]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Grounded);
}

#[test]
fn silence_lands_and_any_command_calls_it_off() {
    let mut fixture = Fixture::hovering();
    fixture.wait(575);
    assert!(
        matches!(fixture.world.truth().phase, DronePhase::Landing(_)),
        "{:?}",
        fixture.world.truth()
    );
    assert_eq!(fixture.send("battery?"), ["89"]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Flying);
}

#[test]
fn yaw_counts_clockwise_from_the_start_and_stays_within_half_a_turn() {
    let mut fixture = Fixture::hovering();
    assert_eq!(fixture.state(Field::Yaw), Some(0.0));
    fixture.run("cw 90");
    let yaw = fixture.state(Field::Yaw).unwrap();
    assert!((84.0..=96.0).contains(&yaw), "{yaw}");
    fixture.run("cw 180");
    let yaw = fixture.state(Field::Yaw).unwrap();
    assert!((-100.0..=-80.0).contains(&yaw), "{yaw}");
}

#[test]
fn an_emergency_or_a_landing_is_not_obeyed_or_refused() {
    let mut fixture = Fixture::hovering_as(|drone| drone.emergency.text = false);
    assert_eq!(fixture.send("emergency"), [""; 0]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Flying);

    let mut fixture = Fixture::hovering_as(|drone| drone.landing.is_refused = true);
    assert_eq!(fixture.send("land"), ["error"]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Flying);

    let mut fixture = Fixture::hovering_as(|drone| drone.landing.deaf_count = 1);
    assert_eq!(fixture.send("land"), [""; 0]);
    assert_eq!(fixture.world.truth().phase, DronePhase::Flying);
    assert_eq!(fixture.run("land"), "ok");
}

#[test]
fn sticks_call_a_landing_off_or_do_not() {
    for (cancelled_by, sticks, is_cancelled) in [
        (CancelledBy::Nothing, "rc 0 50 0 0", false),
        (CancelledBy::Deflection, "rc 0 0 0 0", false),
        (CancelledBy::Deflection, "rc 0 50 0 0", true),
        (CancelledBy::AnySticks, "rc 0 0 0 0", true),
    ] {
        let mut fixture = Fixture::hovering_as(|drone| drone.landing.cancelled_by = cancelled_by);
        assert_eq!(fixture.send("land"), [""; 0]);
        fixture.wait(10);
        fixture.send(sticks);
        let is_flying = fixture.world.truth().phase == DronePhase::Flying;
        assert_eq!(is_flying, is_cancelled, "{cancelled_by:?} {sticks}");
        let replies = fixture.wait(1);
        assert_eq!(replies, if is_cancelled { vec!["error"] } else { vec![] });
    }
}

#[test]
fn a_drone_that_reports_no_flight_counts_no_motor_time() {
    for (flying, expected_s) in [(FlyingFlag::Right, 4.0), (FlyingFlag::Standing, 0.0)] {
        let fixture = Fixture::hovering_as(|drone| drone.status.flying = flying);
        let time_s = fixture.world.truth().motor_s.trunc();
        assert!((time_s - 4.0).abs() < 1.1, "{time_s}");
        let reported_s = fixture.state(Field::Time).unwrap();
        assert!((reported_s - expected_s).abs() < 1.1, "{flying:?}: {reported_s} s");
    }
}

#[test]
fn a_flip_ends_where_it_began_and_video_is_refused() {
    let mut fixture = Fixture::hovering();
    let before = fixture.world.truth().pose;
    assert_eq!(fixture.send("flip f"), Vec::<String>::new());
    assert_eq!(fixture.wait(60), Vec::<String>::new(), "it takes its time");
    assert_eq!(fixture.wait(60), ["ok"]);
    assert!((fixture.world.truth().pose - before).norm() < 0.1);
    assert_eq!(fixture.run("flip up"), "unknown command: flip up");
    assert_eq!(fixture.run("streamon"), "error No video");
    assert_eq!(fixture.run("streamoff"), "ok");
    let mut standing = Fixture::new(SdkVersion::V3_0, 90.0);
    assert_eq!(standing.run("flip f"), "error Motor stop");
    assert_eq!(standing.run("ssid?"), "TELLO-SIM");
    assert_eq!(Fixture::new(SdkVersion::V2_0, 90.0).run("ssid?"), "unknown command: ssid?");
}

#[test]
fn the_attitude_has_the_heading() {
    let mut fixture = Fixture::hovering();
    assert_eq!(fixture.run("attitude?"), "pitch:0;roll:0;yaw:0;");
    assert_eq!(fixture.run("cw 90"), "ok");
    let reply = fixture.run("attitude?");
    let yaw = reply.strip_prefix("pitch:0;roll:0;yaw:").and_then(|rest| rest.strip_suffix(";"));
    let yaw: f64 = yaw.unwrap().parse().unwrap();
    assert!((yaw - 90.0).abs() < 5.0, "{reply}");
}
