use tello_io::tello::Protocol;

use super::super::connection::tests::link;
use super::*;

impl Console {
    /// A person whose lines come from `lines`, or none, who pressed Ctrl-C `asked` times.
    pub(in crate::bench) fn of(lines: Option<Receiver<String>>, asked: u32) -> Self {
        let console = Self { lines, asked: Arc::default() };
        (0..asked).for_each(|_| console.hear(Signal::SIGINT));
        console
    }

    pub(in crate::bench) fn hear(&self, signal: Signal) {
        self.asked.hear(Some(signal));
    }
}

/// A person who has typed `typed`; `is_there`: whose terminal is still open.
fn person(typed: &[&str], is_there: bool, asked: u32) -> Console {
    let (to, lines) = sync_channel(16);
    for line in typed {
        to.send((*line).to_owned()).unwrap();
    }
    if is_there {
        // Its end stays open.
        std::mem::forget(to);
    }
    Console::of(Some(lines), asked)
}

#[test]
fn a_check_is_stopped_by_a_signal_a_line_and_a_closed_terminal_and_by_nothing_else() {
    for (console, stops) in [
        (person(&[], true, 0), false),
        (person(&[], true, 1), true),
        (person(&[""], true, 0), true),
        (person(&[], false, 0), true),
        (Console::of(None, 0), false),
        (Console::of(None, 1), true),
    ] {
        assert_eq!(console.asks_to_stop(), stops, "{console:?}");
    }
}

#[test]
fn lines_that_came_too_early_are_forgotten_and_a_closed_terminal_is_not() {
    let console = person(&["y", "", "n"], true, 0);
    console.forget_lines();
    assert!(!console.asks_to_stop());
    let closed = person(&["y"], false, 0);
    closed.forget_lines();
    assert!(closed.asks_to_stop());
    Console::of(None, 0).forget_lines();
}

#[test]
fn an_answer_is_a_line_and_a_request_to_stop_is_none() {
    let (mut link, _drone) = link(Protocol::Binary);
    for (console, answer) in [
        (person(&["  yes \t", "later"], true, 0), Some("yes")),
        (person(&[""], true, 0), Some("")),
        (person(&[], true, 1), None),
        (person(&[], false, 0), None),
        (Console::of(None, 0), None),
    ] {
        assert_eq!(console.ask("?", &mut link).as_deref(), answer, "{console:?}");
    }
}

#[test]
fn a_bench_without_a_person_says_so() {
    assert!(Console::of(None, 0).is_unattended());
    assert!(!person(&[], true, 0).is_unattended());
    assert_eq!(person(&[], true, 3).interrupts(), 3);
}

#[test]
fn a_terminal_that_closes_and_a_system_that_shuts_down_stop_the_check_and_no_motor() {
    let console = Console::of(None, 0);
    for signal in [Signal::SIGHUP, Signal::SIGHUP, Signal::SIGTERM, Signal::SIGTERM] {
        console.hear(signal);
        assert!(console.asks_to_stop());
        assert_eq!(console.interrupts(), 0, "{signal}");
    }
    console.hear(Signal::SIGINT);
    assert_eq!(console.interrupts(), 1);
}
