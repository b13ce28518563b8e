//! The live page during real flights over real sockets: judged by what reaches the emulated drone.

#[path = "live_view/browser.rs"]
pub(crate) mod browser;
#[path = "live_view/flight.rs"]
pub(crate) mod flight;
#[path = "live_view/timing.rs"]
mod timing;

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value, json};
use tello_io::clock::Clock;
use tello_sim::{Cause, DronePhase};

use browser::Browser;
use flight::{Flight, Watcher};

/// The status line of the answer to a request with these headers.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn status(address: &str, path: &str, headers: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    let request = format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.lines().next().unwrap_or_default().to_owned()
}

#[test]
fn any_client_may_watch_and_only_the_token_lands() {
    let flight = Flight::start("token");
    let address = &flight.address;

    // Pages of other origins, and names that were pointed to this machine, get nothing.
    let own = format!("Host: {address}\r\n");
    assert!(status(address, "/", &own).contains(" 200 "), "{}", status(address, "/", &own));
    for headers in [
        "Host: evil.example\r\n".to_owned(),
        format!("{own}Origin: http://evil.example\r\n"),
        format!("{own}Origin: null\r\n"),
    ] {
        for path in ["/", "/live"] {
            let status = status(address, path, &headers);
            assert!(status.contains(" 403 "), "{path} {headers}: {status}");
        }
    }

    let mut looker = Watcher::open(&flight);
    let briefing = looker.hears("briefing");
    let path = briefing["briefing"]["path"].as_array().map_or(0, Vec::len);
    assert!(path > 1, "{briefing}");
    let first = looker.until("flying", |facts| facts["phase"] == "flying");
    let moved = looker.until("a metre from the start", |facts| {
        let [x, y] = ["x", "y"].map(|row| facts["estimate"][row].as_f64().unwrap_or(0.0));
        x.hypot(y) > 1.0 && !facts["plan"].as_array().is_none_or(Vec::is_empty)
    });
    assert!(moved["step"].as_u64() > first["step"].as_u64(), "{first} {moved}");

    looker.says(&json!({ "order": "land" }));
    let answer = looker.hears("answer");
    assert!(answer["refusal"].as_str().is_some_and(|why| why.contains("only look")), "{answer}");
    looker.says(&json!({ "token": "0".repeat(32) }));
    assert_eq!(looker.hears("access")["may_order"], false);
    assert_eq!(flight.emulator.truth().phase, DronePhase::Flying);

    // Too much, and nonsense, ends the connection and not the flight.
    for flood in [vec![r#"{"order":"land"}"#; 200], vec!["what?"], vec![&*"x".repeat(5_000)]] {
        let mut flooder = Watcher::open(&flight);
        for text in &flood {
            flooder.says_bytes(text);
        }
        flooder.leaves_by_force();
    }

    // He who holds the drone from a page, and is gone, is replaced by a landing.
    let mut looker = Watcher::open(&flight);
    let mut pilot = Watcher::open(&flight);
    pilot.says(&json!({ "token": flight.token }));
    assert_eq!(pilot.hears("access")["may_order"], true);
    pilot.says(&json!({ "order": "hold" }));
    assert_eq!(pilot.hears("answer")["refusal"], Value::Null);
    looker.until("by hand", |facts| facts["is_by_hand"] == true);
    pilot.says(&json!({ "order": "automatic" }));
    looker.until("automatic", |facts| facts["is_by_hand"] == false);
    pilot.says(&json!({ "order": "hold" }));
    looker.until("by hand", |facts| facts["is_by_hand"] == true);
    assert_eq!(flight.emulator.truth().phase, DronePhase::Flying);
    drop(pilot);
    flight.wait_for(DronePhase::Landing(Cause::Order));
    looker.until("landed", |facts| facts["phase"] == "landed");
    assert_eq!(flight.emulator.truth().phase, DronePhase::Grounded);
    looker.hears_the_end();
    flight.ends();
}

#[test]
fn idle_and_half_sent_connections_keep_nobody_from_the_page_and_its_orders() {
    let flight = Flight::start("crowd");
    let address = &flight.address;
    // Watchers beside, all that there is room for, so that the flight is known to fly.
    let mut lookers: Vec<_> = (0..8).map(|_| Watcher::open(&flight)).collect();
    lookers[0].until("flying", |facts| facts["phase"] == "flying");
    let idle: Vec<_> = (0..32).map(|_| TcpStream::connect(address).unwrap()).collect();
    let half_sent: Vec<_> = (0..60)
        .map(|_| {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nHost: 127").unwrap();
            stream
        })
        .collect();

    let clock = Clock::start();
    let own = format!("Host: {address}\r\n");
    for path in ["/", "/page.css", "/page.js"] {
        let status = status(address, path, &own);
        assert!(status.contains(" 200 "), "{path}: {status}");
    }
    let page_s = clock.now().seconds();
    assert!(page_s < 2.0, "{page_s:.2} s for the page");
    let mut pilot = Watcher::open(&flight);
    pilot.says(&json!({ "token": flight.token }));
    assert_eq!(pilot.hears("access")["may_order"], true);
    pilot.says(&json!({ "order": "land" }));
    assert_eq!(pilot.hears("answer")["refusal"], Value::Null);
    flight.wait_for(DronePhase::Landing(Cause::Order));
    let land_s = clock.now().seconds();
    println!("page after {page_s:.2} s, landing after {land_s:.2} s");
    assert!(land_s < 4.0, "{land_s:.2} s to a landing");
    // The operator's slot is reserved.
    pilot.until("landed", |facts| facts["phase"] == "landed");

    // Connections without a complete request are closed by the timeout.
    for mut stream in half_sent.into_iter().chain(idle) {
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let end = stream.read(&mut [0; 64]);
        let is_open = end.as_ref().is_err_and(|error| error.kind() == ErrorKind::WouldBlock);
        assert!(!is_open, "still connected");
    }
    drop((pilot, lookers));
    flight.ends();
}

#[test]
fn a_page_that_holds_the_drone_and_falls_silent_is_replaced_by_a_landing() {
    let flight = Flight::start("silent");
    let mut pilot = Watcher::open(&flight);
    let mut looker = Watcher::open(&flight);
    pilot.says(&json!({ "token": flight.token }));
    assert_eq!(pilot.hears("access")["may_order"], true);
    pilot.until("flying", |facts| facts["phase"] == "flying");
    pilot.says(&json!({ "order": "hold" }));
    looker.until("by hand", |facts| facts["is_by_hand"] == true);
    // Its connection stays open, as behind a radio that is out of range, and nothing answers.
    let clock = Clock::start();
    flight.wait_for(DronePhase::Landing(Cause::Order));
    let land_s = clock.now().seconds();
    println!("landing {land_s:.2} s after the last word of the page");
    assert!((0.9..3.5).contains(&land_s), "{land_s:.2} s");
    flight.wait_for(DronePhase::Grounded);
    drop(pilot);
    flight.ends();
}

#[test]
fn an_emergency_stop_from_the_page_reaches_the_drone_at_once() {
    let flight = Flight::start("emergency-stop");
    let mut pilot = Watcher::open(&flight);
    pilot.says(&json!({ "token": flight.token }));
    assert_eq!(pilot.hears("access")["may_order"], true);
    pilot.until("flying", |facts| facts["phase"] == "flying");
    pilot.says(&json!({ "order": "emergency_stop" }));
    flight.wait_for(DronePhase::Falling);
    pilot.until("emergency stop", |facts| facts["phase"] == "motors_stopped");
    flight.wait_for(DronePhase::Grounded);
    flight.ends();
}

#[test]
fn a_browser_draws_the_flight_and_its_land_button_lands_the_drone() {
    let Some(mut browser) = Browser::start("live-view-browser") else { return };
    let flight = Flight::start("browser");
    // Without the token: numbers and pictures, and no button that works.
    browser.opens(&format!("http://{}/", flight.address));
    browser.until("document.getElementById('line').textContent === 'LIVE'");
    assert_eq!(browser.evaluates("document.getElementById('land').disabled"), json!(true));

    browser.opens(&format!("http://{}/#{}", flight.address, flight.token));
    browser.until("!document.getElementById('land').disabled");
    browser.until("document.getElementById('phase').textContent === 'flying'");
    browser.until("Number(document.getElementById('rate').textContent) > 20");
    // Every canvas has colours on it, and that from above those of vehicle and plan.
    browser.until(DRAWN);
    let before = browser.evaluates("document.getElementById('place').textContent");
    sleep(Duration::from_millis(500));
    let after = browser.evaluates("document.getElementById('place').textContent");
    assert_ne!(before, after, "the numbers stand still");

    // A stray click stops no motor.
    browser.clicks("emergency_stop");
    sleep(Duration::from_millis(300));
    assert_eq!(flight.emulator.truth().phase, DronePhase::Flying);
    browser.clicks("land");
    flight.wait_for(DronePhase::Landing(Cause::Order));
    flight.wait_for(DronePhase::Grounded);
    browser.until("document.getElementById('line').textContent === 'FLIGHT OVER'");
    flight.ends();
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// Whether each canvas has had some pixels of the colours that must be there; `missing` keeps those that it had not.
const DRAWN: &str = r"(() => {
  const colours = palette();
  const missing = window.missing ??= { above: ['trail', 'plan', 'committed', 'goal'],
    side: ['trail', 'plan'], sticks: ['trail'], strip: ['trail'] };
  for (const [id, names] of Object.entries(missing)) {
    if (names.length === 0) continue;
    const canvas = document.getElementById(id);
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    missing[id] = names.filter((name) => {
      const [r, g, b] = [1, 3, 5].map((k) => parseInt(colours[name].slice(k, k + 2), 16));
      let count = 0;
      for (let k = 0; k < data.length; k += 4) {
        const off = Math.abs(data[k] - r) + Math.abs(data[k + 1] - g) + Math.abs(data[k + 2] - b);
        count += off < 9 && data[k + 3] > 100;
      }
      return count <= 10;
    });
  }
  return Object.values(missing).every((names) => names.length === 0);
})()";
