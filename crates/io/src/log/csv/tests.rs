use proptest::prelude::*;

use super::*;

const FLIGHT: &str = "\
pos,0,-0.9077,-2.0248,1.1274,0.0305
input,0,-0.0407,-0.0627,-0.0318,0.1484
target,0,-1.0000,-2.0000,1.3000,0.0000
param,0,1.2940,0.4447,0.9944,0.0327
pos,2,-0.9081,-2.0243,1.1291,0.0286
";

fn reasons(text: &str) -> Vec<(usize, SkipReason)> {
    parse(text.as_bytes()).skipped.into_iter().map(|skipped| (skipped.line, skipped.why)).collect()
}

#[test]
fn a_flight_is_read_by_step_and_tag() {
    let flight = parse(FLIGHT.as_bytes());
    assert_eq!(flight.skipped, []);
    let [first, second] = flight.rows[..] else { panic!("{} rows", flight.rows.len()) };
    let expected = CsvRow {
        step: 0,
        pos: Some(Pose::new(-0.9077, -2.0248, 1.1274, 0.0305)),
        input: Some(Sticks::new(-0.0407, -0.0627, -0.0318, 0.1484)),
        target: Some(Pose::new(-1.0, -2.0, 1.3, 0.0)),
        param: Some(SVector::from([1.294, 0.4447, 0.9944, 0.0327])),
    };
    assert_eq!(first, expected);
    let expected = CsvRow { step: 2, pos: second.pos, ..CsvRow::default() };
    assert_eq!(second, expected, "what is missing stays missing");
}

#[test]
fn each_bad_line_is_skipped_with_its_reason() {
    for (line, why) in [
        ("pospos,0,1,2,3,4", SkipReason::Tag),
        ("pos,0pos,0,1,2,3,4", SkipReason::Step),
        ("pos,-1,1,2,3,4", SkipReason::Step),
        ("pos", SkipReason::Step),
        ("input,1993", SkipReason::Count(0)),
        ("pos,0,1,2,3", SkipReason::Count(3)),
        ("pos,0,1,2,3,4,5", SkipReason::Count(5)),
        ("pos,0,1,2,three,4", SkipReason::Value(3)),
        ("pos,0,1,2,3,", SkipReason::Value(4)),
        ("pos,0,nan,2,3,4", SkipReason::Value(1)),
        ("pos,0,1,1e999,3,4", SkipReason::Value(2)),
        ("pos,0,1,1e308,3,4", SkipReason::Beyond(2, 100.0)),
        ("input,0,0,0,0,-50", SkipReason::Beyond(4, 1.0)),
    ] {
        assert_eq!(reasons(&format!("{line}\n")), [(1, why)], "{line}");
    }
}

#[test]
fn a_step_far_from_the_newest_one_is_skipped() {
    let text = |step: u64| format!("pos,1000,1,2,3,4\npos,{step},1,2,3,4\n");
    for step in [949, 181_001, u64::MAX] {
        assert_eq!(reasons(&text(step)), [(2, SkipReason::Far)], "{step}");
    }
    for step in [950, 181_000] {
        assert_eq!(reasons(&text(step)), [], "{step}");
    }
}

#[test]
fn the_first_of_repeated_lines_counts() {
    let text = "pos,7,1,1,1,1\npos,8,2,2,2,2\n\npos,7,3,3,3,3\n";
    assert_eq!(reasons(text), [(4, SkipReason::OtherValues)]);
    let flight = parse(text.as_bytes());
    assert_eq!(flight.rows.len(), 2);
    assert_eq!(flight.rows[0].pos, Some(Pose::repeat(1.0)));
}

#[test]
fn steps_with_other_values_again_are_refused_and_copies_are_not() {
    let of = |again: &str, repeated: usize| {
        let lines = (0..100).map(|step| format!("pos,{step},1,2,3,4\n"));
        let again = (0..repeated).map(|step| format!("pos,{},1,2,{again},4\n", 60 + step));
        flight(lines.chain(again).collect::<String>().as_bytes())
    };
    assert!(of("5", 10).is_ok() && of("3", 40).is_ok());
    let error = of("5", 11).unwrap_err().to_string();
    assert!(error.contains("line 101, repeated step with other values"), "{error}");
}

#[test]
fn lines_out_of_order_are_refused_by_this_reason() {
    let lines = (0..300).rev().map(|step| format!("pos,{step},1,2,3,4\n"));
    let error = flight(lines.collect::<String>().as_bytes()).unwrap_err().to_string();
    assert!(error.contains("out of order, as line 52"), "{error}");
}

