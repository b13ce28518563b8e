use horizon_estim::MheError;
use horizon_model::rows::Pose;
use horizon_model::{Kinematic, Model};
use tello_flight::Start;
use tello_flight::cycle::{Outcome, Solve};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::config;

use super::*;

fn tally(pipeline: Pipeline) -> Tally {
    let (table, mission) = config::fly(None, None).unwrap();
    let mut flight = config::flight(&table, mission, Start::Airborne);
    flight.cycle.pipeline = pipeline;
    Tally::new(&flight).unwrap()
}

/// A tick whose newest frame arrived 3 ms before it began, and whose sticks were sent 2 ms after that.
fn tick() -> TickRecord {
    let out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 1);
    let mut tick = TickRecord::with_buffers(&out);
    tick.inbox.now = TimeNs(0).after(SpanNs::from_ms(103));
    let at = TimeNs(0).after(SpanNs::from_ms(100));
    let pose = Some(Pose::zeros());
    tick.inbox.sightings.push(Sighting { frame: 1, measured_at: at, received_at: at, pose });
    tick.timing.sent_ns = 2_000_000;
    (tick.timing.estimate_ns, tick.timing.plan_ns) = (1_000_000, 250_000);
    tick
}

fn solve() -> Solve {
    Err(MheError::NotStarted).into()
}

#[test]
fn a_tick_is_late_beyond_five_milliseconds() {
    let mut tally = tally(Pipeline::SameTick);
    for late_ns in [0, 5_000_000, 5_000_001] {
        let mut tick = tick();
        tick.timing.late_ns = late_ns;
        tick.inbox.skipped = 2;
        tally.add(&tick);
    }
    let summary = tally.summary();
    assert_eq!((summary.ticks, summary.late_ticks, summary.missed_periods), (3, 1, 6));
    let line = "\nticks         3, 1 more than 5 ms late, 6 periods missed\n";
    assert!(summary.to_string().contains(line), "{summary}");
}

#[test]
fn time_by_hand_in_flight_is_named() {
    let mut tally = tally(Pipeline::SameTick);
    for (phase, is_by_hand) in [
        (Phase::Flying, false),
        (Phase::Flying, true),
        (Phase::Flying, true),
        (Phase::Landing, true),
    ] {
        tally.add_hand(phase, is_by_hand);
    }
    let summary = tally.summary();
    assert!(summary.to_string().contains("\nby hand       0.04 s in flight\n"), "{summary}");
    assert!(!Summary::default().to_string().contains("by hand"));
}

#[test]
fn an_answer_is_as_old_as_its_frame_when_the_sticks_are_at_the_socket() {
    for (pipeline, expected_ms) in
        [(Pipeline::SameTick, Some([5.5; 4])), (Pipeline::NextTick, None)]
    {
        let mut tally = tally(pipeline);
        let mut first = tick();
        (first.out.controller, first.out.estimator) = (Some(solve()), Some(solve()));
        tally.add(&first);
        assert_eq!(tally.summary().answer_ms, None, "the way is known a tick later");
        let mut second = tick();
        second.timing.socket_latency_ns = 500_000;
        tally.add(&second);
        tally.add(&tick());
        let summary = tally.summary();
        assert_eq!(summary.answer_ms, expected_ms, "{pipeline:?}");
        assert_eq!(summary.solve_ms, Some([1.25; 4]), "of the tick with both");
    }
}

#[test]
fn a_spread_of_nothing_is_none_and_ends_with_the_largest() {
    assert_eq!(quantiles(&[], SPREAD), None);
    let values: Vec<f64> = (0..=1000).rev().map(f64::from).collect();
    assert_eq!(quantiles(&values, SPREAD), Some([500.0, 950.0, 999.0, 1000.0]));
}

/// The summary of a flight that ended so.
fn summary(phase: Phase, faults: &[Fault]) -> Summary {
    let summary = tally(Pipeline::SameTick).summary();
    Summary { phase, faults: faults.to_vec(), targets_reached: summary.targets_count, ..summary }
}

#[test]
fn a_flight_is_a_success_if_it_landed_after_its_last_target() {
    let landed = summary(Phase::Landed, &[]);
    assert!(landed.is_success() && landed.is_complete() && landed.targets_count > 0);
    let without_log = Summary { log_error: Some("disk full".to_owned()), ..landed.clone() };
    assert!(without_log.is_success() && !without_log.is_complete());
    let with_gaps = Summary { records_dropped: 1, ..landed.clone() };
    assert!(with_gaps.is_success() && !with_gaps.is_complete());
    assert!(!summary(Phase::LandingUnconfirmed, &[]).is_success());
    let by_fault = Summary { ended_by: vec![Fault::FenceLeft], ..landed.clone() };
    assert!(!by_fault.is_success());
    let text = by_fault.to_string();
    let lines: Vec<&str> = text.lines().take(2).collect();
    assert!(lines[0].contains("landed (outside of the room), "), "{text}");
    assert!(lines[1].starts_with("likely causes the mission is near a wall"), "{text}");
    let targets_reached = landed.targets_count - 1;
    assert!(!Summary { targets_reached, ..landed }.is_success());
}

