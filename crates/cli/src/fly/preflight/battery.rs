//! The charge of the drone before the take-off.

use tello_io::tello::DroneStatus;

use super::{Check, Readiness, check};

pub(super) fn battery_check(drone: Option<&DroneStatus>, low_pct: u8, critical_pct: u8) -> Check {
    let Some(DroneStatus { battery_pct, is_battery_low, .. }) = drone else {
        return check("battery", Readiness::Bad, "unknown without a report of the drone");
    };
    let limits = format!("takes off from {low_pct} % on and lands below {critical_pct} %");
    let (readiness, why) = match (battery_pct, is_battery_low) {
        (101.., _) => (Readiness::Bad, ", more than a battery holds: the report is not trusted"),
        (_, Some(true)) => (Readiness::Bad, ", low by the drone's own report"),
        (charge, _) if *charge < low_pct => (Readiness::Bad, ""),
        _ => (Readiness::Good, ""),
    };
    check("battery", readiness, format!("{battery_pct} %{why}; {limits}"))
}
