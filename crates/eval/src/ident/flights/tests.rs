use horizon_model::rows::Pose;

use super::*;
use crate::ident::IdentFileTable;
use crate::ident::job::fixtures;

/// A flight along x at 0.5 m/s; in `gaps` no heading is seen.
fn flight(steps: usize, gaps: &[usize]) -> Flight {
    let observed = |k: usize| {
        let mut o = Observed::full(Pose::new(0.01 * k as f64, 0.0, 1.0, 0.0));
        o.is_present[pose::THETA] = !gaps.contains(&k);
        o
    };
    Recording { u: vec![Sticks::zeros(); steps], o: (0..steps).map(observed).collect() }
}

/// The pieces of one flight whose commands were lost in `lost`.
fn pieces(flight: &Flight, lost: std::ops::Range<usize>, steps_min: usize) -> Result<Vec<Span>> {
    let is_lost = (0..flight.o.len()).map(|k| lost.contains(&k)).collect();
    cut_logs(&[Cow::Borrowed(flight)], &[is_lost], steps_min)
}

fn spans(ends: &[[usize; 2]]) -> Vec<Span> {
    ends.iter().map(|[first, end]| Span { recording: 0, steps: *first..*end }).collect()
}

#[test]
fn lost_commands_are_between_the_pieces() {
    let whole = flight(20, &[]);
    assert_eq!(pieces(&whole, 0..0, 20).unwrap(), spans(&[[0, 20]]));
    assert_eq!(pieces(&whole, 8..10, 5).unwrap(), spans(&[[0, 8], [10, 15], [15, 20]]));
    assert_eq!(
        pieces(&whole, 3..10, 5).unwrap(),
        spans(&[[10, 15], [15, 20]]),
        "three are too few"
    );
}

#[test]
fn a_piece_begins_and_ends_with_a_complete_observation() {
    assert_eq!(pieces(&flight(10, &[0, 1, 5, 9]), 0..0, 10).unwrap(), spans(&[[2, 9]]));
    // One complete observation is no piece.
    let gaps: Vec<usize> = (1..10).collect();
    let message = pieces(&flight(10, &gaps), 0..0, 10).unwrap_err().to_string();
    assert!(message.ends_with("the logs have 10 steps, with gaps; fly longer"), "{message}");
    let message = pieces(&flight(9, &[]), 0..0, 10).unwrap_err().to_string();
    assert!(message.ends_with("the logs have 9 steps; fly longer"), "{message}");
}

#[test]
fn pieces_keep_the_number_of_their_flight() {
    let flights = [flight(4, &[]), flight(12, &[])].map(Cow::Owned);
    let is_lost = [vec![false; 4], vec![false; 12]];
    let found = cut_logs(&flights, &is_lost, 10).unwrap();
    assert_eq!(found, [Span { recording: 1, steps: 0..12 }]);
}

#[test]
fn without_a_piece_the_lost_steps_are_counted_and_the_turned_object_is_suggested() {
    let message = pieces(&flight(20, &[]), 4..18, 5).unwrap_err().to_string();
    assert!(message.contains("in 14 of 20 steps"), "{message}");
    assert!(message.contains("(piece_steps_min)") && message.contains("(--turn)"), "{message}");
    assert!(message.contains("full sticks") && message.contains("a_max_mps2"), "{message}");
}

/// Preparation of one log of 40 steps.
fn prepared(table: &IdentFileTable) -> (bool, Flight, Vec<bool>) {
    let recording = flight(40, &[20]);
    let logs = [fixtures::log("a", recording)];
    let job = fixtures::job(table, &logs);
    let (flights, is_lost) = prepare(&job, &Sticks::zeros()).unwrap();
    let flight = flights[0].clone();
    (matches!(flight, Cow::Borrowed(_)), flight.into_owned(), is_lost[0].clone())
}

#[test]
fn a_flight_is_fitted_as_it_is_unless_the_settings_clean_it() {
    let mut table = crate::ident::settings(None).unwrap();
    (table.clean_observations, table.lost_commands) = (false, None);
    let (is_borrowed, kept, is_lost) = prepared(&table);
    assert!(is_borrowed && kept == flight(40, &[20]));
    assert_eq!(is_lost, [false; 40]);
    table.clean_observations = true;
    let (is_borrowed, cleaned, is_lost) = prepared(&table);
    assert!(!is_borrowed && cleaned.u == kept.u && cleaned.o.len() == 40);
    assert_eq!(is_lost.len(), 40);
}
