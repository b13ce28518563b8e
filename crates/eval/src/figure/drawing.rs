//! A figure as a list of shapes and texts, and its SVG text.
//!
//! Owns the elements, the colours and the SVG syntax. What they mean is the panels' business.
//! Coordinates are pixels from the top left corner, y down.

use std::fmt;

use super::overlay::Overlay;

/// Width of every figure. px
pub(super) const WIDTH_PX: f64 = 800.0;

/// Height of the letters of titles, names and tick labels. px
pub(super) const TITLE_PX: f64 = 14.0;
pub(super) const NAME_PX: f64 = 12.0;
pub(super) const TICK_PX: f64 = 11.0;

/// The colours that Okabe and Ito chose to be distinguished by every eye, and greys.
pub(super) const BLUE: Color = Color::opaque(0x00, 0x72, 0xb2);
pub(super) const ORANGE: Color = Color::opaque(0xe6, 0x9f, 0x00);
pub(super) const GREEN: Color = Color::opaque(0x00, 0x9e, 0x73);
pub(super) const VERMILION: Color = Color::opaque(0xd5, 0x5e, 0x00);
pub(super) const PURPLE: Color = Color::opaque(0xcc, 0x79, 0xa7);
pub(super) const SKY: Color = Color::opaque(0x56, 0xb4, 0xe9);
pub(super) const BLACK: Color = Color::opaque(0x1a, 0x1a, 0x1a);
pub(super) const GREY: Color = Color::opaque(0x70, 0x70, 0x70);
pub(super) const PALE: Color = Color::opaque(0xe2, 0xe2, 0xe2);

/// A place on the figure, (x, y). px
pub(super) type Point = (f64, f64);

/// Red, green, blue, and opacity in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Color {
    /// 0..=255
    pub red: u8,
    /// 0..=255
    pub green: u8,
    /// 0..=255
    pub blue: u8,
    /// 0..=1
    pub opacity: f32,
}

impl Color {
    const fn opaque(red: u8, green: u8, blue: u8) -> Self {
        Self { red, green, blue, opacity: 1.0 }
    }

    /// This colour with an opacity.
    pub(super) const fn faded(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stroke {
    pub color: Color,
    pub width_px: f64,
    /// Length of dashes and gaps, 0 for a solid line. px
    pub dash_px: f64,
}

impl Stroke {
    /// A solid line.
    pub(super) const fn solid(color: Color, width_px: f64) -> Self {
        Self { color, width_px, dash_px: 0.0 }
    }

    /// A dashed line.
    pub(super) const fn dashed(color: Color, width_px: f64, dash_px: f64) -> Self {
        Self { color, width_px, dash_px }
    }
}

/// Which point of a text lies where it is put.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// One line of text on its base line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Text {
    pub content: String,
    pub at: Point,
    pub size_px: f64,
    pub anchor: Anchor,
    /// Read from the bottom to the top.
    pub is_vertical: bool,
    pub color: Color,
}

/// Elements of a figure, in the order of painting.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Element {
    /// Polylines of one look.
    Lines(Vec<Vec<Point>>, Stroke),
    /// A filled polygon.
    Area(Vec<Point>, Color),
    /// Filled circles of one radius in px.
    Dots(Vec<Point>, f64, Color),
    /// Letters.
    Text(Text),
}

/// A finished picture, 800 px wide, on white.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub(super) height_px: f64,
    pub(super) title: String,
    pub(super) elements: Vec<Element>,
    /// For the page around it; not part of the SVG.
    pub(super) overlay: Option<Overlay>,
}

impl Figure {
    /// The figure as an SVG document of its own.
    ///
    /// Letters are SVG text: a viewer without `DejaVu` Sans takes its nearest sans serif.
    pub fn svg(&self) -> String {
        self.to_string()
    }

    /// Data for a page that makes the figure interactive; `None` for figures without times.
    pub fn overlay(&self) -> Option<&Overlay> {
        self.overlay.as_ref().filter(|overlay| overlay.has_times())
    }

    /// The map with the times of its only track, a place for each. s, m
    #[must_use]
    pub(crate) fn with_times(mut self, time_s: &[f64], track: &[(f64, f64)]) -> Self {
        if let Some(overlay) = &mut self.overlay {
            overlay.set_track(time_s, track);
        }
        self
    }

    /// Adds lines; nothing without any.
    pub(super) fn lines(&mut self, runs: Vec<Vec<Point>>, stroke: Stroke) {
        if !runs.is_empty() {
            self.elements.push(Element::Lines(runs, stroke));
        }
    }

    /// Adds one straight line.
    pub(super) fn line(&mut self, from: Point, to: Point, stroke: Stroke) {
        self.lines(vec![vec![from, to]], stroke);
    }

    /// Adds a filled polygon; nothing without corners.
    pub(super) fn area(&mut self, corners: Vec<Point>, fill: Color) {
        if !corners.is_empty() {
            self.elements.push(Element::Area(corners, fill));
        }
    }

