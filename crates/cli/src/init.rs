//! `tello-ctl init`: first settings for a room.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Args;
use schemars::schema_for;
use serde_json::{Value, json};
use tello_flight::MissionTable;
use tello_io::atomic_file;
use tello_io::config::{self, Problems, SettingProblem};
use tello_io::mocap::MocapKind;

use crate::mocap::usual_address;
use crate::{Verdict, stdio};

/// Write first settings for your room: fly.json, sim.json, two missions and their schemas.
///
/// The settings are the built-in ones with the changes of the command line; with --room, the missions and the start of
/// the simulated vehicle are in the middle of the room. Files that exist are not touched. Measure the room before you
/// fly: the walls are where the vehicle must stop, its stopping distance inside of those of the net.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl init lab --mocap relay --address 192.168.1.5:51602 --object tello --room=-2,2,-3,1,2.5
  tello-ctl init lab --mocap datastream --address 192.168.1.5:801 --object Tello1
  tello-ctl check lab/fly.json && tello-ctl fly --sim --config lab/fly.json --sim-config lab/sim.json

Exit codes: 0 written and valid, 2 could not write, or a value is refused.")]
pub(crate) struct Arguments {
    /// The folder; made if it does not exist.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Motion capture.
    #[arg(long, value_name = "KIND", default_value = "relay", value_parser = MocapKind::ALL.map(MocapKind::name))]
    mocap: String,
    /// Host and port of it; of `udp`, the port here that it sends to [default: the usual port of KIND on this machine].
    #[arg(long, value_name = "ADDRESS")]
    address: Option<String>,
    /// Name of the drone in it; `tello-ctl mocap list` shows what there is.
    #[arg(long, value_name = "NAME", default_value = "tello")]
    object: String,
    /// Walls of the room in world axes, m: smallest and largest x, smallest and largest y, ceiling.
    #[arg(long, value_name = "X,X,Y,Y,Z", allow_hyphen_values = true)]
    room: Option<Walls>,
    /// Frames per second, of `udp` and `vrpn`, which do not announce it [default: 50].
    #[arg(long, value_name = "HZ", value_parser = rate_hz)]
    rate: Option<f64>,
}

fn rate_hz(text: &str) -> Result<f64, String> {
    let rate_hz = text.parse().ok().filter(|rate_hz: &f64| rate_hz.is_finite() && *rate_hz > 0.0);
    rate_hz.ok_or_else(|| "expected frames per second, above 0".to_owned())
}

/// Smallest and largest x, smallest and largest y, largest z. m
#[derive(Debug, Clone, Copy)]
struct Walls([f64; 5]);

impl FromStr for Walls {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let numbers: Vec<f64> = text
            .split(',')
            .map(|text| {
                let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
                number.with_context(|| format!("{text:?} is no finite number"))
            })
            .collect::<Result<_>>()?;
        let count = numbers.len();
        let Ok(walls) = numbers.try_into() else { bail!("{count} numbers in place of five") };
        Ok(Self(walls))
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let Arguments { dir, mocap, rate, .. } = arguments;
    let kind = MocapKind::named(mocap)
        .with_context(|| format!("`{mocap}` is no kind of motion capture"))?;
    if rate.is_some() && !kind.has_set_rate() {
        bail!("--rate is for udp and vrpn: {mocap} announces its own");
    }
    let files = first_files(arguments, kind)?;
    let is_new = !dir.exists();
    fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    for (name, _) in &files {
        let path = dir.join(name);
        ensure!(!path.exists(), "{} exists already: choose another folder", path.display());
    }
    for (name, value) in &files {
        atomic_file::write_json(&dir.join(name), false, value)?;
    }
    let mut missions = "square.json, hover.json";
    let problems = config::fly_problems(Some(&dir.join("fly.json")), None).list;
    if !problems.is_empty() {
        if fits_hover(dir)? {
            stdio::note("note: the room is too small for the square: fly.json flies hover.json");
            missions = "hover.json";
        } else {
            for (name, _) in &files {
                fs::remove_file(dir.join(name))?;
            }
            if is_new {
                fs::remove_dir(dir)?;
            }
            return Err(refusal(arguments, problems));
        }
    }
    let fly = dir.join("fly.json").display().to_string();
    let quote = if fly.contains(char::is_whitespace) { "'" } else { "" };
    stdio::line(format_args!(
        "wrote fly.json, sim.json, {missions} and their schemas to {}\nnext: tello-ctl check {quote}{fly}{quote}",
        dir.display()
    ))?;
    if kind == MocapKind::Natnet {
        stdio::note(
            "Motive streams with y up unless its up axis is set to z: tello-ctl mocap watch shows it",
        );
    }
    Ok(Verdict::Good)
}

