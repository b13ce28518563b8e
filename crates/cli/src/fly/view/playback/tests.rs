use horizon_model::{Kinematic, Model};
use serde_json::Value;
use tello_flight::Start;
use tello_flight::cycle::Outcome;
use tello_io::clock::TimeNs;
use tello_io::config;

use super::*;

/// The page of a flight of `ticks` ticks.
fn page(ticks: u64, note: Option<&str>) -> Result<String> {
    let (table, mission) = config::fly(None, None).unwrap();
    let mut playback = Playback::new(&config::flight(&table, mission, Start::Grounded)).unwrap();
    let out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 1);
    let mut tick = TickRecord::with_buffers(&out);
    for step in 0..ticks {
        tick.inbox.open(step, TimeNs(step.cast_signed() * 20_000_000));
        tick.out.step = step;
        playback.add(&tick).unwrap();
    }
    playback.page(note)
}

/// What a page plays.
fn recording(page: &str) -> Value {
    let (_, rest) = page.split_once("id=\"recording\">").unwrap();
    let (text, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(text).unwrap()
}

fn steps(page: &str) -> Vec<u64> {
    let recording = recording(page);
    let facts = recording["facts"].as_array().unwrap();
    facts.iter().map(|facts| facts["step"].as_u64().unwrap()).collect()
}

#[test]
fn a_flight_without_a_tick_has_no_page() {
    assert_eq!(page(0, None).unwrap_err().to_string(), "there is no tick to play");
    assert_eq!(steps(&page(1, None).unwrap()), [0]);
}

#[test]
fn the_page_has_all_in_itself_and_takes_nothing_from_elsewhere() {
    let page = page(10, None).unwrap();
    for from_elsewhere in ["page.css", "src=\"page.js\""] {
        assert!(PAGE.contains(from_elsewhere), "the page of the server names {from_elsewhere}");
        assert!(!page.contains(from_elsewhere), "{from_elsewhere}");
    }
    for part in [STYLE, POLICY, PLAYER, SCRIPT, PLAY] {
        assert_eq!(page.matches(part).count(), 1);
    }
    assert_eq!(page.matches("</body>").count(), 1);
}

#[test]
fn facts_come_in_their_order_as_often_as_a_browser_would_get_them() {
    // One in 40 ms.
    assert_eq!(steps(&page(9, None).unwrap()), [0, 2, 4, 6, 8]);
}

#[test]
fn a_long_flight_leaves_facts_out_evenly_and_keeps_its_first() {
    let ticks = 2 * FACTS_MAX as u64 + 2;
    let steps = steps(&page(ticks, None).unwrap());
    assert_eq!((steps.len(), steps[0]), (FACTS_MAX.div_ceil(2) + 1, 0));
    assert!(steps.windows(2).all(|pair| pair[1] - pair[0] == 4), "{:?}", &steps[..9]);
}

#[test]
fn no_text_of_a_flight_ends_the_element_that_it_stands_in() {
    let note = "</script><script>alert(1)</script>";
    let page = page(3, Some(note)).unwrap();
    assert!(!page.contains("alert(1)</script>"));
    assert_eq!(recording(&page)["note"], note);
    assert_eq!(recording(&self::page(3, None).unwrap())["note"], Value::Null);
}
