mod dead_time;
mod push;

use tello_io::config;

use super::*;
use crate::{Profile, ScriptedFault};

#[test]
fn a_control_loop_that_stands_still_misses_periods_and_the_sockets_send_neutral_sticks() {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, tello_flight::Start::Grounded);
    let stall = ScriptedFault { fault: InjectedFault::ControlStalled, from_s: 11.0, for_s: 0.4 };
    let sim = crate::settings(None).unwrap();
    let sim = SimTable { profile: Profile::Clean, faults: vec![stall], ..sim };
    let mut flight = VirtualFlight::new(&flight, &sim, 1).unwrap();
    let mut is_neutral = Vec::new();
    for step in 0..575 {
        flight.tick().unwrap();
        for packet in flight.wire() {
            if let HostPacket::Sticks { u, .. } = packet {
                is_neutral.push((step, u.amax() <= 0.0));
            }
        }
        let skipped = if step == 570 { 20 } else { 0 };
        if !(550..570).contains(&step) {
            assert_eq!(flight.inbox().skipped, skipped, "step {step}");
            let expected = if step == 570 { 1 + 20 } else { 1 };
            assert_eq!(flight.inbox().sightings.len(), expected, "step {step}");
        }
    }
    let within = |from, to| {
        is_neutral.iter().filter(move |(step, _)| (from..to).contains(step)).collect::<Vec<_>>()
    };
    assert!(within(500, 550).iter().any(|(_, is_neutral)| !is_neutral), "it was steered");
    let late = within(556, 570);
    assert!(!late.is_empty() && late.iter().all(|(_, is_neutral)| *is_neutral), "{late:?}");
}
