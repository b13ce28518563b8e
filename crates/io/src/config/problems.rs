//! Every mistake of a settings file at once, each with its place in the file.
//!
//! Reading and checking stop at the first mistake. Here each mistake is noted, its value replaced by what a
//! valid file has in the same place, and the file is read and checked again, until nothing is left. What follows from
//! a replacement is not the file's mistake: its value is replaced and not noted.

mod malformed_json;
mod repair;
mod serde_messages;
mod templates;

use std::error::Error;
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use horizon_model::setting::SettingError;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tello_flight::cycle::DT_S;
use tello_flight::{
    CsvError, CsvErrors, Mission, MissionTable, PointsTable, Start, TrajectoryTable, cycle,
    falling_times,
};

use super::named::unnamed;
use super::place::{KeyPath, Step, doubles};
use super::{
    BUILT_IN_MISSION, FlyTable, SCHEMA, flight, frame_wait, from_value, manual, mocap,
    moving_object, parse, read, read_points,
};
use crate::tello::TelloSettings;
use malformed_json::finite_text;
use repair::{other_wrong, replace};
use serde_messages::{named_places, plain, single_key};
use templates::{fly_template, mission_template};

/// Most mistakes that are looked for in a file.
const PROBLEMS_MAX: usize = 50;

/// Most values that are replaced to find them.
const REPLACED_MAX: usize = 200;

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SettingProblem {
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
    pub list: Vec<SettingProblem>,
}

impl Problems {
    /// `Ok` without mistakes.
    ///
    /// # Errors
    /// All mistakes that were found.
    pub fn into_result(self) -> Result<(), Self> {
        if self.list.is_empty() { Ok(()) } else { Err(self) }
    }
}

impl Display for SettingProblem {
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
    place: KeyPath,
    text: String,
    kind: RefusalKind,
}

enum RefusalKind {
    /// The value at the place is wrong.
    Value,
    /// The table at the place has no such key.
    Missing(String),
    /// Mistakes that are found together, or in another file; they stand in place of the text.
    Together(Vec<SettingProblem>),
}

impl From<SettingError> for Refusal {
    fn from(error: SettingError) -> Self {
        let (place, text) = (KeyPath::of_key(&error.key), error.to_string());
        Self { place, text, kind: RefusalKind::Value }
    }
}

impl RefusalKind {
    /// Of these mistakes; without any the text counts.
    fn together(problems: Vec<SettingProblem>) -> Self {
        if problems.is_empty() { Self::Value } else { Self::Together(problems) }
    }
}

impl Refusal {
    /// Path of the value to replace: the missing one, the refused one, or the whole table of another kind.
    fn target(&self) -> KeyPath {
        match (&self.kind, self.place.0.last()) {
            (RefusalKind::Missing(key), _) if key != "kind" => self.place.with(key),
            (RefusalKind::Value | RefusalKind::Together(_), Some(Step::Key(key)))
                if key == "kind" =>
            {
                self.place.head(self.place.0.len() - 1)
            }
            _ => self.place.clone(),
        }
    }

    fn of_shape(error: &serde_path_to_error::Error<serde_json::Error>) -> Self {
        let mut place = KeyPath::of_path(error.path());
        let message = plain(&error.inner().to_string());
        let named = |start: &str| {
            let rest = message.strip_prefix(start)?;
            rest.split('`').next().map(str::to_owned)
        };
        let missing = named("missing field `").map(RefusalKind::Missing);
        if let Some(unknown) = named("unknown field `")
            && place.0.last() != Some(&Step::Key(unknown.clone()))
        {
            place = place.with(&unknown);
        }
        let key = place.to_string();
        let text = if key.is_empty() { message } else { format!("{key}: {message}") };
        Self { place, text, kind: missing.unwrap_or(RefusalKind::Value) }
    }
}

/// All mistakes of the settings file `path`; a file that cannot be read is one mistake. `template` makes a valid file
/// with the lists and kinds of the given one, `check` names the first value that breaks its rule.
pub fn problems<T: DeserializeOwned>(
    path: &Path,
    template: impl Fn(&Value) -> Option<Value>,
    check: impl Fn(&T) -> Result<(), SettingError>,
) -> Problems {
    let check = |table: &T| check(table).map_err(Refusal::from);
    of_file(path, template, check)
}

