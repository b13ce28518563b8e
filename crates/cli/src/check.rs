//! `tello-ctl check`: is this file valid, and what does it mean?

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use horizon_model::rows::pose;
use schemars::{Schema, schema_for};
use serde::Serialize;
use serde_json::{Value, json};
use tello_eval::figure::{self, FigureFiles, SeenFlights};
use tello_eval::ident::IdentFileTable;
use tello_eval::metrics::Surroundings;
use tello_eval::parameter_file::{self, ParameterFile};
use tello_flight::cycle::{self, FlightTable};
use tello_flight::{Mission, MissionTable, PathPoint, SPEED_AS_WRITTEN, Start, Survey};
use tello_io::config::{self, FlyTable};
use tello_sim::{NominalFlight, SimTable};

use crate::{Verdict, stdio};

/// Validate settings files and show the resolved values.
///
/// The kind of a file (fly, sim, mission, ident or params) follows from its keys. Unknown and missing keys,
/// wrong types and values outside their range are refused, all at once, with file, line, key, value and rule; so are,
/// as by `fly`, a mission that leaves the room or is faster than a vehicle can be, and parameters outside the bounds
/// of the estimator. Of a mission it prints length, time, box, speeds, the distance to the walls, where the vehicle
/// will not keep up, and what becomes of it in the simulator without noise, spread and faults. JSON Schemas among the
/// files are passed over.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 all valid, 1 a file is refused or cannot be read, or the simulator does not get to the \
end of a mission, 2 could not run."
)]
pub(crate) struct Arguments {
    /// Settings files; without any, that of --config or the built-in ones.
    files: Vec<PathBuf>,
    /// Print one JSON object with the verdict on each file.
    #[arg(long)]
    json: bool,
    /// Settings of the flight for files that are missions or parameters [default: the first settings of `fly` among
    /// the files, or the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// How fast a mission is flown, 0.1 to 1: 0.5 as it is written, 1 at the limit of the vehicle.
    #[arg(long, value_name = "SPEED", default_value_t = SPEED_AS_WRITTEN)]
    speed: f64,
    /// Draw the mission from above, as NAME.svg and NAME.png.
    #[arg(long, value_name = "NAME")]
    figure: Option<PathBuf>,
    /// Replace a figure that exists.
    #[arg(long, requires = "figure")]
    force: bool,
    /// Print the JSON Schema of a kind of file, for editors, and leave.
    #[arg(long, value_name = "KIND", conflicts_with = "files")]
    schema: Option<Kind>,
}

/// Kind of a settings file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Settings of `tello-ctl fly`.
    Fly,
    /// Settings of the simulator.
    Sim,
    /// A mission: targets, a path or a trajectory.
    Mission,
    /// Settings of `tello-ctl ident`.
    Ident,
    /// Identified parameters.
    Params,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    if let Some(kind) = arguments.schema {
        stdio::line(serde_json::to_string_pretty(&schema(kind))?)?;
        return Ok(Verdict::Good);
    }
    // Mistakes of the command line are none of the files.
    let (built_in, mission) = config::fly(None, None)?;
    config::flight(&built_in, mission, Start::Grounded).at_speed(arguments.speed)?;
    if let Some(config) = arguments.config.as_deref().filter(|_| !arguments.files.is_empty()) {
        config::load::<Value>(config)?;
    }
    let place = arguments.figure.as_deref().map(|name| FigureFiles::of(name, arguments.force));
    let place = place.transpose()?;
    let files: Vec<Option<&Path>> = if arguments.files.is_empty() {
        vec![arguments.config.as_deref()]
    } else {
        arguments.files.iter().map(|file| Some(file.as_path())).collect()
    };
    let fly_settings = arguments.config.as_deref().or_else(|| {
        let mut settings = files.iter().flatten().copied();
        settings.find(|file| config::load::<Value>(file).is_ok_and(|it| it.get("cycle").is_some()))
    });
    let mut verdict = Verdict::Good;
    let mut reports = Vec::new();
    for file in files {
        if let Some(schema) = file.filter(|file| is_schema(file)) {
            // As `init` writes them beside the settings, for editors.
            stdio::note(format_args!("{}: a JSON Schema, passed over", schema.display()));
            continue;
        }
        let name = file.map_or_else(|| "built-in".into(), |file| file.display().to_string());
        let checked = check_file(file, fly_settings, arguments.speed);
        if let (Some(place), Ok(Checked { mission: Some(mission), .. })) = (&place, &checked) {
            mission.draw(place)?;
        }
        if !checked.as_ref().is_ok_and(Checked::is_good) {
            verdict = Verdict::Bad;
        }
        if !arguments.json {
            print(&name, &checked)?;
        }
        reports.push(report(&name, &checked));
    }
    if arguments.json {
        stdio::line(json!({ "files": reports }))?;
    }
    Ok(verdict)
}

/// A valid file.
struct Checked {
    values: Value,
    /// `None` for a file without a mission.
    mission: Option<CheckedMission>,
}

impl Checked {
    fn is_good(&self) -> bool {
        self.mission.as_ref().is_none_or(|mission| mission.look.nominal.is_finished())
    }
}

