//! Signals: each that a program can outlive lands the drone.
//!
//! Owns which signals those are. They are blocked in every thread and read by one, so that no signal ever ends,
//! stops or interrupts a thread that flies. Left alone are those of a fault in the program (the guardian
//! lands), those that are ignored, by default, as SIGPIPE by Rust or as SIGHUP by `nohup`, and the two that no program
//! can catch. SIGXFSZ costs the log alone.

use std::thread;

use anyhow::{Context, Result};
use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SignalFd, siginfo};

use crate::interrupt::is_hangup_ignored;

/// Signals that keep their meaning. The first four come from a fault of the program: blocked, they would end
/// it without a message. The last one belongs to a debugger.
const LEFT_ALONE: [Signal; 10] = [
    Signal::SIGSEGV,
    Signal::SIGBUS,
    Signal::SIGILL,
    Signal::SIGFPE,
    Signal::SIGPIPE,
    Signal::SIGCHLD,
    Signal::SIGCONT,
    Signal::SIGURG,
    Signal::SIGWINCH,
    Signal::SIGTRAP,
];

/// All the others, those for real time included; SIGHUP only if it ends a program.
fn landing(is_hangup_ignored: bool) -> SigSet {
    let mut signals = SigSet::all();
    for signal in LEFT_ALONE {
        signals.remove(signal);
    }
    // Blocked, it would be read although it is ignored. A SIGINT that a script has its background jobs ignore is one
    // that somebody sends on purpose: it lands.
    if is_hangup_ignored {
        signals.remove(Signal::SIGHUP);
    }
    signals
}

/// Blocks the signals that land, in this thread and in those that it starts from here on.
///
/// # Errors
/// The system refuses.
pub(crate) fn block() -> Result<()> {
    landing(is_hangup_ignored()).thread_block().context("cannot block signals")
}

/// Starts the thread that calls `hear` for every signal, with `None` for one without a name. [`block`] came before.
///
/// # Errors
/// The system gives no descriptor or no thread.
pub(crate) fn listen(mut hear: impl FnMut(Option<Signal>) + Send + 'static) -> Result<()> {
    let signals =
        SignalFd::new(&landing(is_hangup_ignored())).context("cannot listen for signals")?;
    let listen = move || {
        loop {
            match signals.read_signal() {
                Ok(signal) => match signal.and_then(named) {
                    // A log that reached the limit of a file's size: that write fails, and with it the log alone.
                    Some(Signal::SIGXFSZ) => {}
                    signal => hear(signal),
                },
                Err(Errno::EINTR) => {}
                // No signal is heard from here on: they stay blocked.
                Err(_) => return hear(None),
            }
        }
    };
    thread::Builder::new()
        .name("tello-signals".into())
        .spawn(listen)
        .context("cannot listen for signals")?;
    Ok(())
}

/// The signal that was read; those for real time have no name.
fn named(read: siginfo) -> Option<Signal> {
    i32::try_from(read.ssi_signo).ok().and_then(|number| Signal::try_from(number).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_signal_that_ends_stops_or_interrupts_a_program_lands() {
        let landing = landing(false);
        for signal in [
            Signal::SIGHUP,
            Signal::SIGINT,
            Signal::SIGQUIT,
            Signal::SIGABRT,
            Signal::SIGUSR1,
            Signal::SIGUSR2,
            Signal::SIGALRM,
            Signal::SIGTERM,
            Signal::SIGTSTP,
            Signal::SIGTTIN,
            Signal::SIGTTOU,
            Signal::SIGXCPU,
            Signal::SIGXFSZ,
            Signal::SIGIO,
            Signal::SIGPWR,
        ] {
            assert!(landing.contains(signal), "{signal}");
        }
        let left = Signal::iterator().filter(|signal| !landing.contains(*signal));
        assert!(left.eq(Signal::iterator().filter(|signal| LEFT_ALONE.contains(signal))));
    }

    #[test]
    fn a_hang_up_that_was_ignored_at_the_start_stays_ignored_and_nothing_else_does() {
        let (landing, all) = (landing(true), landing(false));
        let left = Signal::iterator().filter(|it| all.contains(*it) && !landing.contains(*it));
        assert_eq!(left.collect::<Vec<_>>(), [Signal::SIGHUP]);
    }

    #[test]
    fn a_thread_and_those_that_it_starts_have_them_blocked_and_the_faults_of_a_program_not() {
        let mask = || SigSet::thread_get_mask().unwrap();
        let masks = thread::spawn(move || {
            block().unwrap();
            [mask(), thread::spawn(mask).join().unwrap()]
        });
        for mask in masks.join().unwrap() {
            assert!(mask.contains(Signal::SIGTERM) && mask.contains(Signal::SIGTSTP));
            assert!(!mask.contains(Signal::SIGSEGV) && !mask.contains(Signal::SIGPIPE));
        }
    }
}
