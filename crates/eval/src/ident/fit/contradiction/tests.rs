use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks, lag, motion};
use horizon_model::{Lagged, Model as _};

use super::*;
use crate::ident::flights::Flight;
use crate::ident::job::fixtures;
use crate::recordings::Loaded;

const STEPS: usize = 6000;

/// Slow sticks of all axes with the phase `phase_rad`, and what the vehicle of the prior does with them, with gusts.
fn flight(phase_rad: f64, p: &SVector<f64, { lag::COUNT }>, dt_s: f64) -> Flight {
    let model = Lagged::default();
    let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.0));
    let mut flight = Recording { u: Vec::new(), o: Vec::new() };
    for k in 0..STEPS {
        let t_s = k as f64 * dt_s;
        let pace = Sticks::new(1.3, 0.9, 1.1, 1.7);
        let u = pace.map(|pace| 0.4 * (pace * t_s + phase_rad + pace).sin());
        flight.o.push(Observed::full(model.observe(&s)));
        flight.u.push(u);
        s = model.step(&s, &u, p, dt_s);
        s[motion::D_X] += 0.01 * (7.1 * k as f64 + phase_rad).sin();
        s[motion::OMEGA] += 0.02 * (5.3 * k as f64).sin();
    }
    flight
}

/// What contradicts in logs of these recordings.
fn found(recordings: Vec<Flight>) -> Vec<Contradiction> {
    let mut table = crate::ident::settings(None).unwrap();
    (table.clean_observations, table.lost_commands, table.delay) = (false, None, None);
    table.dead_time_s = vec![0.0; stick::COUNT];
    let log = |(at, recording): (usize, Flight)| fixtures::log(&format!("{at}.log"), recording);
    let logs: Vec<Loaded> = recordings.into_iter().enumerate().map(log).collect();
    let job = fixtures::job(&table, &logs);
    let mut identification: Identification<'_, Lagged, { motion::COUNT }, { lag::COUNT }> =
        Identification::new(Lagged::default(), &job).unwrap();
    let solved = identification.solve().unwrap();
    assert!(solved.stop != horizon_estim::LmStop::IterationLimit, "{solved:?}");
    identification.contradictions().unwrap()
}

fn prior() -> (SVector<f64, { lag::COUNT }>, f64) {
    let table = crate::ident::settings(None).unwrap();
    (SVector::from_column_slice(&table.map.p_prior), table.dt_s)
}

#[test]
fn a_log_whose_clocks_jump_or_whose_object_turns_in_the_middle_disagrees_with_itself() {
    let (p, dt_s) = prior();
    let right = flight(0.0, &p, dt_s);
    assert_eq!(found(vec![right.clone()]), []);
    let mut late = right.clone();
    for k in STEPS / 2..STEPS {
        late.u[k] = right.u[k - 15];
    }
    let mut turned = right;
    for o in &mut turned.o[STEPS / 2..] {
        o.o[pose::THETA] += 0.5;
    }
    for (flight, name) in [(late, "tau_"), (turned, "theta_0")] {
        let found = found(vec![flight]);
        assert!(found.len() == 1 && found[0].is_refused(), "{found:?}");
        let sentence = found[0].sentence();
        let start = "the first and the second half of 0.log disagree in ";
        assert!(sentence.starts_with(start) && sentence.contains(name), "{sentence}");
    }
}

#[test]
fn logs_of_two_definitions_of_the_object_are_refused_and_of_one_are_not() {
    let (p, dt_s) = prior();
    let [first, mut second] = [0.0, 1.0].map(|phase_rad| flight(phase_rad, &p, dt_s));
    assert_eq!(found(vec![first.clone(), second.clone()]), []);
    for o in &mut second.o {
        o.o[pose::THETA] += 0.8;
    }
    let found = found(vec![first, second]);
    assert!(found.iter().any(Contradiction::is_refused), "{found:?}");
    assert!(found[0].sentence().starts_with("0.log contradicts the other logs"), "{found:?}");
}

#[test]
fn a_log_is_cut_where_pieces_can_begin_and_in_the_middle() {
    let span = Span { recording: 3, steps: 10..110 };
    let parts = cut(&span, 30, |k| *k != 43);
    let steps: Vec<_> = parts.iter().map(|part| part.steps.clone()).collect();
    assert_eq!(steps, [10..44, 44..76, 76..110]);
    assert!(parts.iter().all(|part| part.recording == 3));
    assert_eq!(cut(&span, 30, |_| false), std::slice::from_ref(&span));
    assert_eq!(halves(&parts), [vec![0, 1], vec![2]]);
    assert_eq!(halves(&[span]), [vec![0], vec![]]);
}
