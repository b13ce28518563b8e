use super::*;
use crate::fault::ScriptedFault;

/// Steps with what arrives in each of 10 s, under `fault` from 2 s on for 4 s.
fn arrivals(fault: Option<InjectedFault>) -> Vec<Vec<u64>> {
    let script = fault.map(|fault| ScriptedFault { fault, from_s: 2.0, for_s: 4.0 });
    let mut faults = Faults::new(script.into_iter().collect()).unwrap();
    let mut lag = Lag::default();
    let mut arrived = Vec::new();
    for step in 0..500 {
        faults.begin(step, &Pose::zeros());
        let pose = Some(Pose::new(1.0, -2.0, 1.2, 0.3));
        let taken = TakenFrame { step, is_other: false, pose, change: Pose::zeros() };
        lag.advance(Some(taken), step, &faults, "tello");
        arrived.push(lag.frames("tello").map(|frame| u64::from(frame.number)).collect());
    }
    arrived
}

/// Every frame arrives once and in order, whatever the fault.
fn assert_complete(arrivals: &[Vec<u64>]) {
    assert!(arrivals.iter().flatten().copied().eq(0..500), "{arrivals:?}");
}

#[test]
fn without_a_fault_every_frame_arrives_in_its_step() {
    for (step, frames) in (0..).zip(arrivals(None)) {
        assert_eq!(frames, [step]);
    }
}

#[test]
fn a_lag_makes_the_stream_silent_then_old_and_ends_in_a_burst() {
    let arrivals = arrivals(Some(InjectedFault::MocapLag { delay_s: 1.2 }));
    assert_complete(&arrivals);
    for (step, frames) in (0..).zip(&arrivals) {
        match step {
            0..100 | 301.. => assert_eq!(*frames, [step]),
            100..160 => assert!(frames.is_empty(), "step {step}: {frames:?}"),
            160..300 => assert_eq!(*frames, [step - 60]),
            300 => assert_eq!(frames.len(), 61),
        }
    }
}

#[test]
fn a_ramp_makes_the_frames_older_and_older() {
    let arrivals = arrivals(Some(InjectedFault::MocapLagRamp { growth: 0.15 }));
    assert_complete(&arrivals);
    for (step, frames) in (0_u64..).zip(&arrivals) {
        let Some(newest) = frames.last().filter(|_| (110..300).contains(&step)) else { continue };
        let age_s = (step - newest) as f64 * DT_S;
        let expected_s = 0.15 * (step - 100) as f64 * DT_S;
        assert!((age_s - expected_s).abs() <= DT_S, "step {step}: {age_s} s for {expected_s} s");
    }
    let count = arrivals[100..300].iter().flatten().count();
    assert!((165..=175).contains(&count), "{count} of 200 arrive: 0.85 of them");
}

#[test]
fn a_slow_link_carries_its_bytes_and_no_more() {
    let line = |frame: &TakenFrame| Lag::default().bytes(frame, "tello");
    let pose = Some(Pose::new(1.0, -2.0, 1.2, 0.3));
    let frame = TakenFrame { step: 200, is_other: false, pose, change: Pose::zeros() };
    let bytes_per_s = 0.8 * 50.0 * line(&frame);
    let arrivals = arrivals(Some(InjectedFault::MocapSlowLink { bytes_per_s }));
    assert_complete(&arrivals);
    let count = arrivals[100..300].iter().flatten().count();
    assert!((159..=161).contains(&count), "{count} of 200 arrive: 0.8 of them");
    let newest = arrivals[..300].iter().flatten().max().unwrap();
    assert!((258..=262).contains(newest), "the newest of step 299 is {newest}");
}

#[test]
fn a_fast_link_is_as_good_as_none() {
    for (step, frames) in
        (0..).zip(arrivals(Some(InjectedFault::MocapSlowLink { bytes_per_s: 1e6 })))
    {
        assert_eq!(frames, [step]);
    }
}
