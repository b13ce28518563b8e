use super::super::drawing::{BLUE, Element};
use super::*;

const LINE: Stroke = Stroke::solid(BLUE, 1.0);

/// A panel whose x goes from 0 to 10 over 100 px, and whose y from 0 to 1 over 50 px.
fn panel() -> Panel {
    let area = Area { left: 100.0, top: 20.0, right: 200.0, bottom: 70.0 };
    Panel::bare(area, Axis { low: 0.0, high: 10.0 }, Axis { low: 0.0, high: 1.0 })
}

/// Elements that `draw` adds to an empty figure.
fn drawn(draw: impl FnOnce(&Panel, &mut Figure)) -> Vec<Element> {
    let mut figure = Figure::begin("", &[]);
    let before = figure.elements.len();
    draw(&panel(), &mut figure);
    figure.elements.split_off(before)
}

fn texts(figure: &Figure) -> Vec<String> {
    let text = |element: &Element| match element {
        Element::Text(text) => Some(text.content.clone()),
        _ => None,
    };
    figure.elements.iter().filter_map(text).collect()
}

#[test]
fn the_origin_of_the_data_is_bottom_left() {
    for (data, place) in [
        ((0.0, 0.0), (100.0, 70.0)),
        ((10.0, 1.0), (200.0, 20.0)),
        ((5.0, 0.25), (150.0, 57.5)),
        ((-1.0, 2.0), (90.0, -30.0)),
    ] {
        assert_eq!(panel().at(data), place);
    }
}

#[test]
fn a_line_is_broken_where_a_point_is_absent_and_needs_two_points() {
    let nan = f64::NAN;
    let points =
        [(0.0, 0.0), (2.0, 1.0), (nan, 0.5), (4.0, 0.5), (5.0, nan), (6.0, 0.0), (8.0, 0.0)];
    let runs = vec![vec![(100.0, 70.0), (120.0, 20.0)], vec![(160.0, 70.0), (180.0, 70.0)]];
    let lines = drawn(|panel, figure| panel.line(figure, &points, LINE));
    assert_eq!(lines, [Element::Lines(runs, LINE)]);
    assert_eq!(drawn(|panel, figure| panel.line(figure, &[(1.0, nan); 3], LINE)), []);
    let dots = drawn(|panel, figure| panel.dots(figure, &points[1..4], 2.0, BLUE));
    assert_eq!(dots, [Element::Dots(vec![(120.0, 20.0), (140.0, 45.0)], 2.0, BLUE)]);
}

#[test]
fn spans_are_cut_to_the_axis() {
    let spans = [(-5.0, 1.0), (4.0, 6.0), (9.0, 20.0), (11.0, 12.0), (-2.0, 0.0), (3.0, 3.0)];
    let areas = drawn(|panel, figure| panel.spans(figure, &spans, (0.0, 0.5), BLUE));
    let corners = areas.iter().map(|element| match element {
        Element::Area(corners, _) => (corners[0], corners[2]),
        other => panic!("{other:?}"),
    });
    assert_eq!(
        corners.collect::<Vec<_>>(),
        [
            ((100.0, 70.0), (110.0, 45.0)),
            ((140.0, 70.0), (160.0, 45.0)),
            ((190.0, 70.0), (200.0, 45.0)),
        ]
    );
}

#[test]
fn a_shade_ends_at_the_axis_and_is_absent_for_nan() {
    let shade = |low, high| {
        let areas = drawn(|panel, figure| panel.shade(figure, low, high, BLUE));
        match areas.as_slice() {
            [] => None,
            [Element::Area(corners, _)] => Some((corners[0].0, corners[2].0)),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(shade(2.0, 4.0), Some((120.0, 140.0)));
    assert_eq!(shade(f64::NEG_INFINITY, 4.0), Some((100.0, 140.0)));
    assert_eq!(shade(4.0, f64::INFINITY), Some((140.0, 200.0)));
    for (low, high) in [(f64::NAN, 4.0), (4.0, f64::NAN), (4.0, 4.0), (11.0, 12.0), (-2.0, -1.0)] {
        assert_eq!(shade(low, high), None, "{low} to {high}");
    }
}

#[test]
fn lines_across_are_drawn_at_the_ends_of_the_axis_and_not_beyond() {
    for (x, count) in [(0.0, 1), (10.0, 1), (10.1, 0), (-0.1, 0), (f64::NAN, 0)] {
        let lines = drawn(|panel, figure| panel.vertical(figure, x, LINE));
        assert_eq!(lines.len(), count, "x = {x}");
    }
    for (y, count) in [(0.0, 1), (1.0, 1), (1.1, 0), (f64::NAN, 0)] {
        let lines = drawn(|panel, figure| panel.horizontal(figure, y, LINE));
        assert_eq!(lines.len(), count, "y = {y}");
    }
}

#[test]
fn panels_side_by_side_fill_the_width_and_make_the_figure_higher() {
    for columns in [1, 2, 4] {
        let mut figure = Figure::begin("", &[]);
        let (top, below) = (figure.height_px, Below::Quantity("t [s]"));
        let strip = Strip { columns, height_px: 100.0, heading_lines: 2, below };
        let areas: Vec<_> = strip.place(&mut figure).collect();
        let height_px = top + ABOVE_PX + 2.0 * HEADING_PX + 100.0 + NAMED_PX;
        assert_eq!((areas.len(), figure.height_px), (columns, height_px));
        assert_eq!((areas[0].left, areas[columns - 1].right), (LEFT_PX, WIDTH_PX - RIGHT_PX));
        for area in areas {
            // Sums of columns are rounded.
            assert_eq!((area.top, area.bottom), (top + 42.0, top + 142.0));
            assert!((area.right - area.left - width_px(columns)).abs() < 1e-9, "{area:?}");
        }
    }
}

#[test]
fn numbers_stand_below_only_where_they_are_asked_for() {
    let axis = Some(Axis { low: 0.0, high: 10.0 });
    let open = |axes, below| {
        let mut figure = Figure::begin("title", &[]);
        let area = Area { left: 100.0, top: 20.0, right: 500.0, bottom: 70.0 };
        let panel = Panel::open(&mut figure, area, axes, below, (&[], "y [m]"));
        (panel.is_some(), texts(&figure))
    };
    let has = |texts: &[String], text: &str| texts.iter().any(|other| other == text);
    let count = |texts: &[String], text: &str| texts.iter().filter(|other| *other == text).count();
    let (is_open, none) = open((axis, axis), Below::Nothing);
    assert!(is_open && has(&none, "y [m]") && count(&none, "10") == 1, "{none:?}");
    let (_, numbered) = open((axis, axis), Below::Quantity("t [s]"));
    assert!(has(&numbered, "t [s]") && count(&numbered, "10") == 2, "{numbered:?}");
    let (_, named) = open((axis, axis), Below::Names(&[(5.0, "five")]));
    assert!(has(&named, "five") && count(&named, "10") == 1, "{named:?}");
    for axes in [(None, axis), (axis, None), (None, None)] {
        let (is_open, texts) = open(axes, Below::Nothing);
        assert!(!is_open && has(&texts, "no data"), "{texts:?}");
    }
}
