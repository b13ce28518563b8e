use horizon_model::check::amax;
use horizon_model::rows::stick;

use super::*;

const STALE_S: f64 = 0.25;

fn gate(stick_max: f64) -> Gate {
    Gate::new(&GateTable { stick_max, stale_s: STALE_S }, Protocol::Binary).unwrap()
}

/// Ages with whether each is fresh.
const AGES: [(Option<f64>, bool); 15] = [
    (None, false),
    (Some(0.0), true),
    (Some(-0.0), true),
    (Some(0.02), true),
    (Some(STALE_S), true),
    (Some(STALE_S + 1e-12), false),
    (Some(1.0), false),
    (Some(f64::MAX), false),
    (Some(f64::INFINITY), false),
    (Some(-0.004), true),
    (Some(-STALE_S), true),
    (Some(-STALE_S - 1e-12), false),
    (Some(-1.0), false),
    (Some(f64::NEG_INFINITY), false),
    (Some(f64::NAN), false),
];

/// Values from far outside to far outside, every step of the wire included.
fn values() -> Vec<f64> {
    let mut values: Vec<f64> = (-1400..=1400).map(|step| f64::from(step) / 1320.0).collect();
    values.extend([1.5515, 1.6, 2.0, 100.0, 1e300, f64::MAX, f64::INFINITY, f64::MIN_POSITIVE]);
    values.extend(values.clone().iter().map(|value| -value));
    values.push(f64::NAN);
    values
}

#[test]
fn every_age_and_value_on_every_axis_passes_or_is_neutral() {
    for stick_max in [0.0, 0.3, 0.5, 1.0] {
        let gate = gate(stick_max);
        for axis in 0..stick::COUNT {
            for value in values() {
                for (age_s, is_fresh) in AGES {
                    let mut u_proposed = Sticks::from_element(0.125 * stick_max);
                    u_proposed[axis] = value;
                    let u = gate.pass(&u_proposed, age_s).sticks();
                    // Independently of the gate: the proposal may round to the limit, not beyond.
                    let is_within = value.abs() <= stick_max + 0.5 / 660.0 - 1e-9;
                    let expected = if is_fresh && is_within { u_proposed } else { Sticks::zeros() };
                    let gap = amax(&(u - expected));
                    assert!(
                        gap <= 0.5 / 660.0 + 1e-12,
                        "axis {axis}, limit {stick_max}: {value} at age {age_s:?} became {u}"
                    );
                    assert!(amax(&u) <= stick_max, "{u} beyond {stick_max}");
                }
            }
        }
    }
}

#[test]
fn a_limit_between_two_steps_is_never_exceeded_nor_refused() {
    for (stick_max, protocol, steps) in [
        (0.333, Protocol::Binary, 219.0),
        (0.334, Protocol::Binary, 220.0),
        (0.999, Protocol::Binary, 659.0),
        (0.0007, Protocol::Binary, 0.0),
        (0.29, Protocol::Text, 29.0),
        (0.299, Protocol::Text, 29.0),
        (1.0, Protocol::Text, 100.0),
    ] {
        let gate = Gate::new(&GateTable { stick_max, stale_s: STALE_S }, protocol).unwrap();
        for sign in [1.0, -1.0] {
            let u_hand = Sticks::new(sign * stick_max, 0.0, -sign * stick_max, 0.0);
            let u = gate.pass_manual(&u_hand).sticks();
            let expected = sign * steps / f64::from(protocol.stick_steps()) + 0.0;
            assert_eq!(u, Sticks::new(expected, 0.0, -expected, 0.0), "{stick_max}");
            assert!(amax(&u) <= stick_max, "{u} beyond {stick_max}");
        }
        let step = 1.0 / f64::from(protocol.stick_steps());
        let u = gate.pass_manual(&Sticks::from_element(stick_max + 1.01 * step)).sticks();
        assert_eq!(u, Sticks::zeros(), "{stick_max}");
    }
}

