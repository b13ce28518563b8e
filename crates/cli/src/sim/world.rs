//! The simulated world of the command line: settings, vehicle, and what is varied of it.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use tello_eval::parameter_file;
use tello_sim::plant::{PlantTable, RIGID_BODY};
use tello_sim::{Profile, SimTable};

/// The world that is flown in.
#[derive(Debug, Args)]
pub(crate) struct WorldArguments {
    /// Settings of the simulator [default: the built-in configs/sim.json].
    #[arg(long, value_name = "FILE")]
    sim_config: Option<PathBuf>,
    /// Identified parameters (model lagged): the vehicle to simulate, in place of the settings' one. Its
    /// disturbance, and its spread over seeds, stay those of the settings.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Measurement and link faults, in place of the settings' profile: `clean`, `good_day`,
    /// `typical`, `bad_day`, `mild_outages` or `outages`.
    #[arg(long)]
    profile: Option<Profile>,
    /// Change the vehicle of every seed after its draw, beside the settings' variation: `gain=0.7`
    /// (factor of the horizontal gain), `dead_time=+0.1` (added to every dead time, which stays at 0 or
    /// above; s), `lag=1.4` (factor of the horizontal time constant), `theta_0=-0.3` (added; rad).
    /// Repeatable. With a rigid body also `wind=0.5` (added to the mean speed of the wind, whose direction each seed
    /// draws; m/s) and `flow=0.1` (added to the deviation of the optical flow's error; m/s).
    #[arg(long, value_name = "WHAT=NUMBER")]
    vary: Vec<Vary>,
    /// Structure of the vehicle: `fitted` (first-order lags, as fitted to real flights) or `rigid_body`
    /// (attitude and velocity loops, drag, gusts, drifting optical flow, weakening motors) [default: that
    /// of the settings].
    #[arg(long)]
    plant: Option<PlantKind>,
}

/// Structure of the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub(crate) enum PlantKind {
    /// First-order lags.
    Fitted,
    /// A rigid body with attitude and velocity loops.
    RigidBody,
}

impl PlantKind {
    /// Gives `plant` this structure. A rigid body of the settings stays as it is set.
    pub(crate) fn apply(self, plant: &mut PlantTable) {
        plant.rigid_body = match self {
            Self::Fitted => None,
            Self::RigidBody => Some(plant.rigid_body.unwrap_or(RIGID_BODY)),
        };
    }
}

/// One change of the command line to the vehicle; its number in the unit of the kind.
#[derive(Debug, Clone, Copy)]
struct Vary {
    kind: Variation,
    number: f64,
}

/// Name, whether the number is a factor or added, and what it changes; `None`: the vehicle is no rigid body.
type Variation = (&'static str, bool, fn(&mut SimTable) -> Option<&mut f64>);

const VARIATIONS: [Variation; 6] = [
    ("gain", true, |sim| Some(&mut sim.variation.gain)),
    ("dead_time", false, |sim| Some(&mut sim.variation.dead_time_s)),
    ("lag", true, |sim| Some(&mut sim.variation.lag)),
    ("theta_0", false, |sim| Some(&mut sim.variation.theta_0)),
    ("wind", false, |sim| Some(&mut sim.plant.rigid_body.as_mut()?.wind_mps)),
    ("flow", false, |sim| Some(&mut sim.plant.rigid_body.as_mut()?.flow_drift_mps)),
];

impl FromStr for Vary {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (what, number) = text.split_once('=').context("no `=`: WHAT=NUMBER")?;
        let number = number.parse().with_context(|| format!("{number:?} is no number"))?;
        let Some(kind) = VARIATIONS.into_iter().find(|(name, ..)| *name == what) else {
            bail!("{what:?} cannot be varied: gain, dead_time, lag, theta_0, wind or flow")
        };
        Ok(Self { kind, number })
    }
}

impl Vary {
    /// # Errors
    /// Wind or optical flow, where the vehicle is no rigid body.
    fn apply(self, table: &mut SimTable) -> Result<()> {
        let (_, is_factor, changed) = self.kind;
        let value = changed(table).context("--vary wind=.. and flow=.. need --plant rigid_body")?;
        *value = if is_factor { *value * self.number } else { *value + self.number };
        Ok(())
    }
}

impl WorldArguments {
    /// The simulator's settings with what the command line replaces.
    ///
    /// # Errors
    /// A file that cannot be read or does not fit. Values are checked when a world is built.
    pub(crate) fn table(&self) -> Result<SimTable> {
        let mut table = resolve(self.sim_config.as_ref(), self.profile)?;
        parameter_file::apply(self.params.as_deref(), &mut table.plant)?;
        if let Some(kind) = self.plant {
            kind.apply(&mut table.plant);
        }
        for vary in &self.vary {
            vary.apply(&mut table)?;
        }
        Ok(table)
    }
}

/// The simulator's settings with the profile of the command line.
pub(crate) fn resolve(file: Option<&PathBuf>, profile: Option<Profile>) -> Result<SimTable> {
    let mut table = tello_sim::settings(file.map(PathBuf::as_path))?;
    table.profile = profile.unwrap_or(table.profile);
    Ok(table)
}

#[cfg(test)]
mod tests {
    use tello_sim::plant::VariationTable;

    use super::*;

    #[test]
    fn variations_move_what_they_say_and_add_up() {
        let mut table = tello_sim::settings(None).unwrap();
        for text in ["gain=0.7", "gain=2", "dead_time=+0.1", "lag=1.4", "theta_0=-0.3"] {
            text.parse::<Vary>().unwrap().apply(&mut table).unwrap();
        }
        let expected = VariationTable { gain: 1.4, dead_time_s: 0.1, lag: 1.4, theta_0: -0.3 };
        assert_eq!(table.variation, expected);
    }

    #[test]
    fn wind_and_optical_flow_need_a_rigid_body() {
        let mut table = tello_sim::settings(None).unwrap();
        let [wind, flow]: [Vary; 2] = ["wind=0.5", "flow=0.1"].map(|text| text.parse().unwrap());
        assert!(wind.apply(&mut table).is_err());
        PlantKind::RigidBody.apply(&mut table.plant);
        wind.apply(&mut table).unwrap();
        flow.apply(&mut table).unwrap();
        let body = table.plant.rigid_body.unwrap();
        assert!((body.wind_mps - RIGID_BODY.wind_mps - 0.5).abs() < 1e-12);
        assert!((body.flow_drift_mps - RIGID_BODY.flow_drift_mps - 0.1).abs() < 1e-12);
        PlantKind::Fitted.apply(&mut table.plant);
        assert_eq!(table.plant.rigid_body, None);
    }

    #[test]
    fn what_cannot_be_varied_is_refused() {
        for (text, reason) in
            [("gain", "no `=`"), ("gain=much", "is no number"), ("mass=2", "cannot be varied")]
        {
            let error = format!("{:#}", text.parse::<Vary>().unwrap_err());
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
