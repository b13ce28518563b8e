//! The window on simulated flights with known answers.

use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use horizon_model::{Kinematic, Vector};

mod closed_loop;
mod start;

use super::*;
use crate::arrival_cost::ArrivalTable;
use crate::levenberg::LmStop;

const DT_S: f64 = 0.02;
const WINDOW: usize = 30;

type Vehicle = Mhe<Kinematic, 4, 4, 4, 4>;

fn truth() -> Vector<4> {
    Vector::from([1.35, 0.5, 0.9, 0.1])
}

fn table() -> MheTable {
    MheTable {
        window_steps: WINDOW,
        c_o: vec![3.0, 3.0, 2.0, 0.5],
        c_s: vec![0.4, 0.4, 0.4, 0.2],
        c_p: vec![0.0; gain::COUNT],
        p_prior: vec![1.0, 0.6, 1.1, -0.1],
        p_lb: vec![0.5, 0.1, 0.5, -1.0],
        p_ub: vec![2.0, 1.0, 2.0, 1.0],
        observation_loss: LossTable::None {},
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Fixed,
        shift_prior: false,
        solver: LmTable {
            damping_start: 1e-6,
            cost_tolerance: 1e-12,
            step_tolerance: 1e-12,
            iterations_max: 50,
        },
    }
}

fn estimator(table: &MheTable) -> Vehicle {
    Mhe::new(Kinematic, table.check::<Kinematic, 4, 4, 4, 4>().unwrap(), DT_S).unwrap()
}

/// Sticks that excite every parameter.
fn sticks(k: u32) -> Sticks {
    let t = f64::from(k) * DT_S;
    let mut u = Sticks::zeros();
    u[stick::ROLL] = 0.5 * (2.0 * t).sin();
    u[stick::PITCH] = 0.6 * (3.0 * t).cos();
    u[stick::YAW] = 0.8;
    u[stick::THROTTLE] = 0.4 * (5.0 * t).sin();
    u
}

/// Flies `steps` steps and hands each true state to `see`, which returns what is observed. Returns the
/// last true state and the last cost.
fn fly(
    mhe: &mut Vehicle,
    steps: u32,
    mut see: impl FnMut(u32, &Pose) -> Observed<4>,
) -> (Pose, f64) {
    // The heading passes pi soon.
    let mut s = Pose::new(0.2, -0.3, 1.0, 2.9);
    mhe.start(&s).unwrap();
    let mut cost = f64::NAN;
    for k in 0..steps {
        let u = sticks(k);
        s = Kinematic.step(&s, &u, &truth(), DT_S);
        cost = mhe.update(&u, &see(k, &s), &mut || false).unwrap().cost;
    }
    (s, cost)
}

#[test]
fn noise_free_data_return_the_truth() {
    let mut mhe = estimator(&table());
    let (s, cost) = fly(&mut mhe, 100, |_, s| Observed::full(*s));
    assert!((mhe.s_hat() - s).norm() < 1e-8, "state off by {:e}", (mhe.s_hat() - s).norm());
    assert!((mhe.p_hat() - truth()).norm() < 1e-6, "parameter {}", mhe.p_hat());
    assert!(cost < 1e-14, "cost {cost:e}");
}

#[test]
fn the_window_grows_and_then_shifts() {
    let mut mhe = estimator(&table());
    assert!(!mhe.is_started());
    let mut before = Vec::new();
    let mut s = Pose::new(0.2, -0.3, 1.0, 0.0);
    mhe.start(&s).unwrap();
    assert!(mhe.is_started());
    assert_eq!(mhe.window(), [s]);
    for k in 0..40 {
        s = Kinematic.step(&s, &sticks(k), &truth(), DT_S);
        let stop = mhe.update(&sticks(k), &Observed::full(s), &mut || false).unwrap().stop;
        assert_ne!(stop, LmStop::IterationLimit);
        assert_eq!(mhe.window().len(), WINDOW.min(k as usize + 1) + 1);
        assert_eq!(mhe.window().last(), Some(mhe.s_hat()));
        if mhe.window().len() == before.len() {
            // The fixed state is the estimate that was second before.
            assert_eq!(mhe.window()[0], before[1]);
        }
        before = mhe.window().to_vec();
    }
}

#[test]
fn missing_observations_are_bridged_by_the_model() {
    let mut mhe = estimator(&table());
    let (s, _) = fly(&mut mhe, 100, |k, s| match k {
        50..75 | 97.. => Observed::missing(),
        80..95 => Observed { is_present: [true, true, true, false], ..Observed::full(*s) },
        _ => Observed::full(*s),
    });
    assert!((mhe.s_hat() - s).norm() < 1e-6, "state off by {:e}", (mhe.s_hat() - s).norm());
    // Longer than the window: nothing is left but the model.
    let (s, _) = fly(&mut mhe, 100, |k, s| match k {
        60.. => Observed::missing(),
        _ => Observed::full(*s),
    });
    assert!((mhe.s_hat() - s).norm() < 1e-6, "state off by {:e}", (mhe.s_hat() - s).norm());
}

