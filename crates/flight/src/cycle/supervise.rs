//! From estimate, poses and reports to the decision of the supervisor.
//!
//! Owns how the [`Evidence`] of a tick is collected, and the inputs of each monitor.

use horizon_model::rows::{Pose, PoseRate, Sticks, pos_w, pose, stick};
use nalgebra::{SVector, Vector2, Vector3};

use super::link::Link;
use super::planning::BrakeOrder;
use super::progress::{TrackingError, TrackingExemption, tracked_reference};
use super::walls::Walls;
use super::{COMING, Cycle, Inbox, JUST_ENDED, Outcome, Vehicle};
use crate::drone::DroneStatus;
use crate::time::TimeNs;
use crate::{
    DroneMotion, DroneReport, EstimatedMotion, Evidence, Findings, HandInput, LinkState,
    ObstacleApproach, ObstacleEvidence, Outage, Phase, Pilot, PoseEvidence, Sample,
    TrackingEvidence,
};

/// Age beyond which a report of the drone is too old for the monitors. s
const REPORT_AGE_MAX_S: f64 = 0.5;

/// Largest stick that counts as neutral: that of a released key decays towards zero and never reaches it. 1
const HAND_NEUTRAL: f64 = 0.02;

/// How the vehicle tracks its reference in one tick.
#[derive(Debug, Clone, Copy)]
struct Tracking {
    error: TrackingError,
    /// `None`: it does not count.
    velocity_error: Option<VelocityError>,
}

/// Horizontal differences between vehicle and reference. World frame.
#[derive(Debug, Clone, Copy)]
struct VelocityError {
    /// Of the velocities. m/s
    error_w_mps: Vector2<f64>,
    /// Of the positions. m
    apart_w_m: Vector2<f64>,
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// Decides on this tick; who may steer. `None`: nobody, as in the recording of another controller.
    pub(super) fn supervise(&mut self, inbox: &Inbox, out: &mut Outcome) -> Option<Pilot> {
        if inbox.flown.is_some() {
            return None;
        }
        let findings = self.monitor(inbox);
        self.observe_impact(self.memory.o_seen, &self.fifo.applied(JUST_ENDED));
        out.findings = Some(findings);
        let outage = self.outage();
        let (motion, tracking) = self.follow_motion(inbox.now, out).unzip();
        let pose = out.filtered.and_then(|filtered| filtered.o);
        let decision = self.supervisor.decide(&Evidence {
            t_ns: inbox.now.0,
            skipped: inbox.skipped,
            pose_age_s: self.pose_age_s(inbox),
            pose,
            motion,
            plan: self.planner.plan_clearance(),
            obstacles: self.obstacle_evidence(pose, motion.as_ref()),
            poses: self.pose_evidence(),
            findings,
            outage,
            is_dead_time_long: self.link.as_ref().is_some_and(Link::is_dead_time_long),
            tracking: self.tracking_evidence(tracking),
            speed_mps: out.speed_mps,
            drone: self.memory.drone.as_ref().map(|status| drone_report(status, inbox.now)),
            operator: inbox.operator,
            incidents: inbox.incidents,
            hand: hand_input(inbox.manual.as_ref()),
            is_mission_done: self.mission.is_finished(),
            has_estimator_failed: self.memory.has_estimator_failed,
            has_controller_failed: self.memory.has_controller_failed,
        });
        out.decision = Some(decision);
        self.planner.brake(BrakeOrder {
            is_on: decision.is_braking,
            descends_to_m: self.supervisor.descends_to_m(),
            may_move: self.supervisor.believes_approach(),
        });
        decision.pilot
    }