#[test]
fn what_passes_is_a_whole_number_of_wire_steps() {
    for value in values().into_iter().filter(|value| value.abs() <= 1.0) {
        let u = gate(1.0).pass(&Sticks::from_element(value), Some(0.0)).sticks();
        let steps = u[stick::ROLL] * 660.0;
        assert!((steps - steps.round()).abs() < 1e-9, "{value} became {u}");
        assert_eq!(gate(1.0).pass(&u, Some(0.0)).sticks(), u, "passing twice changed {value}");
    }
}

#[test]
fn what_passes_to_the_text_sdk_is_a_whole_number_of_its_steps() {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: STALE_S }, Protocol::Text).unwrap();
    for value in values().into_iter().filter(|value| value.abs() <= 1.0) {
        let u_proposed = Sticks::new(value, -value, value, value);
        let u = gate.pass(&u_proposed, Some(0.0)).sticks();
        assert!(amax(&(u - u_proposed)) <= 0.005 + 1e-12, "{value} became {u}");
        let steps = u[stick::ROLL] * 100.0;
        assert!((steps - steps.round()).abs() < 1e-9, "{value} became {u}");
    }
}

#[test]
fn a_rounding_error_beyond_the_bound_is_not_a_fault() {
    let u = gate(1.0).pass(&Sticks::from_element(1.0 + 1e-7), Some(0.0)).sticks();
    assert_eq!(u, Sticks::from_element(1.0));
    let u = gate(1.0).pass(&Sticks::from_element(1.0 + 1e-3), Some(0.0)).sticks();
    assert_eq!(u, Sticks::zeros());
}

#[test]
fn the_gesture_that_stops_the_motors_never_passes() {
    let values = [-1.0 - 1e-7, -1.0, -0.76, -0.74, -0.5, 0.0, 0.5, 0.74, 0.76, 1.0, 1.0 + 1e-7];
    let (roll, pitch, yaw, throttle) = (stick::ROLL, stick::PITCH, stick::YAW, stick::THROTTLE);
    let mut cut = 0;
    for at in 0..values.len().pow(4) {
        let u_proposed = Sticks::from_fn(|row, _| {
            values[at / values.len().pow(row.try_into().unwrap()) % values.len()]
        });
        let u = gate(1.0).pass(&u_proposed, Some(0.0)).sticks();
        assert_eq!(gate(1.0).pass_manual(&u_proposed).sticks(), u);
        let is_far = |row: usize| u_proposed[row].abs() > 0.75;
        let is_down = u_proposed[pitch] < 0.0 && u_proposed[throttle] < 0.0;
        let mut expected = u_proposed;
        if is_down && [roll, pitch, yaw, throttle].into_iter().all(is_far) {
            expected[yaw] = 0.5 * u_proposed[yaw].signum();
            cut += 1;
        }
        assert!(amax(&(u - expected)) <= 0.5 / 660.0 + 1e-12, "{u_proposed} became {u}");
    }
    assert_eq!(cut, 3 * 3 * 6 * 6, "three values back and down, six to the sides");
}

#[test]
fn a_stick_at_rest_has_no_sign() {
    // A log that has -0 where a replay has 0 would not be equal to it, bit by bit.
    for value in [0.0, -0.0, 1e-4, -1e-4] {
        let u = gate(1.0).pass(&Sticks::from_element(value), Some(0.0)).sticks();
        let bits = u.map(f64::to_bits);
        assert!(bits.iter().all(|bits| *bits == 0), "{value} became {u:?}");
    }
}

#[test]
fn neutral_is_at_rest() {
    assert_eq!(Approved::neutral().sticks(), Sticks::zeros());
}

#[test]
fn nonsense_limits_are_refused() {
    let refusal = |stick_max, stale_s| {
        Gate::new(&GateTable { stick_max, stale_s }, Protocol::Binary).unwrap_err().to_string()
    };
    assert_eq!(refusal(1.1, 0.1), "stick_max = 1.1: expected 0.0..=1.0");
    assert_eq!(refusal(f64::NAN, 0.1), "stick_max = NaN: expected 0.0..=1.0");
    assert_eq!(refusal(1.0, 0.0), "stale_s = 0: expected 0.01..=2.0");
    assert_eq!(refusal(1.0, 2.5), "stale_s = 2.5: expected 0.01..=2.0");
    assert_eq!(refusal(1.0, f64::INFINITY), "stale_s = inf: expected 0.01..=2.0");
}
