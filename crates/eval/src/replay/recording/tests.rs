use horizon_model::rows::Pose;
use horizon_model::{Kinematic, Model};
use tello_flight::Filtered;

use super::*;

const AT: Pose = Pose::new(1.0, 2.0, 1.3, 0.5);

fn record(o: Option<Pose>, [position, heading]: [Acceptance; 2]) -> TickRecord {
    let mut out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
    out.filtered = Some(Filtered { o, position, heading });
    TickRecord::with_buffers(&out)
}

#[test]
fn rows_that_the_filter_held_are_not_observed() {
    use Acceptance::{Accepted, Held};
    for (position, heading) in [(Accepted, Accepted), (Accepted, Held), (Held, Held)] {
        let o = accepted(&record(Some(AT), [position, heading]).out);
        let mut is_present = [position == Accepted; pose::COUNT];
        is_present[pose::THETA] = heading == Accepted;
        assert_eq!(o.is_present, is_present);
    }
    assert_eq!(accepted(&record(None, [Held; 2]).out), Observed::missing());
    let unfiltered = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
    assert_eq!(accepted(&unfiltered), Observed::missing());
}

#[test]
fn ticks_are_counted_by_what_the_filter_did_and_the_estimate_by_its_distance() {
    use Acceptance::{Accepted, Held};
    let mut counts = Counts::default();
    let mut tick = |o: Option<Pose>, verdicts, s_hat: Option<Pose>| {
        let mut record = record(o, verdicts);
        record.out.s_hat.clear();
        record.out.s_hat.extend(s_hat.iter().flat_map(|s_hat| s_hat.iter()));
        counts.add(&record)
    };
    let aside = AT + Pose::new(0.3, -0.4, 0.0, 1.0);
    let square_m2 = tick(Some(AT), [Accepted; 2], Some(aside)).unwrap();
    assert!((square_m2 - 0.25).abs() < 1e-12, "{square_m2}");
    let low = Pose::new(0.0, 0.0, 0.01, 0.0);
    assert_eq!(tick(Some(low), [Held; 2], Some(low)), Some(0.0));
    assert_eq!(tick(None, [Held, Accepted], None), None);
    assert_eq!(tick(Some(AT), [Accepted; 2], None), None, "in the air without an estimate");
    let Counts { ticks, ticks_airborne, ticks_missing, positions_held, headings_held, .. } = counts;
    assert_eq!((ticks, ticks_airborne, ticks_missing), (4, 2, 4));
    assert_eq!((positions_held, headings_held), (2, 1));
}

#[test]
fn a_report_without_flight_or_without_a_forecast_says_so() {
    let report = |airborne: &[u64], forecasts: usize| {
        let mut errors = forecast_errors::no_errors();
        (0..forecasts).for_each(|_| errors.push(AHEAD_STEPS[0] - 1, &Pose::zeros()));
        let flight = |ticks_airborne| Flight {
            name: "a".into(),
            counts: Counts { ticks: 5, ticks_airborne, ..Counts::default() },
            forecasts: vec![ForecastRow::new("built-in", &errors)],
            errors: Vec::new(),
            lines_skipped: vec!["line 3".into()],
            log: None,
        };
        ForecastReport {
            ahead_s: forecast_errors::ahead_s(),
            flights: airborne.iter().copied().map(flight).collect(),
            pooled: Vec::new(),
            revision: REVISION,
        }
    };
    assert!(report(&[2, 1], 1).is_judged() && !report(&[2, 0], 1).is_judged());
    let text = report(&[0], 1).to_string();
    assert!(text.contains("a: never above") && text.contains("a: skipped line 3"), "{text}");
    assert!(!report(&[4], 1).to_string().contains("never above"));
    let empty = report(&[4], 0);
    assert!(!empty.is_judged() && empty.to_string().contains("a: no forecast"), "{empty}");
}

#[test]
fn a_file_without_a_name_is_a_flight() {
    assert_eq!(name_of(Path::new("logs/12.csv")), "12");
    assert_eq!(name_of(Path::new("..")), "flight");
}
