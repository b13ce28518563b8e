//! Logs as columns.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Result, bail};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;
use tello_io::log::{CONFIG, Ending, LogReader};

use crate::long_call;

/// The records of one channel.
#[derive(Debug, Default)]
struct Table {
    times_ns: Vec<i64>,
    /// By name; every column has as many values as there are records.
    columns: BTreeMap<String, Vec<Value>>,
}

impl Table {
    fn push(&mut self, time_ns: i64, record: Value) {
        let before = self.times_ns.len();
        self.times_ns.push(time_ns);
        self.flatten(String::new(), record, before);
        for column in self.columns.values_mut() {
            column.resize(before + 1, Value::Null);
        }
    }

    /// Objects by `outer.inner`; arrays stay whole.
    fn flatten(&mut self, name: String, value: Value, before: usize) {
        match value {
            Value::Object(fields) if !fields.is_empty() => {
                for (key, value) in fields {
                    let inner = if name.is_empty() { key } else { format!("{name}.{key}") };
                    self.flatten(inner, value, before);
                }
            }
            value => {
                let column = self.columns.entry(name).or_default();
                column.resize(before, Value::Null);
                column.push(value);
            }
        }
    }
}

/// A log by channels, `{topic: (times in ns, {column: values})}`; the settings of the flight, as JSON, and why the log
/// ends early, if they are there.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn read_log(
    py: Python<'_>,
    path: PathBuf,
    topics: Option<Vec<String>>,
) -> PyResult<(Bound<'_, PyDict>, Option<String>, Option<String>)> {
    let (tables, settings, torn) = long_call::run(py, |stop| {
        let mut log = LogReader::open(&path)?;
        if let Some(topics) = &topics {
            log = log.select(&topics.iter().map(String::as_str).collect::<Vec<_>>());
        }
        let mut tables: BTreeMap<String, Table> = BTreeMap::new();
        while let Some(message) = log.next_message()? {
            stop.check()?;
            // What viewers read is on other channels as numbers.
            if !message.is_json {
                continue;
            }
            let record = message.decode()?;
            tables.entry(message.topic.to_owned()).or_default().push(message.t.0, record);
        }
        if let Some(topics) = &topics {
            check_topics(&log, topics)?;
        }
        let torn = match log.ending() {
            Some(Ending::Torn { why, .. }) => Some(why.clone()),
            _ => None,
        };
        Ok((tables, log.head().documents.get(CONFIG).cloned(), torn))
    })?;
    let channels = PyDict::new(py);
    for (topic, table) in tables {
        let columns = PyDict::new(py);
        for (name, values) in table.columns {
            columns.set_item(name, column(py, &values)?)?;
        }
        channels.set_item(topic, (table.times_ns.into_pyarray(py), columns))?;
    }
    Ok((channels, settings, torn))
}

/// # Errors
/// A topic that the log has no channel for.
fn check_topics(log: &LogReader, topics: &[String]) -> Result<()> {
    let is_unknown = |topic: &&String| log.json_topics().all(|known| known != *topic);
    if let Some(topic) = topics.iter().find(is_unknown) {
        let known = log.json_topics().collect::<Vec<_>>().join(", ");
        bail!("topics: {topic} is none of {known}");
    }
    Ok(())
}

/// Numbers as float64, where absent NaN; integers as int64 and flags as bool where none is absent; anything else as
/// a list of JSON texts or strings.
fn column<'py>(py: Python<'py>, values: &[Value]) -> PyResult<Bound<'py, PyAny>> {
    if let Some(numbers) = values.iter().map(Value::as_i64).collect::<Option<Vec<i64>>>() {
        return Ok(numbers.into_pyarray(py).into_any());
    }
    if let Some(flags) = values.iter().map(Value::as_bool).collect::<Option<Vec<bool>>>() {
        return Ok(flags.into_pyarray(py).into_any());
    }
    let number = |value: &Value| if value.is_null() { Some(f64::NAN) } else { value.as_f64() };
    let has_number = values.iter().any(Value::is_number);
    if let Some(numbers) = values.iter().map(number).collect::<Option<Vec<f64>>>()
        && has_number
    {
        return Ok(PyArray1::from_vec(py, numbers).into_any());
    }
    let texts = PyList::empty(py);
    let loads = py.import("json")?.getattr("loads")?;
    for value in values {
        match value {
            Value::String(text) => texts.append(text)?,
            Value::Null => texts.append(py.None())?,
            other => texts.append(loads.call1((other.to_string(),))?)?,
        }
    }
    Ok(texts.into_any())
}
