//! Where a value stands in a JSON text.
//!
//! Owns paths of keys and indices: along values, and along the text. Pure.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display, Formatter};

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use serde_json::value::RawValue;
use serde_path_to_error::Segment;

/// One level of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    Key(String),
    Index(usize),
}

/// A path as people write it: `cycle.mhe.p_lb[3]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct KeyPath(pub(super) Vec<Step>);

impl KeyPath {
    /// Of a key such as `cycle.mhe.p_lb[3]`.
    pub(super) fn of_key(key: &str) -> Self {
        let parts = key.split(['.', '[']).filter(|part| !part.is_empty());
        let step = |part: &str| match part.strip_suffix(']').map(str::parse) {
            Some(Ok(index)) => Step::Index(index),
            _ => Step::Key(part.to_owned()),
        };
        Self(parts.map(step).collect())
    }

    /// Of the place that a deserializer reached.
    pub(super) fn of_path(path: &serde_path_to_error::Path) -> Self {
        let step = |segment: &Segment| match segment {
            Segment::Seq { index } => Some(Step::Index(*index)),
            Segment::Map { key } => Some(Step::Key(key.clone())),
            Segment::Enum { variant } => Some(Step::Key(variant.clone())),
            Segment::Unknown => None,
        };
        Self(path.iter().map_while(step).collect())
    }

    /// The first `count` levels.
    pub(super) fn head(&self, count: usize) -> Self {
        Self(self.0.iter().take(count).cloned().collect())
    }

    pub(super) fn with(&self, key: &str) -> Self {
        Self(self.0.iter().cloned().chain([Step::Key(key.to_owned())]).collect())
    }

    /// Whether `other` is this place or inside of it.
    pub(super) fn contains(&self, other: &Self) -> bool {
        other.0.starts_with(&self.0)
    }

    /// The value at this place.
    pub(super) fn of<'a>(&self, value: &'a Value) -> Option<&'a Value> {
        self.0.iter().try_fold(value, |value, step| match step {
            Step::Key(key) => value.get(key),
            Step::Index(index) => value.get(index),
        })
    }

    /// The value at this place, to be changed.
    pub(super) fn of_mut<'a>(&self, value: &'a mut Value) -> Option<&'a mut Value> {
        self.0.iter().try_fold(value, |value, step| match step {
            Step::Key(key) => value.get_mut(key),
            Step::Index(index) => value.get_mut(index),
        })
    }

    /// Line and column, from 1, of the value at this place in `text`, or of the last level that is there.
    pub(super) fn in_text(&self, text: &str) -> Option<(usize, usize)> {
        let mut raw: &RawValue = serde_json::from_str(text).ok()?;
        for step in &self.0 {
            let next = match step {
                Step::Key(key) => {
                    let entries: Option<BTreeMap<String, &RawValue>> =
                        serde_json::from_str(raw.get()).ok();
                    entries.and_then(|entries| entries.get(key).copied())
                }
                Step::Index(index) => {
                    let entries: Option<Vec<&RawValue>> = serde_json::from_str(raw.get()).ok();
                    entries.and_then(|entries| entries.get(*index).copied())
                }
            };
            let Some(next) = next else { break };
            raw = next;
        }
        line_and_column(raw, text)
    }
}

/// Line and column, from 1, of a part of `text`.
fn line_and_column(raw: &RawValue, text: &str) -> Option<(usize, usize)> {
    let at = raw.get().as_ptr().addr().checked_sub(text.as_ptr().addr())?;
    let before = text.get(..at)?;
    let line_start = before.rfind('\n').map_or(0, |end| end + 1);
    let column = before.get(line_start..)?.chars().count() + 1;
    Some((before.matches('\n').count() + 1, column))
}

/// Keys that an object of the JSON `text` has more than once, with line and column of the later value: a parser takes
/// one of them silently.
pub(super) fn doubles(text: &str) -> Vec<(KeyPath, (usize, usize))> {
    let mut found = Vec::new();
    if let Ok(raw) = serde_json::from_str(text) {
        find_doubles(raw, &KeyPath::default(), text, &mut found);
    }
    found
}

fn find_doubles(
    raw: &RawValue,
    place: &KeyPath,
    text: &str,
    found: &mut Vec<(KeyPath, (usize, usize))>,
) {
    let inside: Vec<(KeyPath, &RawValue)> = if raw.get().starts_with('{') {
        let Ok(Entries(entries)) = serde_json::from_str(raw.get()) else { return };
        let mut known = BTreeSet::new();
        for (key, value) in &entries {
            if !known.insert(key)
                && let Some(at) = line_and_column(value, text)
            {
                found.push((place.with(key), at));
            }
        }
        entries.iter().map(|(key, value)| (place.with(key), *value)).collect()
    } else if raw.get().starts_with('[') {
        let Ok(entries) = serde_json::from_str::<Vec<&RawValue>>(raw.get()) else { return };
        let within = |index| KeyPath(place.0.iter().cloned().chain([Step::Index(index)]).collect());
        entries.into_iter().enumerate().map(|(index, value)| (within(index), value)).collect()
    } else {
        return;
    };
    for (place, value) in inside {
        find_doubles(value, &place, text, found);
    }
}

/// All entries of an object, those of equal keys too.
struct Entries<'a>(Vec<(String, &'a RawValue)>);

impl<'a> Deserialize<'a> for Entries<'a> {
    fn deserialize<D: Deserializer<'a>>(deserializer: D) -> Result<Self, D::Error> {
        struct AllEntries;
        impl<'a> Visitor<'a> for AllEntries {
            type Value = Entries<'a>;

            fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'a>>(self, mut map: A) -> Result<Entries<'a>, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(AllEntries)
    }
}

impl Display for KeyPath {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (k, step) in self.0.iter().enumerate() {
            match step {
                Step::Key(key) if k == 0 => write!(f, "{key}")?,
                Step::Key(key) => write!(f, ".{key}")?,
                Step::Index(index) => write!(f, "[{index}]")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_found_in_its_line_and_column() {
        let text = "{\n  \"a\": { \"\u{e9}\": [1, 2,\n 3] },\n  \"b\": 4\n}";
        for (key, place) in [
            ("b", (4, 8)),
            ("a", (2, 8)),
            ("a.\u{e9}", (2, 15)),
            ("a.\u{e9}[1]", (2, 19)),
            ("a.\u{e9}[2]", (3, 2)),
            ("a.\u{e9}[7]", (2, 15)),
            ("a.nothing", (2, 8)),
            ("", (1, 1)),
        ] {
            let found = KeyPath::of_key(key);
            assert_eq!(found.in_text(text), Some(place), "{key}");
            assert_eq!(found.to_string(), key);
        }
    }

    #[test]
    fn keys_that_are_there_twice_are_found_with_their_place() {
        let text = "{ \"a\": [1, { \"b\": 1,\n \"c\": 2, \"b\": 3 }],\n \"a\": 4 }";
        let found: Vec<_> =
            doubles(text).into_iter().map(|(place, at)| (place.to_string(), at)).collect();
        assert_eq!(found, [("a".to_owned(), (3, 7)), ("a[1].b".to_owned(), (2, 15))]);
        assert_eq!(doubles("{ \"a\": { \"b\": 1 }, \"b\": [{ \"a\": 1 }] }"), []);
        assert_eq!(doubles("{ \"a\": "), []);
    }
}
