//! The page of `tello-ctl report` in a browser.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tello_io::log::LogReader;

use crate::program::{folder, tello_ctl, text};
use crate::report_page::{assert_equal, numbers, report};
use crate::{chromium, support};

/// Output of Chromium for `page` in `folder`, started with `arguments` and without a network.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn open(chromium: &OsString, folder: &Path, page: &str, arguments: &[&str]) -> Output {
    let output = Command::new("timeout")
        .arg("90")
        .arg(chromium)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--disable-dev-shm-usage", "--hide-scrollbars", "--enable-logging=stderr"])
        .arg(format!("--user-data-dir={}", folder.join("browser").display()))
        .args(arguments)
        .arg(format!("file://{}", folder.join(page).display()))
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output));
    output
}

fn console(output: &Output) -> Vec<String> {
    let stderr = String::from_utf8_lossy(&output.stderr);
    stderr.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect()
}

/// Labels and cursors of the open page: times of the cursors with their places, and labels.
fn shown(dom: &str) -> (Vec<(&str, &str)>, Vec<&str>) {
    let attribute = |tag: &'_ str, name: &str| -> Option<(usize, usize)> {
        let begin = tag.find(&format!(" {name}=\""))? + name.len() + 3;
        Some((begin, begin + tag[begin..].find('"')?))
    };
    let tags = || dom.split('<').skip(1);
    let cursors = tags().filter(|tag| tag.contains("class=\"cursor\"")).filter_map(|tag| {
        let (time, way) = (attribute(tag, "data-t")?, attribute(tag, "d")?);
        Some((&tag[time.0..time.1], tag[way.0..way.1].split(' ').next()?))
    });
    let labels = tags().filter(|tag| tag.contains("class=\"values\""));
    (cursors.collect(), labels.filter_map(|tag| Some(tag.split_once('>')?.1)).collect())
}

/// A simulated flight with its report, and the browser that opens it.
pub(crate) struct Flown {
    chromium: OsString,
    pub(crate) folder: PathBuf,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Flown {
    /// `None` without a browser.
    pub(crate) fn new(name: &str) -> Option<Self> {
        let chromium = chromium::find()?;
        let folder = folder(name);
        let flight = ["sim", "--seed", "7", "--profile", "outages", "--log", "flight.mcap"];
        assert!(tello_ctl(&folder, &flight).status.success());
        report(&folder, &["flight.mcap"]);
        Some(Self { chromium, folder })
    }

    /// The document of `page` after its scripts, which complain of nothing.
    fn dom(&self, page: &str) -> String {
        let dumped = open(&self.chromium, &self.folder, page, &["--dump-dom"]);
        assert_eq!(console(&dumped), Vec::<String>::new());
        String::from_utf8(dumped.stdout).unwrap()
    }

    /// The states of the log with their times, in its order.
    pub(crate) fn states(&self) -> Vec<(f64, Value)> {
        let log = LogReader::open(&self.folder.join("flight.mcap")).unwrap();
        let mut log = log.select(&["/estim/state"]);
        let mut states = Vec::new();
        while let Some(message) = log.next_message().unwrap() {
            states.push((message.t.seconds(), message.decode::<Value>().unwrap()));
        }
        states
    }
}

#[test]
fn values_and_zoom_of_the_page_are_those_of_the_log() {
    let Some(flown) = Flown::new("report-hover") else { return };
    let states = flown.states();
    for t_s in [0.5, 6.0, 9.13] {
        let dom = flown.dom(&format!("report.html#t={t_s}"));
        let (cursors, labels) = shown(&dom);
        let by_gap =
            |a: &&(f64, Value), b: &&(f64, Value)| (a.0 - t_s).abs().total_cmp(&(b.0 - t_s).abs());
        let (time_s, state) = states.iter().min_by(by_gap).unwrap();
        assert!(cursors.len() > 10, "{cursors:?}");
        for (time, place) in &cursors {
            assert!((time.parse::<f64>().unwrap() - time_s).abs() < 1e-9, "{cursors:?}");
            assert_eq!(*place, cursors[0].1, "the cursor is not in step");
        }
        for (label, row) in labels.iter().zip(["x", "y", "z", "theta"]) {
            let value = format!("; state {:.4} ", state[row].as_f64().unwrap());
            assert!(label.contains(&value), "{row}: {value} is not in {label}");
        }
    }
    // A pointer over the figure of the state, then two steps of zoom by the keyboard.
    let page = fs::read_to_string(flown.folder.join("report.html")).unwrap();
    let events = "<script>const svg = document.querySelector('figure[id$=\"state\"] svg');\
        const box = svg.getBoundingClientRect();\
        svg.dispatchEvent(new PointerEvent('pointermove', {clientX: box.left + 0.4 * box.width, clientY: box.top + 60}));\
        for (const key of ['+', '+']) svg.dispatchEvent(new KeyboardEvent('keydown', {key}));</script>";
    fs::write(flown.folder.join("driven.html"), page + events).unwrap();
    let driven = flown.dom("driven.html");
    let (cursors, labels) = shown(&driven);
    let paths = |html: &str| html.matches("<path").count();
    let (whole, zoomed) = (paths(&flown.dom("report.html")), paths(&driven) - cursors.len());
    assert!(cursors.len() > 10 && !labels.is_empty(), "the pointer shows nothing");
    assert!(cursors.iter().all(|cursor| *cursor == cursors[0]), "{cursors:?}");
    assert!(zoomed > whole, "a zoom draws nothing");
}

#[test]
fn the_track_in_space_turns_and_a_log_plays_as_a_live_page() {
    let Some(flown) = Flown::new("report-turns") else { return };
    let page = fs::read_to_string(flown.folder.join("report.html")).unwrap();
    let with_keys = |keys: &str| {
        let events = format!(
            "<script>for (const key of [{keys}]) document.querySelector('figure[id$=\"space\"] svg')\
             .dispatchEvent(new KeyboardEvent('keydown', {{key}}));</script>"
        );
        fs::write(flown.folder.join("turned.html"), format!("{page}{events}")).unwrap();
        let dom = flown.dom("turned.html");
        let track = dom.split("<path").find(|tag| tag.contains("class=\"track\"")).unwrap();
        track.split('>').next().unwrap().to_owned()
    };
    let first = with_keys("");
    assert_ne!(with_keys("'ArrowRight'"), first);
    assert_ne!(with_keys("'ArrowUp'"), first);
    assert_eq!(with_keys("'ArrowRight', 'ArrowUp', 'Escape'"), first);
    // Once around, in steps of 5 degrees: the same up to the rounding of the angle.
    let points = |tag: &str| tag.matches('L').count();
    assert_eq!(points(&with_keys("...Array(72).fill('ArrowLeft')")), points(&first));

    let replayed = tello_ctl(&flown.folder, &["replay", "flight.mcap", "--view", "flight.html"]);
    assert!(replayed.status.success(), "{}", text(&replayed));
    let played = flown.dom("flight.html#t=6");
    let shown = |id: &str| {
        let rest = played.split(&format!("id=\"{id}\"")).nth(1).unwrap();
        rest.split(['>', '<']).nth(1).unwrap().replace(['\u{2002}'], " ").replace('\u{2212}', "-")
    };
    assert_eq!((shown("time"), shown("line")), ("6.0".into(), "RECORDED".into()));
    let states = flown.states();
    let (_, state) = states.iter().rev().find(|(time_s, _)| *time_s <= 6.0).unwrap();
    let place = shown("place");
    let numbers: Vec<f64> = place.split(' ').map(|number| number.parse().unwrap()).collect();
    for (number, row) in numbers.iter().zip(["x", "y", "z"]) {
        // Rounded to a centimetre, of a tick that is at most 0.04 s older.
        let difference = (number - state[row].as_f64().unwrap()).abs();
        assert!(difference < 0.05, "{row}: {place} against {state}");
    }
    assert_eq!(numbers.len(), 3);
}

/// Fractions of pixels of a picture that are nearly `color`, red, green and blue.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fraction(picture: &Path, color: [u8; 3]) -> f64 {
    let picture = tiny_skia::Pixmap::load_png(picture).unwrap();
    let is_near = |pixel: &&tiny_skia::PremultipliedColorU8| {
        let channels = [pixel.red(), pixel.green(), pixel.blue()];
        channels.iter().zip(color).all(|(a, b)| a.abs_diff(b) < 12)
    };
    picture.pixels().iter().filter(is_near).count() as f64 / picture.pixels().len() as f64
}