#[test]
fn what_is_seen_late_counts_as_if_it_had_been_seen_in_time() {
    const LATE: usize = 3;
    const STEPS: u32 = 20;
    // Far from the model: the estimates depend on every row.
    let seen = |k: u32, s: &Pose| {
        let mut observed = Observed::full(s.add_scalar(0.01 * f64::from(k % 5)));
        observed.is_present[pose::THETA] = k.is_multiple_of(2);
        observed
    };
    let [mut in_time, mut late] = [estimator(&table()), estimator(&table())];
    let mut all = Vec::new();
    fly(&mut in_time, STEPS, |k, s| {
        all.push(seen(k, s));
        all[k as usize]
    });
    let mut s = Pose::new(0.2, -0.3, 1.0, 2.9);
    late.start(&s).unwrap();
    for k in 0..STEPS {
        s = Kinematic.step(&s, &sticks(k), &truth(), DT_S);
        if let Some(then) = (k as usize).checked_sub(LATE) {
            late.observe_earlier(LATE - 1, &all[then]).unwrap();
        }
        assert!(late.update(&sticks(k), &Observed::missing(), &mut || false).is_ok());
    }
    let is_apart = |late: &Vehicle| (late.s_hat() - in_time.s_hat()).norm() > 1e-3;
    assert!(is_apart(&late), "the newest are still missing");
    for back in 0..LATE {
        late.observe_earlier(back, &all[STEPS as usize - 1 - back]).unwrap();
    }
    // A late observation counts from the next solve on.
    let u = sticks(STEPS);
    for mhe in [&mut in_time, &mut late] {
        assert!(mhe.update(&u, &Observed::missing(), &mut || false).is_ok());
    }
    for (late, in_time) in late.window().iter().zip(in_time.window()) {
        assert!((late - in_time).norm() < 1e-8, "{late} {in_time}");
    }
    let apart = (late.p_hat() - in_time.p_hat()).norm();
    assert!(apart < 1e-6, "parameters apart by {apart:e}");
}

#[test]
fn what_cannot_be_added_is_refused() {
    let mut mhe = estimator(&table());
    let zero = Observed::full(Pose::zeros());
    assert_eq!(mhe.observe_earlier(0, &zero), Err(MheError::NotStarted));
    assert_eq!(mhe.amend(1, |_| Sticks::zeros()), Err(MheError::NotStarted));
    fly(&mut mhe, 3, |_, s| Observed::full(*s));
    let broken = Observed::full(Pose::repeat(f64::NAN));
    assert_eq!(
        mhe.observe_earlier(1, &broken),
        Err(MheError::NonFinite { what: "observation", k: 2 })
    );
}

#[test]
fn what_is_older_than_a_whole_window_is_not_used() {
    let [mut without, mut with] = [estimator(&table()), estimator(&table())];
    for mhe in [&mut without, &mut with] {
        fly(mhe, 30, |_, s| Observed::full(*s));
    }
    let steps = with.window().len() - 1;
    let far = Observed::full(Pose::repeat(9.0));
    let is_apart = |with: &mut Vehicle, back| {
        with.observe_earlier(back, &far).unwrap();
        let mut copy = without.clone();
        for mhe in [&mut *with, &mut copy] {
            assert!(mhe.update(&sticks(30), &Observed::missing(), &mut || false).is_ok());
        }
        (with.s_hat() - copy.s_hat()).norm() > 1e-9
    };
    assert!(!is_apart(&mut with.clone(), steps + 1));
    // The newest state that stays free in the next window.
    assert!(is_apart(&mut with, steps - 2));
}

#[test]
fn an_active_bound_is_held_exactly() {
    let mut bounded = table();
    bounded.p_ub[gain::LAMBDA_H] = 1.2;
    bounded.p_lb[gain::THETA_0] = 0.25;
    bounded.p_prior[gain::THETA_0] = 0.3;
    let mut mhe = estimator(&bounded);
    fly(&mut mhe, 60, |_, s| Observed::full(*s));
    let p = mhe.p_hat();
    assert_eq!(p[gain::LAMBDA_H].to_bits(), 1.2_f64.to_bits(), "{p}");
    assert_eq!(p[gain::THETA_0].to_bits(), 0.25_f64.to_bits(), "{p}");
    assert!((p[gain::LAMBDA_V] - truth()[gain::LAMBDA_V]).abs() < 1e-6, "{p}");
}

