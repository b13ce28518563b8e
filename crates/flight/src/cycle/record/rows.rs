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
