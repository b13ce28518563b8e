//! Records whose fields are the rows of the vehicle model.

use horizon_model::Row;
use schemars::{Schema, json_schema};
use serde::Serialize;
use serde::ser::SerializeMap;

/// A vector of the model, by the names of its rows.
#[derive(Debug)]
pub struct RowsRecord<'a> {
    /// Number of the tick.
    pub step: u64,
    /// Names of the rows.
    pub rows: &'a [Row],
    /// Their values, equally many. Unit of each row
    pub values: &'a [f64],
}

impl Serialize for RowsRecord<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(1 + self.rows.len()))?;
        map.serialize_entry("step", &self.step)?;
        for (row, value) in self.rows.iter().zip(self.values) {
            map.serialize_entry(row.name, value)?;
        }
        map.end()
    }
}

/// JSON schema of a record with these rows.
pub(super) fn rows_schema(rows: &[Row]) -> Schema {
    let mut required = vec!["step"];
    let mut properties = serde_json::Map::new();
    properties.insert("step".into(), serde_json::json!({ "type": "integer" }));
    for row in rows {
        required.push(row.name);
        let property = serde_json::json!({ "type": "number", "description": row.unit });
        properties.insert(row.name.into(), property);
    }
    json_schema!({ "type": "object", "properties": properties, "required": required })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [Row; 2] = [Row::linear("lambda_h", "m/s"), Row::angle("theta_0")];

    #[test]
    fn a_record_has_its_step_and_a_value_under_the_name_of_each_row() {
        let record = RowsRecord { step: 7, rows: &ROWS, values: &[1.5, -0.25] };
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(text, r#"{"step":7,"lambda_h":1.5,"theta_0":-0.25}"#);
    }

    #[test]
    fn the_schema_requires_what_a_record_has_and_names_the_units() {
        let schema = serde_json::to_value(rows_schema(&ROWS)).unwrap();
        assert_eq!(schema["required"], serde_json::json!(["step", "lambda_h", "theta_0"]));
        let properties = schema["properties"].as_object().unwrap();
        assert_eq!(properties.len(), 3);
        assert_eq!(properties["step"]["type"], "integer");
        for (name, unit) in [("lambda_h", "m/s"), ("theta_0", "rad")] {
            assert_eq!(properties[name]["type"], "number");
            assert_eq!(properties[name]["description"], unit);
        }
    }
}
