use super::super::tests::{begin, message};
use super::*;
use crate::mocap::vrpn::encode;

/// Messages that `piece` completes behind a cookie and four descriptions, or why it is given up.
fn count_after_begin(piece: &[u8]) -> Result<usize, SourceError> {
    let (mut messages, mut count) = (Messages::default(), 0);
    messages.push(&begin(), |_| Ok(())).unwrap();
    messages.push(piece, |_| {
        count += 1;
        Ok(())
    })?;
    Ok(count)
}

#[test]
fn a_message_is_at_least_its_head_and_at_most_the_buffer_of_vrpn_long() {
    let announce = |length: usize| {
        let length = u32::try_from(length).unwrap();
        count_after_begin(&length.to_be_bytes())
    };
    for length in [HEAD_BYTES, MESSAGE_BYTES_MAX] {
        assert_eq!(announce(length), Ok(0), "{length}");
    }
    for length in [0, HEAD_BYTES - 1, MESSAGE_BYTES_MAX + 1, 1 << 20] {
        assert_eq!(announce(length), Err(SourceError::NoVrpn), "{length}");
    }
}

#[test]
fn a_message_waits_for_the_bytes_that_fill_it_up() {
    // 10 bytes of body, then six that mean nothing.
    let whole = message(2.5, 7, kind::TYPE, &encode::description("abcde"));
    for length in 0..whole.len() {
        assert_eq!(count_after_begin(&whole[..length]), Ok(0), "{length}");
    }
    assert_eq!(count_after_begin(&whole), Ok(1));
}

#[test]
fn every_truncation_of_a_body_is_refused() {
    let (name, at) = (encode::description("abcde"), encode::pose(1, [1.0; 3], [0.5; 4]));
    for length in 0..name.len() {
        assert_eq!(description(&name[..length]), None, "{length}");
    }
    for length in 0..at.len() {
        assert_eq!(pose(&at[..length]), None, "{length}");
    }
    assert_eq!(description(&name), Some(&b"abcde"[..]));
}
