use super::super::tests::{BODY_3_0, FRAME_3_0, frame};

#[test]
fn the_documented_frame_is_written_byte_by_byte() {
    assert_eq!(frame((3, 0), 1000, &[BODY_3_0]), FRAME_3_0);
}
