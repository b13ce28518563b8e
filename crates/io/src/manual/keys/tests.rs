//! Plain keys, the kitty keyboard protocol, broken sequences and noise.

use proptest::prelude::*;

use super::*;

fn typed(bytes: &[u8]) -> Vec<Typed> {
    let mut decoder = Decoder::default();
    bytes.iter().filter_map(|byte| decoder.feed(*byte)).collect()
}

fn actions(bytes: &[u8]) -> Vec<InputAction> {
    let action = |typed| match typed {
        Typed::Action(action) => Some(action),
        Typed::CanRelease => None,
    };
    typed(bytes).into_iter().filter_map(action).collect()
}

#[test]
fn letters_of_the_published_program_keep_their_meaning() {
    for (key, expected) in [
        (b'q', InputAction::Order(PersonOrder::Land)),
        (b't', InputAction::Order(PersonOrder::TakeOff)),
        (b'r', InputAction::Order(PersonOrder::Land)),
        (b'e', InputAction::Manual),
        (b'c', InputAction::Automatic),
        (b'w', InputAction::Pulse(Direction::Forward)),
        (b's', InputAction::Pulse(Direction::Backward)),
        (b'a', InputAction::Pulse(Direction::Left)),
        (b'd', InputAction::Pulse(Direction::Right)),
        (b'i', InputAction::Pulse(Direction::Up)),
        (b'k', InputAction::Pulse(Direction::Down)),
        (b'j', InputAction::Pulse(Direction::TurnLeft)),
        (b'l', InputAction::Pulse(Direction::TurnRight)),
    ] {
        assert_eq!(actions(&[key]), [expected], "{}", char::from(key));
        let upper = key.to_ascii_uppercase();
        assert_eq!(
            actions(&[upper]),
            [expected],
            "caps lock must not matter: {}",
            char::from(upper)
        );
    }
    assert_eq!(actions(b"xyz \r\n0123456789\t"), []);
}

#[test]
fn backspace_stops_the_motors_at_any_place() {
    let stop = InputAction::Order(PersonOrder::EmergencyStop);
    assert_eq!(actions(b"\x7f"), [stop]);
    assert_eq!(actions(b"\x08"), [stop]);
    assert_eq!(actions(b"\x1b\x7f"), [stop], "after Escape, as with Alt held");
    assert_eq!(actions(b"\x1b[\x7f"), [stop], "in a sequence that never ended");
    assert_eq!(actions(b"\x1b[119;1:\x7f"), [stop]);
    assert_eq!(actions(b"\x1b[127u"), [stop]);
    assert_eq!(actions(b"\x1b[127;1:1u\x1b[127;1:3u"), [stop], "the release is no event");
    assert_eq!(actions(b"\x1b[127;5u"), [stop], "with Ctrl");
}

#[test]
fn a_key_of_another_script_counts_by_its_place_and_a_latin_letter_by_itself() {
    // Cyrillic es and tse, on the keys C and W; A of a French keyboard, on the key Q.
    assert_eq!(actions(b"\x1b[1089::99;5u"), [InputAction::Order(PersonOrder::Land)]);
    assert_eq!(actions(b"\x1b[1094::119u"), [InputAction::Press(Direction::Forward)]);
    assert_eq!(actions(b"\x1b[1094:1062:119;2:3u"), [InputAction::Release(Direction::Forward)]);
    assert_eq!(actions(b"\x1b[97::113u"), [InputAction::Press(Direction::Left)]);
    assert_eq!(actions(b"\x1b[1094u"), []);
}

#[test]
fn interrupt_lands() {
    assert_eq!(actions(b"\x03"), [InputAction::Order(PersonOrder::Land)]);
    assert_eq!(actions(b"\x1b[99;5u"), [InputAction::Order(PersonOrder::Land)]);
    assert_eq!(
        actions(b"\x1b[99;69:1u"),
        [InputAction::Order(PersonOrder::Land)],
        "caps lock is on"
    );
    assert_eq!(actions(b"\x1b[99;1u"), [InputAction::Automatic]);
}

