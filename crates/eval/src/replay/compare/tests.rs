use tello_flight::Start;

use super::*;

/// A replay of no ticks, with the settings of the program.
fn replay() -> Replay {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let cycle = cycle::build(&flight).unwrap();
    let record = TickRecord::with_buffers(&cycle.new_outcome());
    Replay { cycle, record, now: TickJson::default(), out: None, report: report(), next_step: 0 }
}

/// A report of 10 equal ticks, 5 of them steered.
fn report() -> ReplayReport {
    ReplayReport {
        finding: Finding::Different,
        is_equal: false,
        ticks: 10,
        ticks_steered: 5,
        torn: None,
        first_gap: None,
        channels: BTreeMap::new(),
        revision_then: "then".into(),
        revision_now: "now",
    }
}

/// A channel that differs first at `step`.
fn different(step: u64) -> Channel {
    let first = Difference { step, then: Some("1".into()), now: None };
    Channel { records: 10, different: 2, first: Some(first) }
}

#[test]
fn records_are_counted_and_the_first_difference_is_kept() {
    let mut replay = replay();
    for (step, then, now) in [
        (0, Some("1"), Some("1")),
        (1, Some("2"), Some("3")),
        (2, Some("4"), None),
        (3, None, Some("5")),
    ] {
        replay.record.out.step = step;
        replay.note(Topic::State, then.map(str::as_bytes), now.map(str::as_bytes));
    }
    let channel = &replay.report.channels[Topic::State.name()];
    let first = Difference { step: 1, then: Some("2".into()), now: Some("3".into()) };
    assert_eq!(*channel, Channel { records: 4, different: 3, first: Some(first) });
}

#[test]
fn a_record_that_the_log_does_not_have_is_a_difference() {
    let mut replay = replay();
    replay.now.records =
        [(Topic::State, b"1".to_vec()), (Topic::Plan, b"2".to_vec())].into_iter().collect();
    replay.compare(Topic::State, b"1");
    let finished = replay.finish(Path::new("a"), None).unwrap();
    assert_eq!(finished.channels[Topic::State.name()].different, 0);
    let plan = &finished.channels[Topic::Plan.name()];
    let first = plan.first.clone().unwrap();
    assert_eq!((plan.different, first.then, first.now), (1, None, Some("2".into())));
    assert_eq!((finished.finding, finished.is_equal), (Finding::Different, false));
}

#[test]
fn the_rest_of_a_torn_tick_is_not_held_against_the_log() {
    let mut replay = replay();
    replay.now.records = [(Topic::Plan, b"2".to_vec())].into_iter().collect();
    let finished = replay.finish(Path::new("a"), Some("torn".into())).unwrap();
    assert_eq!((finished.finding, finished.is_equal), (Finding::Torn, false));
}

#[test]
fn a_log_without_ticks_is_refused() {
    let mut replay = replay();
    replay.report.ticks = 0;
    let error =
        replay.finish(Path::new("a"), Some("torn at byte 7".into())).unwrap_err().to_string();
    assert!(error.contains("no tick") && error.contains("torn at byte 7"), "{error}");
}

#[test]
fn the_finding_is_the_first_that_holds() {
    let torn = || Some("torn".to_owned());
    for (step, first_gap, torn, ticks_steered, expected) in [
        (Some(4), Some(5), torn(), 5, Finding::Different),
        (Some(5), Some(5), torn(), 5, Finding::TickMissing),
        (None, Some(5), torn(), 5, Finding::TickMissing),
        (None, None, torn(), 0, Finding::Torn),
        (None, None, None, 0, Finding::NeverSteered),
        (None, None, None, 1, Finding::Equal),
    ] {
        let mut report = ReplayReport { ticks_steered, torn, first_gap, ..report() };
        report.channels.insert("b", Channel { records: 10, different: 0, first: None });
        if let Some(step) = step {
            report.channels.insert("a", different(step));
        }
        assert_eq!(report.finding(), expected, "{report:?}");
    }
}

#[test]
fn the_text_names_the_earliest_difference_and_the_verdict() {
    let mut report = report();
    report.channels.insert("a", different(9));
    report.channels.insert("b", different(7));
    let text = report.to_string();
    assert!(text.contains("first difference: tick 7, b\n  then 1\n  now  nothing\n"), "{text}");
    assert!(text.ends_with("written by then, repeated by now\nNOT equal\n"), "{text}");
    report.channels.clear();
    report.finding = Finding::Equal;
    let text = report.to_string();
    assert!(
        text.ends_with("\nequal, bit by bit\n") && !text.contains("first difference:"),
        "{text}"
    );
}

#[test]
fn a_tick_that_is_cut_before_missing_ones_is_no_difference() {
    let mut replay = replay();
    replay.repeat(&Inbox { step: 0, ..Inbox::default() }).unwrap();
    assert!(!replay.now.records.is_empty());
    // A record of a tick whose inbox is missing.
    replay.note_gap();
    replay.repeat(&Inbox { step: 5, ..Inbox::default() }).unwrap();
    let finished = replay.finish(Path::new("a"), None).unwrap();
    assert_eq!((finished.finding, finished.first_gap), (Finding::TickMissing, Some(1)));
}
