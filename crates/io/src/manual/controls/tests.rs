//! Holding, releasing, repeating, opposing and losing keys.

use super::*;
use crate::manual::ManualTable;
use crate::manual::settings::tests::table;

/// Period of the polls.
const TICK: SpanNs = SpanNs::from_ms(20);

/// Largest deflection of these tests.
pub(super) const FULL: f64 = 0.5;

/// Controls and the time that they were last asked at.
pub(super) struct Desk {
    pub(super) controls: ControlState,
    now: TimeNs,
}

impl Desk {
    pub(super) fn new() -> Self {
        let table = ManualTable { deflection: FULL, smoothing_s: 0.1, ..table() };
        let settings = ManualSettings::try_from(&table).unwrap();
        Self { controls: ControlState::new(settings), now: TimeNs(0) }
    }

    pub(super) fn act(&mut self, source: Source, action: InputAction) {
        self.controls.receive(&Event { at: self.now, source, action });
    }

    pub(super) fn key(&mut self, action: InputAction) {
        self.act(Source::Device, action);
    }

    /// The hand after `ms` of polls.
    pub(super) fn after(&mut self, ms: i64) -> ManualInput {
        let mut input = self.controls.input(self.now);
        for _ in 0..ms / 20 {
            self.now = self.now.after(TICK);
            input = self.controls.input(self.now);
        }
        input
    }

    /// The sticks after `ms` in which `source` reports that the keys are still down, twice per 100 ms.
    pub(super) fn sticks_holding(&mut self, source: Source, held: &[Direction], ms: i64) -> Sticks {
        for _ in 0..ms / 40 {
            for direction in held {
                self.act(source, InputAction::Repeat(*direction));
            }
            self.after(40);
        }
        self.sticks_after(0)
    }

    pub(super) fn sticks_after(&mut self, ms: i64) -> Sticks {
        self.after(ms).sticks.expect("a person steers")
    }
}

pub(super) fn assert_near(u: f64, expected: f64) {
    assert!((u - expected).abs() < 1e-3, "{u}, expected {expected}");
}

#[test]
fn the_controller_steers_until_a_stick_key_takes_over_at_once() {
    let mut desk = Desk::new();
    assert_eq!(desk.after(100), ManualInput::default());
    desk.key(InputAction::Press(Direction::Forward));
    let u = desk.sticks_after(20);
    assert!(u[stick::PITCH] > 0.05, "the first tick moves the stick: {u:?}");
    desk.key(InputAction::Release(Direction::Forward));
    assert!(desk.after(5_000).sticks.is_some(), "letting go does not hand back");
    desk.key(InputAction::Automatic);
    assert_eq!(desk.after(20), ManualInput::default());
}

#[test]
fn each_direction_pushes_its_own_stick() {
    for (direction, row, sign) in [
        (Direction::Right, stick::ROLL, 1.0),
        (Direction::Left, stick::ROLL, -1.0),
        (Direction::Forward, stick::PITCH, 1.0),
        (Direction::Backward, stick::PITCH, -1.0),
        (Direction::TurnLeft, stick::YAW, 1.0),
        (Direction::TurnRight, stick::YAW, -1.0),
        (Direction::Up, stick::THROTTLE, 1.0),
        (Direction::Down, stick::THROTTLE, -1.0),
    ] {
        let mut desk = Desk::new();
        desk.key(InputAction::Press(direction));
        let mut expected = Sticks::zeros();
        expected[row] = sign * FULL;
        let u = desk.sticks_holding(Source::Device, &[direction], 2_000);
        assert!((u - expected).norm() < 1e-6, "{direction:?}: {u:?}");
    }
}

#[test]
fn sticks_follow_with_the_time_constant_and_return() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Up));
    assert_near(desk.sticks_after(100)[stick::THROTTLE], FULL * (1.0 - (-1.0_f64).exp()));
    desk.key(InputAction::Release(Direction::Up));
    assert_near(
        desk.sticks_after(100)[stick::THROTTLE],
        FULL * (1.0 - (-1.0_f64).exp()) * (-1.0_f64).exp(),
    );
}

#[test]
fn the_smoothing_does_not_depend_on_when_it_is_polled() {
    let (mut even, mut uneven) = (Desk::new(), Desk::new());
    for desk in [&mut even, &mut uneven] {
        desk.key(InputAction::Press(Direction::Right));
        desk.controls.input(TimeNs(0));
    }
    let at = TimeNs(200_000_000);
    let u = even.sticks_after(200);
    for ns in [3_000_000, 90_000_000, 91_000_000] {
        uneven.controls.input(TimeNs(ns));
    }
    let input = uneven.controls.input(at);
    assert!(input.sticks.is_some_and(|v| (v - u).norm() < 1e-12), "{input:?}, {u:?}");
}