#[test]
fn a_terminal_that_reports_releases_holds_keys() {
    let actions = actions(b"\x1b[119;1:1u\x1b[119;1:2u\x1b[119;1:3u");
    let forward = Direction::Forward;
    assert_eq!(
        actions,
        [InputAction::Press(forward), InputAction::Repeat(forward), InputAction::Release(forward)]
    );
}

#[test]
fn a_release_counts_with_any_modifier() {
    let backward = Direction::Backward;
    assert_eq!(
        actions(b"\x1b[115u\x1b[115;5:3u"),
        [InputAction::Press(backward), InputAction::Release(backward)]
    );
    assert_eq!(actions(b"\x1b[115;5:1u"), [], "Ctrl-S steers nothing");
}

#[test]
fn an_answer_is_reported_and_is_no_key() {
    assert_eq!(typed(b"\x1b[?0u"), [Typed::CanRelease]);
    assert_eq!(typed(b"\x1b[?119u"), [Typed::CanRelease]);
}

#[test]
fn a_window_that_loses_the_keyboard_lets_go_of_all_keys() {
    assert_eq!(actions(b"\x1b[O"), [InputAction::LetGo]);
    assert_eq!(actions(b"\x1b[I"), [], "and takes none when it is back");
    assert_eq!(actions(b"\x1b[1;2O\x1b[?O"), [], "some other key");
}

#[test]
fn other_keys_send_sequences_that_are_skipped_whole() {
    // Arrows, Home, F5, Delete, a mouse report, a focus event, Alt-x.
    assert_eq!(typed(b"\x1b[A\x1b[1;2D\x1b[H\x1b[15~\x1b[3~\x1b[<0;3;7M\x1b[I\x1bx"), []);
    assert_eq!(
        actions(b"\x1b[Aw"),
        [InputAction::Pulse(Direction::Forward)],
        "the next key counts"
    );
    assert_eq!(actions(b"\x1b\x1b[Bt"), [InputAction::Order(PersonOrder::TakeOff)]);
}

#[test]
fn function_keys_mean_nothing_in_any_terminal() {
    // F1 to F4, shifted, as of an older xterm; arrows, Home and End of the application mode; digits of the
    // keypad.
    assert_eq!(typed(b"\x1bOP\x1bOQ\x1bOR\x1bOS\x1bO2Q\x1bO1;2R"), []);
    assert_eq!(typed(b"\x1bOA\x1bOB\x1bOC\x1bOD\x1bOH\x1bOF\x1bOw\x1bOj\x1bOM"), []);
    // F1 to F5 of the Linux console.
    assert_eq!(typed(b"\x1b[[A\x1b[[B\x1b[[C\x1b[[D\x1b[[E"), []);
    assert_eq!(
        actions(b"\x1bOQw\x1b[[Cw"),
        [InputAction::Pulse(Direction::Forward); 2],
        "the next key counts"
    );
    assert_eq!(
        actions(b"\x1bO\x7f\x1b[[\x03"),
        [InputAction::Order(PersonOrder::EmergencyStop), InputAction::Order(PersonOrder::Land)]
    );
    assert_eq!(
        actions(b"\x1bO\x1bOQ\x1b[[\x1b[Ar"),
        [InputAction::Order(PersonOrder::Land)],
        "broken ones"
    );
}

#[test]
fn numbers_without_end_are_cut_off() {
    let mut bytes = b"\x1b[".to_vec();
    bytes.extend([b'9'; 1000]);
    bytes.extend([b';'; 1000]);
    bytes.extend(b"5u");
    assert_eq!(typed(&bytes), []);
}

proptest! {
    #[test]
    fn noise_never_fails_and_a_stop_is_heard_in_it(noise in prop::collection::vec(any::<u8>(), 0..64)) {
        let mut decoder = Decoder::default();
        for byte in noise {
            decoder.feed(byte);
        }
        for stop in [0x7f, 0x08] {
            let mut decoder = decoder.clone();
            let stopped = Some(Typed::Action(InputAction::Order(PersonOrder::EmergencyStop)));
            prop_assert_eq!(decoder.feed(stop), stopped);
            // Directly behind the noise it may be the last byte of another key.
            prop_assert_eq!(decoder.feed(b't'), Some(Typed::Action(InputAction::Order(PersonOrder::TakeOff))));
        }
    }
}
