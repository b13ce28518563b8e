use horizon_model::rows::Pose;
use horizon_model::{Kinematic, Model};
use tello_flight::Filtered;

use super::*;

const O: Pose = Pose::new(1.0, 2.0, 0.5, 0.1);

/// A tick whose filter made this of a pose, and whose estimate is 0.3 m beside and 0.4 m above it.
fn tick(filtered: Option<Filtered>) -> TickRecord {
    let out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 1);
    let mut record = TickRecord::with_buffers(&out);
    record.out.filtered = filtered;
    record.out.s_hat = vec![1.3, 2.0, 0.9, 9.0];
    record
}

fn filtered(position: Verdict, heading: Verdict) -> Filtered {
    Filtered { o: Some(O), position, heading }
}

#[test]
fn position_and_heading_are_accepted_apart() {
    use Verdict::{Accepted, Held, Missing};
    for (position, heading, is_present) in [
        (Accepted, Accepted, [true; 4]),
        (Accepted, Held, [true, true, true, false]),
        (Held, Accepted, [false, false, false, true]),
        (Missing, Missing, [false; 4]),
    ] {
        let accepted = accepted(&tick(Some(filtered(position, heading))).out);
        assert_eq!((accepted.is_present, accepted.o), (is_present, O));
    }
    let first = Filtered { o: None, ..filtered(Missing, Missing) };
    for none in [None, Some(first)] {
        assert_eq!(accepted(&tick(none).out).is_present, [false; 4]);
    }
}

#[test]
fn a_tick_counts_for_what_was_held_and_for_its_distance() {
    let mut counts = Counts::default();
    let square_m2 = counts.add(&tick(Some(filtered(Verdict::Held, Verdict::Accepted))));
    // 0.3^2 + 0.4^2; the heading is no distance.
    assert!((square_m2 - 0.25).abs() < 1e-12, "{square_m2}");
    counts.add(&tick(Some(filtered(Verdict::Accepted, Verdict::Held))));
    counts.add(&tick(None));
    assert_eq!((counts.ticks, counts.ticks_missing, counts.ticks_airborne), (3, 3, 2));
    assert_eq!((counts.positions_held, counts.headings_held), (1, 1));
    assert_eq!(counts.estimates_failed, 0);
}

#[test]
fn a_tick_is_airborne_above_the_height_of_a_flight() {
    for (z_m, is_airborne) in [(AIRBORNE_M, 0), (AIRBORNE_M + 1e-9, 1), (f64::NAN, 0)] {
        let o = Some(Pose::new(1.0, 2.0, z_m, 0.1));
        let mut counts = Counts::default();
        counts.add(&tick(Some(Filtered { o, ..filtered(Verdict::Accepted, Verdict::Accepted) })));
        assert_eq!(counts.ticks_airborne, is_airborne, "{z_m} m");
    }
}

#[test]
fn without_an_estimate_there_is_no_distance() {
    let mut record = tick(Some(filtered(Verdict::Accepted, Verdict::Accepted)));
    record.out.s_hat.clear();
    record.out.estimator = Some(Err(horizon_estim::SolveError::NotStarted).into());
    let mut counts = Counts::default();
    assert_eq!(Some(counts.add(&record)), Some(0.0));
    assert_eq!((counts.estimates_failed, counts.ticks_airborne), (1, 0));
}

/// A replay of flights, by name and ticks in the air.
fn report(flights: &[(&str, u64)]) -> ForecastReport {
    let flight = |&(name, ticks_airborne): &(&str, u64)| Flight {
        name: name.to_owned(),
        counts: Counts { ticks: 9, ticks_airborne, ..Counts::default() },
        forecasts: Vec::new(),
        errors: Vec::new(),
        lines_skipped: vec!["line 3".to_owned()],
        log: None,
    };
    let flights = flights.iter().map(flight).collect();
    let ahead_s = forecast_errors::ahead_s();
    ForecastReport { ahead_s, flights, pooled: Vec::new(), revision: "x" }
}

#[test]
fn a_recording_without_flight_proves_nothing() {
    assert!(report(&[("a", 1), ("b", 2)]).is_airborne());
    let grounded = report(&[("a", 1), ("b", 0)]);
    assert!(!grounded.is_airborne());
    let text = grounded.to_string();
    assert!(text.contains("b: never above 0.3 m: without flight"), "{text}");
    assert!(text.contains("a: skipped line 3\n") && !text.contains("a: never"), "{text}");
    // The figures of one flight alone.
    assert!(!text.contains("ticks    "), "{text}");
    assert!(report(&[("a", 1)]).to_string().contains("ticks             9 (1 airborne)\n"));
}

#[test]
fn a_log_has_the_name_of_its_recording() {
    assert_eq!(name_of(Path::new("logs/a.b.csv")), "a.b");
    assert_eq!(name_of(Path::new("..")), "flight");
}
