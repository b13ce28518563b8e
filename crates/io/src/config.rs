//! Settings files: found, read, checked, and refused with file, key, value and rule.

mod named;
mod objects;
mod place;
mod problems;

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tello_flight::cycle::{CycleTable, FlightTable};
use tello_flight::{MissionTable, ObstacleTable, PointsTable, Start, TrajectoryTable, parse_csv};

use crate::atomic_file;
use crate::clock::SpanNs;
use crate::manual::{ManualSettings, ManualTable};
use crate::mocap::{MocapSettings, MocapTable};
use crate::tello::TelloTable;

use objects::Objects;
use place::KeyPath;

pub use problems::{Problems, SettingProblem, fly_problems, mission_problems, problems};

/// Settings of `tello-ctl fly`: one file, every key required.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlyTable {
    /// The control loop.
    pub cycle: CycleTable,
    /// File with the mission, relative to this file.
    pub mission: PathBuf,
    /// Where poses come from.
    pub mocap: MocapTable,
    /// Name of the object in the mocap system that the obstacle of kind `moving` follows; null or missing: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moving_object: Option<String>,
    /// Where sticks go.
    pub tello: TelloTable,
    /// How a person steers.
    pub manual: ManualTable,
    /// Where logs go.
    pub log: LogTable,
    /// Requests of the control thread to the operating system.
    pub real_time: RealTimeTable,
}

/// Requests of the control thread to the operating system, beside a real-time priority and locked memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("required" = ["core"]))]
pub struct RealTimeTable {
    /// Core of the machine that the thread stays on, from 0; null: any.
    #[serde(deserialize_with = "tello_flight::present")]
    pub core: Option<usize>,
    /// How long a tick waits for its frame at most; the ticks keep in phase with the frames then. 0: they begin
    /// by the clock alone. Default 0.001. s
    #[serde(default = "one_ms")]
    pub frame_wait_s: f64,
}

const fn one_ms() -> f64 {
    1e-3
}

/// Where logs go.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogTable {
    /// Folder, made if it does not exist; relative to where the program is started.
    pub dir: PathBuf,
}

/// Settings for a run without files: parts of the program, and examples of every key.
const BUILT_IN_FLY: &str = include_str!("../../../configs/fly.json");
const BUILT_IN_MISSION: &str = include_str!("../../../configs/missions/square.json");

/// The settings of `tello-ctl fly` in `path`, or the built-in ones, with their mission.
///
/// `mission` replaces the file that the settings name.
///
/// # Errors
/// A file that cannot be read, is not JSON, has an unknown or missing key or a wrong type. Values
/// are checked when the cycle is built.
pub fn fly(path: Option<&Path>, mission: Option<&Path>) -> Result<(FlyTable, MissionTable)> {
    read_fly(path, mission).map_err(|error| explain(error, path, mission))
}

/// All mistakes of the settings and their mission in place of `error`, which is one of them; `error` if the
/// files have none.
pub fn explain(error: anyhow::Error, path: Option<&Path>, mission: Option<&Path>) -> anyhow::Error {
    let problems = fly_problems(path, mission);
    if problems.list.is_empty() { error } else { problems.into() }
}

fn read_fly(path: Option<&Path>, mission: Option<&Path>) -> Result<(FlyTable, MissionTable)> {
    let table: FlyTable = match path {
        Some(path) => load_whole(path)?,
        None => parse(BUILT_IN_FLY).context("in the built-in configs/fly.json")?,
    };
    let mission = match (mission, path) {
        (Some(mission), _) => self::mission(mission)?,
        (None, Some(path)) => self::mission(&path.with_file_name(&table.mission))?,
        (None, None) => parse(BUILT_IN_MISSION).context("in the built-in mission")?,
    };
    Ok((table, mission))
}

/// The settings of `fly` in `path`, if they name every key.
fn load_whole(path: &Path) -> Result<FlyTable> {
    let text = read(path)?;
    let table = || {
        let settings = value(&text)?;
        let table = from_value(&settings).map_err(|error| refusal(&error, &text))?;
        match named::unnamed(&settings).next() {
            Some((_, problem)) => Err(anyhow!(problem)),
            None => Ok(table),
        }
    };
    table().with_context(|| format!("in {}", path.display()))
}

/// The mission in `path`, with the points of the CSV file that it names, if it does.
///
/// # Errors
/// As [`fly`], of either file.
pub fn mission(path: &Path) -> Result<MissionTable> {
    let mut table: MissionTable = load(path)?;
    read_points(path, &mut table)?;
    Ok(table)
}

/// Reads the CSV file that a mission names, if it does.
fn read_points(path: &Path, table: &mut MissionTable) -> Result<()> {
    if let MissionTable::Trajectory(TrajectoryTable { points, .. }) = table
        && let PointsTable::Csv(csv) = points
    {
        let csv = path.with_file_name(csv);
        let rows = parse_csv(&read(&csv)?).with_context(|| format!("in {}", csv.display()))?;
        *points = PointsTable::Rows(rows);
    }
    Ok(())
}

