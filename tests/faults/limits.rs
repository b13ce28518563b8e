//! Limits of a flight in which nothing seems broken: outages, speed, time of the mission, ticks, orders of take-off and
//! landing, undated poses.

use horizon_model::rows::{Pose, Sticks};
use tello_flight::cycle::{
    self, FlightTable, Inbox, Operator, Outcome, ParameterEstimate, Tick, Watch,
};
use tello_flight::{Fault, Mission, MissionTable, ObstacleTable, Phase, RoomTable, Start};
use tello_sim::{InjectedFault, PasserTable, ScriptedFault, SimTable};

use super::story::{Moment, Story, asks, fly, fly_alone, fly_with, mission, settings};

/// When the faults begin: the controller flies along the first side of the square. s
const FROM_S: f64 = 5.0;

/// A flight that starts in the air, with `fault` from [`FROM_S`] on.
fn from_the_air(fault: InjectedFault, for_s: f64) -> (FlightTable, SimTable) {
    let mut settings = settings(&[ScriptedFault { fault, from_s: FROM_S, for_s }]);
    settings.0.start = Start::Airborne;
    settings
}

fn steers(moment: &Moment) -> bool {
    moment.stick.is_some_and(|stick| stick > 0.0)
}

/// Time of the first moment with `fault`. s
fn raised_s(story: &Story, fault: Fault) -> Option<f64> {
    story.first(0.0, |moment| moment.faults.contains(&fault))
}

#[test]
fn a_drone_that_keeps_its_last_sticks_is_braked_by_small_ones_until_it_takes_new_ones() {
    let for_s = 2.5;
    let settings = from_the_air(InjectedFault::DroneSticksStuck, for_s);
    let stick_max = settings.0.cycle.link.as_ref().and_then(|link| link.outage_stick_max).unwrap();
    let story = fly_alone(&settings, 12.0);
    story.assert_sound();
    let held = |moment: &Moment| moment.faults.contains(&Fault::OutageHeld);
    let held_s = raised_s(&story, Fault::OutageHeld).unwrap();
    assert!((0.0..1.5).contains(&(held_s - FROM_S)), "held at {held_s} s");
    for moment in story.moments.iter().filter(|moment| held(moment)) {
        let is_small = moment.stick.is_some_and(|stick| stick <= stick_max + 0.005);
        assert!(is_small && moment.phase == Phase::Flying, "{moment:?}");
    }
    let again_s = story.first(held_s, |moment| !held(moment)).unwrap();
    assert!((0.0..3.0).contains(&(again_s - FROM_S - for_s)), "resumed at {again_s} s");
    assert!(steers(story.last()) && story.last().faults.is_empty(), "{:?}", story.last());
}

/// A flight in which a hand holds a drone that reports no velocity: nothing confirms what looks like an outage.
fn unconfirmed(for_s: f64, room: Option<RoomTable>) -> Story {
    let (mut flight, mut sim) =
        from_the_air(InjectedFault::DroneHeld { sway_m: 0.01, lowered_m: 0.0 }, for_s);
    sim.drone.status.velocity.is_present = false;
    flight.cycle.supervisor.room = room.or(flight.cycle.supervisor.room);
    fly_alone(&(flight, sim), 40.0)
}

#[test]
fn an_outage_that_nothing_confirms_lands_after_its_limit() {
    let limit_s = settings(&[]).0.cycle.supervisor.failsafe.outage_alone_s;
    let story = unconfirmed(8.5, None);
    story.assert_landed_after(FROM_S, Fault::OutageLong, [limit_s, limit_s + 1.5]);
}

#[test]
fn an_outage_that_nothing_confirms_lands_when_the_commands_would_leave_the_room() {
    let room = RoomTable { x_m: [-5.0, 5.0], y_m: [-3.6, 3.6], z_m: [-0.2, 3.0], stop_s: 1.3 };
    let story = unconfirmed(5.0, Some(room));
    story.assert_landed_after(FROM_S, Fault::OutageUnsafe, [0.5, 4.5]);
    assert!(!story.has(Fault::OutageLong) && !story.has(Fault::FenceLeft), "{:?}", story.last());
}