#[test]
fn a_browser_draws_the_page_in_light_in_dark_and_on_paper() {
    let Some(chromium) = chromium::find() else { return };
    let Some(squares) = support::data("thesis/squares") else { return };
    let folder = folder("report-browser");
    let json = report(&folder, &[squares.to_str().unwrap()]);
    let open = |page, arguments: &[&str]| open(&chromium, &folder, page, arguments);

    let dumped = open("report.html", &["--dump-dom"]);
    assert_eq!(console(&dumped), Vec::<String>::new());
    let dom = String::from_utf8(dumped.stdout).unwrap();
    let count = assert_equal(&dom, &json);
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    assert_eq!(count, numbers(&html).len(), "the browser has lost numbers");
    assert_eq!(dom.matches("<svg").count(), html.matches("<svg").count());
    // The check of the console sees what there is to see.
    fs::write(folder.join("bad.html"), "<script>throw new Error('seen')</script>").unwrap();
    let bad = console(&open("bad.html", &["--dump-dom"]));
    assert!(bad.iter().any(|line| line.contains("seen")), "{bad:?}");

    let size = "--window-size=1100,3200";
    let [light, dark] = ["light.png", "dark.png"].map(|name| folder.join(name));
    open("report.html", &[size, &format!("--screenshot={}", light.display())]);
    let is_dark = "--blink-settings=preferredColorScheme=0";
    open("report.html", &[size, is_dark, &format!("--screenshot={}", dark.display())]);
    for (picture, paper, line) in
        [(&light, [255; 3], [0x00, 0x72, 0xb2]), (&dark, [0x15, 0x17, 0x1a], [0x4a, 0xa8, 0xe8])]
    {
        let fractions = [fraction(picture, paper), fraction(picture, line)];
        assert!(fractions[0] > 0.5 && fractions[1] > 2e-4, "{}: {fractions:?}", picture.display());
    }
    let pdf = folder.join("print.pdf");
    open("report.html", &["--no-pdf-header-footer", &format!("--print-to-pdf={}", pdf.display())]);
    let bytes = fs::read(&pdf).unwrap();
    assert!(bytes.starts_with(b"%PDF") && bytes.len() > 100_000, "{} bytes", bytes.len());
}
