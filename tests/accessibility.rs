//! Accessibility of both pages, checked by axe-core.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::live_view::browser::Browser;
use crate::live_view::flight::Flight;
use crate::program::{folder, tello_ctl};
use crate::python;
use crate::report_page::report;

/// The script of axe-core in the Python package that brings it, if there is one.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn axe() -> Option<String> {
    let found = python::with("axe_playwright_python")?;
    let find = "import importlib.util as u; \
                print(u.find_spec('axe_playwright_python').submodule_search_locations[0])";
    let output = Command::new(found).args(["-c", find]).output().unwrap();
    let package = String::from_utf8(output.stdout).unwrap();
    Some(fs::read_to_string(Path::new(package.trim()).join("axe.min.js")).unwrap())
}

/// Violations that axe-core finds in the open page: the rule, its severity, and the first places.
fn violations(browser: &mut Browser, axe: &str) -> Value {
    browser.evaluates(axe);
    browser.evaluates(
        "window.found = null; axe.run().then(({ violations, passes }) => { \
         window.found = { passes: passes.length, violations: violations.map(({ id, impact, nodes }) => \
         [id, impact, nodes.length, ...nodes.slice(0, 3).map(({ html, any }) => \
         [html.slice(0, 200), ...any.map(({ message }) => message)])]) }; })",
    );
    browser.until("window.found !== null");
    browser.evaluates("window.found")
}

/// Every size and both colour schemes.
fn judge(browser: &mut Browser, axe: &str) {
    for (width, height) in [(1280, 800), (390, 844)] {
        for is_dark in [false, true] {
            browser.emulates(width, height, is_dark);
            let found = violations(browser, axe);
            assert!(found["passes"].as_u64().is_some_and(|passes| passes > 10), "{found:#}");
            let violations = found["violations"].as_array().map_or(&[][..], Vec::as_slice);
            assert!(violations.is_empty(), "{width} px, dark {is_dark}: {found:#}");
        }
    }
}

#[test]
fn pages_of_logs_are_accessible() {
    let Some(axe) = axe() else { return };
    let Some(mut browser) = Browser::start("accessibility-report") else { return };
    let folder = folder("accessibility");
    for (seed, log) in [("7", "flight.mcap"), ("8", "other.mcap")] {
        let flown = ["sim", "--seed", seed, "--profile", "outages", "--log", log];
        assert!(tello_ctl(&folder, &flown).status.success());
    }
    report(&folder, &["flight.mcap"]);
    report(&folder, &["flight.mcap", "--against", "other.mcap", "--out", "compared.html"]);
    let replayed = ["replay", "flight.mcap", "--view", "recorded.html"];
    assert!(tello_ctl(&folder, &replayed).status.success());
    for page in ["report.html", "compared.html", "recorded.html"] {
        browser.opens(&format!("file://{}#t=6", folder.join(page).display()));
        let drawn = "document.querySelector('.cursor, #timeline') !== null";
        browser.until(&format!("document.readyState === 'complete' && {drawn}"));
        judge(&mut browser, &axe);
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn the_live_page_is_accessible() {
    let Some(axe) = axe() else { return };
    let Some(mut browser) = Browser::start("accessibility-live") else { return };
    let flight = Flight::start("accessibility");
    browser.opens(&format!("http://{}/#{}", flight.address, flight.token));
    browser.until("document.body.innerText.includes('flying')");
    judge(&mut browser, &axe);
    drop(flight);
}
