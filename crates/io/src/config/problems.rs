//! Every mistake of a settings file at once, each with its place in the file.
//!
//! Reading and checking stop at the first mistake. Here each mistake is noted, its value replaced by what a
//! valid file has in the same place, and the file is read and checked again, until nothing is left or until a
//! mistake comes back in a place that was replaced: what follows from a replacement is not the file's mistake.

use std::error::Error;
use std::fmt::{self, Display, Formatter};
use std::path::Path;

use horizon_model::setting::SettingError;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tello_flight::{
    CsvError, CsvErrors, Mission, MissionTable, PointsTable, Start, TrajectoryTable, cycle,
    falling_times,
};

use super::place::{Place, Step, doubles};
use super::{
    BUILT_IN_FLY, BUILT_IN_MISSION, FlyTable, SCHEMA, flight, frame_wait, manual, mocap,
    moving_object, parse, read, read_points,
};
use crate::tello::TelloSettings;

/// Most mistakes that are looked for in a file.
const PROBLEMS_MAX: usize = 50;

/// Period for which a mission is checked that is checked alone. s
const DT_S: f64 = 0.02;

/// A valid mission of each kind.
const MISSIONS: [&str; 5] = [
    BUILT_IN_MISSION,
    include_str!("../../../../configs/missions/figure_eight.json"),
    include_str!("../../../../configs/missions/arc.json"),
    include_str!("../../../../configs/missions/hover.json"),
    include_str!("../../../../configs/targets/square.json"),
];

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The file; empty where the text names it.
    pub file: String,
    /// Line and column, from 1, if the mistake has a place in the file.
    pub place: Option<(usize, usize)>,
    /// Key, value and rule.
    pub text: String,
}

/// All mistakes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Problems {
    /// In the order in which they were found.
    pub list: Vec<Problem>,
}

impl Display for Problem {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { file, place, text } = self;
        match place {
            Some((line, column)) => write!(f, "{file}:{line}:{column}: {text}"),
            None if file.is_empty() => write!(f, "{text}"),
            None => write!(f, "{file}: {text}"),
        }
    }
}

impl Display for Problems {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let [problem] = &*self.list {
            return write!(f, "{problem}");
        }
        write!(f, "{} mistakes", self.list.len())?;
        self.list.iter().try_for_each(|problem| write!(f, "\n  {problem}"))
    }
}

impl Error for Problems {}

/// Why a value is refused, and where.
struct Refusal {
    place: Place,
    text: String,
    /// What the value is replaced by that was missing.
    missing: Option<String>,
    /// Mistakes that are found together, or in another file, in place of the text.
    together: Vec<Problem>,
}

impl From<SettingError> for Refusal {
    fn from(error: SettingError) -> Self {
        let text = error.to_string();
        Self { place: Place::of_key(&error.key), text, missing: None, together: Vec::new() }
    }
}

impl Refusal {
    fn of_shape(error: &serde_path_to_error::Error<serde_json::Error>) -> Self {
        let mut place = Place::of_path(error.path());
        let message = error.inner().to_string();
        let named = |start: &str| {
            let rest = message.strip_prefix(start)?;
            rest.split('`').next().map(str::to_owned)
        };
        let missing = named("missing field `");
        if let Some(unknown) = named("unknown field `")
            && place.0.last() != Some(&Step::Key(unknown.clone()))
        {
            place = place.with(&unknown);
        }
        let key = place.to_string();
        let text = if key.is_empty() { message } else { format!("{key}: {message}") };
        Self { place, text, missing, together: Vec::new() }
    }
}

/// All mistakes of the settings file `path` of the kind of `template`, a valid one; `check` finds those of its
/// values.
pub fn problems<T: DeserializeOwned>(
    path: &Path,
    template: &str,
    check: impl Fn(&T) -> Result<(), SettingError>,
) -> Problems {
    let check = |table: &T| check(table).map_err(Refusal::from);
    of_file(path, |_| Some(template.to_owned()), check)
}

/// All mistakes of a mission.
pub fn mission_problems(path: &Path) -> Problems {
    let template = |value: &Value| {
        let kind = value.as_object()?.keys().find(|key| *key != SCHEMA)?.clone();
        let is_same = |text: &&&str| parse::<Value>(text).is_ok_and(|it| it.get(&kind).is_some());
        MISSIONS.iter().find(is_same).map(|text| (*text).to_owned())
    };
    of_file(path, template, |table: &MissionTable| check_mission(path, table))
}