    /// Obstacles beside the newest accepted pose, and in the path of the estimated motion.
    fn obstacle_evidence(
        &self,
        pose: Option<Pose>,
        motion: Option<&EstimatedMotion>,
    ) -> ObstacleEvidence {
        let may_stand = matches!(self.supervisor.phase(), Phase::Idle | Phase::TakingOff);
        let holds_here = |is_so: fn(&Walls, &Vector3<f64>) -> bool| {
            self.planner.walls().zip(pose).is_some_and(|(walls, at)| is_so(walls, &pos_w(&at)))
        };
        let approach = if holds_here(Walls::is_approached) {
            ObstacleApproach::Predicted
        } else if holds_here(Walls::may_be_approached) {
            ObstacleApproach::Possible
        } else {
            ObstacleApproach::No
        };
        ObstacleEvidence {
            is_unseen: self.planner.walls().is_some_and(Walls::is_moving_unseen),
            blocks_take_off: may_stand && holds_here(Walls::blocks_take_off),
            approach,
            reference_behind_w: self.reference_behind_w(motion),
            is_vehicle_inside: holds_here(Walls::is_in_fixed),
        }
    }

    /// How plausible the newest poses are.
    fn pose_evidence(&self) -> PoseEvidence {
        PoseEvidence {
            is_repeated: self.is_stream_repeating(),
            jump_m: self.plausibility.jump_m(),
            shift_m: self.plausibility.shift_m(),
            is_rough: self.plausibility.is_rough(),
            drop_m: self.plausibility.drop_m(),
            is_settled: self.standing_start.is_settled(),
        }
    }

    /// The motion beside its reference; `tracking` is `None` without an estimate.
    fn tracking_evidence(&self, tracking: Option<Tracking>) -> TrackingEvidence {
        let (tracking, velocity_error) = match tracking {
            Some(Tracking { error, velocity_error }) => (Some(error), velocity_error),
            None => (None, None),
        };
        TrackingEvidence {
            position_growth_m: tracking.map(|tracking| tracking.position_growth_m),
            velocity_error_mps: velocity_error.map(|velocity| velocity.error_w_mps.norm()),
            is_receding: velocity_error
                .is_some_and(|velocity| velocity.error_w_mps.dot(&velocity.apart_w_m) > 0.0),
            heading_growth_rad: tracking.map(|tracking| tracking.heading_growth_rad),
            height_deficit_m: tracking.map(|tracking| tracking.height_deficit_m),
            sink_depth_m: tracking.map(|tracking| tracking.sink_depth_m),
            pressed_s: self.immobility.pressed_s(),
            has_hit: self.impact.has_hit(),
            overtime_s: self.progress.overtime_s(&self.mission),
        }
    }

    /// Estimated motion, and how it tracks its reference, for the monitors of progress and for `out`; `None` without an
    /// estimate.
    fn follow_motion(
        &mut self,
        now: TimeNs,
        out: &mut Outcome,
    ) -> Option<(EstimatedMotion, Tracking)> {
        let known = self.motion().map(|motion| (motion, self.track(&motion, now)));
        out.tracking_m = known.map(|(_, tracking)| tracking.error.position_growth_m);
        out.speed_mps =
            known.map_or(0.0, |(motion, _)| motion.rate.fixed_rows::<3>(pose::X).norm());
        if let Some((motion, _)) = &known {
            self.immobility.observe_pose(&motion.pose);
        }
        out.pressed_s = self.immobility.pressed_s();
        known
    }

    /// Position of the reference, or of a constant target, if it is behind an obstacle that does not move and the
    /// moving obstacle is not in the path; else `None`. World frame. m
    fn reference_behind_w(&self, motion: Option<&EstimatedMotion>) -> Option<Vector3<f64>> {
        let (walls, at_w) = (self.planner.walls()?, pos_w(&motion?.pose));
        let to_w = pos_w(&self.mission.reference().unwrap_or(*self.mission.target()));
        let is_behind = walls.fixed_blocks_path(&at_w, &to_w);
        (is_behind && !walls.moving_blocks_path(&at_w, &to_w)).then_some(to_w)
    }

    /// Where a vehicle at `at` is held that the controller brings down before a landing, away from the reference of the
    /// mission; `None` without such a descent. World frame. m, rad
    fn held_in_descent(&self, at: &Pose) -> Option<Pose> {
        self.supervisor.descends_to_m().and_then(|_| self.planner.held(at))
    }

