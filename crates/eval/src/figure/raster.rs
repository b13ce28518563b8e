//! A figure as PNG: every element painted with the bundled font.
//!
//! Owns the conversion of elements to `tiny-skia`. It reads no font of the machine.

use thiserror::Error;
use tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, StrokeDash, Transform,
};
use ttf_parser::{Face, OutlineBuilder};

use super::drawing::{Anchor, Color, Element, Figure, Point, Stroke, Text, WIDTH_PX};
use super::font;

/// Pixels of the PNG per pixel of the drawing: sharp on paper and on dense screens.
pub(super) const SCALE: f32 = 2.0;

/// Why a figure has no PNG.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PngError {
    /// The font compiled into the program is damaged.
    #[error("the bundled font cannot be read")]
    Font,
    /// More pixels than memory can be asked for.
    #[error("{width} x {height} pixels are too many to paint")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The encoder refused.
    #[error("PNG encoder: {0}")]
    Encoder(String),
}

impl Figure {
    /// The figure as a PNG file of 1600 pixels width, two for each pixel of the SVG.
    ///
    /// # Errors
    ///
    /// See [`PngError`]; none is expected of a figure of this module.
    pub fn png(&self) -> Result<Vec<u8>, PngError> {
        let face = font::face().ok_or(PngError::Font)?;
        let (width, height) = (pixels(WIDTH_PX), pixels(self.height_px));
        let mut pixmap = Pixmap::new(width, height).ok_or(PngError::Size { width, height })?;
        pixmap.fill(tiny_skia::Color::WHITE);
        for element in &self.elements {
            match element {
                Element::Lines(runs, stroke) => paint_lines(&mut pixmap, runs, *stroke),
                Element::Area(corners, fill) => paint_area(&mut pixmap, corners, *fill),
                Element::Dots(at, radius_px, fill) => {
                    paint_dots(&mut pixmap, at, *radius_px, *fill);
                }
                Element::Text(text) => paint_text(&mut pixmap, &face, text),
            }
        }
        pixmap.encode_png().map_err(|error| PngError::Encoder(error.to_string()))
    }
}

fn paint_lines(pixmap: &mut Pixmap, runs: &[Vec<Point>], stroke: Stroke) {
    let mut builder = PathBuilder::new();
    for run in runs {
        push_polyline(&mut builder, run);
    }
    let dash = single(stroke.dash_px);
    let look = tiny_skia::Stroke {
        width: single(stroke.width_px),
        line_cap: LineCap::Butt,
        line_join: LineJoin::Round,
        dash: StrokeDash::new(vec![dash, dash], 0.0),
        ..tiny_skia::Stroke::default()
    };
    if let Some(path) = builder.finish() {
        pixmap.stroke_path(&path, &paint(stroke.color), &look, scaled(), None);
    }
}

fn paint_area(pixmap: &mut Pixmap, corners: &[Point], fill: Color) {
    let mut builder = PathBuilder::new();
    push_polyline(&mut builder, corners);
    builder.close();
    fill_path(pixmap, builder.finish(), fill, scaled());
}

fn paint_dots(pixmap: &mut Pixmap, at: &[Point], radius_px: f64, fill: Color) {
    let mut builder = PathBuilder::new();
    for &(x, y) in at {
        builder.push_circle(single(x), single(y), single(radius_px));
    }
    fill_path(pixmap, builder.finish(), fill, scaled());
}

fn paint_text(pixmap: &mut Pixmap, face: &Face<'_>, text: &Text) {
    let shift = match text.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => -0.5,
        Anchor::End => -1.0,
    };
    let begin_px = shift * font::width_px(&text.content, text.size_px);
    let units = f64::from(face.units_per_em());
    let mut outline = Outline { builder: PathBuilder::new(), x: 0.0 };
    for (glyph, at) in font::glyphs(face, &text.content) {
        outline.x = single(at * units);
        // A space has no outline, a missing letter stays blank.
        glyph.and_then(|glyph| face.outline_glyph(glyph, &mut outline));
    }
    let (x, y) = text.at;
    let size = single(text.size_px / units);
    let turn = if text.is_vertical { -90.0 } else { 0.0 };
    let place = scaled()
        .pre_translate(single(x), single(y))
        .pre_rotate(turn)
        .pre_translate(single(begin_px), 0.0)
        .pre_scale(size, -size);
    fill_path(pixmap, outline.builder.finish(), text.color, place);
}

fn fill_path(pixmap: &mut Pixmap, path: Option<Path>, color: Color, place: Transform) {
    if let Some(path) = path {
        pixmap.fill_path(&path, &paint(color), FillRule::Winding, place, None);
    }
}

fn push_polyline(builder: &mut PathBuilder, points: &[Point]) {
    for (i, &(x, y)) in points.iter().enumerate() {
        let (x, y) = (single(x), single(y));
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
}

fn paint(color: Color) -> Paint<'static> {
    let mut paint = Paint::default();
    let Color { red, green, blue, opacity } = color;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=255")]
    let alpha = (opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    paint.set_color_rgba8(red, green, blue, alpha);
    paint
}

fn scaled() -> Transform {
    Transform::from_scale(SCALE, SCALE)
}

#[expect(clippy::cast_possible_truncation, reason = "a tenth of a pixel is all that is seen")]
fn single(value: f64) -> f32 {
    value as f32
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "sizes of figures, > 0"
)]
fn pixels(length_px: f64) -> u32 {
    (length_px * f64::from(SCALE)).ceil() as u32
}

/// Collects letters into one path, each moved right by `x` font units.
struct Outline {
    builder: PathBuilder,
    x: f32,
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.builder.move_to(self.x + x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.builder.line_to(self.x + x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.builder.quad_to(self.x + x1, y1, self.x + x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.builder.cubic_to(self.x + x1, y1, self.x + x2, y2, self.x + x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests;
