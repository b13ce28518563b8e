//! What to say when the drone never took off.

use tello_flight::Fault;
use tello_io::clock::SpanNs;
use tello_io::config::FlyTable;
use tello_io::mocap::MocapCounters;

use super::control_loop::LoopEnd;

/// Why the drone never took off, and what to look at.
pub(super) fn not_ready(
    table: &FlyTable,
    patience: SpanNs,
    end: &LoopEnd,
    counters: &MocapCounters,
) -> String {
    let faults: Vec<&str> = end.faults_last.iter().map(Fault::name).collect();
    let is_any = |faults: &[Fault]| faults.iter().any(|fault| end.faults_last.contains(*fault));
    let faults = faults.join(", ");
    // The others are waited for.
    let is_ended = is_any(&[Fault::GuardianLost, Fault::ProgramStalled, Fault::OperatorStop]);
    let mut text = if is_ended {
        format!("did not take off: {faults}")
    } else {
        format!("not ready to fly within {} s: {faults}", patience.seconds())
    };
    if is_any(&[Fault::GuardianLost]) {
        text += "\n  guardian: the process tello-guardian was ended or stopped; nothing flies without it";
    }
    if is_any(&[Fault::MocapStale, Fault::MocapLost]) {
        text += "\n  mocap: ";
        text += &mocap_trouble(table, counters);
    }
    if is_any(&[Fault::DroneUnheard, Fault::DroneSilent]) {
        text += "\n  drone: ";
        text += &drone_trouble(table);
    }
    text
}

/// What may be wrong with a mocap stream that shows no drone.
pub(super) fn mocap_trouble(table: &FlyTable, counters: &MocapCounters) -> String {
    let report = counters.report();
    let messages = counters.messages.get();
    let (key, address) = table.mocap.address();
    let object = table.mocap.object();
    match (counters.connects.get(), messages, counters.given_up()) {
        (_, _, Some(error)) => format!("{address} cannot be understood: {error}"),
        (0, ..) => {
            format!("no pose, nobody is at {address}: is the system running, is {key} right?")
        }
        (_, 0, _) => format!("no pose, nothing comes from {address}: is the mocap system live?"),
        _ => format!(
            "{messages} messages, {} of them of other objects, {} malformed: is the object's name \
             ({object:?}) right, is the drone seen?",
            report.other_object, report.malformed,
        ),
    }
}

/// What may be wrong with a drone that is not heard.
pub(super) fn drone_trouble(table: &FlyTable) -> String {
    format!(
        "it does not answer on {}: is it on, is this machine in its Wi-Fi, is no other program talking to \
         it? One that was spoken to in another protocol than tello.protocol has to be switched off and on.",
        table.tello.address
    )
}