/// Checks `file`, with `fly_settings` as settings of the flight of a mission or of parameters, at `speed`.
fn check_file(file: Option<&Path>, fly_settings: Option<&Path>, speed: f64) -> Result<Checked> {
    let values = resolve(fly_settings, file)?;
    let mission = CheckedMission::of(&values, fly_settings, speed)?;
    Ok(Checked { values, mission })
}

/// The verdict on the file `name`, for the JSON object.
fn report(name: &str, checked: &Result<Checked>) -> Value {
    match checked {
        Ok(Checked { values, mission }) => {
            let look = mission.as_ref().map(|mission| &mission.look);
            json!({ "file": name, "is_valid": true, "values": values, "mission": look })
        }
        Err(error) => json!({ "file": name, "is_valid": false, "error": stdio::chain(error) }),
    }
}

/// Whether `file` is a JSON Schema in place of settings.
fn is_schema(file: &Path) -> bool {
    let text = config::read(file).unwrap_or_default();
    // Not as settings, which are read without the name of their schema.
    let keys: Value = serde_json::from_str(&text).unwrap_or_default();
    let schema = keys.get("$schema").and_then(Value::as_str);
    let is_one = schema.is_some_and(|schema| schema.starts_with("https://json-schema.org/"));
    is_one && keys.get("title").is_some()
}

/// The JSON schema of a kind of file.
fn schema(kind: Kind) -> Schema {
    match kind {
        Kind::Fly => schema_for!(FlyTable),
        Kind::Sim => schema_for!(SimTable),
        Kind::Mission => schema_for!(MissionTable),
        Kind::Ident => schema_for!(IdentFileTable),
        Kind::Params => schema_for!(ParameterFile),
    }
}

/// Prints the verdict on the file `name` as text.
fn print(name: &str, checked: &Result<Checked>) -> Result<()> {
    let Checked { values, mission } = match checked {
        Ok(checked) => checked,
        Err(error) => {
            return stdio::line(format_args!("{name}: refused: {}", stdio::chain(error)));
        }
    };
    let values = serde_json::to_string_pretty(values)?;
    stdio::line(format_args!("{name}: valid\n{values}"))?;
    match mission {
        Some(mission) => stdio::line(format_args!("mission\n{}", mission.look)),
        None => Ok(()),
    }
}

/// The resolved values of a file, once everything in it is checked.
fn resolve(fly_settings: Option<&Path>, file: Option<&Path>) -> Result<Value> {
    let Some(path) = file else {
        return resolve_fly(None);
    };
    let keys: Value = match config::load(path) {
        Ok(keys) => keys,
        // With a key that occurs twice, among the other mistakes of its kind.
        Err(_) if is_flight(path) => return resolve_fly(Some(path)),
        Err(error) => {
            // Not JSON: every kind of file gets the same message, with line and column.
            config::mission_problems(path).into_result()?;
            return Err(error);
        }
    };
    let has = |key: &str| keys.get(key).is_some();
    if has("cycle") {
        return resolve_fly(Some(path));
    }
    if MissionTable::NAMES.iter().any(|kind| has(kind)) {
        let found = config::fly_problems(fly_settings, Some(path)).into_result();
        found.with_context(|| {
            let fly_settings =
                fly_settings.map_or_else(|| "the built-in one".into(), Path::to_string_lossy);
            format!("in the room of --config, {fly_settings}")
        })?;
        return Ok(serde_json::to_value(config::mission(path)?)?);
    }
    if has("profile") {
        return Ok(serde_json::to_value(tello_sim::settings(Some(path))?)?);
    }
    if has("map") {
        return Ok(serde_json::to_value(tello_eval::ident::settings(Some(path))?)?);
    }
    if has("parameters") {
        let file = ParameterFile::read(path)?;
        let (mut table, mission) = config::fly(fly_settings, None)?;
        // Without settings a file of another model is for others than the built-in ones, or for the simulator.
        if fly_settings.is_some() || table.cycle.model == file.model {
            parameter_file::apply(Some(path), &mut table.cycle)?;
            cycle::build(&config::flight(&table, mission, Start::Grounded))
                .with_context(|| parameter_file::of(path))?;
        }
        return Ok(serde_json::to_value(file)?);
    }
    let found = keys.as_object().into_iter().flatten().map(|(key, _)| format!("`{key}`"));
    let found = found.collect::<Vec<_>>().join(", ");
    bail!(
        "{}: unknown kind of file: found {}, no key \"cycle\" (fly), \"profile\" (sim), \"map\" (ident), \
         \"parameters\" (params) or one of \"{}\" (mission)",
        path.display(),
        if found.is_empty() { "none" } else { &found },
        MissionTable::NAMES.join("\", \"")
    )
}

/// Whether a file that cannot be loaded is JSON with settings of a flight.
fn is_flight(path: &Path) -> bool {
    let text = config::read(path).unwrap_or_default();
    serde_json::from_str::<Value>(&text).is_ok_and(|keys| keys.get("cycle").is_some())
}

