use nix::pty::{OpenptyResult, openpty};
use nix::sys::termios::OutputFlags;

use super::*;

/// A terminal in the mode of a shell, by which its other end is held open.
fn terminal() -> (OpenptyResult, Termios) {
    let terminal = openpty(None, None).unwrap();
    let mode = tcgetattr(&terminal.slave).unwrap();
    (terminal, mode)
}

fn character(mode: &Termios, index: SpecialCharacterIndices) -> u8 {
    mode.control_chars[index as usize]
}

#[test]
fn keys_come_one_by_one_and_are_not_echoed() {
    let (_terminal, before) = terminal();
    assert!(before.local_flags.contains(LocalFlags::ICANON | LocalFlags::ECHO));
    let mode = steering(&before);
    assert!(!mode.local_flags.intersects(LocalFlags::ICANON | LocalFlags::ECHO));
    assert_eq!(character(&mode, SpecialCharacterIndices::VMIN), 1);
    assert_eq!(character(&mode, SpecialCharacterIndices::VTIME), 0);
}

#[test]
fn no_key_stops_or_kills_the_program_or_holds_up_its_output() {
    let (_terminal, before) = terminal();
    let mode = steering(&before);
    for index in [SpecialCharacterIndices::VSUSP, SpecialCharacterIndices::VQUIT] {
        assert_ne!(character(&before, index), DISABLED, "a shell has {index:?}");
        assert_eq!(character(&mode, index), DISABLED, "{index:?}");
    }
    assert!(before.input_flags.contains(InputFlags::IXON));
    assert!(!mode.input_flags.contains(InputFlags::IXON));
}

#[test]
fn ctrl_c_stays_a_signal_and_lines_end_as_ever() {
    let (_terminal, before) = terminal();
    let mode = steering(&before);
    assert!(mode.local_flags.contains(LocalFlags::ISIG));
    let interrupt = SpecialCharacterIndices::VINTR;
    assert_eq!(character(&mode, interrupt), character(&before, interrupt));
    assert!(mode.output_flags.contains(OutputFlags::OPOST | OutputFlags::ONLCR));
    assert_eq!(mode.output_flags, before.output_flags);
    assert_eq!(mode.control_flags, before.control_flags);
}

#[test]
fn a_terminal_takes_the_mode_and_the_mode_before() {
    let (terminal, before) = terminal();
    let mode = steering(&before);
    for wanted in [&mode, &before] {
        tcsetattr(&terminal.slave, SetArg::TCSANOW, wanted).unwrap();
        let found = tcgetattr(&terminal.slave).unwrap();
        assert_eq!(found.local_flags, wanted.local_flags);
        assert_eq!(found.input_flags, wanted.input_flags);
        assert_eq!(found.control_chars, wanted.control_chars);
    }
}
