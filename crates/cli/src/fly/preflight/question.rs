//! The question before a take-off.

use std::io::{self, Write as _};

use anyhow::{Result, bail};
use tello_io::manual;

use super::{Check, Readiness};
use crate::fly::GROUND_WAIT;

/// Asks whether to fly.
///
/// # Errors
/// Anything but Enter.
pub(super) fn confirm(address: &str, checks: &[Check]) -> Result<()> {
    // Keys from before the question are no answer to it.
    manual::discard_typed();
    write!(io::stderr(), "{}", question(address, checks))?;
    let mut answer = String::new();
    let bytes = io::stdin().read_line(&mut answer)?;
    if bytes == 0 || !answer.trim().is_empty() {
        bail!("not started: only Enter starts");
    }
    Ok(())
}

pub(super) fn question(address: &str, checks: &[Check]) -> String {
    let is_clear = "Is the room clear? Enter starts, anything else leaves. ";
    match checks.iter().filter(|check| check.readiness == Readiness::Bad).count() {
        0 => format!("The drone at {address} will take off. {is_clear}"),
        failed => format!(
            "{failed} of {} failed. The drone at {address} will take off once all checks pass, if that is \
             within {} s. {is_clear}",
            checks.len(),
            GROUND_WAIT.seconds()
        ),
    }
}
