use super::super::drawing::Element;
use super::super::fit;
use super::super::tests::texts;
use super::*;

#[test]
fn a_title_too_long_is_cut() {
    let title = "flight ".repeat(50);
    let texts = texts(&fit(&title, &[], &[], &[]).svg());
    let shown = texts.iter().find(|text| text.starts_with("flight")).unwrap();
    assert!(shown.ends_with("...") && shown.len() < 150, "{shown}");
}

#[test]
fn entries_that_do_not_fit_begin_a_new_line() {
    let stroke = Stroke::solid(super::super::drawing::BLUE, 1.0);
    let height_px = |count| {
        let legend = vec![(Mark::Line(stroke), "a name of some length"); count];
        let figure = Figure::begin("title", &legend);
        let ends = figure.elements.iter().filter_map(|element| match element {
            Element::Text(text) => Some(text.at.0 + font::width_px(&text.content, text.size_px)),
            _ => None,
        });
        for end in ends {
            assert!(end <= WIDTH_PX - BORDER_PX, "{end} px");
        }
        figure.height_px
    };
    let width_px = MARK_PX + MARK_GAP_PX + font::width_px("a name of some length", NAME_PX);
    // So many entries and the gaps between them fit.
    let fits = (1..20).take_while(|count| {
        let count = f64::from(*count);
        BORDER_PX + count * width_px + (count - 1.0) * ENTRY_GAP_PX <= WIDTH_PX - BORDER_PX
    });
    let fits = fits.count();
    for (count, lines) in [(0, 0.0), (1, 1.0), (fits, 1.0), (fits + 1, 2.0)] {
        assert_eq!((count, height_px(count)), (count, 26.0 + lines * LINE_PX));
    }
}
