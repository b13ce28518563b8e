//! Messages for a drone that never took off, and for a dry run without a pose.

use std::sync::Arc;
use std::time::Duration;

use tello_flight::cycle::StandingTable;
use tello_flight::{Fault, FaultSet};
use tello_io::clock::SpanNs;
use tello_io::config::FlyTable;
use tello_io::link_diagnosis::{drone_trouble, mocap_trouble};
use tello_io::mocap::MocapCounters;

use super::Arguments;
use crate::stdio;

/// Why the drone never took off, by the faults of the last tick, and what to look at.
pub(super) fn take_off_refusal(
    table: &FlyTable,
    ground_wait: SpanNs,
    faults_last: FaultSet,
    counters: &MocapCounters,
    drone_packets: u64,
) -> String {
    let faults: Vec<&str> = faults_last.iter().map(Fault::name).collect();
    let is_any = |faults: &[Fault]| faults.iter().any(|fault| faults_last.contains(*fault));
    let faults = faults.join(", ");
    // The others are waited for.
    let is_ended = is_any(&[Fault::GuardianLost, Fault::ProgramStalled, Fault::OperatorStop]);
    let mut text = if faults_last.is_empty() {
        format!(
            "did not take off: an order lapses after {} s, or when the drone is moved",
            ground_wait.seconds()
        )
    } else if is_ended {
        format!("did not take off: {faults}")
    } else {
        format!("not ready to fly within {} s: {faults}", ground_wait.seconds())
    };
    if is_any(&[Fault::GuardianLost]) {
        text += "\n  guardian: the process tello-guardian was ended or stopped; nothing flies without it";
    }
    if is_any(&[Fault::MocapStale, Fault::MocapLost]) {
        text += "\n  mocap: ";
        text += &mocap_trouble(table, counters);
    } else if is_any(&[Fault::MocapUnsettled]) {
        text += "\n  mocap: ";
        text += &unsettled(&table.cycle.standing);
    }
    if is_any(&[Fault::ObstacleUnseen]) {
        text += "\n  obstacle: no pose of moving_object in the mocap stream: is its name right, is it seen?";
    }
    if is_any(&[Fault::DroneSilent]) && drone_packets > 0 {
        text += "\n  drone: it has fallen silent; its address is ";
        text += &table.tello.address;
    } else if is_any(&[Fault::DroneUnheard, Fault::DroneSilent]) {
        text += "\n  drone: ";
        text += &drone_trouble(table, drone_packets);
    }
    text
}

/// Message on poses of a standing drone that do not agree.
fn unsettled(StandingTable { for_s, distance_m, turn_rad }: &StandingTable) -> String {
    format!(
        "within {for_s} s poses of the drone differ by more than {distance_m} m or {turn_rad} rad (cycle.standing): is \
         it moved, are markers swapped, do poses have noise?"
    )
}

/// How long poses may take to come before a note reports that there are none.
/// Longer than a look-up of the host's name and a connection in vain.
const UNSEEN: Duration = Duration::from_millis(4_500);

/// Lets a dry run note once why there is no pose, if none has come in time: it has no pre-flight list and ends
/// after 10 s only. The picture of a terminal shows no notes.
pub(super) fn note_unseen(arguments: &Arguments, table: &FlyTable, counters: &Arc<MocapCounters>) {
    if !arguments.dry_run || arguments.tui {
        return;
    }
    let (table, counters) = (table.clone(), Arc::clone(counters));
    tokio::spawn(async move {
        tokio::time::sleep(UNSEEN).await;
        if let Some(trouble) = unseen(&table, &counters) {
            // Behind the status line of a terminal, which has no end yet.
            stdio::note(format_args!("\n  note  mocap      {trouble}"));
        }
    });
}

/// Why there is no pose; `None` if there was one.
fn unseen(table: &FlyTable, counters: &MocapCounters) -> Option<String> {
    let report = counters.report();
    (report.frames <= report.unseen).then(|| mocap_trouble(table, counters))
}

#[cfg(test)]
mod tests {
    use tello_io::config;
    use tello_io::tello::Protocol;

    use super::*;

    /// The message after `faults`, without any mocap.
    fn message(faults: &[Fault]) -> String {
        let (table, _) = config::fly(None, None).unwrap();
        let mut set = FaultSet::default();
        for fault in faults {
            set.set(*fault, true);
        }
        take_off_refusal(&table, SpanNs::from_seconds(10.0), set, &MocapCounters::default(), 0)
    }

    #[test]
    fn each_missing_part_is_named_with_what_to_look_at_and_no_other() {
        let parts = ["\n  guardian: ", "\n  mocap: ", "\n  obstacle: ", "\n  drone: "];
        for (fault, expected) in [
            (Fault::GuardianLost, Some(0)),
            (Fault::MocapStale, Some(1)),
            (Fault::MocapLost, Some(1)),
            (Fault::MocapUnsettled, Some(1)),
            (Fault::ObstacleUnseen, Some(2)),
            (Fault::DroneUnheard, Some(3)),
            (Fault::DroneSilent, Some(3)),
            (Fault::BatteryLow, None),
        ] {
            let text = message(&[fault]);
            assert!(text.contains(fault.name()), "{text}");
            for (k, part) in parts.into_iter().enumerate() {
                assert_eq!(text.contains(part), Some(k) == expected, "{fault:?}: {text}");
            }
        }
    }

    #[test]
    fn a_stream_that_shows_no_drone_is_explained() {
        let (table, _) = config::fly(None, None).unwrap();
        let counters = MocapCounters::default();
        let text = unseen(&table, &counters).unwrap();
        assert!(text.starts_with("no pose, nobody is at 127.0.0.1:51602"), "{text}");
    }

    #[test]
    fn what_ends_the_wait_is_not_called_waited_for() {
        let text = message(&[Fault::GuardianLost, Fault::BatteryLow]);
        assert!(text.starts_with("did not take off: battery low, guardian lost"), "{text}");
        let text = message(&[Fault::BatteryLow]);
        assert_eq!(text, "not ready to fly within 10 s: battery low");
    }

    #[test]
    fn a_drone_that_answers_without_a_status_is_not_called_silent() {
        let (mut table, _) = config::fly(None, None).unwrap();
        assert!(drone_trouble(&table, 0).contains("does not answer"));
        assert!(drone_trouble(&table, 1).contains("sends no status"));
        table.tello.protocol = Protocol::Text;
        let text = drone_trouble(&table, 1);
        assert!(text.contains("answers, but") && text.contains("`time` or `tof`"), "{text}");
        let mut silent = FaultSet::default();
        silent.set(Fault::DroneSilent, true);
        let ground_wait = SpanNs::from_seconds(10.0);
        let text = take_off_refusal(&table, ground_wait, silent, &MocapCounters::default(), 9);
        assert!(text.contains("has fallen silent"), "{text}");
    }

    #[test]
    fn a_mocap_that_nobody_serves_is_named_with_its_key() {
        let text = message(&[Fault::MocapStale]);
        assert!(text.contains("nobody is at 127.0.0.1:51602"), "{text}");
        assert!(text.contains("is mocap.relay.address right?"), "{text}");
    }
}
