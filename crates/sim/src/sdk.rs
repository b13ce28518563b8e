//! The drone's side of the text SDK: commands in, replies out, one command at a time.
//!
//! Owns what each command does to the drone, when it is answered, and the state line. Words are
//! [`tello_io::tello::text`]'s, sockets are [`crate::emulator`]'s. Not modelled: video (refused),
//! mission pads and curves; a flip is a pause in place.

mod motion;
mod report;

use horizon_model::rows::Sticks;
use motion::SdkMotion;
use tello_io::tello::text::{Command, CommandError, StateLine};
use tello_io::tello::{DroneOrder, STATE_PORT};

use crate::DT_S;
use crate::drone::{Drone, DronePhase, LandAnswer, Truth};
use crate::firmware::SdkVersion;

/// A movement or a take-off that comes so soon after sticks is refused. s
const STICKS_REST_S: f64 = 0.5;

/// The state of SDK mode.
#[derive(Debug, Clone)]
pub(crate) struct Sdk {
    version: SdkVersion,
    /// Command that is being executed, answered at its end.
    running: Option<Running>,
    /// Since sticks were heard. s
    since_sticks_s: f64,
    /// Port of the host that the state line goes to.
    pub(crate) state_port: u16,
    /// Heading at power-up. rad
    theta_start: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Running {
    TakeOff,
    Land,
    Motion(SdkMotion),
}

impl Sdk {
    /// SDK mode, just entered.
    pub(crate) fn new(version: SdkVersion, theta_start: f64) -> Self {
        Self {
            version,
            running: None,
            since_sticks_s: f64::INFINITY,
            state_port: STATE_PORT,
            theta_start,
        }
    }

    /// The state line of a drone that reports itself as `reported`.
    pub(crate) fn state_line(&self, reported: &Truth) -> StateLine {
        report::state_line(reported, self.version, self.theta_start)
    }

    /// Executes a command; appends what is answered at once.
    pub(crate) fn receive(
        &mut self,
        datagram: &[u8],
        drone: &mut Drone,
        replies: &mut Vec<String>,
    ) {
        drone.reset_watchdog();
        let text = String::from_utf8_lossy(datagram);
        let unknown = || format!("unknown command: {}", text.trim());
        match Command::decode(datagram) {
            Ok(command) => {
                if self.obey(command, drone, replies).is_none() {
                    replies.push(unknown());
                }
            }
            Err(CommandError::OutOfRange) => replies.push(CommandError::OutOfRange.to_string()),
            Err(CommandError::Unknown) => replies.push(unknown()),
        }
    }

    /// Counts a command and executes it: sticks, both stops and a landing at any time, others when none is running.
    /// `None` if this version of the SDK does not know the command.
    fn obey(
        &mut self,
        command: Command,
        drone: &mut Drone,
        replies: &mut Vec<String>,
    ) -> Option<()> {
        let mut reply = |text: &str| replies.push(text.into());
        match command {
            Command::Sticks(u) => {
                drone.count_sticks();
                self.steer(u, drone);
            }
            Command::EmergencyStop => {
                drone.count_order(DroneOrder::EmergencyStop);
                if drone.obeys_text_emergency() {
                    self.running = None;
                    drone.stop_motors();
                }
            }
            Command::Land => {
                drone.count_order(DroneOrder::Land);
                if self.running != Some(Running::Land) {
                    self.land(drone, reply);
                }
            }
            Command::Stop => {
                self.running = None;
                drone.steer(Sticks::zeros());
                reply("ok");
            }
            _ => return self.obey_alone(command, drone, reply),
        }
        Some(())
    }

