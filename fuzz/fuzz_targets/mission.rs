//! Missions as JSON and as CSV: refused, or planned to their end.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_flight::{Mission, MissionTable, parse_csv};

/// Period of the loop. s
const DT_S: f64 = 0.02;

fuzz_target!(|text: &str| {
    let _is_refused = parse_csv(text).is_err();
    if let Ok(table) = serde_json::from_str::<MissionTable>(text) {
        let _is_refused = Mission::new(&table, DT_S).is_err();
    }
});
