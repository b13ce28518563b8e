use horizon_control::{InputCost, MpcTable, QpKind, SolverTable};
use horizon_model::rows::gain;
use horizon_model::{Kinematic, Model};

use super::super::committed::given_steps;
use super::*;

const DT_S: f64 = 0.02;
const HORIZON_STEPS: usize = 10;
/// Bound of the plan, and the smaller one of the sticks.
const EFFECT_MAX: f64 = 0.5;
const STICK_MAX: f64 = 0.4;

fn fifo(dead_time_s: [f64; 4]) -> InputFifo<4> {
    InputFifo::new(&dead_time_s, &Kinematic::INPUT, DT_S).unwrap()
}

fn table(horizon_steps: usize, stages: Vec<(usize, u32)>) -> MpcTable {
    MpcTable {
        horizon_steps,
        stages,
        input_cost: InputCost::Absolute,
        c_u: vec![0.01; 4],
        c_s: vec![1.0; 4],
        c_s_end: vec![1.0; 4],
        u_lb: vec![-EFFECT_MAX; 4],
        u_ub: vec![EFFECT_MAX; 4],
        solver: SolverTable {
            qp: QpKind::Riccati,
            cost_tolerance: 1e-9,
            iterations_max: 20,
            qp_tolerance: 1e-10,
            qp_iterations_max: 50,
        },
    }
}

fn planner(fifo: &InputFifo<4>) -> Planner<Kinematic, 4, 4, 4> {
    let table = table(HORIZON_STEPS, Vec::new());
    let mpc = Mpc::new(Kinematic, table.check::<Kinematic, 4, 4, 4, 4>().unwrap(), DT_S).unwrap();
    let baseline = Baseline { max_target_distance: 100.0, p_correction: SVector::zeros() };
    let bounds =
        StickBounds { lower: Sticks::repeat(-STICK_MAX), upper: Sticks::repeat(STICK_MAX) };
    Planner::new(Kinematic, (mpc, baseline), bounds, fifo, DT_S)
}

/// A target so far ahead and above that a plan is at its bounds throughout.
fn mission() -> Mission {
    let table =
        serde_json::json!({ "targets": { "reach": 0.2, "targets": [[9.0, 0.0, 9.0, 0.0]] } });
    Mission::new(&serde_json::from_value(table).unwrap(), DT_S).unwrap()
}

/// Gains 2 m/s, 1 m/s, 1 rad/s.
fn parameter() -> SVector<f64, { gain::COUNT }> {
    SVector::from([2.0, 1.0, 1.0, 0.0])
}

/// The start of a plan in the coming tick, without an outage.
fn plan_start<'a>(
    s_hat: &'a Pose,
    p_hat: &'a SVector<f64, { gain::COUNT }>,
    fifo: &'a InputFifo<4>,
) -> PlanStart<'a, 4, 4> {
    PlanStart { s_hat, p_hat, fifo, outage_input: None, first_period: 0, covariance: None }
}

fn plan(planner: &mut Planner<Kinematic, 4, 4, 4>, fifo: &InputFifo<4>, is_late: bool) {
    let (s_hat, p_hat) = (Pose::zeros(), parameter());
    let start = plan_start(&s_hat, &p_hat, fifo);
    let report = planner.plan(&start, &mission(), &mut || is_late).unwrap();
    assert_eq!(report.has_new_plan(), !is_late, "{report:?}");
}

#[test]
fn axes_with_a_longer_dead_time_are_decided_further_into_the_plan() {
    // 17, 17.25, 2 and 9.5 steps.
    let mut fifo = fifo([0.34, 0.345, 0.04, 0.19]).with_room(8);
    for (correction, given) in [
        (0, [15, 15, 0, 7]),
        (5, [15, 15, 0, 7]),
        (-2, [15, 15, 0, 7]),
        // The heading's dead time is 0 already, then the height's.
        (-5, [12, 12, 0, 4]),
        (-12, [5, 5, 0, 0]),
    ] {
        fifo.correct([correction; 4]);
        assert_eq!(given_steps(fifo.dead_time_steps()), given, "{correction} steps");
    }
}

#[test]
fn a_stick_is_planned_for_about_the_step_in_which_it_acts_whatever_the_correction() {
    let mut fifo = fifo([0.34, 0.34, 0.04, 0.19]).with_room(8);
    let mut settings = table(30, vec![(3, 5), (3, 5)]).check::<Kinematic, 4, 4, 4, 4>().unwrap();
    for step in [7, 8, 15, 16] {
        settings.begin_stage_at(step);
    }
    let begin_of = |stage| settings.stage_steps().iter().take(stage).sum::<u32>() as usize;
    for correction in -17..=8 {
        fifo.correct([correction; 4]);
        let committed = Committed::new(fifo.dead_time_steps(), &settings);
        let (known, mut last) = (fifo.known_steps(), 0);
        for axis in 0..stick::COUNT {
            // What is sent now is the newest in the coming step.
            let mut sent = fifo.clone();
            sent.push(&Sticks::repeat(1.0));
            let acts = |step: usize| sent.applied((known + step).cast_signed() - 1)[axis] > 0.0;
            let step = (0..=30).find(|step| acts(*step)).unwrap();
            let [open, _] = committed.open_stages[axis];
            let given = committed.given_steps[axis];
            assert_eq!(given, begin_of(open), "{correction}, {axis}");
            // Stages have at most 5 steps; without a correction they begin where they should.
            let off = if correction < -2 { 2 } else { 0 };
            assert!(given.abs_diff(step) <= off, "{given}, {step}: {correction}, {axis}");
            last = last.max(step);
        }
        assert_eq!(committed.steps_max, last, "{correction}");
    }
}