fn resolve_fly(path: Option<&Path>) -> Result<Value> {
    config::fly_problems(path, None).into_result()?;
    let (table, mission) = config::fly(path, None)?;
    let flight = config::flight(&table, mission, Start::Grounded);
    let FlyTable { mocap, tello, manual, log, .. } = table;
    Ok(json!({ "flight": flight, "mocap": mocap, "tello": tello, "manual": manual, "log": log }))
}

/// What a mission is like, and how far it stays from the walls of the room.
#[derive(Debug, Serialize)]
pub(crate) struct Look {
    #[serde(flatten)]
    survey: Survey,
    /// Least distance to a wall; null without a room. m
    pub(crate) room_margin_m: Option<f64>,
    /// Least distance of the path to an obstacle, negative inside of one; null without obstacles. m
    pub(crate) obstacle_margin_m: Option<f64>,
    /// What the vehicle does not follow.
    notes: Vec<String>,
    /// What becomes of it in the simulator.
    nominal: NominalFlight,
}

/// A mission with its surroundings and what was found about it.
pub(crate) struct CheckedMission {
    pub(crate) look: Look,
    mission: Mission,
    around: Surroundings,
}

impl CheckedMission {
    /// The mission in `values`, of a mission file or of settings; `None` for another kind of file. A mission file is
    /// flown with the settings `fly_settings`, at `speed`.
    fn of(values: &Value, fly_settings: Option<&Path>, speed: f64) -> Result<Option<Self>> {
        let table = values.pointer("/flight/mission").unwrap_or(values);
        let Ok(mission) = config::from_value::<MissionTable>(table) else {
            return Ok(None);
        };
        let flight: FlightTable = match values.pointer("/flight") {
            Some(flight) => config::from_value(flight)?,
            None => config::flight(&config::fly(fly_settings, None)?.0, mission, Start::Grounded),
        };
        Self::at(&flight.at_speed(speed)?).map(Some)
    }

    /// The mission of a flight, in its room.
    pub(crate) fn at(flight: &FlightTable) -> Result<Self> {
        let around = Surroundings::of(&flight.cycle)?;
        let mission = Mission::new(&flight.mission, flight.cycle.dt_s)?;
        let survey = mission.survey();
        let room = flight.cycle.supervisor.room.as_ref();
        let room_margin_m = room.map(|room| survey.margin_m(room.walls_m()));
        let obstacle_margin_m = mission.clearance_m(around.obstacles());
        let notes = cycle::notes(&mission, &flight.cycle);
        let nominal = NominalFlight::fly(flight)?;
        let look = Look { survey, room_margin_m, obstacle_margin_m, notes, nominal };
        Ok(Self { look, mission, around })
    }

    /// Draws the mission from above, with the obstacles.
    fn draw(&self, place: &FigureFiles) -> Result<()> {
        let outline = self.mission.outline();
        let outline: Vec<(f64, f64)> =
            outline.iter().map(|at| (at[pose::X], at[pose::Y])).collect();
        let tracks = vec![outline.clone()];
        let seen = [SeenFlights { name: "mission", outline, tracks }];
        let title = format!("{}: the mission from above", place.stem());
        place.save(&figure::tracks_among(&title, &seen, &self.around.outlines()))?;
        Ok(())
    }
}

impl Display for Look {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { survey, room_margin_m, obstacle_margin_m, notes, nominal } = self;
        let Survey { length_m, duration_s, low_w, high_w, fastest, slowest } = survey;
        writeln!(f, "  length   {length_m:.2} m")?;
        let planned =
            if fastest.is_some() { "as planned" } else { "at a guess: targets have no speed" };
        writeln!(f, "  time     {duration_s:.1} s {planned}")?;
        let axes = ["x", "y", "z"].into_iter().zip(low_w.iter().zip(high_w));
        let spans: Vec<String> =
            axes.map(|(name, (low, high))| format!("{name} {low:.2}..{high:.2}")).collect();
        writeln!(f, "  box      {} m", spans.join(", "))?;
        for (name, part) in [("fastest", fastest), ("slowest", slowest)] {
            if let Some(PathPoint { at_w: [x, y, z], at_s, speed_mps }) = part {
                writeln!(
                    f,
                    "  {name}  {speed_mps:.2} m/s at {x:.2}, {y:.2}, {z:.2} m after {at_s:.1} s"
                )?;
            }
        }
        match room_margin_m {
            Some(margin) => writeln!(f, "  room     {margin:.2} m or more to its walls")?,
            None => writeln!(f, "  room     none is set: a real drone does not fly without one")?,
        }
        match obstacle_margin_m {
            Some(margin) if *margin < 0.0 => {
                writeln!(f, "  obstacle {:.2} m INSIDE: the plan flies around it", margin.abs())?;
            }
            Some(margin) if margin.is_finite() => {
                writeln!(f, "  obstacle {margin:.2} m or more to each")?;
            }
            // One that moves is nowhere yet.
            Some(_) | None => {}
        }
        writeln!(f, "  flown    in the simulator: {nominal}")?;
        notes.iter().try_for_each(|note| writeln!(f, "  note     {note}"))
    }
}

#[cfg(test)]
mod tests;