    /// Adds a filled rectangle between two opposite corners.
    pub(super) fn rectangle(&mut self, (x0, y0): Point, (x1, y1): Point, fill: Color) {
        self.area(vec![(x0, y0), (x1, y0), (x1, y1), (x0, y1)], fill);
    }

    /// Adds circles; nothing without any.
    pub(super) fn dots(&mut self, at: Vec<Point>, radius_px: f64, fill: Color) {
        if !at.is_empty() {
            self.elements.push(Element::Dots(at, radius_px, fill));
        }
    }

    /// Adds a horizontal text.
    pub(super) fn text(&mut self, content: &str, at: Point, size_px: f64, anchor: Anchor) {
        let content = content.to_owned();
        let text = Text { content, at, size_px, anchor, is_vertical: false, color: BLACK };
        self.elements.push(Element::Text(text));
    }

    /// Adds a text that reads from the bottom to the top, centred at `at`.
    pub(super) fn vertical_text(&mut self, content: &str, at: Point) {
        self.elements.push(Element::Text(Text {
            content: content.to_owned(),
            at,
            size_px: NAME_PX,
            anchor: Anchor::Middle,
            is_vertical: true,
            color: BLACK,
        }));
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (width, height) = (Px(WIDTH_PX), Px(self.height_px));
        write!(
            f,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, sans-serif\">\n\
             <title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n",
            Escaped(&self.title)
        )?;
        self.elements.iter().try_for_each(|element| writeln!(f, "{element}"))?;
        f.write_str("</svg>\n")
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lines(runs, Stroke { color, width_px, dash_px }) => {
                f.write_str("<path d=\"")?;
                runs.iter().try_for_each(|run| polyline(f, run))?;
                write!(
                    f,
                    "\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{}\" \
                     stroke-linejoin=\"round\" stroke-linecap=\"butt\"",
                    Px(*width_px)
                )?;
                if *dash_px > 0.0 {
                    write!(f, " stroke-dasharray=\"{0} {0}\"", Px(*dash_px))?;
                }
                opacity(f, "stroke", *color)
            }
            Self::Area(corners, fill) => {
                f.write_str("<path d=\"")?;
                polyline(f, corners)?;
                write!(f, "Z\" fill=\"{fill}\"")?;
                opacity(f, "fill", *fill)
            }
            // A line of no length with round ends: the shortest form of a circle.
            Self::Dots(at, radius_px, fill) => {
                f.write_str("<path d=\"")?;
                at.iter().try_for_each(|&(x, y)| write!(f, "M{} {}h0", Px(x), Px(y)))?;
                write!(
                    f,
                    "\" fill=\"none\" stroke=\"{fill}\" stroke-width=\"{}\" \
                     stroke-linecap=\"round\"",
                    Px(2.0 * radius_px)
                )?;
                opacity(f, "stroke", *fill)
            }
            Self::Text(Text { content, at: (x, y), size_px, anchor, is_vertical, color }) => {
                let anchor = match anchor {
                    Anchor::Start => "start",
                    Anchor::Middle => "middle",
                    Anchor::End => "end",
                };
                let (x, y, size) = (Px(*x), Px(*y), Px(*size_px));
                write!(f, "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" fill=\"{color}\"")?;
                write!(f, " text-anchor=\"{anchor}\"")?;
                if *is_vertical {
                    write!(f, " transform=\"rotate(-90 {x} {y})\"")?;
                }
                write!(f, ">{}</text>", Escaped(content))
            }
        }
    }
}

/// The end of an element, with the opacity of its `kind` of paint.
fn opacity(f: &mut fmt::Formatter<'_>, kind: &str, color: Color) -> fmt::Result {
    if color.opacity < 1.0 {
        write!(f, " {kind}-opacity=\"{}\"", color.opacity)?;
    }
    f.write_str("/>")
}

fn polyline(f: &mut fmt::Formatter<'_>, points: &[Point]) -> fmt::Result {
    points.iter().enumerate().try_for_each(|(i, &(x, y))| {
        let command = ["M", "L", " "][i.min(2)];
        write!(f, "{command}{} {}", Px(x), Px(y))
    })
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.red, self.green, self.blue)
    }
}

/// A length rounded to a tenth of a pixel.
struct Px(f64);

impl fmt::Display for Px {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.1}", self.0);
        f.write_str(text.strip_suffix(".0").unwrap_or(&text))
    }
}

/// Text as it may stand in an XML document: mark-up escaped, forbidden characters replaced.
struct Escaped<'a>(&'a str);

impl fmt::Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|c| match c {
            '&' => f.write_str("&amp;"),
            '<' => f.write_str("&lt;"),
            '>' => f.write_str("&gt;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => f.write_str("?"),
            c => write!(f, "{c}"),
        })
    }
}

#[cfg(test)]
mod tests;
