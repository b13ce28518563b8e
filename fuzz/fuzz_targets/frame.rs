//! Frames of the binary protocol with right checks, which noise never has.

use crc::{Algorithm, Crc};

const CRC_8: Algorithm<u8> = Algorithm { init: 0xEE, ..crc::CRC_8_MAXIM_DOW };
const CRC_16: Algorithm<u16> = Algorithm { init: 0x496C, ..crc::CRC_16_MCRF4XX };

/// The datagram that a fuzzer's bytes stand for: themselves, or the inside of a frame.
pub(crate) fn datagram(bytes: &[u8]) -> Vec<u8> {
    match bytes {
        [first, inside @ ..] if first % 2 == 1 => sealed(inside),
        [_, raw @ ..] => raw.to_vec(),
        [] => Vec::new(),
    }
}

/// Start, length and its check, `inside`, check of all.
fn sealed(inside: &[u8]) -> Vec<u8> {
    let length = u16::try_from(inside.len() + 6).unwrap_or(u16::MAX);
    let [low, high] = length.wrapping_mul(8).to_le_bytes();
    let mut frame = vec![0xCC, low, high];
    frame.push(Crc::<u8>::new(&CRC_8).checksum(&frame));
    frame.extend_from_slice(inside);
    let check = Crc::<u16>::new(&CRC_16).checksum(&frame);
    frame.extend_from_slice(&check.to_le_bytes());
    frame
}
