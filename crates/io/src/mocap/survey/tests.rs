use super::*;
use crate::clock::SpanNs;

const AT: Placement =
    Placement { pos_v: [1.0, 2.0, 3.0], matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };

fn head(number: i64, absence: Absence) -> Head {
    Head { number, rate_hz: 100.0, stamp: None, latency: SpanNs(0), absence }
}

fn text(text: &str) -> Name<'_> {
    Name { text: Some(text.as_bytes()), id: None }
}

/// A frame of `bodies` into `survey`.
fn take(survey: &mut Survey, head: Head, bodies: &[(Name<'_>, Option<Placement>)]) {
    let now = TimeNs(0).after(SpanNs::from_ms(10 * head.number));
    let counters = MocapCounters::default();
    let mut collected = Collect { survey, counters: &counters, bodies: Vec::new(), now };
    for (name, at) in bodies {
        collected.body(*name, at.as_ref());
    }
    collected.frame(head);
}

/// Frames and frames with a pose of each object.
fn counts(survey: &Survey) -> Vec<(&str, u64, u64)> {
    survey.objects.iter().map(|(name, track)| (name.as_str(), track.frames, track.seen)).collect()
}

#[test]
fn an_object_that_is_not_in_a_whole_frame_is_lost_in_it() {
    let mut survey = Survey::default();
    take(&mut survey, head(1, Absence::Lost), &[(text("a"), Some(AT)), (text("b"), Some(AT))]);
    take(&mut survey, head(2, Absence::Lost), &[(text("a"), None)]);
    assert_eq!(counts(&survey), [("a", 2, 1), ("b", 2, 1)]);
    // Of a source that sends objects one by one the others are not in the frame, and not lost.
    take(&mut survey, head(3, Absence::Unknown), &[(text("a"), Some(AT))]);
    assert_eq!(counts(&survey), [("a", 3, 2), ("b", 2, 1)]);
    assert_eq!(Some(survey.announced_hz), Some(100.0));
}

#[test]
fn a_frame_that_ends_in_parts_loses_only_what_no_part_had() {
    let mut survey = Survey::default();
    take(&mut survey, head(1, Absence::Lost), &["a", "b", "c"].map(|name| (text(name), Some(AT))));
    take(&mut survey, head(2, Absence::Unknown), &[(text("a"), Some(AT))]);
    take(&mut survey, head(2, Absence::LostUnlessBefore), &[(text("b"), Some(AT))]);
    assert_eq!(counts(&survey), [("a", 2, 2), ("b", 2, 2), ("c", 2, 1)]);
}

#[test]
fn a_place_that_is_no_number_is_refused_and_not_seen() {
    let mut survey = Survey::default();
    let counters = MocapCounters::default();
    let mut collected =
        Collect { survey: &mut survey, counters: &counters, bodies: Vec::new(), now: TimeNs(0) };
    collected.body(text("a"), Some(&Placement { pos_v: [f64::NAN; 3], ..AT }));
    collected.body(text("b"), Some(&Placement { matrix: [1.0; 9], ..AT }));
    collected.frame(head(1, Absence::Lost));
    assert_eq!(counts(&survey), [("a", 1, 0), ("b", 1, 0)]);
    assert_eq!((counters.malformed.get(), counters.refused()), (2, Some(Refusal::Rotation)));
}

#[test]
fn the_bodies_of_a_refused_frame_are_forgotten() {
    let mut survey = Survey::default();
    let counters = MocapCounters::default();
    let mut collected =
        Collect { survey: &mut survey, counters: &counters, bodies: Vec::new(), now: TimeNs(0) };
    collected.body(text("a"), Some(&AT));
    collected.refuse(Refusal::Form);
    collected.body(text("b"), Some(&AT));
    collected.frame(head(1, Absence::Lost));
    assert_eq!(counts(&survey), [("b", 1, 1)]);
}

#[test]
fn an_object_goes_by_its_number_until_it_has_a_name() {
    let mut survey = Survey::default();
    let [by_id, nameless] = [Some(7), None].map(|id| Name { text: None, id });
    take(&mut survey, head(1, Absence::Lost), &[(by_id, Some(AT)), (nameless, Some(AT))]);
    assert_eq!(counts(&survey), [("#7", 1, 1)]);
    let named = Name { text: Some(b"tello"), id: Some(7) };
    take(&mut survey, head(2, Absence::Lost), &[(named, Some(AT))]);
    assert_eq!(counts(&survey), [("tello", 1, 1)]);
}

#[test]
fn as_many_objects_are_remembered_as_there_is_room_for() {
    let mut survey = Survey::default();
    let names: Vec<String> = (0..OBJECTS_MAX + 3).map(|number| format!("{number:03}")).collect();
    let bodies: Vec<_> = names.iter().map(|name| (text(name), Some(AT))).collect();
    take(&mut survey, head(1, Absence::Lost), &bodies);
    assert_eq!(survey.objects.len(), OBJECTS_MAX);
    // Others do not come in later, and those that are there go on.
    take(&mut survey, head(2, Absence::Lost), &[(text("x"), Some(AT)), (text("000"), Some(AT))]);
    assert_eq!(survey.objects.len(), OBJECTS_MAX);
    assert_eq!((counts(&survey)[0], counts(&survey)[1]), (("000", 2, 2), ("001", 2, 1)));
}
