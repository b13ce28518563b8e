//! Status and pose: who has to agree that the drone is down.

use super::*;

/// How the landings of 20 s go on when status and pose report these of every moment: `Some(true)` in the air,
/// `None` nothing. The drone is ordered to land at 0 ms.
fn landings(
    is_text: bool,
    reported: impl Fn(i64) -> Option<bool>,
    sees: impl Fn(i64) -> Option<bool>,
) -> Vec<i64> {
    let counters = Arc::new(LinkCounters::default());
    let mut session = if is_text {
        Session::text(8890, false, counters)
    } else {
        Session::binary(0, None, false, counters)
    };
    session.order(DroneOrder::Land, ms(0));
    let (mut landings, mut times) = (Vec::new(), Landings::default());
    for now_ms in 0..20_000 {
        if now_ms % 20 == 0 {
            session.observe_pose(sees(now_ms), ms(now_ms));
        }
        if now_ms % 100 == 0
            && let Some(is_flying) = reported(now_ms)
        {
            receive(&mut session, is_text, is_flying, now_ms);
        }
        if ms(now_ms) >= session.next_deadline() {
            session.advance(ms(now_ms));
        }
        let has_landed = session.drain().any(|message| is_land(&message));
        landings.extend((has_landed && times.keep(now_ms)).then_some(now_ms));
    }
    landings
}

/// A status of a drone; in the text SDK one whose lines do not count the motors' seconds, since these
/// show 3 s late.
fn receive(session: &mut Session, is_text: bool, is_flying: bool, now_ms: i64) {
    let status = if is_text {
        let line = format!("tof:{};bat:80;", if is_flying { 80 } else { 10 });
        session.receive_state(line.as_bytes(), ms(now_ms))
    } else {
        session.receive(&status(is_flying), ms(now_ms))
    };
    assert_eq!(status.map(|status| status.is_flying), Some(is_flying));
}

fn is_land(message: &Message) -> bool {
    matches!(
        message,
        Message::Binary(HostPacket::Action { action: Action::Land, .. })
            | Message::Text(crate::tello::text::Command::Land)
    )
}

/// Every 0.5 s from 0 ms on, none after `end_ms`.
fn until(end_ms: i64) -> Vec<i64> {
    (0..=end_ms).step_by(500).collect()
}

#[test]
fn a_landing_ends_when_both_sources_report_down_and_by_one_alone_10_s_later() {
    let down_from = |from_ms| move |now_ms| Some(now_ms < from_ms);
    let silent = |_| None;
    for is_text in [false, true] {
        assert_eq!(landings(is_text, down_from(3_100), silent), until(13_000), "status alone");
        assert_eq!(landings(is_text, silent, down_from(3_100)), until(13_000), "pose alone");
        let both = landings(is_text, down_from(3_100), down_from(4_100));
        assert_eq!(both, until(4_000), "the pose is last");
        let both = landings(is_text, down_from(4_100), down_from(3_100));
        assert_eq!(both, until(4_000), "the status is last");
        let late = |now_ms| (now_ms >= 5_100).then_some(false);
        assert_eq!(landings(is_text, down_from(3_100), late), until(5_000), "the pose comes back");
        assert_eq!(landings(is_text, silent, silent), until(19_999), "no source");
        let denies = landings(is_text, |_| Some(false), |_| Some(true));
        assert_eq!(denies, until(19_999), "it denies the flight while the pose hovers");
        let sticks = landings(is_text, |_| Some(true), |_| Some(false));
        assert_eq!(sticks, until(19_999), "it reports flying while the pose stands");
    }
}

#[test]
fn a_pose_in_the_air_holds_for_2_s_of_lost_mocap_and_one_on_the_floor_for_half_a_second() {
    let denies = |_| Some(false);
    let lost_in_the_air = |now_ms| (now_ms < 3_000).then_some(true);
    assert_eq!(landings(false, denies, lost_in_the_air), until(14_500), "10 s from 4.98 s on");
    // Both agree for 0.3 s of the 0.5 s.
    let floor_once = |now_ms| (now_ms == 3_000).then_some(false);
    assert_eq!(landings(false, denies, floor_once), until(3_000));
    // The status ends with the poses: no source is left.
    assert_eq!(landings(false, |_| None, floor_once), until(19_999));
    let flies = |now_ms| (now_ms < 2_000).then_some(true);
    let landings = landings(false, flies, |now_ms| (now_ms == 3_000).then_some(false));
    assert_eq!(landings, until(19_999), "its status counts until 3.9 s, the pose until 3.5 s");
}