/// All mistakes of a mission.
pub fn mission_problems(path: &Path) -> Problems {
    of_file(path, mission_template, |table: &MissionTable| check_mission(path, table))
}

/// All mistakes of the settings of `fly` and of their mission. A mission that cannot be read hides nothing of
/// the settings.
pub fn fly_problems(path: Option<&Path>, mission: Option<&Path>) -> Problems {
    let check = |table: &FlyTable| check_fly(table).map_err(Refusal::from);
    let mut found = path.map_or_else(Problems::default, |path| of_file(path, fly_template, check));
    found.list.extend(path.map(unnamed_keys).unwrap_or_default());
    let from_settings = if mission.is_none() { path.and_then(named_mission) } else { None };
    let named = mission.map(Path::to_owned).or(from_settings.clone());
    if let Some(file) = &named {
        let mut in_mission = mission_problems(file).list;
        // A mission that cannot be read is a mistake of the settings that name it.
        if let ([unread], Some(path), Some(_)) = (&mut *in_mission, path, &from_settings)
            && unread.file.is_empty()
        {
            let key = KeyPath::of_key("mission");
            let place = read(path).ok().and_then(|text| key.in_text(&text));
            let text = format!("{key}: {}", unread.text);
            *unread = SettingProblem { file: path.display().to_string(), place, text };
        }
        found.list.extend(in_mission);
    }
    if found.list.is_empty()
        && let Ok((table, mission)) = super::read_fly(path, mission)
    {
        found.list = misfits(&table, &mission, path, named.as_deref());
    }
    found
}

/// The keys that settings have to name and the file `path` does not.
fn unnamed_keys(path: &Path) -> Vec<SettingProblem> {
    let text = read(path).unwrap_or_default();
    let settings: Value = serde_json::from_str(&text).unwrap_or_default();
    let problem = |(parent, missing): (KeyPath, String)| SettingProblem {
        file: path.display().to_string(),
        place: parent.in_text(&text),
        text: missing,
    };
    unnamed(&settings).map(problem).collect()
}

/// The mission that the settings in `path` name.
fn named_mission(path: &Path) -> Option<PathBuf> {
    let settings: Value = serde_json::from_str(&read(path).ok()?).ok()?;
    Some(path.with_file_name(settings.get("mission")?.as_str()?))
}

/// Why `mission`, of the file `named`, does not fit the settings `table` of the file `path`.
fn misfits(
    table: &FlyTable,
    mission: &MissionTable,
    path: Option<&Path>,
    named: Option<&Path>,
) -> Vec<SettingProblem> {
    let whole = Mission::new(mission, table.cycle.dt_s)
        .and_then(|whole| cycle::misfits(mission, &whole, &table.cycle));
    let text = named.and_then(|file| read(file).ok()).unwrap_or_default();
    let file = named.map(|path| path.display().to_string()).unwrap_or_default();
    let settings = path.map_or("the built-in settings".into(), |path| path.display().to_string());
    let problem = |mut error: SettingError| {
        // A pose of the file has its place there, the whole mission has none.
        let key = error.key.strip_prefix("mission.").map(str::to_owned);
        let place = key.as_deref().and_then(|key| KeyPath::of_key(key).in_text(&text));
        error.key = key.unwrap_or(error.key);
        SettingProblem { file: file.clone(), place, text: format!("{error}, in {settings}") }
    };
    whole.unwrap_or_default().into_iter().map(problem).collect()
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
        let place = KeyPath::of_key("trajectory.points.csv");
        let table = json!(table);
        let csv = place.of(&table).and_then(Value::as_str).unwrap_or_default();
        let file = path.with_file_name(csv).display().to_string();
        let mistakes = error.downcast_ref::<CsvErrors>().into_iter().flat_map(|errors| &errors.0);
        let problem = |CsvError { line, column, text }: &CsvError| SettingProblem {
            file: file.clone(),
            place: Some((*line, *column)),
            text: text.clone(),
        };
        let kind = RefusalKind::together(mistakes.map(problem).collect());
        let text = format!("{place}: {error:#}");
        return Err(Refusal { place, text, kind });
    }
    Mission::new(&read, DT_S).map(drop).map_err(|error| {
        let kind = RefusalKind::together(late_rows(path, table));
        let place = match &kind {
            RefusalKind::Together(_) => KeyPath::of_key("trajectory.points.rows"),
            RefusalKind::Value | RefusalKind::Missing(_) => place_of(&error),
        };
        Refusal { place, text: error.to_string(), kind }
    })
}

