use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks, lag};

use super::*;
use crate::ident::IdentFileTable;
use crate::ident::job::fixtures;
use crate::recordings::Loaded;

const STEPS: usize = 2000;

/// The built-in settings without the search of dead times, which are zero, and without the search of outages.
fn table() -> IdentFileTable {
    let mut table = crate::ident::settings(None).unwrap();
    (table.clean_observations, table.lost_commands, table.delay) = (false, None, None);
    table.dead_time_s = vec![0.0; stick::COUNT];
    table
}

/// Slow sticks of all axes, and what a vehicle with the parameter `p` does with them.
fn flight(p: &SVector<f64, { lag::COUNT }>, dt_s: f64) -> Flight {
    let model = Lagged::new(sharp()).unwrap();
    let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.0));
    let mut flight = Recording { u: Vec::new(), o: Vec::new() };
    for k in 0..STEPS {
        let u = Sticks::new(1.3, 0.9, 1.1, 1.7).map(|pace| {
            let t_s = k as f64 * dt_s;
            0.4 * (pace * t_s + pace).sin()
        });
        flight.o.push(Observed::full(model.observe(&s)));
        flight.u.push(u);
        s = model.step(&s, &u, p, dt_s);
    }
    flight
}

/// A log of a vehicle whose horizontal gain is 0.8 of the prior, and this gain.
fn slow_vehicle(table: &IdentFileTable) -> (Loaded, f64) {
    let mut p = SVector::from_column_slice(&table.map.p_prior);
    p[lag::LAMBDA_H] *= 0.8;
    (fixtures::log("slow.log", flight(&p, table.dt_s)), p[lag::LAMBDA_H])
}

#[test]
fn the_fit_to_a_vehicle_of_the_model_finds_its_gain_and_names_it() {
    let table = table();
    let (log, lambda_h) = slow_vehicle(&table);
    let logs = [log];
    let result = fit(&fixtures::job(&table, &logs)).unwrap();
    assert!(result.has_converged && result.fit.refused.is_none(), "{:?}", result.fit.refused);
    let row = result.fit.parameters.iter().find(|row| row.name == "lambda_h").unwrap();
    // The prior, which is 25 % away, still weighs.
    assert!((row.value / lambda_h - 1.0).abs() < 0.02, "{} instead of {lambda_h}", row.value);
    assert!(row.lower < lambda_h && lambda_h < row.upper, "{row:?}");
    assert_eq!(result.fit.p.len(), lag::COUNT);
    assert!(result.fit.pieces >= 1 && result.fit.steps <= STEPS, "{:?}", result.fit);
    assert_eq!(result.fit.steps_lost, 0);
    assert!(result.delay.is_empty() && result.resamples.is_none());
}

#[test]
fn a_setting_that_breaks_its_rule_is_named_with_the_fit() {
    let mut table = table();
    let (log, _) = slow_vehicle(&table);
    let logs = [log];
    table.map.c_o[0] = -1.0;
    let error = format!("{:#}", fit(&fixtures::job(&table, &logs)).unwrap_err());
    assert!(error.starts_with("in the fit of ident.json: map.C_o[0] = -1"), "{error}");
}

#[test]
fn an_iteration_limit_is_reported_and_is_no_error() {
    let mut table = table();
    let (log, _) = slow_vehicle(&table);
    let logs = [log];
    table.map.solver.iterations_max = 1;
    let result = fit(&fixtures::job(&table, &logs)).unwrap();
    assert!(!result.has_converged);
    let is_reported = result
        .fit
        .verdict
        .iter()
        .chain(&result.fit.refused)
        .any(|why| why.contains("the solver did not converge"));
    assert!(is_reported, "{:?}, {:?}", result.fit.verdict, result.fit.refused);
}

#[test]
fn a_fit_that_is_stopped_is_an_error_and_no_result() {
    struct Stop;

    impl crate::ident::Observer for Stop {
        fn is_stopped(&self) -> bool {
            true
        }
    }

    let table = table();
    let (log, _) = slow_vehicle(&table);
    let logs = [log];
    let job = Job { observer: &Stop, ..fixtures::job(&table, &logs) };
    let error = fit(&job).unwrap_err();
    assert!(error.downcast_ref::<Stopped>().is_some(), "{error:#}");
}
