use super::*;

/// Finite text, places of what was replaced, and the problems with their places.
fn finite(text: &str) -> (String, Vec<KeyPath>, Vec<SettingProblem>) {
    let mut found = Problems::default();
    let (finite, replaced) = finite_text(text.to_owned(), "a.json", &mut found);
    (finite, replaced, found.list)
}

#[test]
fn every_number_that_json_does_not_have_becomes_a_zero_of_its_length() {
    let (text, replaced, problems) =
        finite("{\n  \"a\": NaN,\n  \"b\": { \"c\": [1.5, -Infinity, 2] }, \"d\": inf\n}");
    assert_eq!(text, "{\n  \"a\": 0  ,\n  \"b\": { \"c\": [1.5, 0        , 2] }, \"d\": 0  \n}");
    assert_eq!(replaced, ["a", "b.c[1]", "d"].map(KeyPath::of_key));
    let of = |place, text: &str| SettingProblem {
        file: "a.json".to_owned(),
        place: Some(place),
        text: text.to_owned(),
    };
    assert_eq!(
        problems,
        [
            of((2, 8), "a = NaN: expected finite"),
            of((3, 21), "b.c[1] = -Infinity: expected finite"),
            of((3, 43), "d = inf: expected finite"),
        ]
    );
}

#[test]
fn finite_numbers_and_other_mistakes_are_left_alone() {
    for text in ["{ \"a\": 1e300, \"b\": \"NaN\" }", "{ \"a\": nope }", "{ \"a\": ", "", "NaNs"] {
        assert_eq!(finite(text), (text.to_owned(), vec![], vec![]));
    }
}

#[test]
fn a_text_that_is_no_json_has_a_place_and_no_second_one() {
    for (text, place, reported) in [
        ("{ \"a\": 1,\n  \"b\": nope }", (2, 9), "b: expected a JSON value"),
        ("{ \"a\": 1", (1, 8), "EOF while parsing an object"),
        ("", (1, 0), "EOF while parsing a value"),
    ] {
        let error = serde_json::from_str::<Value>(text).unwrap_err();
        let problem = SettingProblem::of_text(text, "a.json".to_owned(), &error);
        assert_eq!((problem.place, problem.text.as_str()), (Some(place), reported), "{text}");
        let problem = SettingProblem::of_text(text, "a.csv".to_owned(), &error);
        assert!(
            problem.text.ends_with("a mission names its CSV: \"trajectory\", \"points\", \"csv\"")
        );
    }
}
