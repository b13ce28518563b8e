//! The pages by keys alone: order of Tab, visible focus, orders and what becomes of them, time cursor and zoom.

use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value, json};
use tello_sim::{Cause, DronePhase};

use crate::live_view::browser::Browser;
use crate::live_view::flight::Flight;
use crate::program::{tello_ctl, text};
use crate::report_browser::Flown;

/// Keeps every class that a button of an order gets, as `hold:done`.
const WATCH_BUTTONS: &str = "window.seen = []; new MutationObserver((changes) => changes.forEach(({ target }) => \
    seen.push(...[...target.classList].map((name) => `${target.id}:${name}`)))).observe( \
    document.querySelector('.orders'), { attributes: true, subtree: true, attributeFilter: ['class'] })";

/// A flight, and its page with the token.
fn live_page(name: &str) -> Option<(Browser, Flight)> {
    let mut browser = Browser::start(name)?;
    let flight = Flight::start(name);
    browser.opens(&format!("http://{}/#{}", flight.address, flight.token));
    browser.until("!document.getElementById('land').disabled");
    browser.until("document.getElementById('phase').textContent === 'flying'");
    browser.evaluates(WATCH_BUTTONS);
    Some((browser, flight))
}

#[test]
fn orders_of_the_live_page_are_given_and_acknowledged_by_keys() {
    let Some((mut browser, flight)) = live_page("keyboard-orders") else { return };
    // Each is next after the one before.
    browser.tabs_to("e.tagName === 'SUMMARY'");
    for id in ["land", "hold"] {
        browser.presses("Tab");
        assert_eq!(browser.evaluates("document.activeElement.id"), id);
    }
    browser.presses("Enter");
    browser.until("document.getElementById('steers').textContent === 'BY HAND'");
    browser.until("seen.includes('hold:done')");
    browser.until("document.getElementById('answer').textContent === 'hold: ordered'");
    browser.tabs_to("e.id === 'automatic'");
    browser.presses(" ");
    browser.until("document.getElementById('steers').textContent === 'automatic'");
    browser.until("seen.includes('automatic:done')");
    // Keys without a button; one that is held together with Ctrl is the browser's.
    browser.presses("e");
    browser.until("document.getElementById('steers').textContent === 'BY HAND'");
    browser.presses("c");
    browser.until("document.getElementById('steers').textContent === 'automatic'");

    // A short press stops no motor, a long one does.
    browser.tabs_to("e.id === 'emergency_stop'");
    browser.presses("Enter");
    sleep(Duration::from_millis(700));
    flight.wait_for(DronePhase::Flying);
    browser.key("Enter", true);
    flight.wait_for(DronePhase::Falling);
    browser.key("Enter", false);
    browser.until("seen.includes('emergency_stop:done')");
    flight.wait_for(DronePhase::Grounded);
    flight.ends();
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn a_key_lands_and_a_lost_connection_is_reported() {
    let Some((mut browser, flight)) = live_page("keyboard-land") else { return };
    browser.presses("r");
    browser.until("document.getElementById('answer').textContent === 'land: ordered'");
    flight.wait_for(DronePhase::Landing(Cause::Order));
    flight.wait_for(DronePhase::Grounded);
    browser.until("document.getElementById('line').textContent === 'FLIGHT OVER'");
    flight.ends();
    browser.until("wire.socket.readyState !== WebSocket.OPEN");
    browser.presses("e");
    browser.until(
        "document.getElementById('answer').textContent.startsWith('hold: NOT SENT: no connection')",
    );
}

/// Times and places of all cursors of the page, each once.
const CURSORS: &str = "[...new Set([...document.querySelectorAll('.cursor')].map((it) => \
    `${it.dataset.t} ${it.getAttribute('d').split(' ')[0]}`))]";

/// Opens a page of `flown` and waits for its script.
fn opens(browser: &mut Browser, flown: &Flown, page: &str) {
    browser.emulates(1280, 800, false);
    browser.opens(&format!("file://{}", flown.folder.join(page).display()));
    browser.until("document.readyState === 'complete' && document.querySelector('[tabindex], #timeline') !== null");
}

#[test]
fn a_report_is_read_zoomed_and_turned_by_keys() {
    let Some(mut browser) = Browser::start("keyboard-report-browser") else { return };
    let Some(flown) = Flown::new("keyboard-report") else { return };
    opens(&mut browser, &flown, "report.html");
    let track = "document.querySelector('.track').getAttribute('d')";
    browser.tabs_to("e.tagName === 'svg' && e.ariaLabel.includes('space')");
    let unturned = browser.evaluates(track);
    browser.presses("ArrowRight");
    let turned = browser.evaluates(track);
    assert_ne!(turned, unturned);
    browser.tabs_to("e.tagName === 'INPUT'");
    browser.presses("ArrowRight");
    assert_ne!(browser.evaluates(track), turned);

    browser.tabs_to("e.tagName === 'svg' && e.ariaLabel.includes('state')");
    (0..40).for_each(|_| browser.presses("ArrowRight"));
    let cursors = browser.evaluates(CURSORS);
    let [cursor] = cursors.as_array().unwrap().as_slice() else { panic!("{cursors}") };
    let time_s: f64 = cursor.as_str().unwrap().split(' ').next().unwrap().parse().unwrap();
    let states = flown.states();
    let is_it = |(t, _): &&(f64, Value)| (t - time_s).abs() < 1e-9;
    let (_, state) = states.iter().find(is_it).unwrap();
    let label =
        browser.evaluates("document.querySelector('figure[id$=state] .values').textContent");
    let value = format!("; state {:.4} m", state["x"].as_f64().unwrap());
    assert!(label.as_str().unwrap().contains(&value), "{value}: {label}");

    // Zoomed: the cursors of all figures go together, and the time moves on in smaller steps.
    let parts = "document.querySelectorAll('.overlay .grid').length";
    assert_eq!(browser.evaluates(parts), json!(0));
    (0..2).for_each(|_| browser.presses("+"));
    assert!(browser.evaluates(parts).as_u64() > Some(10));
    let zoomed = browser.evaluates(CURSORS);
    assert_eq!(zoomed.as_array().map(Vec::len), Some(1), "{zoomed}");
    assert_ne!(zoomed, cursors);
    browser.presses("Escape");
    assert_eq!((browser.evaluates(parts), browser.evaluates(CURSORS)), (json!(0), cursors));
    // Nothing keeps the focus.
    browser.tabs_to("e === document.body");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn a_recorded_flight_is_played_by_keys() {
    let Some(mut browser) = Browser::start("keyboard-recorded-browser") else { return };
    let Some(flown) = Flown::new("keyboard-recorded") else { return };
    let replayed = tello_ctl(&flown.folder, &["replay", "flight.mcap", "--view", "flight.html"]);
    assert!(replayed.status.success(), "{}", text(&replayed));
    opens(&mut browser, &flown, "flight.html#t=6");
    browser.tabs_to("e.id === 'play'");
    browser.presses("Enter");
    browser.until("document.activeElement.textContent === 'Pause'");
    browser.until("Number(document.getElementById('time').textContent) > 6");
    browser.presses(" ");
    browser.until("document.activeElement.textContent === 'Play'");
    browser.tabs_to("e.id === 'timeline'");
    let time_s = "Number(document.getElementById('timeline').value)";
    let before = browser.evaluates(time_s).as_f64();
    (0..5).for_each(|_| browser.presses("ArrowRight"));
    assert!(browser.evaluates(time_s).as_f64() > before);
    browser.tabs_to("e === document.body");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