#[test]
fn a_robust_loss_ignores_an_outlier() {
    let see = |k: u32, s: &Pose| {
        let outlier = if k % 10 == 5 { 2.0 } else { 0.0 };
        Observed::full(s + Pose::new(outlier, -outlier, 0.0, 0.0))
    };
    let error = |loss: LossTable| {
        let mut mhe = estimator(&MheTable { observation_loss: loss, ..table() });
        let (s, _) = fly(&mut mhe, 96, see);
        (mhe.s_hat() - s).norm()
    };
    let plain = error(LossTable::None {});
    let huber = error(LossTable::Huber { scale: 0.1 });
    let tukey = error(LossTable::Tukey { scale: 1.0 });
    assert!(plain > 0.1, "the outliers do no harm: {plain}");
    assert!(huber < 0.1 * plain, "Huber {huber}, plain {plain}");
    assert!(tukey < 0.01 * plain, "Tukey {tukey}, plain {plain}");
}

#[test]
fn a_shifted_prior_follows_and_a_fixed_one_holds() {
    let stiff = MheTable { c_p: vec![3.0; gain::COUNT], ..table() };
    let gap = |shift_prior| {
        let mut mhe = estimator(&MheTable { shift_prior, ..stiff.clone() });
        fly(&mut mhe, 400, |_, s| Observed::full(*s));
        (mhe.p_hat() - truth()).norm()
    };
    let (fixed, shifted) = (gap(false), gap(true));
    assert!(shifted < 0.1 * fixed, "shifted {shifted}, fixed {fixed}");
}

#[test]
fn a_refused_update_leaves_the_estimator_usable() {
    let mut mhe = estimator(&table());
    let nothing = Observed::missing();
    let u = Sticks::zeros();
    assert_eq!(mhe.update(&u, &nothing, &mut || false), Err(MheError::NotStarted));
    let error = mhe.start(&Pose::new(0.0, f64::NAN, 0.0, 0.0)).unwrap_err();
    assert_eq!(error.to_string(), "observation is not finite at window step 0");
    assert!(!mhe.is_started());

    let (mut s, _) = fly(&mut mhe, 50, |_, s| Observed::full(*s));
    let nan = Observed::full(Pose::new(0.0, 0.0, f64::NAN, 0.0));
    let error = mhe.update(&u, &nan, &mut || false).unwrap_err();
    assert_eq!(error.to_string(), "observation is not finite at window step 31");
    let nan = Sticks::new(f64::NAN, 0.0, 0.0, 0.0);
    let error = mhe.update(&nan, &nothing, &mut || false).unwrap_err();
    assert_eq!(error.to_string(), "input is not finite at window step 30");
    s = Kinematic.step(&s, &u, &truth(), DT_S);
    let report = mhe.update(&u, &Observed::full(s), &mut || false).unwrap();
    assert!((mhe.s_hat() - s).norm() < 1e-6, "{report:?}");

    let huge = Observed::full(Pose::repeat(1e200));
    let error = mhe.update(&u, &huge, &mut || false).unwrap_err();
    assert_eq!(error.to_string(), "r_obs is not finite at window step 30");
    assert!(!mhe.is_started());
    mhe.start(&s).unwrap();
    assert_eq!(
        (mhe.window(), mhe.p_hat()[gain::LAMBDA_H].to_bits()),
        (&[s][..], 1.0_f64.to_bits())
    );
}

#[test]
fn a_late_solve_is_a_prediction() {
    let mut mhe = estimator(&table());
    let (s, _) = fly(&mut mhe, 50, |_, s| Observed::full(*s));
    let (s_hat, p_hat) = (*mhe.s_hat(), *mhe.p_hat());
    let u = sticks(50);
    let far = Observed::full(s + Pose::repeat(0.5));
    let report = mhe.update(&u, &far, &mut || true).unwrap();
    assert_eq!((report.stop, report.iterations), (LmStop::Late, 0));
    assert_eq!(*mhe.s_hat(), Kinematic.step(&s_hat, &u, &p_hat, DT_S));
}

#[test]
fn equal_inputs_give_equal_bits() {
    let run = || {
        let mut mhe = estimator(&MheTable {
            observation_loss: LossTable::Huber { scale: 1.0 },
            c_p: vec![20.0; gain::COUNT],
            ..table()
        });
        let (_, cost) = fly(&mut mhe, 80, |k, s| {
            Observed::full(s + Pose::repeat(0.05 * f64::from(k * 7919 % 13 % 5)))
        });
        (mhe.window().to_vec(), *mhe.p_hat(), cost)
    };
    assert_eq!(run(), run());
}

