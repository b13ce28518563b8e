//! The top of a figure: its title and what its marks mean, above all data.

use super::drawing::{Anchor, Color, Figure, NAME_PX, Stroke, TITLE_PX, WIDTH_PX};
use super::font;

/// Left and right border of title and legend. px
const BORDER_PX: f64 = 16.0;

/// Width of a mark and its distance to its name and to the next mark. px
const MARK_PX: f64 = 22.0;
const MARK_GAP_PX: f64 = 6.0;
const ENTRY_GAP_PX: f64 = 20.0;

/// Height of a line of the legend. px
const LINE_PX: f64 = 18.0;

/// How something looks in the legend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mark {
    Line(Stroke),
    /// Circles of a radius in px.
    Dots(f64, Color),
    Patch(Color),
}

impl Figure {
    /// A figure with a title and a legend and no panel yet.
    pub(super) fn begin(title: &str, legend: &[(Mark, &str)]) -> Self {
        let mut figure =
            Self { height_px: 26.0, title: title.to_owned(), elements: Vec::new(), overlay: None };
        let room_px = WIDTH_PX - 2.0 * BORDER_PX;
        figure.fitted_text(title, (BORDER_PX, 21.0), TITLE_PX, room_px);
        let mut x = BORDER_PX;
        let mut middle = figure.height_px + 0.5 * LINE_PX;
        for (mark, name) in legend {
            let width = MARK_PX + MARK_GAP_PX + font::width_px(name, NAME_PX);
            if x > BORDER_PX && x + width > WIDTH_PX - BORDER_PX {
                x = BORDER_PX;
                middle += LINE_PX;
            }
            figure.mark(*mark, x, middle);
            let at = (x + MARK_PX + MARK_GAP_PX, middle + 4.0);
            figure.fitted_text(name, at, NAME_PX, room_px - MARK_PX - MARK_GAP_PX);
            x += width + ENTRY_GAP_PX;
        }
        if !legend.is_empty() {
            figure.height_px = middle + 0.5 * LINE_PX;
        }
        figure
    }

    /// Leaves a border below the last panel.
    pub(super) fn end(mut self) -> Self {
        self.height_px += 8.0;
        self
    }

    /// Adds a text that begins at `at` and is cut to `room_px`.
    pub(super) fn fitted_text(&mut self, text: &str, at: (f64, f64), size_px: f64, room_px: f64) {
        self.text(&font::shortened(text, size_px, room_px), at, size_px, Anchor::Start);
    }

    fn mark(&mut self, mark: Mark, left: f64, middle: f64) {
        let right = left + MARK_PX;
        match mark {
            Mark::Line(stroke) => self.line((left, middle), (right, middle), stroke),
            Mark::Dots(radius_px, fill) => {
                let at = [0.2, 0.5, 0.8].map(|fraction| (left + fraction * MARK_PX, middle));
                self.dots(at.to_vec(), radius_px, fill);
            }
            Mark::Patch(fill) => {
                self.rectangle((left, middle - 5.0), (right, middle + 5.0), fill);
            }
        }
    }
}

#[cfg(test)]
mod tests;