/// Where a value of a mission stands.
fn place_of(error: &SettingError) -> KeyPath {
    KeyPath::of_key(&error.key.replace("trajectory.points[", "trajectory.points.rows["))
}

/// Rows of a trajectory whose times do not rise: one cannot be replaced without the others.
fn late_rows(path: &Path, table: &MissionTable) -> Vec<SettingProblem> {
    let MissionTable::Trajectory(TrajectoryTable { points: PointsTable::Rows(rows), .. }) = table
    else {
        return Vec::new();
    };
    let text = read(path).unwrap_or_default();
    let problem = |error: SettingError| {
        let error = error.under("trajectory");
        let (file, place) = (path.display().to_string(), place_of(&error).in_text(&text));
        SettingProblem { file, place, text: error.to_string() }
    };
    falling_times(rows).map(problem).collect()
}

/// All mistakes of a file.
fn of_file<T: DeserializeOwned>(
    path: &Path,
    template: impl Fn(&Value) -> Option<Value>,
    check: impl Fn(&T) -> Result<(), Refusal>,
) -> Problems {
    let file = path.display().to_string();
    let text = match read(path) {
        Ok(text) => text,
        Err(error) => {
            let text = format!("{error:#}");
            return Problems {
                list: vec![SettingProblem { file: String::new(), place: None, text }],
            };
        }
    };
    let mut found = Problems::default();
    let (text, replaced) = finite_text(text, &file, &mut found);
    let mut value: Value = match serde_json::from_str(&text) {
        Ok(value) => value,
        Err(error) => {
            found.list.push(SettingProblem::of_text(&text, file, &error));
            return found;
        }
    };
    if let Some(settings) = value.as_object_mut() {
        settings.remove(SCHEMA);
    }
    found.list.extend(doubles(&text).into_iter().map(|(place, at)| SettingProblem {
        file: file.clone(),
        place: Some(at),
        text: format!("{place} occurs twice"),
    }));
    let template = template(&value);
    Search { file, text, value, template, replaced, found }.run(check)
}

/// Search for the mistakes of one file: each refused value is noted and replaced by that of a valid file.
struct Search {
    file: String,
    text: String,
    /// The settings with the replacements so far.
    value: Value,
    /// A valid file; `None`: nothing can be replaced.
    template: Option<Value>,
    /// Places of the replacements.
    replaced: Vec<KeyPath>,
    found: Problems,
}

impl Search {
    /// Reads and checks until nothing is refused, nothing can be replaced, or a limit is reached.
    fn run<T: DeserializeOwned>(mut self, check: impl Fn(&T) -> Result<(), Refusal>) -> Problems {
        for _ in 0..REPLACED_MAX {
            let refused = match from_value::<T>(&self.value) {
                Ok(table) => check(&table).err(),
                Err(error) => Some(Refusal::of_shape(&error)),
            };
            let refused = refused.filter(|_| self.found.list.len() < PROBLEMS_MAX);
            if !refused.is_some_and(|refusal| self.repair(refusal)) {
                break;
            }
        }
        self.found
    }

    /// Notes a refusal, unless it follows from a replacement, and replaces its value. Returns whether a value was
    /// replaced.
    fn repair(&mut self, refusal: Refusal) -> bool {
        let target = refusal.target();
        let names = self.template.as_ref().map_or_else(Vec::new, |template| {
            named_places(&refusal.text, &refusal.place, template)
        });
        let touches = |place: &KeyPath| place.contains(&target) || target.contains(place);
        if !self.replaced.iter().any(|place| touches(place) || names.contains(place)) {
            if let RefusalKind::Together(problems) = refusal.kind {
                self.found.list.extend(problems);
            } else {
                let place = refusal.place.in_text(&self.text);
                let text = single_key(&refusal.text, target.of(&self.value));
                self.found.list.push(SettingProblem { file: self.file.clone(), place, text });
            }
        }
        let Some(template) = &self.template else { return false };
        let wrong = other_wrong(&refusal.place, &names, &self.value, template).unwrap_or(target);
        let replaced = replace(&mut self.value, template, &wrong);
        let is_replaced = replaced.is_some();
        self.replaced.extend(replaced);
        is_replaced
    }
}

#[cfg(test)]
mod tests;
