//! Texts that are no JSON: their mistakes, and what can be read all the same.

use std::path::Path;

use serde_json::Value;

use super::super::{not_finite_number, parse};
use super::{KeyPath, Problems, SettingProblem};

/// `text` with a 0 for each number that JSON does not have, such as `NaN`; these are noted, with their places.
pub(super) fn finite_text(
    mut text: String,
    file: &str,
    found: &mut Problems,
) -> (String, Vec<KeyPath>) {
    let mut replaced = Vec::new();
    while let Some(number) = not_finite_number(&text) {
        let place = KeyPath::of_key(&number.key);
        found.list.push(SettingProblem {
            file: file.to_owned(),
            place: Some(number.place),
            text: format!("{place} = {}: expected finite", &text[number.range.clone()]),
        });
        // Of the same length: the places of what follows stay.
        let zero = format!("{:<1$}", "0", number.range.len());
        text.replace_range(number.range, &zero);
        replaced.push(place);
    }
    (text, replaced)
}

impl SettingProblem {
    /// Of a text that is no JSON.
    pub(super) fn of_text(text: &str, file: String, error: &serde_json::Error) -> Self {
        let place = Some((error.line(), error.column()));
        // Read again for the key; the place stands in front.
        let reported =
            parse::<Value>(text).err().map_or_else(|| error.to_string(), |it| it.to_string());
        let reported = reported.split(" at line ").next().unwrap_or_default().trim_end_matches(',');
        // As serde names what begins with a wrong letter.
        let mut text = reported.replace("expected ident", "expected a JSON value");
        if Path::new(&file).extension().is_some_and(|kind| kind.eq_ignore_ascii_case("csv")) {
            text.push_str("; a mission names its CSV: \"trajectory\", \"points\", \"csv\"");
        }
        Self { file, place, text }
    }
}

#[cfg(test)]
mod tests;