#[test]
fn one_pose_on_the_floor_ends_no_landing() {
    let outlier = |now_ms| Some(now_ms != 3_000);
    assert_eq!(landings(false, |_| None, outlier), until(19_999));
    assert_eq!(landings(true, |_| Some(false), outlier), until(19_999));
}

#[test]
fn a_status_that_stands_in_the_air_by_its_own_height_is_no_source() {
    // Ground, flight and landing by the height of the status. dm
    for (ground_dm, last_dm, sees_floor, end_ms) in [
        (2, 13, false, 39_999),
        (2, 7, false, 39_999),
        (2, 6, false, 19_999),
        // With the pose on the floor it decides alone, or both.
        (2, 13, true, 20_000),
        (2, 6, true, 10_000),
        // A height that never rises denies nothing.
        (0, 0, false, 19_999),
    ] {
        for is_text in [false, true] {
            let ends_ms = last_landing(is_text, [ground_dm, last_dm], sees_floor);
            assert_eq!(ends_ms / 500, end_ms / 500, "{ground_dm}, {last_dm}, {sees_floor}");
        }
    }
}

/// The last landing of a drone that took off at 0 s, was ordered to land at 10 s and reports that it stands from
/// then on, with these heights on the ground and then. dm
fn last_landing(is_text: bool, [ground_dm, last_dm]: [i16; 2], sees_floor: bool) -> i64 {
    let counters = Arc::new(LinkCounters::default());
    let mut session = if is_text {
        Session::text(8890, false, counters)
    } else {
        Session::binary(0, None, false, counters)
    };
    let mut last_ms = 0;
    for now_ms in (0..40_000).step_by(20) {
        let (is_flying, height_dm) = match now_ms {
            0 => (false, ground_dm),
            1..10_000 => (true, last_dm),
            _ => (false, last_dm),
        };
        let datagram = if is_text {
            let tof_cm = if is_flying { 80 } else { 10 };
            format!("tof:{tof_cm};h:{};bat:80;", height_dm * 10).into_bytes()
        } else {
            let status = FlightStatus { height_dm, ..FlightStatus::new(is_flying) };
            bytes(DronePacket::Status { sequence: 0, status })
        };
        let status = if is_text {
            session.receive_state(&datagram, ms(now_ms))
        } else {
            session.receive(&datagram, ms(now_ms))
        };
        assert_eq!(status.and_then(|status| status.height_m), Some(f64::from(height_dm) * 0.1));
        match now_ms {
            0 => session.order(DroneOrder::TakeOff, ms(now_ms)),
            10_000 => session.order(DroneOrder::Land, ms(now_ms)),
            1..10_000 => session.approve(approved(0.5), ms(now_ms), ms(now_ms)),
            _ => session.observe_pose(sees_floor.then_some(false), ms(now_ms)),
        }
        session.advance(ms(now_ms));
        if session.drain().any(|message| is_land(&message)) {
            last_ms = now_ms;
        }
    }
    last_ms
}

#[test]
fn a_landing_is_resumed_when_the_pose_comes_back_in_the_air() {
    // Without mocap the status decides; it lies.
    let back = |now_ms| (now_ms >= 15_000).then_some(true);
    let resumed: Vec<_> = until(9_999).into_iter().chain((15_000..20_000).step_by(500)).collect();
    for is_text in [false, true] {
        assert_eq!(landings(is_text, |_| Some(false), back), resumed);
    }
    // Not more often than any landing, however often the source changes its report.
    let flickers = |now_ms: i64| Some(now_ms % 1_000 < 400);
    let landings = landings(false, |_| Some(false), flickers);
    assert!(landings.windows(2).all(|pair| pair[1] - pair[0] >= 500), "{landings:?}");
    assert!(landings.len() > 15, "{landings:?}");
}

