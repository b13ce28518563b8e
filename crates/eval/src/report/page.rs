//! The report as one HTML page: no network, figures inside, complete without its script.
//!
//! Owns the mark-up. Every text from outside is escaped; every number that stands in the page carries in
//! `data-json` where the same number stands in the JSON.

use std::fmt::Display;

use super::FlightsReport;
use super::assessment::Judgement;
use super::group::{Comparison, FlightRow, Group};
use super::pictures::Picture;
use super::quantity::{OF_FLIGHT, Quantity, Spread};
use crate::REVISION;
use crate::figure::Overlay;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = concat!(include_str!("space.js"), include_str!("page.js"));

/// A flight that is shown in full.
pub(super) struct Shown<'a> {
    pub row: &'a FlightRow,
    pub pictures: Vec<Picture>,
}

/// By which a page of this program is known.
pub(super) const GENERATOR: &str = r#"<meta name="generator" content="tello-ctl">"#;

/// The page of `report`, with the figures of all flights and those of some.
pub(super) fn page(report: &FlightsReport, pictures: &[Picture], shown: &[Shown<'_>]) -> String {
    let title = format!("Flights: {}", names(&report.groups));
    let mut page = Page::default();
    page.add(format_args!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n{GENERATOR}\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n\
         <title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n",
        escaped(&title)
    ));
    page.element("h1", &title);
    for group in &report.groups {
        page.verdict(group, report.groups.len() > 1);
    }
    page.unusable(report);
    page.element("h2", "Numbers");
    page.numbers(&report.groups);
    if let Some(comparison) = &report.comparison {
        page.comparison(comparison, &report.groups);
    }
    page.element("h2", "All flights together");
    page.pictures(pictures);
    page.element("h2", "Flight by flight");
    for (number, group) in report.groups.iter().enumerate() {
        page.flights(group, number);
    }
    page.element("h2", "Some flights in full");
    page.element_of("p", "note", SHOWN);
    for one in shown {
        page.element("h3", &one.row.name);
        page.judgement(one.row);
        page.pictures(&one.pictures);
    }
    page.definitions(&report.groups);
    page.add(format_args!(
        "</main>\n<footer>Written by tello-ctl {} ({}).</footer>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
        env!("CARGO_PKG_VERSION"),
        escaped(REVISION)
    ));
    page.html
}

const SHOWN: &str = "Every flight of a group of four or less; of a larger group the fastest, the middle one, the \
                     slowest, and the one that was farthest from its line.";

/// Names of all groups.
fn names(groups: &[Group]) -> String {
    groups.iter().map(|group| group.name.as_str()).collect::<Vec<_>>().join(" against ")
}

/// Text as it may stand in HTML, also in a quoted attribute.
fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut safe, c| {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\n' | '\t' => safe.push(' '),
            c if c.is_control() => safe.push('?'),
            c => safe.push(c),
        }
        safe
    })
}

/// The page so far.
#[derive(Default)]
struct Page {
    html: String,
}

impl Page {
    fn add(&mut self, html: impl Display) {
        self.html += &html.to_string();
    }

    fn element(&mut self, tag: &str, text: &str) {
        self.add(format_args!("<{tag}>{}</{tag}>\n", escaped(text)));
    }

    fn element_of(&mut self, tag: &str, class: &str, text: &str) {
        self.add(format_args!("<{tag} class=\"{class}\">{}</{tag}>\n", escaped(text)));
    }

    fn verdict(&mut self, group: &Group, is_named: bool) {
        let class = match group.judged_count {
            0 => "",
            judged if judged == group.good_count => " good",
            _ => " bad",
        };
        let name =
            if is_named { format!("<b>{}</b>: ", escaped(&group.name)) } else { String::new() };
        self.add(format_args!(
            "<p class=\"verdict{class}\">{name}{}</p>\n",
            escaped(&group.verdict())
        ));
    }

    fn unusable(&mut self, report: &FlightsReport) {
        for file in &report.unusable {
            let text = format!("Not in this report: {file}");
            self.element_of("p", "note", &text);
        }
    }

    /// A cell with a number that stands at `pointer` in the JSON.
    fn number(&mut self, value: f64, digits: usize, pointer: &str) {
        self.add(format_args!("<td data-json=\"{}\">{value:.digits$}</td>", escaped(pointer)));
    }

    fn head(&mut self, caption: &str, columns: &[&str]) {
        self.add("<div class=\"wide\" tabindex=\"0\"><table>\n");
        self.element("caption", caption);
        self.add("<tr>");
        for column in columns {
            self.add(format_args!("<th>{}</th>", escaped(column)));
        }
        self.add("</tr>\n");
    }

    fn foot(&mut self) {
        self.add("</table></div>\n");
    }

    fn numbers(&mut self, groups: &[Group]) {
        let columns = [
            "number",
            "unit",
            "lower quartile",
            "median",
            "upper quartile",
            "90 %",
            "95 %",
            "largest",
            "count",
        ];
        for (number, group) in groups.iter().enumerate() {
            let caption = format!(
                "{}: {}, {} of {} judged ones good. Definitions below.",
                group.name,
                flights(group.flights.len()),
                group.good_count,
                group.judged_count
            );
            self.head(&caption, &columns);
            for &quantity in Quantity::ALL {
                let Some(spread) = group.numbers.get(&quantity) else { continue };
                let (name, unit, digits) = quantity.label();
                self.add(format_args!("<tr><td>{}</td><td>{}</td>", escaped(name), escaped(unit)));
                let at = format!("/groups/{number}/numbers/{}", quantity.key());
                let Spread { count, q25, median, q75, p90, p95, max } = *spread;
                for (key, value) in [
                    ("q25", q25),
                    ("median", median),
                    ("q75", q75),
                    ("p90", p90),
                    ("p95", p95),
                    ("max", max),
                ] {
                    self.number(value, digits, &format!("{at}/{key}"));
                }
                self.number(count as f64, 0, &format!("{at}/count"));
                self.add("</tr>\n");
            }
            self.foot();
        }
    }

