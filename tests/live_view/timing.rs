//! How late ticks are with and without those who watch: numbers to look at, which a busy machine changes.

use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, sleep};
use std::time::Duration;

use serde_json::Value;
use tello_io::log::LogReader;

use super::browser::Browser;
use super::flight::{Flight, Watcher};

/// Flights of each kind, one after the other in turns.
const FLIGHTS: usize = 2;

/// When the browser is killed, after it was opened.
const BROWSER_LIVES: Duration = Duration::from_secs(10);

/// Lateness and length of every tick. ms
#[derive(Debug, Default)]
struct Ticks {
    late: Vec<f64>,
    length: Vec<f64>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Ticks {
    fn add(&mut self, log: &Path) {
        let mut log = LogReader::open(log).unwrap();
        while let Some(message) = log.next_message().unwrap() {
            if message.topic == "/cycle/timing" {
                let timing: Value = serde_json::from_slice(message.data).unwrap();
                let ms = |key: &str| timing[key].as_f64().unwrap() * 1e-6;
                self.late.push(ms("late_ns"));
                self.length.push(ms("tick_ns"));
            }
        }
    }

    fn show(&mut self, kind: &str) {
        for (what, values) in [("late", &mut self.late), ("length", &mut self.length)] {
            values.sort_by(f64::total_cmp);
            let last = values.len() - 1;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=1")]
            let fraction = |fraction: f64| values[(fraction * last as f64) as usize];
            let [p50, p95, p99, p999, max] = [0.5, 0.95, 0.99, 0.999, 1.0].map(fraction);
            println!(
                "{kind:<8} {:6} ticks, {what:<6} {p50:.3} {p95:.3} {p99:.3} {p999:.3} {max:.3} ms",
                values.len()
            );
        }
    }
}

/// Two who say too much and come again, and two who ask for files as fast as they get them.
fn flood(flight: &Flight, stop: &Arc<AtomicBool>, done: &Arc<AtomicU64>) {
    for number in 0..4 {
        let (address, stop, done) = (flight.address.clone(), Arc::clone(stop), Arc::clone(done));
        thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                if number % 2 == 0 {
                    let Some(mut watcher) = Watcher::try_open(&address) else { continue };
                    (0..200).for_each(|_| watcher.says_bytes(r#"{"order":"land"}"#));
                    watcher.reads_to_the_end();
                } else if let Ok(mut stream) = TcpStream::connect(&address) {
                    let request = format!("GET /page.js HTTP/1.1\r\nHost: {address}\r\n\r\n");
                    stream.write_all(request.as_bytes()).ok();
                    stream.read_to_end(&mut Vec::new()).ok();
                }
                done.fetch_add(1, Ordering::Relaxed);
            }
        });
    }
}

#[test]
#[ignore = "several minutes, and nothing that can fail: prints the numbers of docs/benchmarks"]
fn ticks_with_and_without_watchers() {
    let mut kinds =
        [("alone", Ticks::default()), ("browser", Ticks::default()), ("flood", Ticks::default())];
    let done = Arc::new(AtomicU64::new(0));
    for number in 0..FLIGHTS {
        for (kind, ticks) in &mut kinds {
            let name = format!("timing-{kind}-{number}");
            let flight = Flight::start_with(&name, *kind != "alone");
            let stop = Arc::new(AtomicBool::new(false));
            if *kind == "flood" {
                flood(&flight, &stop, &done);
            }
            if *kind != "alone"
                && let Some(mut browser) = Browser::start(&format!("live-view-browser-{name}"))
            {
                browser.opens(&format!("http://{}/#{}", flight.address, flight.token));
                sleep(BROWSER_LIVES);
                // Dropped, it is killed.
            }
            let log = flight.ends();
            stop.store(true, Ordering::Relaxed);
            ticks.add(&log);
        }
    }
    for (kind, ticks) in &mut kinds {
        ticks.show(kind);
    }
    println!("{} connections of floods", done.load(Ordering::Relaxed));
    if let Ok(mut load) = File::open("/proc/loadavg") {
        let mut text = String::new();
        load.read_to_string(&mut text).ok();
        println!("load of the machine {text}");
    }
}
