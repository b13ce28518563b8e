//! How good the day is.
//!
//! Owns the names that a user chooses from. What a day does to the measurement is
//! [`crate::mocap`]'s, what it does to the commands [`crate::command_link`]'s.

use std::str::FromStr;

use schemars::JsonSchema;
use serde::de::{IntoDeserializer, value};
use serde::{Deserialize, Serialize};

/// How good sensor and link are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// The true pose at every step, every command arrives.
    Clean,
    /// Recording days with few short stalls and hardly a lost pose.
    GoodDay,
    /// The mean over all recording days.
    Typical,
    /// The day of the identification flights: a fifth of the samples is stalled.
    BadDay,
    /// A good day on which commands get lost for 3 s after 20 s on average.
    MildOutages,
    /// A good day on which commands get lost for 4 s after 14 s on average, as in the closed-loop flights.
    Outages,
}

impl FromStr for Profile {
    type Err = value::Error;

    /// The profile of a name as in the settings, `good_day`; the error lists all names.
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::deserialize(name.into_deserializer())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_are_named_as_in_the_settings() {
        assert_eq!("good_day".parse(), Ok(Profile::GoodDay));
        assert_eq!("outages".parse(), Ok(Profile::Outages));
        let error = "fog".parse::<Profile>().unwrap_err().to_string();
        assert!(error.contains("`fog`") && error.contains("`mild_outages`"), "{error}");
    }
}
