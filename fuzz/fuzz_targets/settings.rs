//! The tables of settings files: refused, or checked without a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use serde_json::from_str;
use horizon_control::MpcTable;
use tello_flight::SupervisorTable;
use tello_io::manual::{ManualSettings, ManualTable};
use tello_flight::gate::{Gate, GateTable};
use tello_io::tello::{Protocol, TelloSettings, TelloTable};
use tello_sim::{SimTable, World};

fuzz_target!(|text: &str| {
    if let Ok(table) = from_str::<ManualTable>(text) {
        let _is_refused = ManualSettings::try_from(&table).is_err();
    }
    if let Ok(table) = from_str::<TelloTable>(text) {
        let _is_refused = TelloSettings::try_from(&table).is_err();
    }
    if let Ok(table) = from_str::<GateTable>(text) {
        let _is_refused = Gate::new(&table, Protocol::Text).is_err();
    }
    if let Ok(table) = from_str::<SimTable>(text) {
        let _is_refused = World::new(&table, 0).is_err();
    }
    let _is_refused = from_str::<MpcTable>(text).is_err();
    let _is_refused = from_str::<SupervisorTable>(text).is_err();
});
