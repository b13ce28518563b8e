//! Outlier filter of the motion capture, thesis section 4.3.3.
//!
//! Owns what of a raw pose is accepted: a value too far from the last accepted one is held back, and
//! the longer it is held the further it may jump, so that the filter finds back after a loss. Heading
//! comes in wrapped and goes out continuous. What an estimator does with a held value is not decided
//! here.

use std::ops::RangeInclusive;

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Relays report a lost object at the origin to within rounding; a vehicle may start further from it. m
const ORIGIN_MAX_M: f64 = 0.1;

/// Bounds of the limits and of their growths: a limit in millimetres or degrees is beyond them and would refuse
/// nothing. m, rad
const BASE_M: RangeInclusive<f64> = 0.01..=5.0;
const GROWTH_M: RangeInclusive<f64> = 0.0..=1.0;
const BASE_RAD: RangeInclusive<f64> = 0.01..=3.15;
const GROWTH_RAD: RangeInclusive<f64> = 0.0..=0.5;

/// Limits of the filter, as written in a file. Each limit is `base + growth * hold`, with `hold` the
/// number of periods in which its group has missed or refused a sample since it last accepted one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilterTable {
    /// Largest horizontal jump. m, 0.01..=5
    pub horizontal_base_m: f64,
    /// Growth of that limit per held period. m, 0..=1
    pub horizontal_growth_m: f64,
    /// Largest vertical jump. m, 0.01..=5
    pub vertical_base_m: f64,
    /// Growth of that limit per held period. m, 0..=1
    pub vertical_growth_m: f64,
    /// Largest turn. rad, 0.01..=3.15
    pub angle_base_rad: f64,
    /// Growth of that limit per held period. rad, 0..=0.5
    pub angle_growth_rad: f64,
    /// Growth of that limit per period in which a heading was seen and refused, in place of `angle_growth_rad`: a
    /// vehicle that is seen does not jump, and wrong headings last for more than a second. With it a heading is also
    /// accepted that is within `angle_base_rad` of the estimate. Missing: the same growth, and the estimate is not
    /// used. rad, 0..=0.5
    #[serde(default)]
    pub angle_growth_refused_rad: Option<f64>,
    /// A lower z is refused. m
    pub floor_m: f64,
    /// A first sample with x, y and z all nearer to zero than this means "object lost". m, 0..=0.1
    pub origin_m: f64,
}

/// Checked [`FilterTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings {
    /// Limit of the horizontal distance. m
    horizontal: Limit,
    /// Limit of the difference of heights. m
    vertical: Limit,
    /// Limit of the difference of headings. rad
    angle: Limit,
    /// Growth of the limit of the angle per period with a refused heading, if that differs. rad
    angle_growth_refused: Option<f64>,
    floor_m: f64,
    origin_m: f64,
}

/// Largest accepted jump, in the unit of its group.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limit {
    /// Without a hold. Unit of the group
    base: f64,
    /// For each period of a hold. Unit of the group
    growth: f64,
}

impl Limit {
    fn after(self, hold: u32) -> f64 {
        self.base + self.growth * f64::from(hold)
    }
}

/// Periods of a hold. A source with several frames a period lengthens it once in each: the vehicle moves no faster for
/// it.
#[derive(Debug, Clone, Copy, Default)]
struct Hold {
    /// Length. periods
    periods: u32,
    /// Whether the present period counts already.
    has_grown: bool,
}

impl Hold {
    fn grow(&mut self) {
        let grown = self.periods.saturating_add(1);
        self.periods = if self.has_grown { self.periods.max(1) } else { grown };
        self.has_grown = true;
    }
}

impl TryFrom<&FilterTable> for FilterSettings {
    type Error = SettingError;

