//! What a person in the laboratory looks at first after a fault has ended a flight.

use super::Fault;

impl Fault {
    /// What leads to the fault in practice, most frequent first, with the way out where it is not obvious; `None` for
    /// faults that end no flight, or whose name is plain. The fault itself shows none of these causes.
    pub fn likely_causes(self) -> Option<&'static str> {
        Some(match self {
            Self::MocapStale | Self::MocapLost => {
                "markers hidden, the object outside of the tracked volume, the stream broken off or repeating a pose; \
                 frame numbers or time stamps that jumped or began anew (server restarted, clock set), poses that come \
                 late"
            }
            Self::MocapFrozen => {
                "the motion capture repeats a pose or tracks another object; the drone ignores its sticks"
            }
            Self::MocapJumped | Self::MocapRough => {
                "markers swapped, hidden or reflected; the motion capture needs a new calibration"
            }
            Self::PoseDoubtful | Self::PoseInconsistent => {
                "the poses drift or belong to another object; z of the motion capture is not up (mocap watch); the \
                 drone's own velocity or height is wrong (a floor without texture, dim light, furniture below)"
            }
            Self::HeadingWrong => {
                "the rigid body is turned against the drone's nose, or the frame is mirrored (mocap watch); its heading \
                 drifts; sticks act late"
            }
            Self::ObstacleEntered | Self::PlanBlocked | Self::BlockedLong => {
                "walls or obstacles leave too little room beside the mission (check --figure); a lower --speed"
            }
            Self::ObstacleUnseen | Self::ObstacleApproaches => {
                "somebody comes near the vehicle; the markers of the moving obstacle are hidden"
            }
            Self::FenceNear | Self::FenceLeft => {
                "the mission is near a wall of `room`; lost commands; a draught; the frame is mirrored or turned \
                 (mocap watch)"
            }
            Self::TrackingLost | Self::MissionOverdue => {
                "the parameters do not fit this drone (ident); it is pushed or held, or evades somebody for long; lost \
                 commands; without light or texture on the floor it does not hold its velocity; the frame is mirrored \
                 or turned (mocap watch)"
            }
            Self::Immobile | Self::NotFlying => {
                "the drone touches something, is held, or landed by itself"
            }
            Self::TooFast => {
                "without light or texture on the floor the drone does not hold its velocity"
            }
            Self::DeadTimeLong => {
                "Wi-Fi delays the sticks; the dead times of the parameters do not fit this drone (ident)"
            }
            Self::OutageHeld | Self::OutageLong | Self::OutageUnsafe => {
                "Wi-Fi loses the sticks; the drone is pushed or held; another program steers it"
            }
            Self::DroneSilent => "Wi-Fi is interrupted; the drone is off",
            Self::TookOffUnasked => "another program or a person started the drone",
            Self::EstimatorFailed | Self::ControllerFailed | Self::SolverFailing => {
                "poses or parameters far from those of a flying drone; report it with the log"
            }
            Self::TicksLate | Self::GuardianLost | Self::ProgramStalled => {
                "the computer is overloaded or was suspended (real-time priority: docs/install.md)"
            }
            Self::TakeOffTimeout => {
                "the drone refuses to start (battery, heat, tilt); another object is tracked in its place"
            }
            Self::LandingTimeout => {
                "Wi-Fi is interrupted; another program or app steers the drone; another object is tracked in its place; z \
                 of the motion capture is not up (mocap watch)"
            }
            Self::PersonGone => "nobody steers: hand back to the controller or land",
            _ => return None,
        })
    }
}
