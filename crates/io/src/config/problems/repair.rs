//! Replacement of a refused value by that of a valid file, so that the next mistake shows.

use serde_json::Value;

use crate::config::place::{KeyPath, Step};

/// Place of the value that is wrong in place of the refused one: a rule may name another one. The refused one is first
/// in `names`. `None`: the refused one is wrong.
pub(super) fn other_wrong(
    refused: &KeyPath,
    names: &[KeyPath],
    value: &Value,
    template: &Value,
) -> Option<KeyPath> {
    let (first, others) = names.split_first()?;
    if first != refused || first.of(value) != first.of(template) {
        return None;
    }
    let is_wrong =
        |place: &&KeyPath| place.of(value).is_some_and(|it| Some(it) != place.of(template));
    others.iter().find(is_wrong).cloned()
}

/// Replaces the value at `place` by that of `template`, or the nearest enclosing one that `template` has; a key that
/// `template` lacks is removed. Returns the changed place; `None` if nothing changed.
pub(super) fn replace(value: &mut Value, template: &Value, place: &KeyPath) -> Option<KeyPath> {
    for count in (1..=place.0.len()).rev() {
        let (outside, here) = (place.head(count - 1), place.head(count));
        let Some(Step::Key(key)) = place.0.get(count - 1) else {
            if let (Some(valid), Some(old)) = (here.of(template), here.of_mut(value))
                && old != valid
            {
                *old = valid.clone();
                return Some(here);
            }
            continue;
        };
        let Some(Value::Object(parent)) = outside.of_mut(value) else { continue };
        match here.of(template) {
            Some(valid) if parent.get(key) != Some(valid) => {
                parent.insert(key.clone(), valid.clone());
                return Some(here);
            }
            None if outside.of(template).is_some() && parent.remove(key).is_some() => {
                // Nothing is left of an alternative of another kind: the valid one takes its place.
                if parent.is_empty()
                    && let Some(Value::Object(valid)) = outside.of(template)
                {
                    parent.clone_from(valid);
                    return Some(outside);
                }
                return Some(here);
            }
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_nearest_value_that_a_valid_file_has_replaces_the_refused_one() {
        let template =
            json!({ "a": 1, "b": { "c": 2, "d": 3 }, "list": [1, 2], "kind": { "right": 2 } });
        for (refused, at, replaced, expected) in [
            (json!({ "a": -1 }), "a", Some("a"), json!({ "a": 1 })),
            (json!({ "a": 1 }), "a", None, json!({ "a": 1 })),
            (json!({ "b": { "c": 9 } }), "b.c", Some("b.c"), json!({ "b": { "c": 2 } })),
            // A value that is valid by itself: what encloses it is wrong.
            (json!({ "b": { "c": 2 } }), "b.c", Some("b"), json!({ "b": { "c": 2, "d": 3 } })),
            (json!({ "list": [1, -5] }), "list[1]", Some("list[1]"), json!({ "list": [1, 2] })),
            (json!({ "list": [1, 2, 3] }), "list[2]", Some("list"), json!({ "list": [1, 2] })),
            // Keys that no valid file has.
            (json!({ "a": 1, "z": 9 }), "z", Some("z"), json!({ "a": 1 })),
            (
                json!({ "b": { "c": { "x": 1 } } }),
                "b.c.x",
                Some("b.c.x"),
                json!({ "b": { "c": {} } }),
            ),
            (
                json!({ "kind": { "wrong": 1 } }),
                "kind.wrong",
                Some("kind"),
                json!({ "kind": { "right": 2 } }),
            ),
        ] {
            let mut value = refused.clone();
            let changed = replace(&mut value, &template, &KeyPath::of_key(at));
            assert_eq!(changed, replaced.map(KeyPath::of_key), "{refused} at {at}");
            assert_eq!(value, expected, "{refused} at {at}");
        }
    }

    #[test]
    fn a_rule_that_names_two_values_blames_the_one_that_no_valid_file_has() {
        let template = json!({ "a": 1, "b": 2, "c": 3 });
        let other = |value: Value, names: &[&str]| {
            let names: Vec<KeyPath> = names.iter().map(|name| KeyPath::of_key(name)).collect();
            other_wrong(&KeyPath::of_key("a"), &names, &value, &template)
        };
        let wrong = |name: &str| Some(KeyPath::of_key(name));
        assert_eq!(other(json!({ "a": 1, "b": 9, "c": 9 }), &["a", "b", "c"]), wrong("b"));
        assert_eq!(other(json!({ "a": 1, "b": 2, "c": 9 }), &["a", "b", "c"]), wrong("c"));
        assert_eq!(other(json!({ "a": 1, "c": 9 }), &["a", "b", "c"]), wrong("c"), "b is missing");
        assert_eq!(other(json!({ "a": 1, "b": 2 }), &["a", "b"]), None, "none is wrong");
        assert_eq!(other(json!({ "a": 7, "b": 9 }), &["a", "b"]), None, "the refused one is wrong");
        assert_eq!(other(json!({ "a": 1, "b": 9 }), &["b", "a"]), None, "it is not named first");
        assert_eq!(other(json!({ "a": 1, "b": 9 }), &[]), None, "nothing is named");
    }
}
