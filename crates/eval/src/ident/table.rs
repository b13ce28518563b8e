//! Settings of an identification, as written in JSON.

use std::path::PathBuf;

use crate::outage::{OutageSettings, OutageTable};
use horizon_estim::{DelaySettings, DelayTable, IdentTable};
use horizon_model::rows::{pose, stick};
use horizon_model::setting::{SettingError, in_range, vector};
use horizon_model::{Kinematic, Model};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use tello_flight::cycle::{ModelKind, WithModel};

/// Settings of `tello-ctl ident`: one file, every key required.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentFileTable {
    /// The vehicle model.
    pub model: ModelKind,
    /// Period of the logs. s, 0.005..=0.1
    pub dt_s: f64,
    /// Added to the yaw of every log, for an object that was defined turned. rad
    pub turn_rad: f64,
    /// From sending a stick until it acts: roll, pitch, yaw, throttle. s, 0..=2
    pub dead_time_s: Vec<f64>,
    /// Sticks that have one dead time, for the search.
    pub dead_time_groups: Vec<Vec<Stick>>,
    /// How the dead times are searched by their likelihood, from `dead_time_s` on; null keeps them.
    pub delay: Option<DelayTable>,
    /// Logs and folders of logs that are read when the command line names none.
    pub logs: Vec<PathBuf>,
    /// Most logs that are read; further ones are named and left out. 1..=100000
    pub logs_max: usize,
    /// Whether a smoother first leaves out stalls, outages and heading flips.
    pub clean_observations: bool,
    /// How periods in which the drone ignores its sticks are found, to be left out; null keeps them.
    pub lost_commands: Option<OutageTable>,
    /// Shortest piece into which a log is split. steps, 2..=1000000
    pub piece_steps_min: usize,
    /// Weights, prior, bounds and losses of the estimate, and its solver.
    pub map: IdentTable,
    /// Threads to use, 0 for all. 0..=1024
    pub threads: usize,
    /// Whether estimates of an earlier run are deleted first.
    pub clear_estimates: bool,
}

impl IdentFileTable {
    /// Checks the range of every value, and that no stick is in two groups of dead times.
    ///
    /// # Errors
    /// The first key that breaks its rule.
    pub fn check(&self) -> Result<(), SettingError> {
        in_range("dt_s", self.dt_s, 0.005..=0.1)?;
        in_range("turn_rad", self.turn_rad, -10.0..=10.0)?;
        in_range("logs_max", self.logs_max, 1..=100_000)?;
        in_range("piece_steps_min", self.piece_steps_min, 2..=1_000_000)?;
        in_range("threads", self.threads, 0..=1024)?;
        let mut sticks: Vec<Stick> = self.dead_time_groups.iter().flatten().copied().collect();
        let count = sticks.len();
        sticks.sort_unstable();
        sticks.dedup();
        let is_empty = self.dead_time_groups.iter().any(Vec::is_empty);
        if sticks.len() < count || is_empty {
            let rule = "groups of at least one stick, each stick once";
            let value = format!("{:?}", self.dead_time_groups);
            return Err(SettingError::new("dead_time_groups", value, rule));
        }
        vector("dead_time_s", &self.dead_time_s, &Kinematic::INPUT, |key, value| {
            in_range(key, value, 0.0..=2.0)
        })?;
        let reach_s = self.delay.as_ref().map_or(f64::INFINITY, |delay| delay.dead_time_max_s);
        for stick in sticks {
            let dead_time_s = self.dead_time_s[stick.row()];
            if dead_time_s > reach_s {
                let rule =
                    format!("at most delay.dead_time_max_s = {reach_s}: its search begins there");
                let key = format!("dead_time_s[{}]", stick.row());
                return Err(SettingError::new(key, dead_time_s, rule));
            }
        }
        let under = |section: &'static str| move |error: SettingError| error.under(section);
        self.delay.as_ref().map(DelaySettings::try_from).transpose().map_err(under("delay"))?;
        let lost_commands = self.lost_commands.as_ref().map(OutageSettings::try_from).transpose();
        lost_commands.map_err(under("lost_commands"))?;
        self.model.with(CheckMap(&self.map)).map_err(under("map"))
    }
}

struct CheckMap<'a>(&'a IdentTable);

impl WithModel for CheckMap<'_> {
    type Output = Result<(), SettingError>;

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, _model: M) -> Self::Output
    where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
    {
        self.0.check::<M, _, _, _, _>().map(drop)
    }
}

/// Name of a stick.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Stick {
    /// To the right.
    Roll,
    /// Forward.
    Pitch,
    /// Counter-clockwise from above.
    Yaw,
    /// Up.
    Throttle,
}

impl Stick {
    /// Row of the input.
    pub fn row(self) -> usize {
        match self {
            Self::Roll => stick::ROLL,
            Self::Pitch => stick::PITCH,
            Self::Yaw => stick::YAW,
            Self::Throttle => stick::THROTTLE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(change: impl FnOnce(&mut IdentFileTable)) -> String {
        let mut table = crate::ident::settings(None).unwrap();
        assert!(table.check().is_ok());
        change(&mut table);
        table.check().unwrap_err().to_string()
    }

    #[test]
    fn a_stick_is_in_one_group_at_most_and_no_group_is_empty() {
        let rule = "groups of at least one stick, each stick once";
        for groups in [
            vec![vec![Stick::Roll, Stick::Pitch], vec![Stick::Roll]],
            vec![vec![Stick::Yaw, Stick::Yaw]],
            vec![vec![Stick::Yaw], Vec::new()],
        ] {
            let text = refusal(|table| table.dead_time_groups.clone_from(&groups));
            assert!(text.starts_with("dead_time_groups = ") && text.ends_with(rule), "{text}");
        }
        let mut table = crate::ident::settings(None).unwrap();
        table.dead_time_groups = vec![vec![Stick::Throttle, Stick::Yaw]];
        assert!(table.check().is_ok(), "sticks in no group keep their dead time");
    }

    #[test]
    fn each_value_out_of_range_is_named_with_its_section() {
        for (text, key) in [
            (refusal(|table| table.dt_s = 0.2), "dt_s = 0.2"),
            (refusal(|table| table.turn_rad = f64::NAN), "turn_rad = NaN"),
            (refusal(|table| table.logs_max = 0), "logs_max = 0"),
            (refusal(|table| table.piece_steps_min = 1), "piece_steps_min = 1"),
            (refusal(|table| table.threads = 1025), "threads = 1025"),
            (refusal(|table| table.dead_time_s[2] = -0.1), "dead_time_s[2] = -0.1"),
            (refusal(|table| table.dead_time_s.truncate(3)), "dead_time_s = "),
            (refusal(|table| table.dead_time_s[0] = 1.9), "dead_time_s[0] = 1.9"),
            (refusal(|table| table.delay.as_mut().unwrap().rounds = 0), "delay.rounds = 0"),
            (refusal(|table| table.map.c_s[0] = 0.0), "map.C_s[0] = 0"),
        ] {
            assert!(text.starts_with(key), "{text}");
        }
    }

    #[test]
    fn each_stick_has_its_row() {
        let all = [Stick::Roll, Stick::Pitch, Stick::Yaw, Stick::Throttle];
        for (stick, row) in all.into_iter().zip(&Kinematic::INPUT) {
            let name = serde_json::to_value(stick).unwrap();
            assert_eq!(name, row.name, "{stick:?}");
            assert_eq!(Kinematic::INPUT[stick.row()].name, row.name);
        }
    }
}
