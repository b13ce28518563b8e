use super::*;

fn ms(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

/// The sender's end, and the guardian's, which has reported that it watches.
fn pair() -> (Heartbeat, UnixStream) {
    let (ours, mut channel) = UnixStream::pair().unwrap();
    channel.write_all(&[READY]).unwrap();
    channel.set_nonblocking(true).unwrap();
    (Heartbeat::await_ready(ours).unwrap(), channel)
}

fn heard(channel: &mut UnixStream) -> Vec<u8> {
    let mut bytes = [0; 64];
    let count = channel.read(&mut bytes).unwrap_or(0);
    bytes[..count].to_vec()
}

#[test]
fn news_is_sent_at_once_and_the_rest_in_time() {
    let (mut heartbeat, mut channel) = pair();
    for at_ms in 0..100 {
        heartbeat.beat(SenderState::Idle, ms(at_ms));
    }
    assert_eq!(heard(&mut channel), *b"iiiiiii");
    heartbeat.beat(SenderState::Steering, ms(100));
    heartbeat.beat(SenderState::Landing, ms(100));
    assert_eq!(heard(&mut channel), *b"sl");
}

#[test]
fn a_landing_of_the_guardian_is_heard_once() {
    let (mut heartbeat, mut channel) = pair();
    heartbeat.beat(SenderState::Steering, ms(0));
    assert_eq!(heartbeat.report(ms(1)), GuardianReport::Continue);
    channel.write_all(&[LANDING_ORDERED]).unwrap();
    assert_eq!(heartbeat.report(ms(2)), GuardianReport::LandingOrdered { is_steered: true });
    assert_eq!(heartbeat.report(ms(3)), GuardianReport::Continue);
}

#[test]
fn a_pause_in_flight_is_a_landing_even_before_the_guardian_reports_it() {
    let (mut heartbeat, _channel) = pair();
    heartbeat.beat(SenderState::Idle, ms(0));
    assert_eq!(heartbeat.report(ms(5_000)), GuardianReport::Continue, "nothing was in the air");
    for state in [SenderState::Steering, SenderState::Landing] {
        heartbeat.beat(state, ms(10_000));
        assert_eq!(heartbeat.report(ms(10_249)), GuardianReport::Continue);
        let is_steered = state == SenderState::Steering;
        assert_eq!(heartbeat.report(ms(10_250)), GuardianReport::LandingOrdered { is_steered });
    }
    assert!(PAUSE_MAX < super::super::HEARTBEAT_TIMEOUT, "a stick could follow the landing");
}

#[test]
fn a_guardian_that_has_ended_is_missed_once() {
    let (mut heartbeat, channel) = pair();
    heartbeat.beat(SenderState::Steering, ms(0));
    drop(channel);
    heartbeat.beat(SenderState::Steering, ms(20));
    assert_eq!(heartbeat.report(ms(21)), GuardianReport::Gone);
    assert_eq!(heartbeat.report(ms(22)), GuardianReport::Continue);
    assert_eq!(heartbeat.pause(ms(30)), Some(SpanNs::from_ms(10)));
    // The sender goes on with its landing: its pauses are counted as before.
    heartbeat.beat(SenderState::Landing, ms(40));
    assert_eq!(heartbeat.pause(ms(50)), Some(SpanNs::from_ms(10)));
}

/// Turns of a sender every `period_ms` until the guardian counts as gone, for 5 s at most; when that is. ms
fn missed_ms(period_ms: usize, mut answer: impl FnMut(i64, &mut UnixStream)) -> Option<i64> {
    let (mut heartbeat, mut channel) = pair();
    for at_ms in (0..5_000).step_by(period_ms) {
        match heartbeat.report(ms(at_ms)) {
            GuardianReport::Gone => return Some(at_ms),
            report => assert_eq!(report, GuardianReport::Continue, "{at_ms} ms"),
        }
        heartbeat.beat(SenderState::Steering, ms(at_ms));
        answer(at_ms, &mut channel);
    }
    None
}

#[test]
fn a_guardian_that_does_not_answer_is_missed_within_half_a_second() {
    for period_ms in [5, 20, 40] {
        let missed_ms = missed_ms(period_ms, |_, _| {}).unwrap();
        assert!((300..=500).contains(&missed_ms), "every {period_ms} ms: after {missed_ms} ms");
    }
    let answer = |_: i64, channel: &mut UnixStream| {
        if !heard(channel).is_empty() {
            channel.write_all(&[HEARD]).unwrap();
        }
    };
    assert_eq!(missed_ms(20, answer), None);
    let late = |at_ms: i64, channel: &mut UnixStream| {
        if at_ms % 300 == 0 {
            channel.write_all(&[HEARD]).unwrap();
        }
    };
    assert_eq!(missed_ms(20, late), None, "what is late by 0.3 s is no silence");
}

#[test]
fn time_in_which_the_sender_has_no_turn_is_no_silence_of_the_guardian() {
    let (mut heartbeat, _channel) = pair();
    heartbeat.beat(SenderState::Idle, ms(0));
    // Something stalls both, again and again.
    for turn in 1..10 {
        assert_eq!(heartbeat.report(ms(5_000 * turn)), GuardianReport::Continue, "turn {turn}");
        heartbeat.beat(SenderState::Idle, ms(5_000 * turn));
    }
}

#[test]
fn a_guardian_that_answers_again_hears_what_the_sender_does_and_stays_missed() {
    let (mut heartbeat, mut channel) = pair();
    let missed = (0..100).find(|turn| {
        heartbeat.beat(SenderState::Steering, ms(20 * turn));
        heartbeat.report(ms(20 * turn)) == GuardianReport::Gone
    });
    let gone_ms = 20 * missed.unwrap();
    channel.write_all(&[HEARD]).unwrap();
    heartbeat.beat(SenderState::Landing, ms(gone_ms + 20));
    assert_eq!(heartbeat.report(ms(gone_ms + 21)), GuardianReport::Continue, "it is missed once");
    assert_eq!(heard(&mut channel).last(), Some(&(SenderState::Landing as u8)));
}

#[test]
fn the_end_is_the_last_word_behind_a_full_channel_too() {
    let (mut heartbeat, mut channel) = pair();
    for at_ms in 0..100_000 {
        heartbeat.beat(SenderState::Steering, ms(20 * at_ms));
    }
    let reader = std::thread::spawn(move || {
        channel.set_nonblocking(false).unwrap();
        let mut bytes = Vec::new();
        channel.read_to_end(&mut bytes).unwrap();
        bytes
    });
    heartbeat.end();
    assert_eq!(reader.join().unwrap().last(), Some(&(SenderState::Over as u8)));
}

#[test]
fn without_a_guardian_there_is_nothing_to_heed() {
    let mut heartbeat = Heartbeat::default();
    heartbeat.beat(SenderState::Steering, ms(0));
    let pause = Some(SpanNs::from_ms(5_000));
    assert_eq!(
        (heartbeat.report(ms(5_000)), heartbeat.pause(ms(5_000))),
        (GuardianReport::Continue, pause)
    );
}
