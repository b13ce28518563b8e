//! The checks of the bench: what to do, which packets are sent and when, and what is expected.
//!
//! Owns the table that `tello-ctl bench --list` prints. What depends on each assumption stands in
//! `docs/bench-test.md`.

use std::fmt::{self, Display, Formatter};

use horizon_model::rows::Sticks;

/// Where a check is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// On the table or in the hand: no packet of the check starts a motor.
    Still,
    /// On the table without propellers: the motors run.
    PropsOff,
    /// In the air, inside of a net.
    Net,
}

impl Place {
    pub(super) fn spins(self) -> bool {
        self != Self::Still
    }
}

impl Display for Place {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Still => "props off, motors stay off",
            Self::PropsOff => "props off, motors run",
            Self::Net => "in the net, flies",
        })
    }
}

/// Proof by the drone's reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Proof {
    /// Nothing: eyes, or the table of velocities.
    None,
    /// The motors ran and are off before the ending begins.
    Down,
    /// Only eyes can tell: motors that are not off before the ending begins disprove it.
    NotDown,
    /// Every question was answered.
    Answered,
}

/// One part of a check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// The order to take off, once.
    TakeOff,
    /// The order to land, once, with a new sequence number.
    Land,
    /// The order to land alone every 0.5 s for so long, with the same sequence number or new ones. s
    Lands { for_s: f64, has_same_number: bool },
    /// The order to stop the motors, twice: one datagram of fifty is lost.
    Emergency,
    /// The request for a connection, or for SDK mode, once.
    Hello,
    /// The question for the firmware's version, with this sequence number. Binary protocol only.
    Ask(u16),
    /// Sticks (roll, pitch, yaw, throttle) at 20 Hz for so long. s
    Sticks([f64; 4], f64),
    /// Neutral sticks at 20 Hz from us and these from a second socket, for so long. s
    Second([f64; 4], f64),
    /// Nothing is sent for so long. s
    Quiet(f64),
    /// Nothing is sent until the drone says that it flies, at most for so long. s
    Flying(f64),
    /// Nothing is sent until the drone says that its motors are off, at most for so long. s
    Down(f64),
}

impl Display for Step {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::TakeOff => f.write_str("take-off"),
            Self::Land => f.write_str("LAND"),
            Self::Lands { for_s, has_same_number } => {
                let number = if *has_same_number { "one sequence number" } else { "new numbers" };
                write!(f, "LAND every 0.5 s with {number} for {for_s} s")
            }
            Self::Emergency => f.write_str("emergency twice"),
            Self::Hello => f.write_str("request for a connection"),
            Self::Ask(sequence) => write!(f, "version? #{sequence}"),
            Self::Sticks(NEUTRAL, 0.0) => f.write_str("neutral sticks once"),
            Self::Sticks(NEUTRAL, for_s) => write!(f, "neutral sticks {for_s} s"),
            Self::Sticks(u, for_s) => write!(f, "sticks {u:?} {for_s} s"),
            Self::Second(u, for_s) => write!(f, "a second program's sticks {u:?} {for_s} s"),
            Self::Quiet(for_s) => write!(f, "nothing {for_s} s"),
            Self::Flying(most_s) => write!(f, "nothing until it flies, {most_s} s at most"),
            Self::Down(most_s) => write!(f, "nothing until it is down, {most_s} s at most"),
        }
    }
}

/// One check.
#[derive(Debug)]
pub(super) struct Check {
    pub(super) name: &'static str,
    pub(super) place: Place,
    pub(super) assumption: &'static str,
    /// Task of the owner.
    pub(super) todo: &'static str,
    pub(super) steps: &'static [Step],
    pub(super) proof: Proof,
    /// What only eyes can tell; yes is what is expected.
    pub(super) question: Option<&'static str>,
}

impl Check {
    /// Whether it needs sequence numbers, or sends sticks soon after the take-off, for which a drone in the
    /// text SDK breaks the take-off off.
    pub(super) fn is_binary_only(&self) -> bool {
        self.place == Place::Net || self.proof == Proof::Answered
    }
}