#[test]
fn a_stop_lands_a_drone_that_only_its_own_word_puts_on_the_ground() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.receive(1_000, &status(true));
    for now_ms in (20..10_000).step_by(20) {
        fixture.approve(now_ms, 0.5);
    }
    fixture.receive(10_000, &status(false));
    fixture.session.stop(ms(10_000));
    for now_ms in (10_000..20_000).step_by(100) {
        fixture.receive(now_ms, &status(false));
        fixture.run(now_ms, now_ms + 99);
        assert!(!fixture.session.is_over(ms(now_ms)), "{now_ms} ms");
        assert_eq!(
            fixture.session.sender_state(ms(now_ms)),
            crate::tello::guardian::SenderState::Landing
        );
    }
    fixture.receive(20_000, &status(false));
    assert!(fixture.session.is_over(ms(20_000)));
    assert_eq!(fixture.times(is_landing), (10_000..20_000).step_by(500).collect::<Vec<_>>());
}

#[test]
fn after_the_stop_a_drone_that_was_seen_in_the_air_is_landed_for_15_s() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    for now_ms in (0..10_000).step_by(20) {
        fixture.approve(now_ms, 0.5);
        fixture.observe_pose(now_ms, Some(true));
    }
    fixture.session.stop(ms(10_000));
    for now_ms in 10_000..25_000 {
        // No pose from here on: the control thread is gone.
        if now_ms % 100 == 0 {
            fixture.receive(now_ms, &status(false));
        }
        fixture.run(now_ms, now_ms);
        assert!(!fixture.session.is_over(ms(now_ms)), "{now_ms} ms");
    }
    assert!(fixture.session.is_over(ms(25_000)));
    let expected: Vec<_> = (10_000..25_000).step_by(500).collect();
    assert_eq!(fixture.times(is_landing), expected);
}

#[test]
fn a_stop_with_a_pose_on_the_floor_waits_for_it_only() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.approve(6_000, 0.5);
    fixture.receive(6_000, &status(false));
    fixture.observe_pose(6_000, Some(true));
    fixture.session.stop(ms(6_000));
    for now_ms in (6_000..8_000).step_by(20) {
        fixture.observe_pose(now_ms, Some(now_ms < 7_000));
        fixture.run(now_ms, now_ms + 19);
        assert_eq!(fixture.session.is_over(ms(now_ms)), now_ms >= 7_300, "{now_ms} ms");
    }
}

#[test]
fn a_drone_that_is_carried_before_the_flight_is_not_landed_by_the_stop() {
    let mut fixture = Fixture::standing();
    fixture.approve(10, 0.0);
    fixture.observe_pose(20, Some(true));
    fixture.receive(20, &status(false));
    fixture.session.stop(ms(30));
    assert!(fixture.session.is_over(ms(30)));
    // Sticks that deflect may have flown it, whatever it reports.
    let mut fixture = Fixture::standing();
    fixture.approve(10, 0.1);
    fixture.observe_pose(20, Some(true));
    fixture.receive(20, &status(false));
    fixture.session.stop(ms(30));
    fixture.note(30);
    assert!(!fixture.session.is_over(ms(30)));
    assert_eq!(fixture.times(is_landing), [30]);
}

#[test]
fn a_drone_that_was_last_heard_standing_and_never_flew_does_not_hold_up_the_stop() {
    let mut fixture = Fixture::standing();
    for now_ms in (10..5_000).step_by(20) {
        fixture.approve(now_ms, 0.0);
    }
    fixture.session.stop(ms(5_000));
    assert!(fixture.session.is_over(ms(5_000)), "switched off meanwhile");
}

#[test]
fn a_pose_in_the_air_counts_for_2_s_after_it_was_lost() {
    let mut fixture = Fixture::connected();
    let airborne = |fixture: &Fixture, now_ms| fixture.session.sources.is_airborne(ms(now_ms));
    fixture.observe_pose(1_000, Some(true));
    fixture.observe_pose(2_999, None);
    assert_eq!(airborne(&fixture, 2_999), Some(true));
    fixture.observe_pose(3_000, None);
    assert_eq!(airborne(&fixture, 3_000), None);
}