#[test]
fn opposite_keys_cancel_and_neighbours_add() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Left));
    desk.key(InputAction::Press(Direction::Right));
    desk.key(InputAction::Press(Direction::Up));
    let u = desk.sticks_after(800);
    assert_near(u[stick::ROLL], 0.0);
    assert_near(u[stick::THROTTLE], FULL);
    desk.key(InputAction::Release(Direction::Left));
    let u = desk.sticks_holding(Source::Device, &[Direction::Right, Direction::Up], 1_000);
    assert_near(u[stick::ROLL], FULL);
}

#[test]
fn a_key_without_release_acts_for_its_pulse_and_repeats_extend_it() {
    let mut desk = Desk::new();
    desk.act(Source::Terminal, InputAction::Pulse(Direction::Forward));
    let u_peak = desk.sticks_after(140)[stick::PITCH];
    let u_after = desk.sticks_after(40)[stick::PITCH];
    assert!(u_after < u_peak, "{u_after} after the pulse, {u_peak} in it");
    assert_near(desk.sticks_after(2_000)[stick::PITCH], 0.0);
    for _ in 0..50 {
        desk.act(Source::Terminal, InputAction::Pulse(Direction::Forward));
        desk.after(40);
    }
    assert_near(desk.sticks_after(0)[stick::PITCH], FULL);
}

#[test]
fn a_late_event_does_not_act_beyond_its_pulse() {
    let mut desk = Desk::new();
    let pulse = Event {
        at: desk.now,
        source: Source::Terminal,
        action: InputAction::Pulse(Direction::Down),
    };
    desk.now = desk.now.after(SpanNs::from_ms(3_000));
    desk.controls.receive(&pulse);
    assert_near(desk.sticks_after(1_000)[stick::THROTTLE], 0.0);
}

#[test]
fn a_repetition_does_not_shorten_what_a_release_ends() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Left));
    desk.key(InputAction::Pulse(Direction::Left));
    assert_near(desk.sticks_after(880)[stick::ROLL], -FULL);
    // Another source's release is not this one's.
    desk.key(InputAction::Repeat(Direction::Left));
    desk.act(Source::Terminal, InputAction::Release(Direction::Left));
    assert_near(desk.sticks_after(800)[stick::ROLL], -FULL);
}

#[test]
fn a_key_and_an_axis_together_do_not_exceed_the_deflection() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Up));
    desk.key(InputAction::Axis(stick::THROTTLE, 1.0));
    assert_near(desk.sticks_after(860)[stick::THROTTLE], FULL);
}

#[test]
fn an_axis_takes_over_when_it_leaves_its_rest() {
    let mut desk = Desk::new();
    desk.key(InputAction::Axis(stick::YAW, 0.0));
    assert_eq!(desk.after(100), ManualInput::default(), "a stick at rest steers nothing");
    desk.key(InputAction::Axis(stick::YAW, -0.5));
    assert_near(desk.sticks_after(1_900)[stick::YAW], -0.5 * FULL);
}

#[test]
fn a_lost_device_that_steered_levels_the_sticks_and_lands() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Forward));
    desk.after(500);
    desk.key(InputAction::Lost);
    let input = desk.after(980);
    assert_eq!(input.order, None, "another device has a second");
    assert!(input.sticks.is_some_and(|u| u.norm() < 1e-3), "{input:?}");
    assert_eq!(desk.after(40).order, Some(PersonOrder::Land));
}

#[test]
fn another_device_or_the_controller_goes_on_after_a_loss() {
    let mut desk = Desk::new();
    desk.key(InputAction::Manual);
    desk.key(InputAction::Lost);
    desk.act(Source::Terminal, InputAction::Manual);
    assert_eq!(
        desk.after(3_000),
        ManualInput { sticks: Some(Sticks::zeros()), ..ManualInput::default() }
    );
    desk.act(Source::Terminal, InputAction::Lost);
    desk.key(InputAction::Automatic);
    assert_eq!(desk.after(3_000), ManualInput::default());
}

#[test]
fn a_lost_device_that_did_not_steer_changes_nothing() {
    let mut desk = Desk::new();
    desk.key(InputAction::Lost);
    assert_eq!(desk.after(3_000), ManualInput::default());
}

#[test]
fn orders_pass_in_every_state_and_the_strongest_wins() {
    for prepare in [
        None,
        Some(InputAction::Manual),
        Some(InputAction::Press(Direction::Up)),
        Some(InputAction::Lost),
    ] {
        let mut desk = Desk::new();
        if let Some(action) = prepare {
            desk.key(action);
            desk.after(500);
        }
        for (actions, expected) in [
            (vec![PersonOrder::TakeOff], PersonOrder::TakeOff),
            (vec![PersonOrder::TakeOff, PersonOrder::Land], PersonOrder::Land),
            (
                vec![PersonOrder::EmergencyStop, PersonOrder::Land, PersonOrder::TakeOff],
                PersonOrder::EmergencyStop,
            ),
        ] {
            for order in actions {
                desk.key(InputAction::Order(order));
            }
            assert_eq!(desk.after(0).order, Some(expected), "after {prepare:?}");
            assert_eq!(desk.after(0).order, None, "an order is given once");
        }
    }
}
