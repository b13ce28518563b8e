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
    let faults: Vec<&str> = end.faults_last.iter().map(Fault::name).collect();
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
    let is_any = |faults: &[Fault]| faults.iter().any(|fault| end.faults_last.contains(*fault));
    let mut text =
        format!("not ready to fly within {} s: {}", patience.seconds(), faults.join(", "));
    if is_any(&[Fault::MocapStale, Fault::MocapLost]) {
        text += "\n  mocap: ";
        text += &mocap;
    }
    if is_any(&[Fault::DroneUnheard, Fault::DroneSilent]) {
        text += "\n  drone: it does not answer on ";
        text += &table.tello.address;
        text += ": is it on, is this machine in its Wi-Fi, is no other program talking to it?";
    }
    text
}