/// Settings and mission of a flight: all that its ticks depend on. Checks nothing.
pub fn flight(table: &FlyTable, mission: MissionTable, start: Start) -> FlightTable {
    FlightTable { start, mission, cycle: table.cycle.clone(), protocol: table.tello.protocol }
}

/// How a person steers, checked.
///
/// # Errors
/// A value outside its range, or a deflection that the gate would refuse.
pub fn manual(table: &FlyTable) -> Result<ManualSettings, SettingError> {
    let settings =
        ManualSettings::try_from(&table.manual).map_err(|error| error.under("manual"))?;
    let stick_max = table.cycle.gate.stick_max;
    if settings.deflection > stick_max {
        let rule = format!("at most cycle.gate.stick_max = {stick_max}");
        return Err(SettingError::new("manual.deflection", settings.deflection, rule));
    }
    Ok(settings)
}

/// How long a tick waits for its frame, checked.
///
/// # Errors
/// A value outside its range.
pub fn frame_wait(table: &FlyTable) -> Result<SpanNs, SettingError> {
    let wait_s = in_range("real_time.frame_wait_s", table.real_time.frame_wait_s, 0.0..=0.005)?;
    Ok(SpanNs::from_seconds(wait_s))
}

/// Where poses come from, checked.
///
/// # Errors
/// A value that breaks its rule.
pub fn mocap(table: &FlyTable) -> Result<MocapSettings, SettingError> {
    MocapSettings::try_from(&table.mocap).map_err(|error| error.under("mocap"))
}

/// Where the places of the obstacle that moves come from, checked; `None` if none does.
///
/// # Errors
/// A name without such an obstacle or the reverse, the vehicle's own name, or a source that only one reader gets.
pub fn moving_object(table: &FlyTable) -> Result<Option<MocapSettings>, SettingError> {
    const KEY: &str = "moving_object";
    let is_moving = |obstacle: &ObstacleTable| matches!(obstacle, ObstacleTable::Moving { .. });
    let has_obstacle = table.cycle.obstacles.iter().any(is_moving);
    let Some(name) = &table.moving_object else {
        let rule = "the name of an object in the mocap system, with an obstacle of kind moving";
        return if has_obstacle { Err(SettingError::new(KEY, "null", rule)) } else { Ok(None) };
    };
    let rule = match &table.mocap {
        _ if !has_obstacle => "null without an obstacle of kind moving in cycle.obstacles",
        mocap if mocap.object() == name => "another object than the vehicle",
        MocapTable::Udp(_) => "null with mocap.udp: its datagrams reach one reader",
        mocap => {
            let settings = MocapSettings::try_from(&mocap.of_object(name));
            return settings.map(Some).map_err(|error| error.under(KEY));
        }
    };
    Err(SettingError::new(KEY, name, rule))
}

/// The JSON file `path` as a table.
///
/// # Errors
/// As [`fly`].
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T> {
    parse(&read(path)?).with_context(|| format!("in {}", path.display()))
}

const SETTINGS_BYTES_MAX: u64 = 64 << 20;

/// The text of a file of settings.
///
/// # Errors
/// It cannot be read, is larger than 64 MiB, or is no UTF-8.
pub fn read(path: &Path) -> Result<String> {
    let bytes = atomic_file::read(path, SETTINGS_BYTES_MAX)
        .with_context(|| format!("cannot read {}", path.display()))?;
    let text = String::from_utf8(bytes)
        .ok()
        .with_context(|| format!("{} is not text in UTF-8", path.display()))?;
    // Some editors begin a file with a mark of its byte order.
    let rest = text.strip_prefix('\u{feff}').map(str::to_owned);
    Ok(rest.unwrap_or(text))
}

/// JSON text as a table, with the path of the offending key in the message. `"$schema"` at the top is for
/// editors and may be there.
///
/// # Errors
/// Not JSON, a key that occurs twice, an unknown or missing one, or a wrong type; each with its place in the text.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    from_value(&value(text)?).map_err(|error| refusal(&error, text))
}

/// A JSON value as a table. All tables are read from values, so that each has one parser in the program.
///
/// # Errors
/// An unknown or missing key, or a wrong type, an array for a table among them, with the path of the key.
pub fn from_value<T: DeserializeOwned>(
    value: &Value,
) -> Result<T, serde_path_to_error::Error<serde_json::Error>> {
    serde_path_to_error::deserialize(Objects(value))
}

/// The value of a JSON text, without the name of its schema.
fn value(text: &str) -> Result<Value> {
    let mut json = serde_json::Deserializer::from_str(text);
    let mut value: Value = match serde_path_to_error::deserialize(&mut json) {
        Ok(value) => value,
        Err(error) => match not_finite(text, &error) {
            Some(NotFinite { key, place: (line, _), range }) => {
                bail!("{key} = {}: expected finite, at line {line}", &text[range])
            }
            None => return Err(error.into()),
        },
    };
    json.end()?;
    if let Some((place, (line, column))) = place::doubles(text).into_iter().next() {
        bail!("{place} occurs twice, again at line {line} column {column}");
    }
    if let Some(settings) = value.as_object_mut() {
        settings.remove(SCHEMA);
    }
    Ok(value)
}