const NEUTRAL: [f64; 4] = [0.0; 4];
const ONCE: Step = Step::Sticks(NEUTRAL, 0.0);
const TURN: [f64; 4] = [0.0, 0.0, 0.3, 0.0];

/// Sticks of a table's row.
pub(super) fn sticks([roll, pitch, yaw, throttle]: [f64; 4]) -> Sticks {
    Sticks::new(roll, pitch, yaw, throttle)
}

const fn hover(for_s: f64) -> Step {
    Step::Sticks(NEUTRAL, for_s)
}

const fn still(
    name: &'static str,
    assumption: &'static str,
    todo: &'static str,
    steps: &'static [Step],
) -> Check {
    let (place, proof, question) = (Place::Still, Proof::None, None);
    Check { name, place, assumption, todo, steps, proof, question }
}

const fn net(
    name: &'static str,
    assumption: &'static str,
    steps: &'static [Step],
    proof: Proof,
    question: Option<&'static str>,
) -> Check {
    let todo = "place it in the middle of the net, nose away from you; stay outside";
    Check { name, place: Place::Net, assumption, todo, steps, proof, question }
}

/// All checks, in the order in which they are done.
pub(super) const CHECKS: [Check; 17] = [
    still(
        "status",
        "ten status packets a second; standing, height, velocity and charge are reported",
        "place the drone on the table",
        &[Step::Ask(1), Step::Quiet(5.0)],
    ),
    Check {
        proof: Proof::Answered,
        ..still(
            "sequence",
            "repeated and lower sequence numbers are answered, not dropped",
            "leave the drone on the table",
            &[
                Step::Ask(100),
                Step::Quiet(0.5),
                Step::Ask(100),
                Step::Quiet(0.5),
                Step::Ask(101),
                Step::Quiet(0.5),
                Step::Ask(5),
                Step::Quiet(1.0),
            ],
        )
    },
    still(
        "carry_forward",
        "velocity is reported: forward is + on the first axis, 2 m in all",
        "hold it level, nose forward; after Enter walk 2 m forward within 4 s and stand still",
        &[Step::Quiet(8.0)],
    ),
    still(
        "carry_right",
        "right is + on the second axis, 2 m in all",
        "hold it level, nose forward; after Enter walk 2 m to its right within 4 s and stand still",
        &[Step::Quiet(8.0)],
    ),
    still(
        "carry_up",
        "up is - on the third axis, and height grows by 1 m",
        "hold it level at the hip; after Enter lift it by 1 m within 2 s and hold it there",
        &[Step::Quiet(6.0)],
    ),
    still(
        "carry_turn",
        "the axes of the velocity are those of the world, not of the vehicle: the second axis is +; the heading turns",
        "start as in carry_forward; after Enter turn yourself and it by 90 degrees clockwise within 3 s, \
         then walk 2 m in the direction of its nose within 4 s",
        &[Step::Quiet(12.0)],
    ),
    still(
        "reboot",
        "after a restart the drone is silent until it is asked for a connection",
        "after Enter switch the drone off, count to 5, switch it on, and let the computer join its Wi-Fi; \
         nothing is sent for 60 s",
        &[Step::Quiet(60.0), Step::Hello, Step::Quiet(4.0)],
    ),
    Check {
        name: "emergency",
        place: Place::PropsOff,
        assumption: "`emergency` stops the motors in this protocol",
        todo: "take all four propellers off; place it on the table",
        steps: &[Step::TakeOff, Step::Quiet(2.5), Step::Emergency, Step::Quiet(4.0)],
        proof: Proof::Down,
        question: Some("Did the motors stop 2.5 s after they were started, not 3 s later?"),
    },
    net(
        "flag",
        "the flying flag is right, and at most 1 s late",
        &[Step::TakeOff, Step::Flying(8.0), hover(4.0), ONCE, Step::Land, Step::Down(8.0)],
        Proof::Down,
        Some("Did it land at once, and was it on the floor when the program went on?"),
    ),
    net(
        "stick_step",
        "forward, right and counter-clockwise sticks do what they say; the velocity follows within 0.5 s",
        &[
            Step::TakeOff,
            Step::Flying(8.0),
            hover(4.0),
            Step::Sticks([0.0, 0.3, 0.0, 0.0], 1.5),
            hover(2.5),
            Step::Sticks([0.3, 0.0, 0.0, 0.0], 1.5),
            hover(2.5),
            Step::Sticks(TURN, 1.5),
            hover(1.5),
            ONCE,
            Step::Land,
            Step::Down(8.0),
        ],
        Proof::NotDown,
        Some("Did it go forward, then right, then turn counter-clockwise?"),
    ),
    net(
        "land_early",
        "LAND is ignored for at most 3 s after a take-off",
        &[Step::TakeOff, Step::Quiet(0.5), Step::Lands { for_s: 10.0, has_same_number: false }],
        Proof::Down,
        None,
    ),
    net(
        "land_same_number",
        "a LAND with a number that was sent before is obeyed",
        &[Step::TakeOff, Step::Quiet(0.5), Step::Lands { for_s: 10.0, has_same_number: true }],
        Proof::Down,
        None,
    ),
    net(
        "land_neutral",
        "neutral sticks do not cancel a landing",
        &[
            Step::TakeOff,
            Step::Flying(8.0),
            hover(4.0),
            ONCE,
            Step::Land,
            Step::Quiet(0.5),
            hover(3.0),
            Step::Quiet(2.0),
        ],
        Proof::Down,
        Some("Did it go down without a stop?"),
    ),
    net(
        "land_sticks",
        "a landing drone levels: it does not keep its last sticks",
        &[
            Step::TakeOff,
            Step::Flying(8.0),
            hover(4.0),
            Step::Sticks([0.0, 0.2, 0.0, 0.0], 1.0),
            Step::Land,
            Step::Down(6.0),
        ],
        Proof::NotDown,
        Some("Did it stop moving forward within a second of the beginning of its descent?"),
    ),
    net(
        "conn_req",
        "a request for a connection is harmless in flight and while landing",
        &[
            Step::TakeOff,
            Step::Flying(8.0),
            hover(3.0),
            Step::Hello,
            Step::Quiet(1.0),
            hover(1.0),
            ONCE,
            Step::Land,
            Step::Quiet(0.5),
            Step::Hello,
            Step::Down(8.0),
        ],
        Proof::Down,
        Some("Did it hover without a jump, and land without a stop?"),
    ),
    net(
        "silence",
        "a drone that hears nothing keeps its last sticks (here it turns) and lands after 15 s",
        &[Step::TakeOff, Step::Flying(8.0), hover(3.0), Step::Sticks(TURN, 1.0), Step::Down(35.0)],
        Proof::Down,
        Some("Did it go on turning until it landed by itself?"),
    ),
    net(
        "second_program",
        "a second program's sticks act beside ours",
        &[
            Step::TakeOff,
            Step::Flying(8.0),
            hover(3.0),
            Step::Second(TURN, 3.0),
            hover(1.0),
            ONCE,
            Step::Land,
            Step::Down(8.0),
        ],
        Proof::NotDown,
        Some("Did it turn, smoothly or in jerks?"),
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_only_what_spins_is_ordered_to_take_off() {
        for (i, check) in CHECKS.iter().enumerate() {
            assert!(CHECKS.iter().skip(i + 1).all(|other| other.name != check.name));
            assert_eq!(check.steps.contains(&Step::TakeOff), check.place.spins(), "{}", check.name);
            let turns = |step: &Step| matches!(step, Step::Sticks(u, _) if *u != NEUTRAL);
            assert!(check.place.spins() || !check.steps.iter().any(turns), "{}", check.name);
        }
    }
}
