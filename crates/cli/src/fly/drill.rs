//! A failure of this program on order, against a simulator: does the drone come down?
//!
//! Owns what can fail and when. Nothing of it runs unless asked for, and only a drone on this machine is
//! drilled with.

use std::net::SocketAddr;
use std::str::FromStr;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use tello_io::clock::TimeNs;
use tokio::task::AbortHandle;

/// How long a thread stands still.
const STALL: Duration = Duration::from_secs(3);

/// Kind of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Failure {
    /// The control thread stands still.
    ControlStalls,
    /// The control thread panics.
    ControlPanics,
    /// The thread of the sockets stands still.
    LinkStalls,
    /// The task that talks to the drone is gone, as after a panic.
    LinkDies,
    /// The thread of the sockets panics outside of any task: it is the main thread.
    MainPanics,
}

/// Failure and its time after the start: `control-stalls@9`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InjectedFailure {
    failure: Failure,
    /// s
    after_s: f64,
}

impl FromStr for InjectedFailure {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (what, after_s) =
            text.split_once('@').with_context(|| format!("{text:?}: expected WHAT@SECONDS"))?;
        let after_s: f64 = after_s.parse().with_context(|| format!("{after_s:?} is no number"))?;
        if !(0.0..=3600.0).contains(&after_s) {
            bail!("{after_s} s: expected 0 to 3600");
        }
        let failure = match what {
            "control-stalls" => Failure::ControlStalls,
            "control-panics" => Failure::ControlPanics,
            "link-stalls" => Failure::LinkStalls,
            "link-dies" => Failure::LinkDies,
            "main-panics" => Failure::MainPanics,
            _ => bail!(
                "{what:?}: expected control-stalls, control-panics, link-stalls, link-dies or main-panics"
            ),
        };
        Ok(Self { failure, after_s })
    }
}

impl InjectedFailure {
    /// Refuses a drone that may be a real one.
    ///
    /// # Errors
    /// `drone` is not on this machine.
    pub(super) fn check(drone: &str) -> Result<()> {
        let is_simulated = drone.parse().is_ok_and(|at: SocketAddr| at.ip().is_loopback());
        if !is_simulated {
            bail!("--drill is for a simulator on this machine, and {drone} may be a real drone");
        }
        Ok(())
    }

    /// Fails, if that is the control thread's part and its time has come. `is_done` remembers it.
    #[expect(clippy::panic, reason = "a panic on order, to see that the drone lands")]
    pub(super) fn inject(&self, now: TimeNs, is_done: &mut bool) {
        if *is_done || now.seconds() < self.after_s {
            return;
        }
        *is_done = true;
        match self.failure {
            Failure::ControlStalls => thread::sleep(STALL),
            Failure::ControlPanics => panic!("drill"),
            Failure::LinkStalls | Failure::LinkDies | Failure::MainPanics => {}
        }
    }

    /// Fails, if that is the sockets' part, when its time has come.
    pub(super) async fn inject_into_link(self, link: AbortHandle) {
        tokio::time::sleep(Duration::from_secs_f64(self.after_s)).await;
        match self.failure {
            Failure::LinkStalls => thread::sleep(STALL),
            Failure::LinkDies => link.abort(),
            Failure::ControlStalls | Failure::ControlPanics | Failure::MainPanics => {}
        }
    }
}

/// Panics, if that is the main thread's part, when its time has come; never comes back.
#[expect(clippy::panic, reason = "a panic on order, to see that the drone lands")]
pub(super) async fn inject_into_main(drill: Option<InjectedFailure>) {
    let Some(InjectedFailure { failure: Failure::MainPanics, after_s }) = drill else {
        return std::future::pending().await;
    };
    tokio::time::sleep(Duration::from_secs_f64(after_s)).await;
    panic!("drill");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drill_is_read_and_kept_away_from_real_drones() {
        let drill: InjectedFailure = "link-dies@7.5".parse().unwrap();
        assert_eq!(drill, InjectedFailure { failure: Failure::LinkDies, after_s: 7.5 });
        for bad in
            ["link-dies", "link-dies@soon", "link-dies@NaN", "link-dies@-1", "battery-burns@3"]
        {
            assert!(bad.parse::<InjectedFailure>().is_err(), "{bad}");
        }
        assert!(InjectedFailure::check("127.0.0.1:8889").is_ok());
        for real in ["192.168.10.1:8889", "tello:8889"] {
            assert!(InjectedFailure::check(real).unwrap_err().to_string().contains(real));
        }
    }
}
