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
