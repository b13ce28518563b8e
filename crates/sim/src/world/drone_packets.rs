//! The drone's side of the conversation: packets in, packets out.
//!
//! Owns what each packet of the host does to the drone and what the drone answers. Bytes are
//! [`tello_io::tello::protocol`]'s, sockets are [`crate::emulator`]'s. Not modelled: the fast bit of
//! the sticks and everything about video; the altitude limit is confirmed and not kept.

use horizon_model::rows::pose;
use tello_io::tello::DroneOrder;
use tello_io::tello::protocol::{
    Action, Answer, DronePacket, FlightStatus, HostPacket, Query, Setting, Version,
};

use super::World;
use crate::DT_S;
use crate::drone::{LandAnswer, Truth};
use crate::fault::InjectedFault;

/// Firmware with which a Tello was often sold.
const VERSION: &[u8] = b"01.04.91.01";
const ALTITUDE_LIMIT_M: u16 = 30;
const TILT_LIMIT_RAD: f64 = 25.0_f64.to_radians();
/// Rate of the clock of the drone's log. Hz
const LOG_TICK_HZ: f64 = 2_344_062.0;

impl World {
    /// Takes one packet of the host; returns the drone's answer.
    ///
    /// Actions are acknowledged when they are accepted, an emergency stop never is. Under `drone_deaf` the
    /// drone ignores every packet, under `drone_mute` it executes each without an answer. In a command outage of
    /// [`crate::Profile`] packets still arrive: only the sticks have no effect. The recordings of the thesis contain no
    /// other commands.
    pub fn receive(&mut self, packet: &HostPacket) -> Option<DronePacket> {
        self.is_connected |=
            matches!(packet, HostPacket::ConnReq { .. }) && !self.ignores_commands();
        if self.ignores_commands() || !self.is_connected {
            return None;
        }
        self.drone.reset_watchdog();
        let answer = match *packet {
            HostPacket::ConnReq { video_port } => Some(DronePacket::ConnAck { video_port }),
            HostPacket::Sticks { u, .. } => {
                self.drone.count_sticks();
                self.drone.obey_sticks(u);
                None
            }
            HostPacket::Action { action, sequence } => {
                let is_accepted = match action {
                    Action::TakeOff => {
                        self.drone.count_order(DroneOrder::TakeOff);
                        self.drone.take_off()
                    }
                    Action::Land => {
                        self.drone.count_order(DroneOrder::Land);
                        self.drone.receive_land() == LandAnswer::Accepted
                    }
                };
                is_accepted.then_some(DronePacket::Ack { action, sequence })
            }
            HostPacket::EmergencyStop => {
                self.drone.count_order(DroneOrder::EmergencyStop);
                if self.firmware.emergency.binary {
                    self.drone.stop_motors();
                }
                None
            }
            HostPacket::CancelLanding { sequence } => self
                .drone
                .cancel_landing()
                .then_some(DronePacket::Ack { action: Action::Land, sequence }),
            HostPacket::AltitudeLimit { sequence, .. } => {
                Some(DronePacket::SettingAck { setting: Setting::AltitudeLimit, sequence })
            }
            HostPacket::Query { sequence, query } => {
                self.fact(query).map(|answer| DronePacket::Answer { sequence, answer })
            }
            HostPacket::DateTime { .. } | HostPacket::LogHeaderAck { .. } => None,
        };
        answer.filter(|_| !self.is_mute())
    }

    /// The flight status that the drone sends about ten times per second; `None` while it is mute or
    /// knows no host.
    pub(crate) fn flight_status(&self) -> Option<FlightStatus> {
        if self.is_mute() {
            return None;
        }
        let truth = self.reported();
        let battery_pct = whole_percent(truth.battery_pct);
        let low_pct = self.firmware.warns_below_pct;
        let status = FlightStatus {
            height_dm: tenths(truth.pose[pose::Z]),
            vel_north_dm_s: tenths(truth.velocity.x_mps),
            vel_east_dm_s: tenths(-truth.velocity.y_mps),
            vel_down_dm_s: tenths(-truth.velocity.z_mps),
            fly_time_ds: tenths(truth.motor_s),
            battery_pct,
            ..FlightStatus::new(self.reporter.is_flying())
        };
        Some(status.with_battery(battery_pct < low_pct, battery_pct < low_pct / 2))
    }

    /// The record of the drone's log that it sends about ten times per second, once its header is acknowledged; `None`
    /// while it is mute or knows no host. It powered up at the heading `theta_start`. rad
    pub(crate) fn log_record(&self, sequence: u16, theta_start: f64) -> Option<DronePacket> {
        if self.is_mute() {
            return None;
        }
        let now_s = self.step() as f64 * DT_S;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "counts modulo 2^32"
        )]
        let tick = ((now_s * LOG_TICK_HZ) as u64 % (1 << 32)) as u32;
        let yaw_rad = theta_start - self.reported().pose[pose::THETA];
        Some(DronePacket::LogData { sequence, tick, yaw_rad })
    }

    /// The drone as it reports itself.
    pub(crate) fn reported(&self) -> Truth {
        self.reporter.reported(self.truth())
    }

    pub(crate) fn ignores_commands(&self) -> bool {
        self.faults.is_on(InjectedFault::DroneDeaf, self.step()) || self.is_rebooting
    }

    pub(crate) fn is_mute(&self) -> bool {
        self.faults.is_on(InjectedFault::DroneMute, self.step()) || !self.is_connected
    }

    /// Answers of a drone from the shop, with the battery threshold of this one.
    fn fact(&self, query: Query) -> Option<Answer> {
        Some(match query {
            Query::Version => Answer::Version(Version::read(VERSION)?),
            Query::AltitudeLimit => Answer::AltitudeLimit(ALTITUDE_LIMIT_M),
            Query::BatteryThreshold => Answer::BatteryThreshold(self.firmware.warns_below_pct),
            Query::TiltLimit => Answer::TiltLimit(TILT_LIMIT_RAD),
        })
    }
}

/// A quantity in tenths of its unit, as the wire carries it.
fn tenths(value: f64) -> i16 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "tenths of a metre in a room fit; a cast saturates"
    )]
    let tenths = (10.0 * value).round() as i16;
    tenths
}

/// Charge as shown: a started percent is still there.
pub(crate) fn whole_percent(battery_pct: f64) -> u8 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=100")]
    let whole = battery_pct.ceil() as u8;
    whole
}

#[cfg(test)]
mod tests;
