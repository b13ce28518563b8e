use super::super::fit;
use super::super::tests::texts;
use super::*;

#[test]
fn names_may_hold_mark_up() {
    let title = "a < b && \"c\" > \u{1}";
    assert!(texts(&fit(title, &[], &[], &[]).svg()).contains(&"a < b && \"c\" > ?".to_owned()));
}

#[test]
fn lengths_are_rounded_to_a_tenth_without_an_empty_decimal() {
    for (length, text) in [(3.0, "3"), (2.96, "3"), (2.94, "2.9"), (-0.16, "-0.2"), (10.0, "10")] {
        assert_eq!(Px(length).to_string(), text);
    }
}

#[test]
fn each_element_is_the_svg_that_draws_it() {
    let runs = vec![vec![(0.0, 1.0), (2.0, 3.0), (4.0, 5.5)], vec![(6.0, 7.0)]];
    let dashed = Stroke::dashed(BLUE, 1.5, 4.0);
    let square = vec![(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)];
    let text = Text {
        content: "a".to_owned(),
        at: (1.0, 2.0),
        size_px: 12.0,
        anchor: Anchor::End,
        is_vertical: true,
        color: BLACK,
    };
    for (element, svg) in [
        (
            Element::Lines(runs.clone(), dashed),
            "<path d=\"M0 1L2 3 4 5.5M6 7\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"1.5\" \
             stroke-linejoin=\"round\" stroke-linecap=\"butt\" stroke-dasharray=\"4 4\"/>",
        ),
        (
            Element::Lines(runs, Stroke::solid(BLUE, 1.0)),
            "<path d=\"M0 1L2 3 4 5.5M6 7\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"1\" \
             stroke-linejoin=\"round\" stroke-linecap=\"butt\"/>",
        ),
        (
            Element::Area(square, GREEN.faded(0.25)),
            "<path d=\"M0 0L1 0 1 1Z\" fill=\"#009e73\" fill-opacity=\"0.25\"/>",
        ),
        (
            Element::Dots(vec![(1.0, 2.0), (3.0, 4.0)], 1.5, PALE),
            "<path d=\"M1 2h0M3 4h0\" fill=\"none\" stroke=\"#e2e2e2\" stroke-width=\"3\" \
             stroke-linecap=\"round\"/>",
        ),
        (
            Element::Text(text),
            "<text x=\"1\" y=\"2\" font-size=\"12\" fill=\"#1a1a1a\" text-anchor=\"end\" \
             transform=\"rotate(-90 1 2)\">a</text>",
        ),
    ] {
        assert_eq!(element.to_string(), svg);
    }
}

#[test]
fn nothing_to_draw_is_no_element() {
    let mut figure = Figure::begin("", &[]);
    let count = figure.elements.len();
    figure.lines(Vec::new(), Stroke::solid(BLUE, 1.0));
    figure.area(Vec::new(), BLUE);
    figure.dots(Vec::new(), 1.0, BLUE);
    assert_eq!(figure.elements.len(), count);
}
