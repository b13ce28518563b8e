//! `tello-ctl report` as its readers meet it: the thesis' numbers, one page, and the same in JSON.

use std::fs;

use serde_json::Value;

use crate::program;
use crate::report_page;
use crate::support;
use program::{folder, tello_ctl, text};
use report_page::{assert_equal, report};

#[test]
fn the_real_squares_have_the_numbers_of_the_thesis() {
    let Some(squares) = support::data("thesis/squares") else { return };
    let folder = folder("report-squares");
    let json = report(&folder, &[squares.to_str().unwrap(), "--figures", "figures"]);
    let group = &json["groups"][0];
    assert_eq!(group["flights"].as_array().unwrap().len(), 29);
    assert_eq!((&group["good_count"], &group["judged_count"]), (&29.into(), &29.into()));
    // Digits as in the reference, flight by flight definitions in `quantity.rs`.
    for (pointer, digits, expected) in [
        ("finish_s/q25", 2, "14.78"),
        ("finish_s/median", 2, "18.18"),
        ("finish_s/q75", 2, "22.20"),
        ("speed_mps/median", 3, "0.351"),
        // To the line itself; to the samples of the thesis, 0.02 m apart, it is 0.0784.
        ("distance_m/median", 4, "0.0782"),
        ("distance_m/p90", 3, "0.192"),
        ("distance_m/p95", 3, "0.223"),
        ("distance_m/max", 2, "0.29"),
        ("distance_4d/median", 4, "0.1410"),
        ("input_norm/median", 3, "0.365"),
        ("overshoot_m/median", 3, "0.084"),
        ("overshoot_m/p90", 3, "0.218"),
        ("overshoot_m/max", 3, "0.289"),
        ("distance_m/count", 0, "27539"),
    ] {
        let value = group["numbers"].pointer(&format!("/{pointer}")).and_then(Value::as_f64);
        assert_eq!(format!("{:.digits$}", value.unwrap()), expected, "{pointer}: {value:?}");
    }
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    let count = assert_equal(&html, &json);
    assert!(count > 29 * 6, "only {count} numbers in the page");
    let figures = fs::read_dir(folder.join("figures")).unwrap();
    for figure in figures {
        let path = figure.unwrap().path();
        let svg = fs::read_to_string(&path).unwrap();
        assert!(html.contains(&svg), "{} is not in the page", path.display());
        roxmltree::Document::parse(&svg).unwrap();
    }
}

#[test]
fn a_piloted_end_and_a_missed_target_are_named() {
    let Some(flight) = support::data("thesis/closed_loop/square1_13.log") else { return };
    let folder = folder("report-piloted");
    let json = report(&folder, &[flight.to_str().unwrap()]);
    let row = &json["groups"][0]["flights"][0];
    assert_eq!(row["judgement"], "bad", "{row}");
    let verdict = json["verdicts"][0].as_str().unwrap();
    assert!(verdict.contains("of 5 targets") || verdict.contains("targets"), "{verdict}");
    assert!(verdict.contains("a pilot flies"), "{verdict}");
}

#[test]
fn equal_groups_differ_by_nothing_and_stand_side_by_side() {
    let Some(data) = support::data("thesis/squares") else { return };
    let folder = folder("report-against");
    let mut flights: Vec<_> = fs::read_dir(data).unwrap().map(|entry| entry.unwrap()).collect();
    flights.sort_by_key(fs::DirEntry::file_name);
    fs::create_dir(folder.join("squares")).unwrap();
    for flight in flights.iter().take(6) {
        fs::copy(flight.path(), folder.join("squares").join(flight.file_name())).unwrap();
    }
    let squares = "squares";
    let json = report(&folder, &[squares, "--against", squares, "--out", "both.html"]);
    assert_eq!(json["groups"][0]["numbers"], json["groups"][1]["numbers"]);
    assert_eq!(json["comparison"]["paired_by"], "name");
    let differences = json["comparison"]["differences"].as_array().unwrap();
    assert!(differences.len() > 4, "{differences:?}");
    for row in differences {
        assert_eq!((&row["pairs"], &row["difference"]), (&6.into(), &0.0.into()), "{row}");
        assert_eq!(row["interval"], serde_json::json!([0.0, 0.0]), "{row}");
    }
    assert_equal(&fs::read_to_string(folder.join("both.html")).unwrap(), &json);
}

#[test]
fn files_without_a_flight_are_named_and_do_not_stop_the_others() {
    let folder = folder("report-unusable");
    fs::write(folder.join("empty.log"), "").unwrap();
    fs::write(folder.join("torn.log"), "pospos,1,2").unwrap();
    let output = tello_ctl(&folder, &["report", "empty.log", "torn.log"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let all = text(&output);
    assert!(all.contains("empty.log") && all.contains("torn.log"), "{all}");
    let rows: Vec<String> =
        (0..50).map(|k| format!("pos,{k},0.{k:03},0,1,0\ninput,{k},0,0.5,0,0\n")).collect();
    fs::write(folder.join("a<b>&'c'.log"), rows.concat()).unwrap();
    let output = tello_ctl(&folder, &["report", "empty.log", "a<b>&'c'.log"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(html.contains("a&lt;b&gt;&amp;&#39;c&#39;"), "the name is not escaped");
    assert!(html.contains("not judged") && !html.contains("a<b>"), "{}", text(&output));
}