#[test]
fn a_bad_setting_is_named() {
    let check = |table: MheTable| table.check::<Kinematic, 4, 4, 4, 4>().unwrap_err().to_string();
    assert_eq!(
        check(MheTable { window_steps: 1, ..table() }),
        "window_steps = 1: expected 2..=200"
    );
    assert_eq!(
        check(MheTable { p_prior: vec![1.0, 0.6, f64::NAN, 0.0], ..table() }),
        "p_prior[2] = NaN: expected 0.5..=2.0"
    );
    assert_eq!(
        check(MheTable { c_s: vec![1.0, 1.0, 0.0, 1.0], ..table() }),
        "C_s[2] = 0: expected 1e-6..=1e6"
    );
    assert_eq!(
        check(MheTable { solver: LmTable { iterations_max: 0, ..table().solver }, ..table() }),
        "solver.iterations_max = 0: expected 1..=1000"
    );
    let json = serde_json::to_string(&table()).unwrap();
    assert_eq!(serde_json::from_str::<MheTable>(&json).unwrap(), table());
    assert!(json.contains(r#""C_o":[3.0,3.0,2.0,0.5]"#), "{json}");
    let without = json.replace(r#""shift_prior":false,"#, "");
    assert!(serde_json::from_str::<MheTable>(&without).is_err());
}

#[test]
fn a_carried_arrival_needs_a_prior_that_stays() {
    let carried = |c_0: f64, forget_s| ArrivalTable::Carried { c_0: vec![c_0; 4], forget_s };
    let check = |table: MheTable| table.check::<Kinematic, 4, 4, 4, 4>().map_err(|e| e.to_string());
    let table = MheTable { c_p: vec![1.0; 4], arrival: carried(3.0, 60.0), ..table() };
    assert!(check(table.clone()).is_ok());
    for (bad, message) in [
        (MheTable { c_p: vec![0.0; 4], ..table.clone() }, "C_p[0] = 0: expected 1e-6..=1e6"),
        (
            MheTable { shift_prior: true, ..table.clone() },
            "shift_prior = true: expected false with a carried arrival",
        ),
        (
            MheTable { arrival: carried(0.0, 60.0), ..table.clone() },
            "arrival.carried.C_0[0] = 0: expected 1e-6..=1e6",
        ),
        (
            MheTable { arrival: carried(3.0, f64::NAN), ..table.clone() },
            "arrival.carried.forget_s = NaN: expected finite and > 0",
        ),
    ] {
        assert_eq!(check(bad).unwrap_err(), message);
    }
    let json = serde_json::to_string(&table.arrival).unwrap();
    assert_eq!(json, r#"{"carried":{"C_0":[3.0,3.0,3.0,3.0],"forget_s":60.0}}"#);
    let parse = serde_json::from_str::<ArrivalTable>;
    assert_eq!(parse(&json).unwrap(), table.arrival);
    assert_eq!(parse(r#""fixed""#).unwrap(), ArrivalTable::Fixed);
    assert!(parse(&json.replace("}}", r#","C_p":[1.0]}}"#)).is_err());
}

#[test]
fn heading_estimates_stay_continuous_beyond_pi() {
    let mut mhe = estimator(&table());
    fly(&mut mhe, 200, |_, s| Observed::full(*s));
    let turned = mhe.s_hat()[pose::THETA];
    assert!(turned > 2.0 * std::f64::consts::PI - 1.0, "turned to {turned}");
}

#[test]
fn weights_at_their_limits_are_solved() {
    for (c_o, c_s) in [(1e-6, 1e6), (1e6, 1e-6)] {
        let mut mhe = estimator(&MheTable { c_o: vec![c_o; 4], c_s: vec![c_s; 4], ..table() });
        mhe.start(&Pose::zeros()).unwrap();
        for k in 0..50 {
            let solved = mhe.update(&sticks(k), &Observed::full(Pose::zeros()), &mut || false);
            assert!(solved.is_ok(), "{k}: {solved:?}");
        }
    }
}

#[test]
fn without_a_factorization_there_is_no_covariance() {
    let arrival = ArrivalTable::Carried { c_0: vec![100.0; 4], forget_s: 60.0 };
    let solver = LmTable { iterations_max: 1, ..table().solver };
    let table = MheTable { arrival, solver, c_p: vec![1.0; 4], ..table() };
    let mut settings = table.check::<Kinematic, 4, 4, 4, 4>().unwrap();
    settings.c_s[pose::X] = 1e200;
    let mut mhe = Mhe::new(Kinematic, settings, DT_S).unwrap();
    mhe.start(&Pose::zeros()).unwrap();
    for k in 0..3 {
        mhe.update(&sticks(k), &Observed::full(Pose::zeros()), &mut || false).unwrap_err();
        assert!(mhe.state_covariance().is_none());
    }
}
