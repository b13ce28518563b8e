//! `tello-ctl check`: is this file valid, and what does it mean?

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use schemars::schema_for;
use serde_json::{Value, json};
use tello_eval::ident::IdentFileTable;
use tello_eval::parameter_file::ParameterFile;
use tello_flight::{Mission, MissionTable, Start, cycle};
use tello_io::config::{self, FlyTable};
use tello_sim::{DT_S, SimTable, World};

use crate::{Verdict, stdio};

/// Validate settings files and show the resolved values.
///
/// The kind of a file (fly, sim, mission, ident or params) follows from its keys. Unknown and missing keys,
/// wrong types and values outside their range are refused with file, key, value and rule.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Settings files; without any, the built-in ones.
    files: Vec<PathBuf>,
    /// Print one JSON object with the verdict on each file.
    #[arg(long)]
    json: bool,
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

/// First key of a mission.
const MISSION_KINDS: [&str; 5] = ["targets", "waypoints", "spline", "circle", "trajectory"];

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    if let Some(kind) = arguments.schema {
        let schema = match kind {
            Kind::Fly => schema_for!(FlyTable),
            Kind::Sim => schema_for!(SimTable),
            Kind::Mission => schema_for!(MissionTable),
            Kind::Ident => schema_for!(IdentFileTable),
            Kind::Params => schema_for!(ParameterFile),
        };
        stdio::line(serde_json::to_string_pretty(&schema)?)?;
        return Ok(Verdict::Good);
    }
    let mut verdict = Verdict::Good;
    let mut reports = Vec::new();
    let files: Vec<Option<&Path>> = if arguments.files.is_empty() {
        vec![None]
    } else {
        arguments.files.iter().map(|file| Some(file.as_path())).collect()
    };
    for file in files {
        let name = file.map_or_else(|| "built-in".into(), |file| file.display().to_string());
        let resolved = resolve(file);
        if resolved.is_err() {
            verdict = Verdict::Bad;
        }
        if !arguments.json {
            match &resolved {
                Ok(values) => {
                    stdio::line(format_args!(
                        "{name}: valid\n{}",
                        serde_json::to_string_pretty(values)?
                    ))?;
                }
                Err(error) => {
                    stdio::line(format_args!("{name}: refused: {}", stdio::chain(error)))?;
                }
            }
        }
        reports.push(match resolved {
            Ok(values) => json!({ "file": name, "is_valid": true, "values": values }),
            Err(error) => {
                json!({ "file": name, "is_valid": false, "error": stdio::chain(&error) })
            }
        });
    }
    if arguments.json {
        stdio::line(json!({ "files": reports }))?;
    }
    Ok(verdict)
}

/// The resolved values of a file, once everything in it is checked.
fn resolve(file: Option<&Path>) -> Result<Value> {
    let Some(path) = file else {
        return resolve_fly(None);
    };
    let keys: Value = config::load(path)?;
    if keys.get("cycle").is_some() {
        return resolve_fly(Some(path));
    }
    if MISSION_KINDS.iter().any(|kind| keys.get(kind).is_some()) {
        let table = config::mission(path)?;
        Mission::new(&table, DT_S)?;
        return Ok(serde_json::to_value(table)?);
    }
    if keys.get("profile").is_some() {
        let table: SimTable = config::load(path)?;
        World::new(&table, 0)?;
        return Ok(serde_json::to_value(table)?);
    }
    if keys.get("map").is_some() {
        let table: IdentFileTable = config::load(path)?;
        table.check()?;
        return Ok(serde_json::to_value(table)?);
    }
    if keys.get("parameters").is_some() {
        return Ok(serde_json::to_value(ParameterFile::read(path)?)?);
    }
    bail!(
        "{} is none of ours: no key \"cycle\" (fly), \"profile\" (sim), \"map\" (ident), \
         \"parameters\" (params) or one of \"{}\" (mission)",
        path.display(),
        MISSION_KINDS.join("\", \"")
    )
}

fn resolve_fly(path: Option<&Path>) -> Result<Value> {
    let (table, mission) = config::fly(path, None)?;
    let flight = config::flight(&table, mission, Start::Grounded);
    cycle::build(&flight)?;
    config::manual(&table)?;
    config::mocap(&table)?;
    let FlyTable { mocap, tello, manual, log, .. } = table;
    Ok(json!({ "flight": flight, "mocap": mocap, "tello": tello, "manual": manual, "log": log }))
}