    fn try_from(table: &FilterTable) -> Result<Self, SettingError> {
        Ok(Self {
            horizontal: Limit {
                base: in_range("horizontal_base_m", table.horizontal_base_m, BASE_M)?,
                growth: in_range("horizontal_growth_m", table.horizontal_growth_m, GROWTH_M)?,
            },
            vertical: Limit {
                base: in_range("vertical_base_m", table.vertical_base_m, BASE_M)?,
                growth: in_range("vertical_growth_m", table.vertical_growth_m, GROWTH_M)?,
            },
            angle: Limit {
                base: in_range("angle_base_rad", table.angle_base_rad, BASE_RAD)?,
                growth: in_range("angle_growth_rad", table.angle_growth_rad, GROWTH_RAD)?,
            },
            angle_growth_refused: table
                .angle_growth_refused_rad
                .map(|growth| in_range("angle_growth_refused_rad", growth, GROWTH_RAD))
                .transpose()?,
            floor_m: finite("floor_m", table.floor_m)?,
            origin_m: in_range("origin_m", table.origin_m, 0.0..=ORIGIN_MAX_M)?,
        })
    }
}

/// Acceptance of a group of rows, position or heading, of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Acceptance {
    /// There was no sample.
    Missing,
    /// The raw value is accepted.
    Accepted,
    /// The raw value is refused, the last accepted one stands.
    Held,
}

/// Result of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filtered {
    /// Last accepted pose, heading continuous; `None` before the first. m, rad
    pub o: Option<Pose>,
    /// Acceptance on x, y and z.
    pub position: Acceptance,
    /// Acceptance on theta.
    pub heading: Acceptance,
}

/// Filter with the last accepted pose and the lengths of the present holds.
#[derive(Debug, Clone)]
pub struct PoseFilter {
    settings: FilterSettings,
    o_ref: Option<Pose>,
    position_hold: Hold,
    heading_hold: Hold,
    /// Periods of `heading_hold` in which a heading was seen and refused.
    headings_refused: Hold,
}

impl PoseFilter {
    /// A filter that has seen nothing.
    pub fn new(settings: FilterSettings) -> Self {
        Self {
            settings,
            o_ref: None,
            position_hold: Hold::default(),
            heading_hold: Hold::default(),
            headings_refused: Hold::default(),
        }
    }

    /// Forgets what was accepted: the next pose is the first.
    ///
    /// Real time: no allocation, constant cost.
    pub fn restart(&mut self) {
        *self = Self::new(self.settings);
    }

