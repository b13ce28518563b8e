use std::ops::Range;

use super::super::tests::{figures, flight};
use super::*;

#[test]
fn png_has_twice_the_pixels_and_shows_letters_and_data() {
    for (name, figure) in figures(&flight()) {
        let pixmap = Pixmap::decode_png(&figure.png().unwrap()).unwrap();
        let size = format!("{} x {}", pixmap.width(), pixmap.height());
        let scale = f64::from(SCALE);
        assert_eq!(size, format!("{} x {}", scale * WIDTH_PX, (scale * figure.height_px).ceil()));
        let is_dark = |rows: Range<u32>| {
            let pixels = rows.flat_map(|y| (0..pixmap.width()).map(move |x| (x, y)));
            let dark = pixels.filter_map(|(x, y)| pixmap.pixel(x, y)).filter(|p| p.red() < 100);
            dark.count()
        };
        // The title stands alone in the first 26 pixels of the drawing.
        let title = is_dark(0..52);
        assert!((100..5_000).contains(&title), "{name}: {title} dark pixels in the title");
        let rest = is_dark(52..pixmap.height());
        assert!(rest > 3_000, "{name}: {rest} dark pixels below the title");
    }
}

/// The figure's pixels.
fn painted(figure: &Figure) -> Pixmap {
    Pixmap::decode_png(&figure.png().unwrap()).unwrap()
}

/// Red, green and blue of the pixel of the PNG at a place of the drawing.
fn color(pixmap: &Pixmap, (x, y): (u32, u32)) -> [u8; 3] {
    let pixel = pixmap.pixel(2 * x, 2 * y).unwrap();
    [pixel.red(), pixel.green(), pixel.blue()]
}

#[test]
fn a_half_seen_area_is_its_colour_half_way_to_white() {
    let mut figure = Figure::begin("", &[]);
    figure.height_px = 100.0;
    let black = Color { red: 0, green: 0, blue: 0, opacity: 1.0 };
    figure.rectangle((100.0, 40.0), (200.0, 80.0), black);
    figure.rectangle((300.0, 40.0), (400.0, 80.0), black.faded(0.5));
    let pixmap = painted(&figure);
    assert_eq!(color(&pixmap, (150, 60)), [0; 3]);
    // 255 less 128 of 255, which is the opacity in eight bits.
    assert_eq!(color(&pixmap, (350, 60)), [127; 3]);
    assert_eq!(color(&pixmap, (250, 60)), [255; 3]);
    assert_eq!(color(&pixmap, (150, 90)), [255; 3]);
}

#[test]
fn a_text_lies_before_around_or_behind_its_place() {
    for (anchor, is_left, is_right) in
        [(Anchor::Start, false, true), (Anchor::Middle, true, true), (Anchor::End, true, false)]
    {
        let mut figure = Figure::begin("", &[]);
        figure.height_px = 100.0;
        figure.text("HHHH", (400.0, 60.0), 14.0, anchor);
        let pixmap = painted(&figure);
        let is_dark = |columns: Range<u32>| {
            let mut places = columns.flat_map(|x| (50..60).map(move |y| (x, y)));
            places.any(|place| color(&pixmap, place)[0] < 100)
        };
        assert_eq!((is_dark(300..400), is_dark(401..500)), (is_left, is_right), "{anchor:?}");
    }
}

#[test]
fn a_figure_without_height_has_no_png() {
    let mut figure = Figure::begin("", &[]);
    figure.height_px = 0.0;
    assert_eq!(figure.png(), Err(PngError::Size { width: 1600, height: 0 }));
}
