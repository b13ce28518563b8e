//! Times on which sender, supervisor and guardian agree.
//!
//! Owns how long a silence, an order or a report counts. What each of them does then is decided where it is used.

use crate::time::SpanNs;

/// Silence of the control thread after which the sender sends neutral sticks in place of the approved
/// ones.
pub const CONTROL_SILENCE_NEUTRAL: SpanNs = SpanNs::from_ms(100);

/// LAND is repeated this often, as is the supervisor's order to stop the motors: one of fifty datagrams is lost, and a
/// drone that takes off ignores the first ones.
pub const LAND_PERIOD: SpanNs = SpanNs::from_ms(500);

/// Time for which one source, motion capture or the drone, has to report without a break that the drone is
/// down where the other reports nothing: LAND is repeated meanwhile, since a drone may
/// refuse it for seconds. Longer than 15 s is of no use: a drone that receives nothing lands by itself then.
pub const ALONE_HOLD: SpanNs = SpanNs::from_ms(10_000);

/// A Tello ignores `land` for so long after the order to take off, and may not report to fly yet: until then "not
/// flying" does not mean landed.
pub const TAKE_OFF_TAIL: SpanNs = SpanNs::from_ms(4000);

/// An order to take off that has shown no effect may still have one for so long: the way to a drone may carry it
/// seconds late, and a drone may start its motors late. Until then "not flying" does not mean landed.
pub const TAKE_OFF_UNSEEN: SpanNs = SpanNs::from_ms(8000);

/// Age beyond which a status no longer counts. Statuses come ten times a second; gaps of up to 0.6 s are assumed
/// (docs/bench-test.md).
pub const STATUS_FRESH: SpanNs = SpanNs::from_ms(2000);

/// The text SDK's count of seconds with motors on stands still for so long if they are off.
pub const MOTORS_REST: SpanNs = SpanNs::from_ms(3000);