/// All mistakes of the settings of `fly` and of their mission. A mission that cannot be read hides nothing of
/// the settings.
pub fn fly_problems(path: Option<&Path>, mission: Option<&Path>) -> Problems {
    let check = |table: &FlyTable| check_fly(table).map_err(Refusal::from);
    let mut found = path.map_or_else(Problems::default, |path| of_file(path, fly_template, check));
    let named = path.and_then(|path| {
        let settings: Value = serde_json::from_str(&read(path).ok()?).ok()?;
        Some(path.with_file_name(settings.get("mission")?.as_str()?))
    });
    let named = mission.map(Path::to_owned).or(named);
    if let Some(mission) = &named {
        found.list.extend(mission_problems(mission).list);
    }
    if found.list.is_empty()
        && let Ok((table, mission)) = super::read_fly(path, mission)
        && let Ok(mission) = Mission::new(&mission, table.cycle.dt_s)
        && let Ok(misfits) = cycle::misfits(&mission, &table.cycle)
    {
        let file = named.map(|path| path.display().to_string()).unwrap_or_default();
        let settings =
            path.map_or("the built-in settings".into(), |path| path.display().to_string());
        found.list.extend(misfits.into_iter().map(|error| Problem {
            file: file.clone(),
            place: None,
            text: format!("{error}, in {settings}"),
        }));
    }
    found
}

/// Kinds of motion capture of which an address and an object make a valid table.
const MOCAP_BY_ADDRESS: [&str; 5] = ["relay", "datastream", "natnet", "qtm", "vrpn"];

/// Valid settings with the kind of motion capture of `settings`.
fn fly_template(settings: &Value) -> Option<String> {
    let mut template: Value = parse(BUILT_IN_FLY).ok()?;
    let kinds = settings.get("mocap").and_then(Value::as_object);
    if let Some(kind) = kinds.filter(|kinds| kinds.len() == 1).and_then(|kinds| kinds.keys().next())
        && MOCAP_BY_ADDRESS.contains(&kind.as_str())
    {
        let mut table = json!({ "address": "127.0.0.1:801", "object": "tello" });
        if kind == "vrpn" {
            table["rate_hz"] = json!(100.0);
        }
        template["mocap"] = json!({ kind: table });
    }
    Some(template.to_string())
}

/// Values of the settings without their mission.
fn check_fly(table: &FlyTable) -> Result<(), SettingError> {
    manual(table)?;
    mocap(table)?;
    moving_object(table)?;
    frame_wait(table)?;
    TelloSettings::try_from(&table.tello).map_err(|error| error.under("tello"))?;
    let Ok(mission) = parse(BUILT_IN_MISSION) else { return Ok(()) };
    match cycle::build(&flight(table, mission, Start::Grounded)) {
        Err(error) if !error.key.starts_with("mission") => Err(error),
        _ => Ok(()),
    }
}

/// Values of a mission, and of the CSV file that it names.
fn check_mission(path: &Path, table: &MissionTable) -> Result<(), Refusal> {
    let mut read = table.clone();
    if let Err(error) = read_points(path, &mut read) {
        let place = Place::of_key("trajectory.points.csv");
        let table = json!(table);
        let csv = place.of(&table).and_then(Value::as_str).unwrap_or_default();
        let file = path.with_file_name(csv).display().to_string();
        let mistakes = error.downcast_ref::<CsvErrors>().into_iter().flat_map(|errors| &errors.0);
        let problem = |CsvError { line, column, text }: &CsvError| Problem {
            file: file.clone(),
            place: Some((*line, *column)),
            text: text.clone(),
        };
        let together = mistakes.map(problem).collect();
        let text = format!("{place}: {error:#}");
        return Err(Refusal { place, text, missing: None, together });
    }
    Mission::new(&read, DT_S).map(drop).map_err(|error| {
        let together = late_rows(path, table);
        let all = Place::of_key("trajectory.points.rows");
        let place = if together.is_empty() { place_of(&error) } else { all };
        Refusal { place, text: error.to_string(), missing: None, together }
    })
}

/// Where a value of a mission stands.
fn place_of(error: &SettingError) -> Place {
    Place::of_key(&error.key.replace("trajectory.points[", "trajectory.points.rows["))
}