#[test]
fn a_vehicle_that_is_too_fast_lands_after_three_tenths_of_a_second() {
    let push = InjectedFault::DronePushed { velocity_w_mps: [3.5, 0.0, 0.0] };
    let mut settings = from_the_air(push, 0.8);
    settings.0.mission = mission("hover.json");
    let story = fly_alone(&settings, 40.0);
    story.assert_landed_after(FROM_S, Fault::TooFast, [0.3, 0.6]);
}

#[test]
fn a_mission_that_waits_for_too_long_is_landed() {
    const OVERTIME_S: f64 = 5.0;
    let mut settings = settings(&[]);
    settings.0.start = Start::Airborne;
    settings.0.mission = mission("square.json");
    let MissionTable::Waypoints(square) = &mut settings.0.mission else { panic!("waypoints") };
    // The first side, with a person at its end who stays there.
    square.waypoints.truncate(2);
    settings.0.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.6 }];
    settings.1.passer = Some(PasserTable {
        from_w_m: [-2.0, -1.5, 1.0],
        to_w_m: [-2.0, -1.4, 1.0],
        speed_mps: 0.0,
        hidden_s: None,
    });
    settings.0.cycle.supervisor.failsafe.overtime_s = OVERTIME_S;
    let planned = Mission::new(&settings.0.mission, settings.0.cycle.dt_s).unwrap().planned_s();
    let story = fly_alone(&settings, 90.0);
    let limit_s = 2.0 * planned + OVERTIME_S;
    // 1.5 s to come to rest at most.
    story.assert_landed_after(0.0, Fault::MissionOverdue, [limit_s - 0.05, limit_s + 1.6]);
}

/// A cycle whose poses have no known time at first.
struct Undated {
    cycle: Box<dyn Tick>,
    until_step: u64,
}

impl Tick for Undated {
    fn tick(&mut self, inbox: &Inbox, watch: &mut dyn Watch, out: &mut Outcome) {
        let mut inbox = inbox.clone();
        inbox.incidents.is_mocap_undated = inbox.step < self.until_step;
        self.cycle.tick(&inbox, watch, out);
    }

    fn new_outcome(&self) -> Outcome {
        self.cycle.new_outcome()
    }

    fn forecast(&self, u_planned: &[Sticks]) -> Option<Pose> {
        self.cycle.forecast(u_planned)
    }

    fn parameter_estimate(&self) -> Option<ParameterEstimate> {
        self.cycle.parameter_estimate()
    }
}

#[test]
fn poses_of_unknown_time_keep_the_drone_on_the_ground_until_they_are_dated() {
    let settings = settings(&[]);
    let cycle = cycle::build(&settings.0).unwrap();
    let until_step = 150;
    let story = fly_with(Box::new(Undated { cycle, until_step }), &settings, 4.0, |_, _| {});
    let dated_s = until_step as f64 * settings.0.cycle.dt_s;
    for moment in &story.moments {
        let is_undated = moment.faults.contains(&Fault::MocapUndated);
        assert_eq!(is_undated, moment.at_s < dated_s - 1e-9, "{moment:?}");
        assert!(!is_undated || moment.phase == Phase::Idle, "{moment:?}");
    }
    let take_off_s = story.first(0.0, |moment| moment.take_offs > 0).unwrap();
    assert!((0.0..0.1).contains(&(take_off_s - dated_s + 1e-9)), "take-off at {take_off_s} s");
}

