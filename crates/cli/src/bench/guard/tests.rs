use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::process::Command;

use tello_io::clock::SpanNs;

use super::*;

/// The guardian's words: it watches, it has read heartbeats, it has ordered a landing.
const READY: u8 = b'r';
const HEARD: u8 = b'h';
const LANDING_ORDERED: u8 = b'L';

fn at(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

/// A guard whose guardian is the other end of the channel.
fn guard() -> (Guard, UnixStream) {
    let socket = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let drone = socket.local_addr().unwrap();
    let started = Heartbeat::start_guardian(&socket, drone, Protocol::Binary, |post| {
        let mut channel = post.channel;
        channel.write_all(&[READY])?;
        channel.set_nonblocking(true)?;
        Ok(channel)
    });
    let (heartbeat, channel) = started.unwrap();
    let process = Guardian::of(Command::new("true").spawn().unwrap());
    (Guard { heartbeat, process: Some(process), ..Guard::absent() }, channel)
}

/// What the guardian has received since the last call.
fn received(channel: &mut UnixStream) -> Vec<u8> {
    let mut bytes = vec![0; 64];
    match channel.read(&mut bytes) {
        Ok(count) => bytes.truncate(count),
        Err(error) if error.kind() == ErrorKind::WouldBlock => bytes.clear(),
        Err(error) => panic!("{error}"),
    }
    bytes
}

#[test]
fn a_check_that_starts_no_motor_needs_no_guardian() {
    let mut guard = Guard::absent();
    for (state, ms) in
        [(SenderState::Steering, 0), (SenderState::Steering, 2_000), (SenderState::Landing, 9_000)]
    {
        guard.set(state, at(ms));
        assert!(!guard.has_failed(), "{state:?}");
    }
}

#[test]
fn the_guardian_hears_the_state_of_the_bench_at_once_and_again_with_every_turn() {
    let (mut guard, mut channel) = guard();
    for (state, ms) in
        [(SenderState::Idle, 0), (SenderState::Steering, 5), (SenderState::Landing, 10)]
    {
        guard.set(state, at(ms));
        assert_eq!(received(&mut channel), [state as u8]);
    }
    guard.turn(at(50));
    assert_eq!(received(&mut channel), [SenderState::Landing as u8]);
    assert!(!guard.has_failed());
}

#[test]
fn a_guardian_that_answers_lets_a_check_go_on() {
    let (mut guard, mut channel) = guard();
    guard.set(SenderState::Steering, at(0));
    for turn in 1..100 {
        channel.write_all(&[HEARD]).unwrap();
        guard.turn(at(40 * turn));
        assert!(!guard.has_failed(), "turn {turn}");
    }
}

#[test]
fn a_guardian_that_has_landed_is_lost_or_is_silent_ends_the_check_for_good() {
    let landed = |channel: &mut UnixStream| channel.write_all(&[LANDING_ORDERED]).unwrap();
    let lost = |channel: &mut UnixStream| channel.shutdown(std::net::Shutdown::Both).unwrap();
    for act in [landed, lost] {
        let (mut guard, mut channel) = guard();
        guard.set(SenderState::Steering, at(0));
        act(&mut channel);
        guard.turn(at(40));
        assert!(guard.has_failed());
        guard.turn(at(80));
        assert!(guard.has_failed());
    }
    let (mut guard, _channel) = guard();
    guard.set(SenderState::Steering, at(0));
    let silent = (1..20).find(|turn| {
        guard.turn(at(40 * turn));
        guard.has_failed()
    });
    assert!(silent.is_some_and(|turn| (10..=12).contains(&turn)), "{silent:?}");
}

#[test]
fn a_bench_that_stood_still_takes_the_drone_for_landed() {
    let (mut guard, _channel) = guard();
    guard.set(SenderState::Steering, at(0));
    guard.turn(at(300));
    assert!(guard.has_failed());
    let (mut idle, _channel) = self::guard();
    idle.set(SenderState::Idle, at(0));
    idle.turn(at(300));
    assert!(!idle.has_failed(), "no drone depended on it");
}

#[test]
fn the_guardian_receives_the_end_of_the_check() {
    let (guard, mut channel) = guard();
    drop(guard);
    assert_eq!(received(&mut channel), [SenderState::Over as u8]);
}
