use super::*;

/// Faults without values.
const PLAIN: [InjectedFault; 6] = [
    InjectedFault::MocapLost,
    InjectedFault::MocapFixed,
    InjectedFault::DroneDeaf,
    InjectedFault::DroneMute,
    InjectedFault::DroneRefusesLand,
    InjectedFault::ControlStalled,
];

#[test]
fn a_scripted_fault_lasts_as_long_as_it_says() {
    let script = vec![
        ScriptedFault { fault: InjectedFault::MocapLost, from_s: 0.6, for_s: 0.1 },
        ScriptedFault { fault: InjectedFault::DroneDeaf, from_s: 0.0, for_s: 0.02 },
    ];
    let faults = Faults::new(script).unwrap();
    let steps = |fault| (0..100).filter(|k| faults.is_on(fault, *k)).collect::<Vec<_>>();
    assert_eq!(steps(InjectedFault::MocapLost), [30, 31, 32, 33, 34]);
    assert_eq!(steps(InjectedFault::DroneDeaf), [0]);
    assert!(steps(InjectedFault::MocapFixed).is_empty());
}

#[test]
fn a_fault_set_by_hand_lasts_until_it_is_cleared() {
    let mut faults = Faults::default();
    for fault in PLAIN {
        faults.set(fault, true);
        let on = PLAIN.into_iter().filter(|other| faults.is_on(*other, 7));
        assert!(on.eq([fault]), "{fault:?}");
        faults.set(fault, false);
    }
    assert!(PLAIN.into_iter().all(|fault| !faults.is_on(fault, 7)));
}

#[test]
fn a_present_fault_knows_its_onset_and_forgets_it_when_it_is_over() {
    let drift = InjectedFault::MocapDrift { velocity_w_mps: [0.1, 0.0, 0.0], yaw_radps: 0.0 };
    let script = vec![ScriptedFault { fault: drift, from_s: 0.2, for_s: 0.2 }];
    let mut faults = Faults::new(script).unwrap();
    let at = |step: u64| Pose::new(step as f64, 0.0, 1.0, 0.0);
    let mut seen = Vec::new();
    for step in 0..30 {
        faults.begin(step, &at(step));
        seen.extend(faults.present(step));
    }
    assert_eq!(seen.len(), 10);
    for (k, present) in (0..).zip(seen) {
        assert_eq!((present.fault, present.pose_onset), (drift, at(10)));
        assert!((present.elapsed_s - f64::from(k) * DT_S).abs() < 1e-12, "{present:?}");
    }
    faults.set(drift, true);
    faults.begin(40, &at(40));
    faults.set(drift, false);
    faults.set(drift, true);
    faults.begin(50, &at(50));
    assert!(faults.present(50).all(|present| present.pose_onset == at(50)));
    assert_eq!(faults.present(50).count(), 1);
}

#[test]
fn a_fault_with_a_value_outside_of_its_range_is_refused() {
    let refusal = |fault, from_s| {
        let entry = ScriptedFault { fault, from_s, for_s: 1.0 };
        Faults::new(vec![entry]).unwrap_err().to_string()
    };
    let text = refusal(InjectedFault::MocapLost, -1.0);
    assert_eq!(text, "faults[0].from_s = -1: expected finite and >= 0");
    for (fault, key) in [
        (still(f64::NAN, 0.0), "mocap_still.offset_m"),
        (still(0.0, -1.0), "mocap_still.noise_m"),
        (InjectedFault::MocapSlowLink { bytes_per_s: 0.0 }, "mocap_slow_link.bytes_per_s"),
        (InjectedFault::MocapLag { delay_s: -0.1 }, "mocap_lag.delay_s"),
        (InjectedFault::MocapHeading { turn_rad: f64::INFINITY }, "mocap_heading.turn_rad"),
        (
            InjectedFault::SecondController { sticks: [0.0, 1.5, 0.0, 0.0], rate_hz: 20.0 },
            "second_controller.sticks",
        ),
    ] {
        let text = refusal(fault, 1.0);
        assert!(text.starts_with(&format!("faults[0].fault.{key} = ")), "{text}");
    }
}

fn still(x_m: f64, noise_m: f64) -> InjectedFault {
    InjectedFault::MocapStill {
        offset_w_m: [x_m, 0.0, 0.0],
        turn_rad: 0.0,
        noise_m,
        noise_rad: 0.0,
    }
}
