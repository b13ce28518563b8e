use super::super::packet::{self, kind};
use super::super::tests::message;
use super::*;

#[test]
fn the_documented_bytes_are_written() {
    let mut written = Vec::new();
    cookie(&mut written);
    assert_eq!(written, b"vrpn: ver. 07.35  0\0\0\0\0\0");
    // 24 bytes of head and 10 of body, filled up to 16: at 2.5 s, by 7, of type -2, "abcde".
    let expected = b"\0\0\0\x22\0\0\0\x02\0\x07\xa1\x20\0\0\0\x07\xff\xff\xff\xfe\0\0\0\0\
        \0\0\0\x06abcde\0\0\0\0\0\0\0";
    assert_eq!(message(2.5, 7, kind::TYPE, &description("abcde")), expected);
}

#[test]
fn a_pose_is_64_bytes_and_is_read_again() {
    let body = pose(1, [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(body.len(), 64);
    assert_eq!(&body[..16], b"\0\0\0\x01\0\0\0\0\x3f\xf0\0\0\0\0\0\0");
    assert_eq!(packet::pose(&body), Some((1, [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])));
}
