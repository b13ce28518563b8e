//! A record of the drone's own log, as the payload of one message.
//!
//! Envelope: 0x55, length of the record, check of these, type, tick; body; check of all. Each byte of the body is
//! combined with the low byte of the tick (exclusive or). Clients look at separator, length and type; the check
//! values are not known, and 0 here. Layout: `docs/protocol.md`.

/// First byte of a record.
const SEPARATOR: u8 = 0x55;
/// Type of the record of the inertial measurement unit.
const IMU: u16 = 2048;
/// Bytes before the body of a record, and after it.
const HEAD_BYTES: usize = 10;
const CHECK_BYTES: usize = 2;
/// Bytes of the body: the last field that clients read ends at 108.
const BODY_BYTES: usize = 120;
const RECORD_BYTES: usize = HEAD_BYTES + BODY_BYTES + CHECK_BYTES;
/// A byte that clients skip, then the record.
const PAYLOAD_BYTES: usize = 1 + RECORD_BYTES;

/// Offsets in the body.
const ACCELERATION_Z: usize = 28;
const QUATERNION_W: usize = 48;
const QUATERNION_Z: usize = 60;
const TEMPERATURE: usize = 106;

/// Temperature of a drone that has flown a little. 0.01 degrees Celsius
const TEMPERATURE_CDEG: i16 = 6200;

/// A record of the inertial measurement unit, level, with the heading `yaw_rad` (clockwise from above).
pub(super) fn imu_payload(tick: u32, yaw_rad: f64) -> [u8; PAYLOAD_BYTES] {
    let mut body = [0; BODY_BYTES];
    let mut put = |offset: usize, bytes: &[u8]| {
        for (to, from) in body.iter_mut().skip(offset).zip(bytes) {
            *to = *from;
        }
    };
    #[expect(clippy::cast_possible_truncation, reason = "single precision on the wire")]
    let [sin, cos] = [(0.5 * yaw_rad).sin() as f32, (0.5 * yaw_rad).cos() as f32];
    put(ACCELERATION_Z, &(-1.0_f32).to_le_bytes());
    put(QUATERNION_W, &cos.to_le_bytes());
    put(QUATERNION_Z, &sin.to_le_bytes());
    put(TEMPERATURE, &TEMPERATURE_CDEG.to_le_bytes());
    let tick = tick.to_le_bytes();
    #[expect(clippy::cast_possible_truncation, reason = "a constant of three digits")]
    let [low, high] = const { (RECORD_BYTES as u16).to_le_bytes() };
    let [type_low, type_high] = IMU.to_le_bytes();
    let head = [0, SEPARATOR, low, high, 0, type_low, type_high].into_iter().chain(tick);
    let coded = body.into_iter().map(|byte| byte ^ tick[0]);
    let mut payload = [0; PAYLOAD_BYTES];
    for (to, from) in payload.iter_mut().zip(head.chain(coded)) {
        *to = from;
    }
    payload
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
