//! The records of a log as tables, one for each channel.
//!
//! Owns how a record becomes a row. The columns of a table are all that occur in any record of its channel,
//! in the order in which they first occur; what a record lacks is an empty cell.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use tello_io::atomic_file;
use tello_io::log::{Ending, LogReader};

/// Names of the columns of each channel.
type Columns = BTreeMap<String, Vec<String>>;

/// Result of a log.
#[derive(Debug)]
pub struct Tables {
    /// A line about each table.
    pub lines: Vec<String>,
    /// How the log ends.
    pub ending: Option<Ending>,
    /// Records that are no JSON, which no table has.
    pub unreadable: u64,
}

/// Writes the tables of `topics`, of all channels if there are none, to `dir`.
///
/// # Errors
/// The log cannot be read or has no such message; a table exists and `is_replaced` is false, or cannot be written.
pub fn write(file: &Path, dir: &Path, topics: &[String], is_replaced: bool) -> Result<Tables> {
    let (columns, ending, unreadable) = columns(file, topics)?;
    for topic in topics {
        ensure!(columns.contains_key(topic), "{} has no JSON message of {topic}", file.display());
    }
    if columns.is_empty() {
        bail!("there is no message in {}", file.display());
    }
    let name = |topic: &str| topic.trim_start_matches('/').replace('/', "_") + ".csv";
    let mut names = BTreeMap::new();
    for topic in columns.keys() {
        if let Some(other) = names.insert(name(topic), topic) {
            bail!("{other} and {topic} are both {}: choose one by --topic", name(topic));
        }
    }
    std::fs::create_dir_all(dir)
        .with_context(|| format!("cannot make the folder {}", dir.display()))?;
    let mut lines = Vec::with_capacity(columns.len());
    for (topic, columns) in &columns {
        let path = dir.join(name(topic));
        let rows =
            atomic_file::write(&path, is_replaced, |part| write_table(file, part, topic, columns))?;
        lines.push(format!("{}: {rows} rows of {topic}", path.display()));
    }
    Ok(Tables { lines, ending, unreadable })
}

/// Columns of each channel by their first occurrence, how the log ends, and how many records are no JSON.
fn columns(file: &Path, topics: &[String]) -> Result<(Columns, Option<Ending>, u64)> {
    let mut columns = Columns::new();
    let mut unreadable = 0;
    let mut log = open(file, topics)?;
    while let Some(message) = log.next_message()? {
        // What viewers read is on other channels as numbers.
        if !message.is_json {
            continue;
        }
        let known = columns.entry(message.topic.to_owned()).or_default();
        let Ok(record) = message.decode() else {
            unreadable += 1;
            continue;
        };
        for (name, _) in cells(&record) {
            if !known.contains(&name) {
                known.push(name);
            }
        }
    }
    Ok((columns, log.ending().cloned(), unreadable))
}

fn open(file: &Path, topics: &[String]) -> Result<LogReader> {
    let log = LogReader::open(file)?;
    let topics: Vec<&str> = topics.iter().map(String::as_str).collect();
    Ok(if topics.is_empty() { log } else { log.select(&topics) })
}

fn write_table(file: &Path, to: &Path, topic: &str, columns: &[String]) -> Result<usize> {
    let mut out = BufWriter::new(File::create_new(to)?);
    write!(out, "t_s")?;
    for name in columns {
        write!(out, ",{}", quoted(name))?;
    }
    writeln!(out)?;
    let mut log = LogReader::open(file)?.select(&[topic]);
    let mut rows = 0;
    while let Some(message) = log.next_message()? {
        let Ok(record) = message.decode() else { continue };
        write!(out, "{}", message.t.seconds())?;
        let cells: BTreeMap<String, String> = cells(&record).into_iter().collect();
        for name in columns {
            write!(out, ",{}", cells.get(name).map_or("", String::as_str))?;
        }
        writeln!(out)?;
        rows += 1;
    }
    out.flush()?;
    Ok(rows)
}

/// Names and texts of all that is no list and no record in `record`; `null` is an empty text.
fn cells(record: &Value) -> Vec<(String, String)> {
    let mut cells = Vec::new();
    flatten(String::new(), record, &mut cells);
    cells
}

fn flatten(name: String, value: &Value, cells: &mut Vec<(String, String)>) {
    let inner = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                flatten(inner(key), value, cells);
            }
        }
        Value::Array(items) => {
            for (place, value) in items.iter().enumerate() {
                flatten(inner(&place.to_string()), value, cells);
            }
        }
        Value::Null => cells.push((name, String::new())),
        Value::String(text) => cells.push((name, quoted(text))),
        Value::Bool(_) | Value::Number(_) => cells.push((name, value.to_string())),
    }
}

/// A text as a cell.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use tello_io::clock::TimeNs;
    use tello_io::log::{Channel, Head, LogWriter};

    use super::*;

    #[test]
    fn a_record_that_is_no_json_costs_its_row_alone() {
        let dir = std::env::temp_dir().join(format!("tello-ctl-table-{}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        let (file, topic) = (dir.join("a.mcap"), "/a/b");
        let schema = || schemars::schema_for!(Vec<u8>).into();
        let channels =
            [topic, "/a_b"].map(|topic| Channel { topic, schema_name: "Row", schema: schema() });
        let mut log = LogWriter::create(&file, &Head::default(), &channels).unwrap();
        log.write_bytes("/a_b", TimeNs(0), b"{}").unwrap();
        for (t_ns, record) in
            [(0, "{\"x\": 1}"), (1_000_000_000, "{\"x\": "), (2_000_000_000, "{\"x\": 3}")]
        {
            log.write_bytes(topic, TimeNs(t_ns), record.as_bytes()).unwrap();
        }
        log.finish().unwrap();
        let error = write(&file, &dir, &[], true).unwrap_err().to_string();
        assert!(error.contains("/a/b and /a_b are both a_b.csv"), "{error}");
        let tables = write(&file, &dir, &[topic.to_owned()], false).unwrap();
        assert_eq!((tables.unreadable, tables.lines.len()), (1, 1));
        assert_eq!(fs::read_to_string(dir.join("a_b.csv")).unwrap(), "t_s,x\n0,1\n2,3\n");
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn every_leaf_of_a_record_is_a_cell() {
        let record = serde_json::json!({
            "step": 3, "pose": { "x": 1.5, "y": null }, "sticks": [[0.1, 0.2]], "why": "a, \"b\""
        });
        let cells: BTreeMap<String, String> = cells(&record).into_iter().collect();
        for (name, text) in [
            ("step", "3"),
            ("pose.x", "1.5"),
            ("pose.y", ""),
            ("sticks.0.1", "0.2"),
            ("why", "\"a, \"\"b\"\"\""),
        ] {
            assert_eq!(cells[name], text, "{name}");
        }
        assert_eq!(cells.len(), 6);
    }
}