/// Rows of a trajectory whose times do not rise: one cannot be replaced without the others.
fn late_rows(path: &Path, table: &MissionTable) -> Vec<Problem> {
    let MissionTable::Trajectory(TrajectoryTable { points: PointsTable::Rows(rows), .. }) = table
    else {
        return Vec::new();
    };
    let text = read(path).unwrap_or_default();
    let problem = |error: SettingError| {
        let error = error.under("trajectory");
        let (file, place) = (path.display().to_string(), place_of(&error).in_text(&text));
        Problem { file, place, text: error.to_string() }
    };
    falling_times(rows).map(problem).collect()
}

fn of_file<T: DeserializeOwned>(
    path: &Path,
    template: impl Fn(&Value) -> Option<String>,
    check: impl Fn(&T) -> Result<(), Refusal>,
) -> Problems {
    let file = path.display().to_string();
    let text = match read(path) {
        Ok(text) => text,
        Err(error) => {
            let text = format!("{error:#}");
            return Problems { list: vec![Problem { file: String::new(), place: None, text }] };
        }
    };
    let mut value: Value = match serde_json::from_str(&text) {
        Ok(value) => value,
        Err(error) => {
            let place = Some((error.line(), error.column()));
            // Read again for the key; the place stands in front.
            let text =
                parse::<Value>(&text).err().map_or_else(|| error.to_string(), |it| it.to_string());
            let text =
                text.split(" at line ").next().unwrap_or_default().trim_end_matches(',').to_owned();
            let problem = Problem { file, place, text };
            return Problems { list: vec![problem] };
        }
    };
    if let Some(settings) = value.as_object_mut() {
        settings.remove(SCHEMA);
    }
    let template = template(&value).and_then(|text| parse::<Value>(&text).ok());
    let twice = doubles(&text).into_iter().map(|(place, at)| Problem {
        file: file.clone(),
        place: Some(at),
        text: format!("{place} is there twice"),
    });
    let (mut found, mut replaced) = (Problems { list: twice.collect() }, Vec::<Place>::new());
    while found.list.len() < PROBLEMS_MAX {
        let refused = match serde_path_to_error::deserialize::<_, T>(&value) {
            Ok(table) => check(&table).err(),
            Err(error) => Some(Refusal::of_shape(&error)),
        };
        let Some(refusal) = refused else { break };
        let target = refusal
            .missing
            .as_ref()
            .map_or_else(|| refusal.place.clone(), |key| refusal.place.with(key));
        if replaced.iter().any(|place| place.contains(&target) || target.contains(place)) {
            break;
        }
        if refusal.together.is_empty() {
            let place = refusal.place.in_text(&text);
            let text = refusal.text.replace(SINGLE_KEY, &single_key(target.of(&value)));
            found.list.push(Problem { file: file.clone(), place, text });
        }
        found.list.extend(refusal.together);
        let Some(template) = &template else { break };
        let wrong = named(&refusal.text, &value, template).unwrap_or(target);
        let Some(place) = replace(&mut value, template, &wrong) else { break };
        replaced.push(place);
    }
    found
}

/// What serde says of a table that stands for one of several kinds, and names none or more than one.
const SINGLE_KEY: &str = "invalid value: map, expected map with a single key";

/// The same with the keys that are there.
fn single_key(value: Option<&Value>) -> String {
    let keys = value.and_then(Value::as_object).into_iter().flat_map(|it| it.keys());
    let keys = keys.map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
    let found = if keys.is_empty() { "none" } else { &keys };
    format!("one kind is expected, found {found}")
}

/// The value that is wrong if it is not the one that is refused: a rule may name another one. That which is refused is
/// named first.
fn named(text: &str, value: &Value, template: &Value) -> Option<Place> {
    let words = text.split([' ', ':', ',']).filter(|word| !word.is_empty());
    let places = words.map(Place::of_key);
    let mut valid = places.filter_map(|place| Some((place.of(template)?.clone(), place)));
    let (first, place) = valid.next()?;
    if place.of(value) != Some(&first) {
        return None;
    }
    let is_wrong = |(valid, place): &(Value, Place)| place.of(value).is_some_and(|it| it != valid);
    valid.find(is_wrong).map(|(_, place)| place)
}

/// Puts what `template` has at `place` there, or at the next level outside that it has; what it has not at the
/// level above is removed. Where that was, unless nothing changed.
fn replace(value: &mut Value, template: &Value, place: &Place) -> Option<Place> {
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
                // A table of one kind has nothing left.
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
mod tests;