/// The files of `init` with their names: the built-in ones with the changes of the command line.
fn first_files(arguments: &Arguments, kind: MocapKind) -> Result<[(&'static str, Value); 6]> {
    let Arguments { address, object, room, rate, .. } = arguments;
    let (table, square) = config::fly(None, None)?;
    let mut fly = with_schema("fly.schema.json", serde_json::to_value(table)?);
    fly["mission"] = json!("square.json");
    let address = address.clone().unwrap_or_else(|| usual_address(kind, "127.0.0.1"));
    fly["mocap"] = json!(kind.table(address, object.clone(), rate.unwrap_or(50.0)));
    let mut square = serde_json::to_value(square)?;
    let mut hover: Value =
        serde_json::from_str(include_str!("../../../configs/missions/hover.json"))?;
    let mut sim: Value = serde_json::from_str(tello_sim::BUILT_IN)?;
    if let Some(Walls([x_0, x_1, y_0, y_1, z])) = room {
        let room = &mut fly["cycle"]["supervisor"]["room"];
        (room["x_m"], room["y_m"]) = (json!([x_0, x_1]), json!([y_0, y_1]));
        let low_m = room["z_m"].get(0).cloned();
        room["z_m"] = json!([low_m, z]);
        let middle @ [x, y] = [f64::midpoint(*x_0, *x_1), f64::midpoint(*y_0, *y_1)];
        centre(&mut square["waypoints"]["waypoints"], 0, middle);
        centre(&mut hover["trajectory"]["points"]["rows"], 1, middle);
        let start = &mut sim["start"]["ground"];
        (start["x"], start["y"]) = (json!(x), json!(y));
    }
    Ok([
        ("fly.schema.json", serde_json::to_value(schema_for!(config::FlyTable))?),
        ("mission.schema.json", serde_json::to_value(schema_for!(MissionTable))?),
        ("square.json", with_schema("mission.schema.json", square)),
        ("hover.json", with_schema("mission.schema.json", hover)),
        ("sim.json", sim),
        ("fly.json", fly),
    ])
}

/// Why `init` writes nothing. A mission that the person never wrote is no mistake of theirs.
fn refusal(arguments: &Arguments, problems: Vec<SettingProblem>) -> anyhow::Error {
    let path = arguments.dir.join("fly.json");
    let is_own = |problem: &SettingProblem| Path::new(&problem.file) == path;
    let reason = if problems.iter().any(is_own) || arguments.room.is_none() {
        ""
    } else {
        "the room is too small for the missions that come with it: "
    };
    anyhow!("nothing is written: {reason}{}", Problems { list: problems })
}

/// Lets the settings in `dir` fly `hover.json` in place of the square, if that is all they need.
fn fits_hover(dir: &Path) -> Result<bool> {
    let (path, hover) = (dir.join("fly.json"), dir.join("hover.json"));
    if !config::fly_problems(Some(&path), Some(&hover)).list.is_empty() {
        return Ok(false);
    }
    let mut fly: Value = config::load(&path)?;
    fly["mission"] = json!("hover.json");
    atomic_file::write_json(&path, true, &fly)?;
    fs::remove_file(dir.join("square.json"))?;
    Ok(true)
}

/// Moves the points of a mission, whose x and y stand from `column` on, to lie around `middle`.
fn centre(points: &mut Value, column: usize, middle: [f64; 2]) {
    let Value::Array(points) = points else { return };
    for (axis, middle) in [column, column + 1].into_iter().zip(middle) {
        let values = points.iter().filter_map(|point| point[axis].as_f64());
        let (low, high) =
            values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        for point in points.iter_mut() {
            if let Some(value) = point[axis].as_f64() {
                point[axis] = json!(value - f64::midpoint(low, high) + middle);
            }
        }
    }
}

/// `value` that names its schema, for editors.
fn with_schema(schema: &str, value: Value) -> Value {
    let mut named = json!({ "$schema": schema });
    if let (Value::Object(named), Value::Object(value)) = (&mut named, value) {
        named.extend(value);
    }
    named
}

#[cfg(test)]
mod tests;
