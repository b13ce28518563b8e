//! The words of a refusal: in the terms of a settings file, and what they name.

use serde_json::Value;

use super::KeyPath;

/// Message of a library about a value, in the terms of JSON.
pub(super) fn plain(message: &str) -> String {
    let (reported, expected) = message.split_once(", expected ").unwrap_or((message, ""));
    let words = match expected {
        "" => return message.to_owned(),
        "f64" | "f32" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number",
        "string or map" => "a name or an object",
        "fewer elements in array" => "fewer entries",
        "a boolean" => "true or false",
        _ if expected.starts_with("struct ") => "an object",
        _ => expected,
    };
    format!("{reported}, expected {words}")
}

/// Message of serde about a table that stands for one of several kinds, and names none or more than one.
const SINGLE_KEY: &str = "invalid value: map, expected map with a single key";

/// `text` with the keys of `value` where it states that there must be one.
pub(super) fn single_key(text: &str, value: Option<&Value>) -> String {
    let keys = value.and_then(Value::as_object).into_iter().flat_map(|it| it.keys());
    let keys = keys.map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
    let found = if keys.is_empty() { "none" } else { &keys };
    text.replace(SINGLE_KEY, &format!("one kind is expected, found {found}"))
}

/// Places of `template` that `text` names: by whole keys, or by keys beside `place`.
pub(super) fn named_places(text: &str, place: &KeyPath, template: &Value) -> Vec<KeyPath> {
    let beside = place.head(place.0.len().saturating_sub(1));
    let words = text.split([' ', ':', ',']).filter(|word| !word.is_empty());
    let places = words.filter_map(|word| {
        let whole = KeyPath::of_key(word);
        let near = KeyPath(beside.0.iter().chain(&whole.0).cloned().collect());
        [whole, near].into_iter().find(|it| !it.0.is_empty() && it.of(template).is_some())
    });
    places.collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn types_of_the_program_are_named_in_the_terms_of_json() {
        for (reported, plainly) in [
            ("invalid type: null, expected f64", "invalid type: null, expected a number"),
            (
                "invalid value: integer `-1`, expected usize",
                "invalid value: integer `-1`, expected a whole number",
            ),
            (
                "invalid length 0, expected struct GateTable with 2 elements",
                "invalid length 0, expected an object",
            ),
            ("missing field `a`", "missing field `a`"),
            ("unknown field `x`, expected `a` or `b`", "unknown field `x`, expected `a` or `b`"),
        ] {
            assert_eq!(plain(reported), plainly);
        }
    }

    #[test]
    fn a_rule_names_values_by_their_whole_key_or_beside_the_refused_one() {
        let template = json!({ "a": { "low": 1, "high": 2 }, "b": 3 });
        let place = KeyPath::of_key("a.high");
        let named =
            named_places("a.high = 0: expected above low = 1 and b, not c", &place, &template);
        let named: Vec<String> = named.iter().map(KeyPath::to_string).collect();
        assert_eq!(named, ["a.high", "a.low", "b"]);
    }
}
