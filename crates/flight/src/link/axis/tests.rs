use std::f64::consts::PI;

use horizon_model::check::amax;
use horizon_model::differences;

use super::super::tests::table;
use super::*;

const DT_S: f64 = 0.02;
const TAU_S: f64 = 0.12;

/// Of the heading and of the height.
fn noises() -> [Noise; 2] {
    let table = table();
    [table.turn.unwrap().noise(&table), table.height.unwrap().noise()]
}

#[test]
fn the_covariance_is_propagated_by_the_jacobian_of_the_mean() {
    let table = table();
    let root = SMatrix::<f64, { row::COUNT }, { row::COUNT }>::from_fn(|i, j| {
        (0.7 * i as f64 + 1.3 * j as f64).sin()
    });
    for (noise, value) in
        noises().into_iter().flat_map(|noise| [0.3, PI - 1e-9, -PI + 1e-9].map(|at| (noise, at)))
    {
        let mut start = AxisFilter::new(&table, noise, value);
        start.covariance = root * root.transpose();
        start.s = State::from([value, 0.4, -0.2, 0.15, -0.03]);
        let command = AxisCommand { asked: 0.8, rate: -3.0 };
        let predicted = |s: &State| {
            let mut axis = AxisFilter { s: *s, ..start.clone() };
            axis.predict(&table, command, TAU_S, DT_S);
            axis
        };
        let by_state = differences::jacobian(|s| predicted(s).s, &start.s);
        let (keep, sd) = (keep_factors(&table, &noise, DT_S), stationary_sd(&table, &noise));
        let noise =
            (State::repeat(1.0) - keep.component_mul(&keep)).component_mul(&sd).component_mul(&sd);
        let expected =
            by_state * start.covariance * by_state.transpose() + SMatrix::from_diagonal(&noise);
        let gap = amax(&(predicted(&start.s).covariance - expected));
        assert!(gap < 1e-8, "{gap:e} at {value}");
    }
}

#[test]
fn a_value_that_stays_off_is_taken_after_half_a_second() {
    let table = table();
    for noise in noises() {
        let mut axis = AxisFilter::new(&table, noise, 0.2);
        let mut see = |off: f64, steps: u32| {
            for _ in 0..steps {
                axis.predict(&table, AxisCommand::default(), TAU_S, DT_S);
                axis.correct(&table, Some(0.2 + off), DT_S);
            }
            axis.s[row::VALUE] - 0.2
        };
        assert!(see(0.0, 50).abs() < 1e-9);
        assert!(see(2.5, 20).abs() < 1e-9);
        assert!(see(0.0, 1).abs() < 1e-9);
        assert!((see(2.5, 30) - 2.5).abs() < 1e-9);
    }
}

#[test]
fn a_vehicle_that_is_the_model_is_followed_over_the_wrap_of_a_heading() {
    let table = table();
    for noise in noises() {
        let mut axis = AxisFilter::new(&table, noise, 3.0);
        let (mut value, mut rate, mut before) = (3.0, 0.0, 0.0);
        let fraction = 1.0 - (-DT_S / TAU_S).exp();
        for k in 0..500 {
            let asked = 1.2 * (f64::from(k) * DT_S).sin();
            let command = AxisCommand { asked, rate: (asked - before) / DT_S };
            before = asked;
            axis.predict(&table, command, TAU_S, DT_S);
            rate += fraction * (asked - rate);
            value += DT_S * rate;
            let seen = if noise.is_angle { wrap(value) } else { value };
            axis.correct(&table, (k % 3 != 0).then_some(seen), DT_S);
            let off = axis.s[row::VALUE] - value;
            let gap = if noise.is_angle { wrap(off).abs() } else { off.abs() };
            assert!(gap < 1e-6, "{gap} at {k}");
        }
    }
}

#[test]
fn a_wrong_dead_time_is_found_within_its_standard_deviation() {
    let table = table();
    for (noise, late_steps) in
        noises().into_iter().flat_map(|noise| [-3_i32, 0, 3].map(|late| (noise, late)))
    {
        let mut axis = AxisFilter::new(&table, noise, 1.0);
        let (mut value, mut rate) = (1.0, 0.0);
        let fraction = 1.0 - (-DT_S / TAU_S).exp();
        let asked = |k: i32| {
            let t_s = f64::from(k) * DT_S;
            0.3 * (3.0 * t_s).sin() + 0.25 * (8.0 * t_s).sin()
        };
        let prior = axis.dead_time_error();
        assert!((prior.sd_s - table.sd_dead_time_s).abs() < 1e-12 && prior.mean_s.abs() < 1e-12);
        for k in 1..1500 {
            let command = AxisCommand { asked: asked(k), rate: (asked(k) - asked(k - 1)) / DT_S };
            axis.predict(&table, command, TAU_S, DT_S);
            rate += fraction * (asked(k - late_steps) - rate);
            value += DT_S * rate;
            axis.correct(&table, Some(value), DT_S);
        }
        let DeadTimeError { mean_s, sd_s } = axis.dead_time_error();
        let late_s = f64::from(late_steps) * DT_S;
        assert!((mean_s - late_s).abs() < 0.012, "{late_s}: {mean_s} +- {sd_s} s");
        assert!(sd_s < 0.5 * table.sd_dead_time_s, "{sd_s} s");
    }
}

#[test]
fn each_error_moves_the_mean_to_its_side() {
    let table = table();
    let [noise, _] = noises();
    let predicted = |row: usize, error: f64| {
        let mut axis = AxisFilter::new(&table, noise, 0.0);
        axis.s[row] = error;
        axis.predict(&table, AxisCommand { asked: 0.8, rate: 3.0 }, TAU_S, DT_S);
        axis.s
    };
    let right = predicted(row::GAIN, 0.0);
    let change = |row, error| predicted(row, error) - right;
    assert!(change(row::GAIN, 0.1)[row::RATE] > 1e-3, "more gain is faster");
    assert!(change(row::DEAD_TIME, 0.1)[row::RATE] < -1e-3, "later is slower while it grows");
    let drift = change(row::D, 0.2)[row::VALUE];
    let expected = DT_S * 0.2 * (-DT_S / table.turn.unwrap().decay_s).exp();
    assert!((drift - expected).abs() < 1e-12, "{drift}");
    let kept = predicted(row::GAIN, 0.1)[row::GAIN];
    assert!((kept - 0.1 * (-DT_S / table.adapt_s).exp()).abs() < 1e-12, "{kept}");
    for noise in noises() {
        let mut axis = AxisFilter::new(&table, noise, 0.0);
        axis.s[row::DEAD_TIME] = 0.03;
        axis.correct_dead_time(0.02);
        assert!((axis.dead_time_error().mean_s - 0.01).abs() < 1e-12, "{axis:?}");
    }
}