    /// How the vehicle tracks its reference. What was before the flight does not count. In the descent before a landing
    /// the reference is the place at which the vehicle is held.
    fn track(&mut self, motion: &EstimatedMotion, now: TimeNs) -> Tracking {
        let at = &motion.pose;
        let held = self.held_in_descent(at);
        if self.supervisor.phase() != Phase::Flying || held.is_some() {
            self.progress.restart();
        }
        let reference = held.or_else(|| tracked_reference(&self.mission));
        let exemption = self.tracking_exemption(at, reference.as_ref(), now);
        let velocity_error = self.velocity_error(motion, held.as_ref(), exemption);
        let error = match held {
            Some(held) => TrackingError::in_descent(at, &held, exemption),
            None => self.progress.tracking_error(&self.mission, at, exemption),
        };
        Tracking { error, velocity_error }
    }

    /// Why a vehicle at `at` may be off its `reference`.
    fn tracking_exemption(
        &self,
        at: &Pose,
        reference: Option<&Pose>,
        now: TimeNs,
    ) -> TrackingExemption {
        let (walls, at_w) = (self.planner.walls(), pos_w(at));
        TrackingExemption {
            is_beside_fixed: walls.is_some_and(|walls| walls.is_beside_fixed(&at_w)),
            is_path_blocked: walls
                .zip(reference)
                .is_some_and(|(walls, to)| walls.moving_blocks_path(&at_w, &pos_w(to))),
            was_approached: self.supervisor.was_approached(now.0),
        }
    }

    /// The velocity beside that of the reference, or of the place `held` in the descent; `None` if the reference is a
    /// constant target, or with any exemption.
    fn velocity_error(
        &self,
        motion: &EstimatedMotion,
        held: Option<&Pose>,
        exemption: TrackingExemption,
    ) -> Option<VelocityError> {
        let (to, rate) = match held {
            Some(held) => (*held, PoseRate::zeros()),
            None => (self.mission.reference()?, self.mission.reference_rate()?),
        };
        (!exemption.is_any()).then(|| VelocityError {
            error_w_mps: pos_w(&(motion.rate - rate)).xy(),
            apart_w_m: (pos_w(&motion.pose) - pos_w(&to)).xy(),
        })
    }

    /// Takes this tick to the monitors of the motion; their findings.
    fn monitor(&mut self, inbox: &Inbox) -> Findings {
        let sample = self.sample(self.memory.o_seen, self.fifo.applied(JUST_ENDED), inbox);
        if !self.is_monitored() {
            self.monitors.update_on_ground(&sample);
            return Findings::default();
        }
        if let Some(repeated) = self.memory.o_repeated.filter(|_| sample.pose.is_none()) {
            self.monitors.observe_repeated(&repeated);
        }
        let findings = self.monitors.update(&sample);
        if !self.plausibility.has_jumped() {
            return findings;
        }
        self.monitors.restart_direction();
        Findings { direction_error_rad: None, is_direction_wrong: false, ..findings }
    }

    /// Takes a period without a tick, in which `u_nominal` would have been applied and no motion was measured, to the
    /// monitors and to the worst case.
    pub(super) fn monitor_missed(&mut self, u_nominal: Sticks) {
        if self.is_monitored() {
            let link_is_up = self.link_is_up();
            let sample = Sample { pose: None, drone: None, u_applied: u_nominal, link_is_up };
            self.monitors.update(&sample);
        }
        if self.mhe.is_started() {
            self.follow_worst_case(&u_nominal);
        }
        self.observe_impact(None, &u_nominal);
    }

    /// Takes the pose `seen` after a period in which `u_applied` was applied to the detection of an impact.
    fn observe_impact(&mut self, seen: Option<Pose>, u_applied: &Sticks) {
        self.impact.observe_period(seen.as_ref(), u_applied, self.theta_hat_rad());
    }