    /// Checks the sample of one period; `None` if nothing arrived in it. A pose that is not finite has
    /// not arrived.
    ///
    /// The heading is checked only with an accepted position, and its hold grows only when it is
    /// itself refused: so did the filter of the recorded flights. A missing sample lengthens both
    /// holds, since the vehicle moves on.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update(&mut self, raw: Option<&Pose>) -> Filtered {
        for hold in [&mut self.position_hold, &mut self.heading_hold, &mut self.headings_refused] {
            hold.has_grown = false;
        }
        self.update_again(raw)
    }

    /// Checks another sample of the period of [`PoseFilter::update`]; no hold is lengthened once more.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn update_again(&mut self, raw: Option<&Pose>) -> Filtered {
        let raw = raw.filter(|raw| raw.iter().all(|row| row.is_finite()));
        let (position, heading) = match (raw, self.o_ref) {
            (None, _) => self.miss(),
            (Some(raw), None) => self.begin(raw),
            (Some(raw), Some(o_ref)) => self.check(raw, o_ref),
        };
        Filtered { o: self.o_ref, position, heading }
    }

    /// Takes back the heading that was accepted last: the vehicle turned by `theta_rad` by a better
    /// source. What the filter holds from here on.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn refuse_heading(&mut self, theta_rad: f64) -> Filtered {
        self.refuse();
        if let Some(o_ref) = &mut self.o_ref {
            o_ref[pose::THETA] = theta_rad;
        }
        Filtered { o: self.o_ref, position: Acceptance::Accepted, heading: Acceptance::Held }
    }

    /// Accepts the refused heading of `raw` after all if it is that of the estimate, `theta_hat_rad`: the vehicle
    /// turned while others were refused. What the filter holds from here on.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn confirm_heading(
        &mut self,
        raw: &Pose,
        theta_hat_rad: f64,
        filtered: Filtered,
    ) -> Filtered {
        let is_refused =
            (filtered.position, filtered.heading) == (Acceptance::Accepted, Acceptance::Held);
        let is_near = (raw[pose::THETA] - theta_hat_rad).is_finite()
            && wrap(raw[pose::THETA] - theta_hat_rad).abs() <= self.settings.angle.base;
        let has_say = self.settings.angle_growth_refused.is_some();
        let Some(o_ref) = self.o_ref.as_mut().filter(|_| has_say && is_refused && is_near) else {
            return filtered;
        };
        o_ref[pose::THETA] += wrap(raw[pose::THETA] - o_ref[pose::THETA]);
        self.release_heading();
        Filtered { o: self.o_ref, heading: Acceptance::Accepted, ..filtered }
    }

    fn refuse(&mut self) {
        self.heading_hold.grow();
        self.headings_refused.grow();
    }

    fn release_heading(&mut self) {
        (self.heading_hold.periods, self.headings_refused.periods) = (0, 0);
    }

    /// Largest accepted turn. rad
    fn turn_max(&self) -> f64 {
        let limit = self.settings.angle;
        match self.settings.angle_growth_refused {
            None => limit.after(self.heading_hold.periods),
            Some(growth) => {
                let refused = self.headings_refused.periods;
                let missing = self.heading_hold.periods.saturating_sub(refused);
                limit.after(missing) + growth * f64::from(refused)
            }
        }
    }

    fn miss(&mut self) -> (Acceptance, Acceptance) {
        self.position_hold.grow();
        self.heading_hold.grow();
        (Acceptance::Missing, Acceptance::Missing)
    }

    fn begin(&mut self, raw: &Pose) -> (Acceptance, Acceptance) {
        let pos_w = [raw[pose::X], raw[pose::Y], raw[pose::Z]];
        let is_lost = pos_w.iter().all(|row| row.abs() < self.settings.origin_m);
        if is_lost || raw[pose::Z] < self.settings.floor_m {
            return (Acceptance::Missing, Acceptance::Missing);
        }
        self.o_ref = Some(*raw);
        self.position_hold.periods = 0;
        self.release_heading();
        (Acceptance::Accepted, Acceptance::Accepted)
    }

    fn check(&mut self, raw: &Pose, o_ref: Pose) -> (Acceptance, Acceptance) {
        let turn_max = self.turn_max();
        let Self { settings, position_hold, .. } = self;
        let jump_w = raw - o_ref;
        let is_near = jump_w[pose::X].hypot(jump_w[pose::Y])
            <= settings.horizontal.after(position_hold.periods)
            && jump_w[pose::Z].abs() <= settings.vertical.after(position_hold.periods)
            && raw[pose::Z] >= settings.floor_m;
        if !is_near {
            position_hold.grow();
            return (Acceptance::Held, Acceptance::Held);
        }
        position_hold.periods = 0;
        // |wrap(theta - theta_ref)| <= turn_max, thesis equations 4.9 and 4.12.
        let turn = wrap(jump_w[pose::THETA]);
        let heading = if turn.abs() <= turn_max {
            self.release_heading();
            Acceptance::Accepted
        } else {
            self.refuse();
            Acceptance::Held
        };
        let theta = if heading == Acceptance::Accepted {
            o_ref[pose::THETA] + turn
        } else {
            o_ref[pose::THETA]
        };
        self.o_ref = Some(Pose::new(raw[pose::X], raw[pose::Y], raw[pose::Z], theta));
        (Acceptance::Accepted, heading)
    }
}

#[cfg(test)]
mod tests;