    /// Executes a command that does not act beside a running one, which is ignored then, or refused if it would move
    /// the drone; during a landing the drone ignores it. `None` if this version of the SDK does not know the command.
    fn obey_alone(
        &mut self,
        command: Command,
        drone: &mut Drone,
        mut reply: impl FnMut(&str),
    ) -> Option<()> {
        let is_movement = matches!(
            command,
            Command::TakeOff | Command::Go { .. } | Command::Turn { .. } | Command::Flip
        );
        if command == Command::TakeOff {
            drone.count_order(DroneOrder::TakeOff);
        }
        if self.running == Some(Running::Land) {
            return Some(());
        }
        if is_movement && (self.running.is_some() || self.since_sticks_s < STICKS_REST_S) {
            reply("error Not joystick");
            return Some(());
        }
        if self.running.is_some() {
            return Some(());
        }
        match command {
            Command::Enter | Command::Setting => reply("ok"),
            Command::StreamOn => reply("error No video"),
            Command::TakeOff => match drone.truth().phase {
                DronePhase::Grounded if drone.take_off() => self.running = Some(Running::TakeOff),
                DronePhase::Grounded => reply("error Motor stop"),
                _ => reply("error"),
            },
            Command::Go { cm } => {
                self.move_by(SdkMotion::go(cm, &drone.truth().pose), drone, reply);
            }
            Command::Turn { deg } => {
                self.move_by(SdkMotion::turn(deg, &drone.truth().pose), drone, reply);
            }
            Command::Flip => self.move_by(SdkMotion::flip(&drone.truth().pose), drone, reply),
            Command::Query(query) => {
                reply(&report::answer(query, &drone.truth(), self.version, self.theta_start)?);
            }
            Command::Ports { state, .. } => {
                (self.version >= SdkVersion::V3_0).then_some(())?;
                self.state_port = state;
                reply("ok");
            }
            Command::Sticks(_) | Command::EmergencyStop | Command::Land | Command::Stop => {}
        }
        Some(())
    }

    fn steer(&mut self, u: Sticks, drone: &mut Drone) {
        self.since_sticks_s = 0.0;
        let is_landing = self.running == Some(Running::Land);
        if self.running.is_none() || (is_landing && drone.is_landing_cancelled_by(&u)) {
            drone.obey_sticks(u);
        }
    }

    fn land(&mut self, drone: &mut Drone, mut reply: impl FnMut(&str)) {
        match drone.receive_land() {
            // Not heard early in a take-off.
            LandAnswer::Unheard => {}
            LandAnswer::Refused => reply("error"),
            LandAnswer::Accepted => {
                if self.running.is_some() {
                    reply("error Auto land");
                }
                self.running = Some(Running::Land);
            }
        }
    }

    fn move_by(&mut self, motion: SdkMotion, drone: &Drone, mut reply: impl FnMut(&str)) {
        match drone.truth().phase {
            DronePhase::Flying => self.running = Some(Running::Motion(motion)),
            DronePhase::Landing(_) => reply("error Auto land"),
            DronePhase::Grounded | DronePhase::TakingOff | DronePhase::Falling => {
                reply("error Motor stop");
            }
        }
    }

    /// Simulates one step; appends the reply of what is done.
    pub(crate) fn advance(&mut self, drone: &mut Drone, replies: &mut Vec<String>) {
        self.since_sticks_s += DT_S;
        let phase = drone.truth().phase;
        let reply = match &mut self.running {
            None => None,
            Some(Running::TakeOff) => match phase {
                DronePhase::TakingOff => None,
                DronePhase::Flying => Some("ok"),
                DronePhase::Landing(_) => Some("error Auto land"),
                DronePhase::Grounded | DronePhase::Falling => Some("error"),
            },
            Some(Running::Land) => match phase {
                DronePhase::Landing(_) => None,
                DronePhase::Grounded => Some("ok"),
                DronePhase::TakingOff | DronePhase::Flying | DronePhase::Falling => Some("error"),
            },
            Some(Running::Motion(motion)) => match phase {
                DronePhase::Flying => {
                    let (u, reply) = motion.steer(&drone.truth());
                    drone.steer(u);
                    reply
                }
                _ => Some("error Auto land"),
            },
        };
        if let Some(reply) = reply {
            self.running = None;
            replies.push(reply.into());
        }
    }
}

#[cfg(test)]
mod tests;
