//! The one font of the figures: `DejaVu` Sans, part of the program.
//!
//! Owns letter shapes and widths, so that a machine without fonts paints and arranges like any
//! other.

use ttf_parser::{Face, GlyphId};

/// Width of a letter that the font does not have, relative to its height.
const UNKNOWN_ADVANCE: f64 = 0.6;

/// The bundled font; `None` only if the bytes that were compiled in are damaged.
pub(super) fn face() -> Option<Face<'static>> {
    Face::parse(dejavu::sans::regular(), 0).ok()
}

/// The letters of `text` and where each begins, relative to a letter height of 1.
pub(super) fn glyphs(face: &Face<'_>, text: &str) -> Vec<(Option<GlyphId>, f64)> {
    let mut at = 0.0;
    let place = |c| {
        let glyph = face.glyph_index(c);
        let begin = at;
        at += advance(face, c);
        (glyph, begin)
    };
    text.chars().map(place).collect()
}

/// Width of `text` in letters of height `size_px`. px
pub(super) fn width_px(text: &str, size_px: f64) -> f64 {
    let face = face();
    let widths = text.chars().map(|c| face.as_ref().map_or(UNKNOWN_ADVANCE, |f| advance(f, c)));
    size_px * widths.sum::<f64>()
}

/// `text`, its end replaced by dots if it is wider than `room_px`.
pub(super) fn shortened(text: &str, size_px: f64, room_px: f64) -> String {
    if width_px(text, size_px) <= room_px {
        return text.to_owned();
    }
    let mut kept = text.to_owned();
    while kept.pop().is_some() && width_px(&kept, size_px) + width_px("...", size_px) > room_px {}
    kept + "..."
}

fn advance(face: &Face<'_>, c: char) -> f64 {
    let advance = face.glyph_index(c).and_then(|glyph| face.glyph_hor_advance(glyph));
    advance.map_or(UNKNOWN_ADVANCE, |units| f64::from(units) / f64::from(face.units_per_em()))
}

#[cfg(test)]
mod tests;
