use std::io::{Read, Write};
use std::os::fd::AsFd;

use rtrb::{Consumer, RingBuffer};

use super::super::{Direction, PersonOrder};
use super::*;

/// An outlet into a queue of two events, its other end, and what closes it.
fn outlet() -> (Outlet, Consumer<Event>, Arc<AtomicBool>) {
    let (producer, consumer) = RingBuffer::new(2);
    let ends = Arc::new(AtomicBool::new(false));
    let emergency = EmergencyRequest::default();
    (Outlet::new(producer, emergency, Clock::start(), Arc::clone(&ends)), consumer, ends)
}

#[test]
fn an_outlet_closes_at_the_end_of_the_flight() {
    let (open, _events, ends) = outlet();
    assert!(open.is_open());
    ends.store(true, Ordering::Relaxed);
    assert!(!open.is_open());
}

#[test]
fn an_emergency_stop_needs_neither_room_nor_a_control_loop() {
    let (mut outlet, events, ends) = outlet();
    let emergency = outlet.emergency.clone();
    outlet.push(Source::Terminal, InputAction::Press(Direction::Forward));
    outlet.push(Source::Terminal, InputAction::Release(Direction::Forward));
    assert!(!emergency.take(), "no person asked for it");
    let stuck = thread::spawn(move || {
        outlet.push(Source::Terminal, InputAction::Order(PersonOrder::EmergencyStop));
        outlet
    });
    while !emergency.take() {
        thread::yield_now();
    }
    assert!(!stuck.is_finished() && !emergency.take(), "asked for once, and the queue is full");
    drop(events);
    let mut outlet = stuck.join().unwrap();
    assert!(outlet.is_open());
    outlet.push(Source::Terminal, InputAction::Order(PersonOrder::EmergencyStop));
    assert!(emergency.take());
    ends.store(true, Ordering::Relaxed);
    assert!(!outlet.is_open());
}

#[test]
fn an_event_has_its_source_and_the_time_of_its_reading() {
    let (mut outlet, mut events, _ends) = outlet();
    let before = outlet.now();
    outlet.push(Source::Device, InputAction::Order(PersonOrder::Land));
    let Event { at, source, action } = events.pop().unwrap();
    assert_eq!((source, action), (Source::Device, InputAction::Order(PersonOrder::Land)));
    assert!(before <= at && at <= outlet.now());
}

#[test]
fn a_release_waits_for_room_and_is_not_lost() {
    let (mut outlet, mut events, _ends) = outlet();
    let actions = [
        InputAction::Press(Direction::Forward),
        InputAction::Press(Direction::Left),
        InputAction::Release(Direction::Forward),
        InputAction::Release(Direction::Left),
    ];
    let writer = thread::spawn(move || {
        for action in actions {
            outlet.push(Source::Terminal, action);
        }
    });
    // The third event finds the queue full, until there is a look at it.
    while events.slots() < 2 {
        thread::yield_now();
    }
    let mut heard = Vec::new();
    while heard.len() < actions.len() {
        match events.pop() {
            Ok(event) => heard.push(event.action),
            Err(_) => thread::yield_now(),
        }
    }
    writer.join().unwrap();
    assert_eq!(heard, actions);
}

#[test]
fn a_full_queue_does_not_hold_up_the_end() {
    for closes_by_order in [true, false] {
        let (mut outlet, events, ends) = outlet();
        outlet.push(Source::Terminal, InputAction::Manual);
        outlet.push(Source::Terminal, InputAction::Manual);
        if closes_by_order {
            ends.store(true, Ordering::Relaxed);
        } else {
            drop(events);
        }
        // It returns.
        outlet.push(Source::Terminal, InputAction::Lost);
    }
}

#[test]
fn what_was_written_before_a_hang_up_is_read_before_it_counts_as_gone() {
    let (mut reader, mut writer) = std::io::pipe().unwrap();
    writer.write_all(b"w").unwrap();
    assert_eq!(wait(reader.as_fd()), Readiness::Data);
    drop(writer);
    assert_eq!(wait(reader.as_fd()), Readiness::Data);
    let mut byte = [0];
    reader.read_exact(&mut byte).unwrap();
    assert_eq!(wait(reader.as_fd()), Readiness::Gone);
}

#[test]
fn a_device_that_is_silent_is_not_gone() {
    let (reader, writer) = std::io::pipe().unwrap();
    assert_eq!(wait(reader.as_fd()), Readiness::Nothing);
    drop(writer);
}
