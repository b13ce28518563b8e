use super::*;

#[test]
fn a_text_is_as_wide_as_its_letters_and_grows_with_their_size() {
    let [a, b, ab] = ["W", "i", "Wi"].map(|text| width_px(text, 10.0));
    assert!(a > 2.0 * b && b > 0.0, "{a} {b}");
    let (double, empty) = (width_px("Wi", 20.0), width_px("", 10.0));
    assert_eq!((ab, double, empty), (a + b, 2.0 * ab, 0.0));
}

#[test]
fn a_letter_that_the_font_lacks_leaves_its_room() {
    let missing = '\u{4e00}';
    let face = face().unwrap();
    let glyphs = glyphs(&face, &format!("{missing}i"));
    assert_eq!(glyphs[0], (None, 0.0));
    assert_eq!((glyphs[1].0.is_some(), glyphs[1].1), (true, UNKNOWN_ADVANCE));
    let width_px = width_px(&missing.to_string(), 10.0);
    assert_eq!(Some(width_px), Some(10.0 * UNKNOWN_ADVANCE));
}

#[test]
fn a_text_is_cut_only_where_it_has_to_be() {
    let text = "abcdefghij";
    let room_px = width_px(text, 12.0);
    assert_eq!(shortened(text, 12.0, room_px), text);
    let cut = shortened(text, 12.0, room_px - 0.1);
    let kept = cut.strip_suffix("...").unwrap();
    assert!(text.starts_with(kept), "{cut}");
    assert!(width_px(&cut, 12.0) < room_px, "{cut}");
    // A letter more had no room.
    let more = format!("{}...", &text[..=kept.len()]);
    assert!(width_px(&more, 12.0) > room_px - 0.1, "{more}");
    assert_eq!(shortened(text, 12.0, 0.0), "...");
}