    fn comparison(&mut self, comparison: &Comparison, groups: &[Group]) {
        let caption = format!(
            "{}: first minus second, flight by flight, paired by {}. A flight that lacks the number is in no pair; \
             the median of the differences and its 95 % interval by the bootstrap.",
            names(groups),
            comparison.paired_by
        );
        self.element("h3", "Differences");
        self.head(
            &caption,
            &["number", "of the flight", "unit", "pairs", "difference", "from", "to"],
        );
        for (row, paired) in comparison.differences.iter().enumerate() {
            let (name, unit, digits) = paired.quantity.label();
            let at = format!("/comparison/differences/{row}");
            self.add(format_args!(
                "<tr><td>{}</td><td>{}</td><td>{}</td>",
                escaped(name),
                escaped(paired.of_flight),
                escaped(unit)
            ));
            self.number(paired.pairs as f64, 0, &format!("{at}/pairs"));
            self.number(paired.difference, digits, &format!("{at}/difference"));
            for (end, value) in paired.interval.iter().enumerate() {
                self.number(*value, digits, &format!("{at}/interval/{end}"));
            }
            self.add("</tr>\n");
        }
        self.foot();
    }

    fn flights(&mut self, group: &Group, number: usize) {
        let columns = [
            "flight",
            "finish [s]",
            "distance median [m]",
            "largest [m]",
            "overshoot [m]",
            "speed [m/s]",
            "input norm",
            "solve [ms]",
            "verdict",
        ];
        self.head(&group.name, &columns);
        for (row, flight) in group.flights.iter().enumerate() {
            self.add(format_args!("<tr><td>{}</td>", escaped(&flight.name)));
            for (quantity, key, pick) in OF_FLIGHT {
                match flight.numbers.get(&quantity) {
                    Some(spread) => {
                        let at = format!(
                            "/groups/{number}/flights/{row}/numbers/{}/{key}",
                            quantity.key()
                        );
                        self.number(pick(spread), quantity.label().2.min(3), &at);
                    }
                    None => self.add("<td>-</td>"),
                }
            }
            self.add("<td class=\"words\">");
            self.words(flight);
            self.add("</td></tr>\n");
        }
        self.foot();
    }

    /// Judgement, reasons and remarks of a flight.
    fn words(&mut self, flight: &FlightRow) {
        let class = match flight.judgement {
            Judgement::Good => "good",
            Judgement::Bad => "bad",
            Judgement::NotJudged => "",
        };
        let why: Vec<&str> =
            flight.reasons.iter().chain(&flight.remarks).map(String::as_str).collect();
        let why = if why.is_empty() { String::new() } else { format!(": {}", why.join("; ")) };
        self.add(format_args!(
            "<span class=\"{class}\"><b>{}</b>{}</span>",
            flight.judgement.name(),
            escaped(&why)
        ));
    }

    fn judgement(&mut self, flight: &FlightRow) {
        self.add("<p>");
        self.words(flight);
        self.add("</p>\n");
    }

    fn pictures(&mut self, pictures: &[Picture]) {
        for Picture { name, caption, figure } in pictures {
            // The keyboard scrolls it on narrow screens; the script makes what it listens to focusable itself.
            let is_focused = figure.overlay().is_some_and(Overlay::takes_keys);
            let focus = if is_focused { "" } else { " tabindex=\"0\"" };
            self.add(format_args!("<figure id=\"{}\"{focus}>\n", escaped(name)));
            self.add(figure.svg());
            if let Some(overlay) = figure.overlay()
                && let Ok(json) = serde_json::to_string(overlay)
            {
                // No text of a flight can end the element.
                let json = json.replace('<', "\\u003c");
                self.add(format_args!("<script type=\"application/json\">{json}</script>\n"));
            }
            self.element("figcaption", caption);
            self.add("</figure>\n");
        }
    }

    fn definitions(&mut self, groups: &[Group]) {
        self.element("h2", "Definitions");
        self.element(
            "p",
            "A flight counts from the tick in which its first target is reached to the tick in which the last is. \
             Poses are the controller's own estimates, as in the thesis. A flight is good if it reached every target \
             and never was farther than 0.3 m from its line horizontally, which is what the thesis counts as valid. \
             Quantiles are linear between order statistics.",
        );
        self.add("<dl>\n");
        for &quantity in Quantity::ALL {
            if groups.iter().any(|group| group.numbers.contains_key(&quantity)) {
                let (name, unit, _) = quantity.label();
                self.element("dt", &format!("{name} [{unit}]"));
                self.element("dd", quantity.definition());
            }
        }
        self.add("</dl>\n");
    }
}

/// So many flights, in words.
fn flights(count: usize) -> String {
    if count == 1 { "1 flight".into() } else { format!("{count} flights") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_outside_cannot_become_mark_up() {
        let text = escaped("<script>alert('a & \"b\"')</script>\u{1b}\n");
        assert_eq!(text, "&lt;script&gt;alert(&#39;a &amp; &quot;b&quot;&#39;)&lt;/script&gt;? ");
    }
}
