//! Records of the drone's own log, as the payload of one message.
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
/// Between the four entries of the quaternion: w, x, y, z.
const ENTRY_BYTES: usize = 4;
const TEMPERATURE: usize = 106;

/// Temperature of a drone that has flown a little. 0.01 degrees Celsius
const TEMPERATURE_CDEG: i16 = 6200;

/// By how much the norm of a quaternion may differ from 1. 1
const NORM_ERROR_MAX: f64 = 0.1;

/// Tick of the clock and heading (clockwise from above, rad, -pi..=pi) of the newest record of the inertial
/// measurement unit in a payload; `None` if it has none that is complete.
pub(super) fn imu_heading(payload: &[u8]) -> Option<(u32, f64)> {
    let mut rest = payload.get(1..)?;
    let mut newest = None;
    while let [SEPARATOR, low, high, _, type_low, type_high, tick @ ..] = rest {
        let length = usize::from(u16::from_le_bytes([*low, *high]));
        let Some((record, after)) = rest.split_at_checked(length) else { break };
        let Some(body) = record.get(HEAD_BYTES..length.saturating_sub(CHECK_BYTES)) else { break };
        let Some(tick) = tick.first_chunk() else { break };
        if u16::from_le_bytes([*type_low, *type_high]) == IMU {
            newest = heading(body, tick[0])
                .map(|yaw_rad| (u32::from_le_bytes(*tick), yaw_rad))
                .or(newest);
        }
        rest = after;
    }
    newest
}

/// Heading of the quaternion in the body of a record whose bytes are combined with `key`. rad
fn heading(body: &[u8], key: u8) -> Option<f64> {
    let entry = |place: usize| {
        let bytes: &[u8; ENTRY_BYTES] =
            body.get(QUATERNION_W + place * ENTRY_BYTES..)?.first_chunk()?;
        Some(f64::from(f32::from_le_bytes(bytes.map(|byte| byte ^ key))))
    };
    let [w, x, y, z] = [entry(0)?, entry(1)?, entry(2)?, entry(3)?];
    let norm = (w * w + x * x + y * y + z * z).sqrt();
    // NaN is no norm.
    let is_rotation = (norm - 1.0).abs() <= NORM_ERROR_MAX;
    is_rotation.then(|| (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z))
}

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
