//! The tables of settings files: refused, or checked without a panic.
#![no_main]

use horizon_control::MpcTable;
use horizon_model::Kinematic;
use libfuzzer_sys::fuzz_target;
use serde_json::from_str;
use tello_flight::gate::{Gate, GateTable};
use tello_flight::{SupervisorSettings, SupervisorTable};
use tello_io::manual::{ManualSettings, ManualTable};
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
    if let Ok(table) = from_str::<MpcTable>(text) {
        let _is_refused = table.check::<Kinematic, 4, 4, 4, 4>().is_err();
    }
    if let Ok(table) = from_str::<SupervisorTable>(text) {
        let _is_refused = SupervisorSettings::try_from(&table).is_err();
    }
});