#[test]
fn a_dry_run_needs_no_target_and_is_ended_by_a_person() {
    for (phase, fault, is_success) in [
        (Phase::Landed, Fault::OperatorStop, true),
        (Phase::Landed, Fault::MocapLost, false),
        (Phase::Idle, Fault::OperatorStop, false),
    ] {
        let flight = summary(phase, &[fault]);
        let ended_by = vec![fault];
        let dry = Summary { is_dry_run: true, targets_reached: 0, ended_by, ..flight };
        assert_eq!(dry.is_success(), is_success, "{phase:?}, {fault:?}");
        let text = dry.to_string();
        let reason = if fault == Fault::MocapLost { " (mocap lost)" } else { "" };
        let first = text.lines().next().unwrap();
        assert_eq!(first, format!("result        dry run ended{reason}"), "{text}");
    }
}

#[test]
fn targets_count_that_the_log_could_not_take() {
    let end = LoopEnd { targets_reached: 3, records_dropped: 400, ..LoopEnd::default() };
    let (mocap, drone) = (MocapCounters::default(), LinkCounters::default());
    let summary = tally(Pipeline::SameTick).summary().with_end(&end, &mocap, "tello", &drone);
    assert_eq!((summary.targets_reached, summary.records_dropped), (3, 400));
}

#[test]
fn a_landing_that_one_source_alone_reports_says_so() {
    let first = |faults: &[Fault]| {
        let text = summary(Phase::Landed, faults).to_string();
        text.lines().next().unwrap().to_owned()
    };
    let count = summary(Phase::Landed, &[]).targets_count;
    let end = format!(", {count} of {count} targets");
    assert_eq!(first(&[]), format!("result        landed{end}"));
    let by_pose = first(&[Fault::LandedByPose, Fault::LandedByDrone]);
    assert!(by_pose.contains("landed by the pose alone;") && by_pose.ends_with(&end), "{by_pose}");
    let by_drone = first(&[Fault::BatteryLow, Fault::LandedByDrone]);
    assert!(by_drone.contains("landed by the drone alone;"), "{by_drone}");
}

#[test]
fn only_trouble_has_a_line_of_its_own() {
    let calm = summary(Phase::Landed, &[]).to_string();
    for name in [
        "faults",
        "link down",
        "links",
        "log gaps",
        "INCOMPLETE",
        "firmware",
        "refusal",
        "MHE + MPC",
    ] {
        assert!(!calm.contains(name), "{calm}");
    }
    let links = Links { orders_lost: 3, ..Links::default() };
    let trouble = Summary {
        links,
        records_dropped: 4,
        log_error: Some("disk full".to_owned()),
        refusal: Some("error Motor stop".to_owned()),
        outages: Outages { count: 2, down_s: 1.5 },
        ..summary(Phase::LandingUnconfirmed, &[Fault::BatteryLow])
    };
    let text = trouble.to_string();
    for line in [
        "faults        battery low\n",
        "link down     2 times, 1.50 s together\n",
        "guardian 0 landings, 0 lost; 3 orders lost\n",
        "refusal       error Motor stop\n",
        "log gaps      4 ticks could not be recorded\n",
        "log           INCOMPLETE: disk full\n",
    ] {
        assert!(text.contains(line), "no {line:?} in {text}");
    }
}

#[test]
fn headings_that_are_refused_beside_good_positions_are_the_reason_of_lost_poses() {
    use tello_flight::{Acceptance, Filtered};
    let hidden = |is_lost: bool, refused: usize, accepted: usize| {
        let mut tally = tally(Pipeline::SameTick);
        let refused = std::iter::repeat_n(Acceptance::Held, refused);
        for heading in refused.chain(std::iter::repeat_n(Acceptance::Accepted, accepted)) {
            let mut tick = tick();
            let position = Acceptance::Accepted;
            tick.out.filtered = Some(Filtered { o: Some(Pose::zeros()), position, heading });
            tally.add(&tick);
        }
        let mut end = LoopEnd::default();
        end.faults_last.set(Fault::MocapLost, is_lost);
        let (mocap, drone) = (MocapCounters::default(), LinkCounters::default());
        tally.summary().with_end(&end, &mocap, "tello", &drone).hidden
    };
    let reason = hidden(true, 100, 0).unwrap();
    assert!(reason.starts_with("headings refused for 2.0 s beside good positions"), "{reason}");
    assert_eq!([hidden(true, 20, 0), hidden(false, 100, 0)], [None, None]);
    assert_eq!(hidden(true, 100, 1), None, "poses ended later, for another reason");
}