    /// Takes the inputs by which the controller should move the vehicle, those of the mission while the link is up, to
    /// the detection of an immobile vehicle. While a person steers, this and the progress begin anew.
    pub(super) fn follow_immobility(&mut self, pilot: Option<Pilot>, u_sent: &Sticks) {
        if pilot == Some(Pilot::Person) {
            self.immobility.restart();
            // After a hand-back the reference may wait: under a brake or a hold the mission is not resumed.
            self.progress.restart();
        } else if (self.memory.is_on_mission || self.planner.is_at_rest()) && self.link_is_up() {
            self.immobility.add_input(u_sent, self.dt_s);
        }
    }

    /// Whether the motion is that of a flight.
    fn is_monitored(&self) -> bool {
        matches!(self.supervisor.phase(), Phase::TakingOff | Phase::Flying) && !self.is_dry_run
    }

    /// What the monitors see of a period in which `u_applied` was applied.
    fn sample(&self, pose: Option<Pose>, u_applied: Sticks, inbox: &Inbox) -> Sample {
        let is_fresh = |status: &DroneStatus| {
            inbox.now.since(status.received_at).seconds() <= REPORT_AGE_MAX_S
        };
        let drone = self.memory.drone.filter(is_fresh).as_ref().map(drone_motion);
        Sample { pose, drone, u_applied, link_is_up: self.link_is_up() }
    }

    /// The present command outage; `None` without one.
    fn outage(&mut self) -> Option<Outage> {
        if !self.mhe.is_started() {
            return None;
        }
        self.follow_worst_case(&self.fifo.applied(JUST_ENDED));
        let (states, for_s) = self.worst_case.states()?;
        let is_held = self.link.as_ref().is_some_and(|link| link.state() == LinkState::Held);
        Some(Outage { for_s, is_held, if_applied: states.map(|s| self.motion_of(&s)) })
    }

    /// Follows the worst case of an outage by a period in which `u_nominal` would have been applied.
    fn follow_worst_case(&mut self, u_nominal: &Sticks) {
        let link_is_up = self.link_is_up();
        let estimate = (self.mhe.s_hat(), self.mhe.p_hat());
        self.worst_case.follow(&self.model, link_is_up, estimate, u_nominal, self.dt_s);
    }

    /// Pose and velocity by the newest estimate; `None` before the first.
    pub(super) fn motion(&self) -> Option<EstimatedMotion> {
        self.mhe.is_started().then(|| self.motion_of(self.mhe.s_hat()))
    }

    fn motion_of(&self, s: &SVector<f64, NS>) -> EstimatedMotion {
        let rate = self.rate_of(s, &self.fifo.applied(COMING));
        EstimatedMotion { pose: self.model.observe(s), rate }
    }

    /// Mean change of the pose per second, from the state `s` on, while `u` acts for a period.
    pub(super) fn rate_of(&self, s: &SVector<f64, NS>, u: &Sticks) -> PoseRate {
        let s_next = self.model.step(s, u, self.mhe.p_hat(), self.dt_s);
        (self.model.observe(&s_next) - self.model.observe(s)) / self.dt_s
    }
}

/// Whether a person moves the sticks `manual`, which are `None` if nobody holds them.
fn hand_input(manual: Option<&[f64; stick::COUNT]>) -> HandInput {
    match manual {
        None => HandInput::Absent,
        Some(hand) if hand.iter().all(|u| u.abs() <= HAND_NEUTRAL) => HandInput::Neutral,
        Some(_) => HandInput::Steering,
    }
}

/// The motion that `status` reports.
fn drone_motion(status: &DroneStatus) -> DroneMotion {
    DroneMotion {
        horizontal_d_mps: status.velocity_d_mps.map(|[first, second, _]| [first, second]),
        height_m: status.height_m,
        heading_rad: status.heading_rad,
    }
}

/// The evidence of `status` at `now`.
fn drone_report(status: &DroneStatus, now: TimeNs) -> DroneReport {
    DroneReport {
        age_s: now.since(status.received_at).seconds(),
        is_flying: status.is_flying,
        takes_sticks: status.takes_sticks,
        height_m: status.height_m,
        battery_pct: status.battery_pct,
        is_battery_low: status.is_battery_low == Some(true),
        is_battery_critical: status.is_battery_critical == Some(true),
    }
}

#[cfg(test)]
mod tests;
