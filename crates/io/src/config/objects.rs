//! A JSON value whose tables are objects.
//!
//! Owns one refusal: serde takes an array for a struct, by the order of its fields. A file that gives one has numbers
//! in other places than their names suggest.

use serde::de::value::{MapAccessDeserializer, MapDeserializer};
use serde::de::{
    DeserializeSeed, Deserializer, Error as _, IntoDeserializer, SeqAccess, Unexpected, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_json::{Error, Value};

/// Reads `Value` as `serde_json` does, but no struct from an array.
#[derive(Debug, Clone, Copy)]
pub(super) struct Objects<'a>(pub(super) &'a Value);

impl<'de> Deserializer<'de> for Objects<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(entries) => {
                let mut rest = Entries(entries.iter());
                let found = visitor.visit_seq(&mut rest)?;
                if rest.0.len() > 0 {
                    return Err(Error::invalid_length(entries.len(), &"fewer elements in array"));
                }
                Ok(found)
            }
            Value::Object(entries) => {
                let entries = entries.iter().map(|(key, value)| (key.as_str(), Objects(value)));
                visitor.visit_map(MapDeserializer::new(entries))
            }
            value => value.deserialize_any(visitor),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(_) => Err(Error::invalid_type(Unexpected::Seq, &visitor)),
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.0.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.0 {
            Value::Object(entries) if entries.len() == 1 => {
                let entries = entries.iter().map(|(key, value)| (key.as_str(), Objects(value)));
                visitor.visit_enum(MapAccessDeserializer::new(MapDeserializer::new(entries)))
            }
            value => value.deserialize_enum(name, variants, visitor),
        }
    }

    // Serde takes a number for a variant, too, by the order in which the program has them.
    fn deserialize_identifier<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Number(_) => Err(Error::invalid_type(Unexpected::Other("number"), &visitor)),
            _ => self.deserialize_any(visitor),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map ignored_any
    }
}

impl<'de> IntoDeserializer<'de, Error> for Objects<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// Rest of an array.
struct Entries<'a>(std::slice::Iter<'a, Value>);

impl<'de> SeqAccess<'de> for Entries<'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Error> {
        self.0.next().map(|value| seed.deserialize(Objects(value))).transpose()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;
    use serde_json::json;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Table {
        pair: [f64; 2],
        kind: Kind,
        #[serde(default)]
        inner: Option<Inner>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Plain,
        Of(Inner),
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(tag = "kind", rename_all = "snake_case")]
    enum Tagged {
        First {},
    }

    #[test]
    fn a_number_names_no_variant() {
        let read = |kind: Value| Tagged::deserialize(Objects(&json!({ "kind": kind })));
        assert_eq!(read(json!("first")).unwrap(), Tagged::First {});
        assert!(read(json!(0)).unwrap_err().to_string().contains("number"));
    }

    #[derive(Debug, PartialEq, Deserialize)]
    struct Inner {
        a: u32,
    }

    fn read(value: &Value) -> Result<Table, String> {
        Table::deserialize(Objects(value)).map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_read_and_refused_as_by_the_library() {
        for value in [
            json!({ "pair": [1, 2.5], "kind": "plain" }),
            json!({ "pair": [1, 2.5], "kind": { "of": { "a": 3 } }, "inner": { "a": 4 } }),
            json!({ "pair": [1, 2], "kind": "plain", "inner": null }),
            json!({ "pair": [1, 2, 3], "kind": "plain" }),
            json!({ "pair": [1], "kind": "plain" }),
            json!({ "pair": [1, "b"], "kind": "plain" }),
            json!({ "pair": [1, 2], "kind": "other" }),
            json!({ "pair": [1, 2], "kind": {} }),
            json!({ "pair": [1, 2], "kind": { "of": { "a": -1 }, "plain": 0 } }),
            json!({ "pair": [1, 2], "kind": { "of": { "a": 1.5 } } }),
            json!({ "pair": [1, 2], "kind": "plain", "more": 1 }),
            json!({ "pair": [1, 2] }),
            json!(3),
        ] {
            let expected = Table::deserialize(&value).map_err(|error| error.to_string());
            assert_eq!(read(&value), expected, "{value}");
        }
    }

    #[test]
    fn an_array_is_no_table_at_any_level() {
        for value in [
            json!([[1, 2], "plain"]),
            json!({ "pair": [1, 2], "kind": "plain", "inner": [4] }),
            json!({ "pair": [1, 2], "kind": { "of": [3] } }),
        ] {
            assert!(Table::deserialize(&value).is_ok(), "the library takes {value}");
            let refused = read(&value).unwrap_err();
            assert!(refused.starts_with("invalid type: sequence, expected struct"), "{refused}");
        }
    }
}
