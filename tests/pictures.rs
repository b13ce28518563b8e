//! The pictures of the book, drawn again by the commands beside them.
//!
//! `TELLO_GOLDEN=write cargo test --test thorough pictures` writes them anew: look at them before they are kept.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use horizon_model::check::maximum;

use crate::program;

/// Pages with the folder of their pictures.
const PAGES: [(&str, &str); 2] = [("control.md", "control"), ("first-flight.md", "pictures")];
/// Largest difference of a number: the last bits of sine and exponential differ between machines.
const TOLERANCE: f64 = 0.011;

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The contents of the blocks of `language` in `page`.
fn blocks<'a>(page: &'a str, language: &str) -> impl Iterator<Item = &'a str> {
    let fence = format!("```{language}\n");
    let rest: Vec<&str> = page.split(&fence).skip(1).collect();
    rest.into_iter().filter_map(|rest| rest.split("```").next())
}

/// `text` without its numbers, and those.
fn parts(text: &str) -> (String, Vec<f64>) {
    let is_number = |c: char| c.is_ascii_digit() || ".-".contains(c);
    let (mut rest, mut numbers) = (String::new(), Vec::new());
    for word in text.split_inclusive(|c| !is_number(c)) {
        let number = word.trim_end_matches(|c| !is_number(c));
        match number.parse() {
            Ok(value) => numbers.push(value),
            Err(_) => rest.push_str(number),
        }
        rest.push_str(word.strip_prefix(number).unwrap_or_default());
    }
    (rest, numbers)
}

/// Where the commands of the book are typed: with `configs`, a first `lab`, and the settings with a pole.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn workplace(control: &str) -> PathBuf {
    let folder = program::folder("pictures");
    symlink(project().join("configs"), folder.join("configs")).unwrap();
    let output = program::tello_ctl(&folder, &["init", "lab"]);
    assert!(output.status.success(), "{}", program::text(&output));
    let fly = fs::read_to_string(folder.join("lab/fly.json")).unwrap();
    let mut pole: serde_json::Value = serde_json::from_str(&fly).unwrap();
    let obstacles = blocks(control, "json").last().unwrap();
    pole["cycle"]["obstacles"] = serde_json::from_str(obstacles).unwrap();
    fs::write(folder.join("lab/pole.json"), pole.to_string()).unwrap();
    folder
}

#[test]
fn the_commands_beside_the_pictures_draw_them() {
    let is_written = std::env::var_os("TELLO_GOLDEN").is_some_and(|what| what == "write");
    let docs = project().join("docs");
    let pages = PAGES.map(|(page, _)| fs::read_to_string(docs.join(page)).unwrap());
    let [control, _] = &pages;
    let folder = workplace(control);
    let mut drawn = 0;
    for ((_, pictures), text) in PAGES.iter().zip(&pages) {
        for line in blocks(text, "sh").flat_map(str::lines) {
            let Some((_, name)) = line.split_once("--figure ") else { continue };
            let picture = format!("{pictures}/{name}.svg");
            assert!(text.contains(&format!("({picture})")), "no picture beside: {line}");
            let words: Vec<&str> = line.split_whitespace().skip(1).collect();
            let output = program::tello_ctl(&folder, &words);
            assert!(output.status.success(), "{line}\n{}", program::text(&output));
            let svg = fs::read_to_string(folder.join(format!("{name}.svg"))).unwrap();
            // Two pages draw a `square`, and no command replaces a file unasked.
            for ending in ["svg", "png"] {
                fs::remove_file(folder.join(format!("{name}.{ending}"))).unwrap();
            }
            if is_written {
                fs::write(docs.join(&picture), &svg).unwrap();
            }
            let kept = fs::read_to_string(docs.join(&picture)).unwrap();
            let ((rest, numbers), (kept_rest, kept_numbers)) = (parts(&svg), parts(&kept));
            assert_eq!(
                numbers.len(),
                kept_numbers.len(),
                "{picture} is not what this draws: {line}"
            );
            let gap = numbers.iter().zip(&kept_numbers).map(|(a, b)| (a - b).abs());
            let gap = gap.fold(0.0, maximum);
            assert!(rest == kept_rest && gap < TOLERANCE, "{picture}, gap {gap}: {line}");
            drawn += 1;
        }
    }
    assert_eq!(drawn, 5, "pictures");
}