/// `error` with its place in `text`.
fn refusal(error: &serde_path_to_error::Error<serde_json::Error>, text: &str) -> anyhow::Error {
    match KeyPath::of_path(error.path()).in_text(text) {
        Some((line, column)) => anyhow!("{error} at line {line} column {column}"),
        None => anyhow!("{error}"),
    }
}

/// A number that JSON does not have, as other programs write it.
struct NotFinite {
    key: String,
    /// Line and column, from 1.
    place: (usize, usize),
    /// In the text. bytes
    range: Range<usize>,
}

/// The first number in `text` that JSON does not have, if that is why it cannot be read.
fn not_finite_number(text: &str) -> Option<NotFinite> {
    let mut json = serde_json::Deserializer::from_str(text);
    not_finite(text, &serde_path_to_error::deserialize::<_, Value>(&mut json).err()?)
}

/// The same, where reading has stopped with `error`.
fn not_finite(
    text: &str,
    error: &serde_path_to_error::Error<serde_json::Error>,
) -> Option<NotFinite> {
    let at = error.inner();
    let lines_before = at.line().checked_sub(1)?;
    let line_start: usize = text.split_inclusive('\n').take(lines_before).map(str::len).sum();
    let line = text.get(line_start..)?.lines().next()?;
    let is_part = |c: char| c.is_alphanumeric() || "+-.".contains(c);
    let (before, after) = line.split_at_checked(at.column().checked_sub(1)?)?;
    let begin = before.trim_end_matches(is_part).len();
    let end = before.len() + after.len() - after.trim_start_matches(is_part).len();
    let is_infinite = line.get(begin..end)?.parse::<f64>().is_ok_and(|value| !value.is_finite());
    is_infinite.then(|| NotFinite {
        key: error.path().to_string(),
        place: (at.line(), before[..begin].chars().count() + 1),
        range: line_start + begin..line_start + end,
    })
}

/// Key of the schema, for editors.
const SCHEMA: &str = "$schema";

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mocap::UdpTable;

    /// The built-in settings of a flight with one change.
    fn changed(change: impl FnOnce(&mut FlyTable)) -> FlyTable {
        let mut table: FlyTable = parse(BUILT_IN_FLY).unwrap();
        change(&mut table);
        table
    }

    #[test]
    fn a_person_may_not_ask_for_more_than_the_gate_lets_through() {
        assert!(manual(&changed(|_| {})).is_ok());
        let refused = manual(&changed(|table| {
            table.cycle.gate.stick_max = 0.4;
            table.manual.deflection = 0.5;
        }));
        let error = refused.unwrap_err().to_string();
        assert_eq!(error, "manual.deflection = 0.5: expected at most cycle.gate.stick_max = 0.4");
        let refused = manual(&changed(|table| table.manual.pulse_s = 3.0));
        assert_eq!(refused.unwrap_err().key, "manual.pulse_s");
    }

    #[test]
    fn an_obstacle_that_moves_and_its_object_need_each_other() {
        let with = |name: Option<&str>, change: fn(&mut FlyTable)| {
            let table = changed(|table| {
                table.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.3 }];
                table.moving_object = name.map(str::to_owned);
                change(table);
            });
            moving_object(&table).map_err(|error| error.to_string())
        };
        assert!(with(Some("person"), |_| ()).unwrap().is_some());
        assert_eq!(moving_object(&changed(|_| ())).unwrap(), None);
        let no_obstacle = |table: &mut FlyTable| table.cycle.obstacles.clear();
        let by_udp = |table: &mut FlyTable| {
            let udp = UdpTable { listen: "0.0.0.0:1".into(), object: "tello".into(), rate_hz: 1.0 };
            table.mocap = MocapTable::Udp(udp);
        };
        for (refused, words) in [
            (with(None, |_| ()), "moving_object = null: expected the name of an object"),
            (with(Some("tello"), |_| ()), "another object than the vehicle"),
            (with(Some("person"), no_obstacle), "null without an obstacle of kind moving"),
            (with(Some("person"), by_udp), "null with mocap.udp"),
            (with(Some("a b"), |_| ()), "moving_object.relay.object"),
        ] {
            let refused = refused.unwrap_err();
            assert!(refused.contains(words), "{refused}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn damaged_settings_are_refused_or_read_and_never_a_panic(
            at in 0..BUILT_IN_FLY.len(),
            length in 0..20_usize,
            noise in "[ -~]{0,8}",
        ) {
            let end = (at + length).min(BUILT_IN_FLY.len());
            let mut text = BUILT_IN_FLY.to_owned();
            text.replace_range(at..end, &noise);
            if let Ok(table) = parse::<FlyTable>(&text) {
                let again: FlyTable = parse(&serde_json::to_string(&table).unwrap()).unwrap();
                prop_assert_eq!(again, table);
            }
        }
    }
}
