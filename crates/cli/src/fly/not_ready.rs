//! What to say when the drone never took off.

use tello_control::Fault;
use tello_io::clock::SpanNs;
use tello_io::vicon::ViconCounters;

use super::control_loop::LoopEnd;
use crate::config::FlyTable;

/// Why the drone never took off, and what to look at.
pub(super) fn not_ready(
    table: &FlyTable,
    patience: SpanNs,
    end: &LoopEnd,
    counters: &ViconCounters,
) -> String {
    let faults: Vec<&str> = end.faults.iter().map(Fault::name).collect();
    let lines = counters.lines.get();
    let (relay, object) = (&table.vicon.address, &table.vicon.object);
    let mocap = match (counters.connects.get(), lines) {
        (0, _) => format!(
            "no pose, nobody answers on {relay}: is the relay running, is vicon.address right?"
        ),
        (_, 0) => {
            format!("no pose, {relay} accepts but sends nothing: is Vicon Tracker live?")
        }
        _ => format!(
            "{lines} lines, {} of them of other objects, {} malformed: is vicon.object ({object}) \
             right, is the drone seen?",
            counters.other_object.get(),
            counters.malformed.get(),
        ),
    };
    format!(
        "not ready to fly within {} s: {}\n  mocap: {mocap}\n  drone: expected on {}: is it on, is \
         this machine in its Wi-Fi, is no other program talking to it?",
        patience.seconds(),
        faults.join(", "),
        table.tello.address
    )
}