#[test]
fn a_drone_that_flies_without_an_order_lands_after_a_second() {
    for operator in [Operator::Wait, Operator::Fly] {
        let mut settings = settings(&[]);
        settings.1.start = tello_sim::SimStart::Air { x: -2.0, y: -3.0, z: 1.0, theta: 0.0 };
        let story = fly(&settings, 20.0, asks(operator, 0.0));
        assert!(raised_s(&story, Fault::DroneAloft).is_some_and(|at_s| at_s < 0.2));
        let landing_s = story.first(0.0, |moment| moment.landings > 0).unwrap();
        assert!((0.9..1.2).contains(&landing_s), "{operator:?}: LAND at {landing_s} s");
        assert!(story.last().faults.contains(&Fault::TookOffUnasked), "{:?}", story.last());
        let is_still = |moment: &Moment| !steers(moment) && moment.take_offs == 0;
        assert!(story.moments.iter().all(is_still), "{operator:?}");
        story.assert_down();
    }
}

#[test]
fn ticks_that_are_missed_are_forgiven_up_to_the_limit_and_one_more_lands() {
    let (FlightTable { cycle, .. }, _) = settings(&[]);
    let limit_s = f64::from(cycle.supervisor.late_periods_max) * cycle.dt_s;
    let stalled =
        |for_s, seconds| fly_alone(&from_the_air(InjectedFault::ControlStalled, for_s), seconds);
    let story = stalled(limit_s, 9.0);
    story.assert_sound();
    assert!(!story.has(Fault::TicksLate) && steers(story.last()), "{:?}", story.last());
    // The sender gives neutral sticks after 0.1 s.
    let silent = |moment: &&Moment| (FROM_S + 0.13..FROM_S + limit_s - 0.01).contains(&moment.at_s);
    assert!(story.moments.iter().filter(silent).all(|moment| !steers(moment)));
    let late_s = limit_s + cycle.dt_s;
    let story = stalled(late_s, 20.0);
    story.assert_landed_after(FROM_S, Fault::TicksLate, [late_s - 1e-6, late_s + 0.03]);
}

#[test]
fn what_a_fast_vehicle_flies_while_the_loop_stalls_does_not_contradict_its_drone() {
    for from_s in [3.0, 3.5, 4.0, 4.5, 5.0] {
        let mut settings = from_the_air(InjectedFault::ControlStalled, 0.36);
        settings.0 = settings.0.at_speed(1.0).unwrap();
        settings.1.faults = [0.0, 3.0]
            .map(|later_s| ScriptedFault {
                fault: InjectedFault::ControlStalled,
                from_s: from_s + later_s,
                for_s: 0.36,
            })
            .to_vec();
        let story = fly_alone(&settings, 40.0);
        for fault in [Fault::PoseDoubtful, Fault::PoseInconsistent, Fault::HeadingWrong] {
            assert!(!story.has(fault), "from {from_s} s: {fault:?}, {:?}", story.last());
        }
        assert_eq!(story.last().phase, Phase::Landed, "from {from_s} s: {:?}", story.last());
        assert!(!story.has(Fault::TicksLate), "from {from_s} s");
    }
}

#[test]
fn a_landing_that_takes_too_long_is_unconfirmed_and_goes_on() {
    const TIMEOUT_S: f64 = 4.0;
    let refused_s = 6.0;
    let mut settings = from_the_air(InjectedFault::DroneRefusesLand, refused_s);
    settings.0.cycle.supervisor.landing_timeout_s = TIMEOUT_S;
    let story = fly(&settings, 30.0, asks(Operator::Land, FROM_S));
    story.assert_landed_after(FROM_S, Fault::LandingTimeout, [0.0, 0.03]);
    let unconfirmed = |moment: &Moment| moment.phase == Phase::LandingUnconfirmed;
    let raised_s = raised_s(&story, Fault::LandingTimeout).unwrap();
    assert_eq!(story.first(0.0, unconfirmed), Some(raised_s));
    let after_s = raised_s - FROM_S - TIMEOUT_S;
    assert!((-1e-6..0.05).contains(&after_s), "after {after_s} s");
    let refused = |moment: &&Moment| (raised_s..FROM_S + refused_s).contains(&moment.at_s);
    let landings: usize = story.moments.iter().filter(refused).map(|moment| moment.landings).sum();
    assert!(landings >= 4, "{landings} orders to land in 2 s");
    assert_eq!(story.last().phase, Phase::LandingUnconfirmed);
}