#[test]
fn a_line_without_its_line_break_is_not_read() {
    // The last value may have been 0.0286, of which 0.02 reads well.
    let cut = &FLIGHT[..FLIGHT.len() - 3];
    assert_eq!(reasons(cut), [(5, SkipReason::Torn)]);
    assert_eq!(parse(cut.as_bytes()).rows.len(), 1);
}

#[test]
fn a_file_of_another_system_reads_the_same() {
    let crlf = "\u{feff}".to_owned() + &FLIGHT.replace('\n', " \r\n").replace(',', ", ");
    assert_eq!(parse(crlf.as_bytes()), parse(FLIGHT.as_bytes()));
}

#[test]
fn a_skipped_line_is_shown_shortened() {
    let text = format!("{}\n", "x".repeat(500));
    let skipped = &parse(text.as_bytes()).skipped[0];
    assert_eq!(skipped.to_string(), format!("line 1, unknown tag: {}", "x".repeat(60)));
}

#[test]
fn a_row_is_written_as_the_thesis_writes_it() {
    let mut text = Vec::new();
    for row in parse(FLIGHT.as_bytes()).rows {
        row.write(&mut text, THESIS_DECIMALS).unwrap();
    }
    assert_eq!(String::from_utf8(text).unwrap(), FLIGHT);
}

#[test]
fn the_digits_behind_the_point_are_counted_on_whole_lines_only() {
    let decimals = |text: &str| parse(text.as_bytes()).decimals;
    assert_eq!(decimals(FLIGHT), THESIS_DECIMALS);
    assert_eq!(decimals("pos,0,1,2,-3.25,4.5\npos,1,1.12345,2,three,4\n"), 2);
    assert_eq!(decimals(""), 0);
}

#[test]
fn steps_in_any_order_come_out_sorted_and_whole() {
    let text =
        "pos,9,1,1,1,1\npos,3,2,2,2,2\ninput,9,1,1,1,1\npos,9,4,4,4,4\ninput,3,-1,-1,-1,-1\n";
    let flight = parse(text.as_bytes());
    assert_eq!(reasons(text), [(4, SkipReason::OtherValues)]);
    let [first, second] = flight.rows[..] else { panic!("{} rows", flight.rows.len()) };
    assert_eq!((first.step, second.step), (3, 9));
    assert_eq!(first.input, Some(Sticks::repeat(-1.0)));
    assert_eq!((second.pos, second.input), (Some(Pose::repeat(1.0)), Some(Sticks::repeat(1.0))));
}

proptest! {
    #[test]
    fn numbers_are_read_to_the_bit(text in "-?[0-9]{0,12}[.]?[0-9]{0,12}(e-?[0-9]{1,2})?") {
        let expected = text.parse().ok().filter(|number: &f64| number.is_finite());
        let read = number(text.as_bytes());
        prop_assert_eq!(read.map(|(number, _)| number.to_bits()), expected.map(f64::to_bits));
        let is_plain = !text.contains('e');
        let decimals = text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
        prop_assert!(!is_plain || read.is_none_or(|(_, behind_point)| behind_point == decimals));
    }

    #[test]
    fn every_cut_loses_its_torn_line_only(cut in 0..=FLIGHT.len()) {
        let flight = parse(&FLIGHT.as_bytes()[..cut]);
        let is_torn = cut > 0 && !FLIGHT[..cut].ends_with('\n');
        prop_assert_eq!(flight.skipped.len(), usize::from(is_torn));
        let lines: usize = flight.rows.iter().map(|row| {
            let mut text = Vec::new();
            row.write(&mut text, THESIS_DECIMALS).unwrap();
            String::from_utf8(text).unwrap().lines().count()
        }).sum();
        prop_assert_eq!(lines, FLIGHT[..cut].matches('\n').count());
    }

    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let flight = parse(&bytes);
        let lines = bytes.split(|byte| *byte == b'\n').count();
        prop_assert!(flight.rows.len() + flight.skipped.len() <= lines);
    }

    #[test]
    fn any_damage_is_survived(at in 0..FLIGHT.len(), byte in any::<u8>()) {
        let mut bytes = FLIGHT.as_bytes().to_vec();
        bytes[at] = byte;
        let flight = parse(&bytes);
        prop_assert!(flight.skipped.len() <= 2, "{:?}", flight.skipped);
    }
}
