//! The guardian of a check that runs the motors, as of a flight.
//!
//! Owns its messages: whether motors may run, and whether the bench lands them.

use std::net::{SocketAddr, UdpSocket};

use anyhow::{Context, Result};
use tello_io::clock::TimeNs;
use tello_io::tello::{GuardianReport, Heartbeat, Protocol, SenderState};

use crate::fly::Guardian;

/// The bench's end of the channel to its guardian. Dropped, it reports the end to the guardian.
#[derive(Debug)]
pub(super) struct Guard {
    heartbeat: Heartbeat,
    process: Option<Guardian>,
    state: SenderState,
    has_failed: bool,
}

impl Guard {
    /// No guardian: for checks that start no motor.
    pub(super) fn absent() -> Self {
        Self {
            heartbeat: Heartbeat::default(),
            process: None,
            state: SenderState::Idle,
            has_failed: false,
        }
    }

    /// Starts a guardian of the drone at `address`; returns when it watches.
    pub(super) fn start(
        socket: &UdpSocket,
        address: SocketAddr,
        protocol: Protocol,
    ) -> Result<Self> {
        let (heartbeat, process) =
            Heartbeat::start_guardian(socket, address, protocol, Guardian::spawn)
                .context("cannot start the guardian")?;
        Ok(Self { heartbeat, process: Some(process), ..Self::absent() })
    }

    /// Sets the state of the bench as a sender from here on.
    pub(super) fn set(&mut self, state: SenderState, now: TimeNs) {
        self.state = state;
        self.turn(now);
    }

    /// Receives the guardian's verdict and sends a heartbeat. To be called before anything is sent, and at least every
    /// 40 ms.
    pub(super) fn turn(&mut self, now: TimeNs) {
        self.has_failed |=
            self.process.is_some() && self.heartbeat.report(now) != GuardianReport::Continue;
        self.heartbeat.beat(self.state, now);
    }

    /// Whether the guardian has ordered a landing, or is lost: no check goes on.
    pub(super) fn has_failed(&self) -> bool {
        self.has_failed
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        std::mem::take(&mut self.heartbeat).end();
        if let Some(process) = self.process.take() {
            process.end();
        }
    }
}

#[cfg(test)]
mod tests;