#[test]
fn in_an_outage_one_input_acts_in_place_of_all() {
    let mut fifo = fifo([0.04; 4]);
    for u in [0.1, 0.2, 0.3] {
        fifo.push(&Sticks::repeat(u));
    }
    let (s_hat, p_hat) = (Pose::zeros(), parameter());
    let mut start = plan_start(&s_hat, &p_hat, &fifo);
    assert_eq!([-1, 0, 1].map(|ahead| start.applied(ahead)), [0.1, 0.2, 0.3].map(Sticks::repeat));
    start.outage_input = Some(Sticks::zeros());
    assert_eq!([-1, 0, 1].map(|ahead| start.applied(ahead)), [Sticks::zeros(); 3]);
}

#[test]
fn in_an_outage_a_brake_goes_on_from_the_sticks_that_were_sent() {
    // Roll and pitch act 3 steps later than yaw and throttle.
    let mut fifo = fifo([0.1, 0.1, 0.04, 0.04]);
    (0..8).for_each(|_| fifo.push(&Sticks::repeat(0.3)));
    let (s_hat, p_hat) = (Pose::zeros(), parameter());
    let start =
        PlanStart { outage_input: Some(Sticks::repeat(-0.4)), ..plan_start(&s_hat, &p_hat, &fifo) };
    for (is_braking, last) in [(false, -0.4), (true, 0.3)] {
        let mut planner = planner(&fifo);
        planner.brake(BrakeOrder { is_on: is_braking, descends_to_m: None, may_move: true });
        let report = planner.plan(&start, &mission(), &mut || false).unwrap();
        assert!(report.has_new_plan(), "{report:?}");
        let roll: Vec<f64> = planner.u_given[..3].iter().map(|u| u[stick::ROLL]).collect();
        assert_eq!(roll, [-0.4, -0.4, last], "braking: {is_braking}");
        assert_eq!(planner.before(&start), Sticks::repeat(last), "braking: {is_braking}");
    }
}

#[test]
fn a_brake_reaches_as_far_as_the_committed_sticks_lead_and_yaw_ends_with_its_own() {
    // Roll and pitch act 3 steps later than throttle, yaw 1 step later.
    let mut fifo = fifo([0.1, 0.1, 0.04, 0.06]);
    (0..8).for_each(|_| fifo.push(&Sticks::repeat(0.3)));
    let (s_hat, p_hat) = (Pose::zeros(), parameter());
    let start = plan_start(&s_hat, &p_hat, &fifo);
    let mut planner = planner(&fifo);
    planner.brake(BrakeOrder { is_on: true, descends_to_m: None, may_move: true });
    let report = planner.plan(&start, &mission(), &mut || false).unwrap();
    assert!(report.has_new_plan(), "{report:?}");
    let gone = planner.rest_by_neutral(&start) - planner.s_0;
    let [steps, one] = [3.0, 1.0].map(|steps| 0.3 * DT_S * steps);
    assert!((pos_w(&gone).xy().norm() - 2.0 * steps * 2.0_f64.sqrt()).abs() < 1e-4, "{gone}");
    let turns = [gone[pose::THETA].abs(), gone[pose::Z]];
    assert!(turns.iter().any(|turn| (turn - one).abs() < 1e-12), "{gone}");
}

#[test]
fn a_plan_begins_where_the_inputs_in_transit_lead() {
    let mut fifo = fifo([0.06; 4]);
    for pitch in [0.1, 0.2, 0.3] {
        let mut u = Sticks::zeros();
        u[stick::PITCH] = pitch;
        fifo.push(&u);
    }
    let mut planner = planner(&fifo);
    plan(&mut planner, &fifo, false);
    // 2 m/s times 0.02 s times the sum of the three.
    let expected = Pose::new(2.0 * 0.02 * 0.6, 0.0, 0.0, 0.0);
    assert!((planner.s_pred() - expected).norm() < 1e-15, "{}", planner.s_pred());
    assert_eq!(planner.reference(), Some(Pose::new(9.0, 0.0, 9.0, 0.0)));
}

#[test]
fn an_unused_plan_loses_its_authority_and_ends_with_its_horizon() {
    let fifo = fifo([0.06; 4]);
    let mut planner = planner(&fifo);
    assert_eq!((planner.sticks(), planner.lag()), (Sticks::zeros(), None));
    plan(&mut planner, &fifo, false);
    for lag in (0..).take(HORIZON_STEPS) {
        assert_eq!(planner.lag(), Some(lag));
        // 0.5 exp(-lag / 10), clipped to 0.4.
        let expected = (EFFECT_MAX * (-f64::from(lag) / 10.0).exp()).min(STICK_MAX);
        let u = planner.sticks();
        for axis in [stick::PITCH, stick::THROTTLE] {
            assert!((u[axis] - expected).abs() < 1e-6, "lag {lag}: {u}, {expected} expected");
        }
        assert!(u[stick::ROLL].abs() < 1e-6 && u[stick::YAW].abs() < 1e-6, "{u}");
        planner.age_plan();
    }
    assert!(!planner.has_usable_plan());
    assert_eq!(planner.sticks(), Sticks::zeros());
}

#[test]
fn a_late_solve_makes_no_plan_and_lets_the_one_in_use_age() {
    let fifo = fifo([0.06; 4]);
    let mut planner = planner(&fifo);
    plan(&mut planner, &fifo, true);
    assert_eq!((planner.sticks(), planner.lag()), (Sticks::zeros(), None));
    plan(&mut planner, &fifo, false);
    plan(&mut planner, &fifo, true);
    assert_eq!(planner.lag(), Some(1));
    plan(&mut planner, &fifo, false);
    assert_eq!(planner.lag(), Some(0));
    planner.drop_plan();
    assert_eq!((planner.sticks(), planner.lag()), (Sticks::zeros(), None));
}
