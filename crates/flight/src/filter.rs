//! Outlier filter of the motion capture, thesis section 4.3.3.
//!
//! Owns what of a raw pose is accepted: a value too far from the last accepted one is held back, and
//! the longer it is held the further it may jump, so that the filter finds back after a loss. Heading
//! comes in wrapped and goes out continuous. What an estimator does with a held value is not decided
//! here.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, not_negative, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Limits of the filter, as written in a file. Each limit is `base + growth * hold`, with `hold` the
/// number of samples that its group has missed or refused since it last accepted one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilterTable {
    /// Largest horizontal jump. m, > 0
    pub horizontal_base_m: f64,
    /// Growth of that limit per held sample. m, >= 0
    pub horizontal_growth_m: f64,
    /// Largest vertical jump. m, > 0
    pub vertical_base_m: f64,
    /// Growth of that limit per held sample. m, >= 0
    pub vertical_growth_m: f64,
    /// Largest turn. rad, > 0
    pub angle_base_rad: f64,
    /// Growth of that limit per held sample. rad, >= 0
    pub angle_growth_rad: f64,
    /// Growth of that limit per heading that was seen and refused, in place of `angle_growth_rad`: a vehicle that is
    /// seen does not jump, and wrong headings last for more than a second. With it a heading is also accepted that is
    /// within `angle_base_rad` of the estimate. Missing: the same growth, and the estimate has no say. rad, >= 0
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_growth_refused_rad: Option<f64>,
    /// A lower z is refused. m
    pub floor_m: f64,
    /// A first sample with x, y and z all nearer to zero than this means "object lost". m, >= 0
    pub origin_m: f64,
}

/// Checked [`FilterTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings {
    horizontal: Limit,
    vertical: Limit,
    angle: Limit,
    /// Growth of the limit of the angle per refused heading, if that differs. rad
    angle_growth_refused: Option<f64>,
    floor_m: f64,
    origin_m: f64,
}

/// Largest accepted jump, in the unit of its group.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limit {
    base: f64,
    growth: f64,
}

impl Limit {
    fn after(self, hold: u32) -> f64 {
        self.base + self.growth * f64::from(hold)
    }
}

impl TryFrom<&FilterTable> for FilterSettings {
    type Error = SettingError;

    fn try_from(table: &FilterTable) -> Result<Self, SettingError> {
        Ok(Self {
            horizontal: Limit {
                base: positive("horizontal_base_m", table.horizontal_base_m)?,
                growth: not_negative("horizontal_growth_m", table.horizontal_growth_m)?,
            },
            vertical: Limit {
                base: positive("vertical_base_m", table.vertical_base_m)?,
                growth: not_negative("vertical_growth_m", table.vertical_growth_m)?,
            },
            angle: Limit {
                base: positive("angle_base_rad", table.angle_base_rad)?,
                growth: not_negative("angle_growth_rad", table.angle_growth_rad)?,
            },
            angle_growth_refused: table
                .angle_growth_refused_rad
                .map(|growth| not_negative("angle_growth_refused_rad", growth))
                .transpose()?,
            floor_m: finite("floor_m", table.floor_m)?,
            origin_m: not_negative("origin_m", table.origin_m)?,
        })
    }
}

/// What became of a group of rows, position or heading, of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// There was nothing to judge.
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
    /// Verdict on x, y and z.
    pub position: Verdict,
    /// Verdict on theta.
    pub heading: Verdict,
}

/// Filter with the last accepted pose and the lengths of the present holds.
#[derive(Debug, Clone)]
pub struct PoseFilter {
    settings: FilterSettings,
    o_ref: Option<Pose>,
    position_hold: u32,
    heading_hold: u32,
    /// Those of `heading_hold` in which a heading was seen and refused.
    headings_refused: u32,
}

impl PoseFilter {
    /// A filter that has seen nothing.
    pub fn new(settings: FilterSettings) -> Self {
        Self { settings, o_ref: None, position_hold: 0, heading_hold: 0, headings_refused: 0 }
    }

    /// Forgets what was accepted: the next pose is the first.
    pub fn restart(&mut self) {
        *self = Self::new(self.settings);
    }

    /// Judges the sample of one step; `None` if nothing arrived in it. A pose that is not finite has
    /// not arrived.
    ///
    /// The heading is judged only with an accepted position, and its hold grows only when it is
    /// itself refused: so did the filter of the recorded flights. A missing sample lengthens both
    /// holds, since the vehicle moves on.
    pub fn update(&mut self, raw: Option<&Pose>) -> Filtered {
        let raw = raw.filter(|raw| raw.iter().all(|row| row.is_finite()));
        let (position, heading) = match (raw, self.o_ref) {
            (None, _) => self.miss(),
            (Some(raw), None) => self.begin(raw),
            (Some(raw), Some(o_ref)) => self.judge(raw, o_ref),
        };
        Filtered { o: self.o_ref, position, heading }
    }

    /// Takes back the heading that was accepted last: the vehicle turned by `theta_rad` by a better
    /// source. What the filter holds from here on.
    pub fn refuse_heading(&mut self, theta_rad: f64) -> Filtered {
        self.refuse();
        if let Some(o_ref) = &mut self.o_ref {
            o_ref[pose::THETA] = theta_rad;
        }
        Filtered { o: self.o_ref, position: Verdict::Accepted, heading: Verdict::Held }
    }

    /// Accepts the refused heading of `raw` after all if it is that of the estimate, `theta_hat_rad`: the vehicle turned
    /// while others were refused. What the filter holds from here on.
    pub fn confirm_heading(
        &mut self,
        raw: &Pose,
        theta_hat_rad: f64,
        filtered: Filtered,
    ) -> Filtered {
        let is_refused =
            (filtered.position, filtered.heading) == (Verdict::Accepted, Verdict::Held);
        let is_near = (raw[pose::THETA] - theta_hat_rad).is_finite()
            && wrap(raw[pose::THETA] - theta_hat_rad).abs() <= self.settings.angle.base;
        let has_say = self.settings.angle_growth_refused.is_some();
        let Some(o_ref) = self.o_ref.as_mut().filter(|_| has_say && is_refused && is_near) else {
            return filtered;
        };
        o_ref[pose::THETA] += wrap(raw[pose::THETA] - o_ref[pose::THETA]);
        (self.heading_hold, self.headings_refused) = (0, 0);
        Filtered { o: self.o_ref, heading: Verdict::Accepted, ..filtered }
    }

    fn refuse(&mut self) {
        self.heading_hold = self.heading_hold.saturating_add(1);
        self.headings_refused = self.headings_refused.saturating_add(1);
    }

    /// Largest accepted turn. rad
    fn turn_max(&self) -> f64 {
        let limit = self.settings.angle;
        match self.settings.angle_growth_refused {
            None => limit.after(self.heading_hold),
            Some(growth) => {
                let missing = self.heading_hold.saturating_sub(self.headings_refused);
                limit.after(missing) + growth * f64::from(self.headings_refused)
            }
        }
    }

    fn miss(&mut self) -> (Verdict, Verdict) {
        self.position_hold = self.position_hold.saturating_add(1);
        self.heading_hold = self.heading_hold.saturating_add(1);
        (Verdict::Missing, Verdict::Missing)
    }

    fn begin(&mut self, raw: &Pose) -> (Verdict, Verdict) {
        let position = [raw[pose::X], raw[pose::Y], raw[pose::Z]];
        if position.iter().all(|row| row.abs() < self.settings.origin_m) {
            return (Verdict::Missing, Verdict::Missing);
        }
        self.o_ref = Some(*raw);
        self.position_hold = 0;
        self.heading_hold = 0;
        self.headings_refused = 0;
        (Verdict::Accepted, Verdict::Accepted)
    }

    fn judge(&mut self, raw: &Pose, o_ref: Pose) -> (Verdict, Verdict) {
        let turn_max = self.turn_max();
        let Self { settings, position_hold, .. } = self;
        let jump = raw - o_ref;
        let is_near = jump[pose::X].hypot(jump[pose::Y])
            <= settings.horizontal.after(*position_hold)
            && jump[pose::Z].abs() <= settings.vertical.after(*position_hold)
            && raw[pose::Z] >= settings.floor_m;
        if !is_near {
            *position_hold = position_hold.saturating_add(1);
            return (Verdict::Held, Verdict::Held);
        }
        *position_hold = 0;
        // Thesis equation 4.9.
        let turn = wrap(jump[pose::THETA]);
        let heading = if turn.abs() <= turn_max {
            (self.heading_hold, self.headings_refused) = (0, 0);
            Verdict::Accepted
        } else {
            self.refuse();
            Verdict::Held
        };
        let theta = if heading == Verdict::Accepted {
            o_ref[pose::THETA] + turn
        } else {
            o_ref[pose::THETA]
        };
        self.o_ref = Some(Pose::new(raw[pose::X], raw[pose::Y], raw[pose::Z], theta));
        (Verdict::Accepted, heading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    fn table() -> FilterTable {
        FilterTable {
            horizontal_base_m: 0.3,
            horizontal_growth_m: 0.1,
            vertical_base_m: 0.3,
            vertical_growth_m: 0.06,
            angle_base_rad: 0.15,
            angle_growth_rad: 0.04,
            angle_growth_refused_rad: None,
            floor_m: 0.01,
            origin_m: 0.001,
        }
    }

    /// A filter whose reference is `o`.
    fn filter_at(o: &Pose) -> PoseFilter {
        let mut filter = PoseFilter::new((&table()).try_into().unwrap());
        assert_eq!(filter.update(Some(o)).position, Verdict::Accepted);
        filter
    }

    #[test]
    fn nothing_is_believed_before_the_first_sight() {
        let mut filter = PoseFilter::new((&table()).try_into().unwrap());
        let lost = Pose::new(0.0, -0.0009, 0.0, 1.0);
        let nan = Pose::new(0.0, f64::NAN, 1.0, 0.0);
        for raw in [None, Some(&lost), Some(&nan)] {
            let filtered = filter.update(raw);
            assert_eq!((filtered.o, filtered.position), (None, Verdict::Missing), "{raw:?}");
        }
        let o = Pose::new(0.0, 0.0, 0.5, 1.0);
        assert_eq!(filter.update(Some(&o)).o, Some(o));
    }

    #[test]
    fn heading_goes_on_over_the_wrap() {
        let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 3.1));
        let mut turned = 3.1;
        for k in 0..200 {
            turned += 0.1;
            let raw = Pose::new(0.0, 0.0, 1.0, wrap(turned));
            let filtered = filter.update(Some(&raw));
            let gap = filtered.o.map_or(f64::NAN, |o| o[pose::THETA] - turned);
            assert!(gap.abs() < 1e-9, "gap {gap} at {k}");
        }
        assert!(turned > 3.0 * TAU);
    }

    #[test]
    fn a_jump_is_held_until_the_limit_has_grown_to_it() {
        let start = Pose::new(0.0, 0.0, 1.0, 0.0);
        for (raw, expected) in [
            (Pose::new(0.31, 0.0, 1.0, 0.0), 1),
            (Pose::new(0.6, 0.8, 1.0, 0.0), 7),
            (Pose::new(0.0, 0.0, 1.5, 0.0), 4),
        ] {
            let mut filter = filter_at(&start);
            let held = (0..100).take_while(|_| filter.update(Some(&raw)).position == Verdict::Held);
            assert_eq!(held.count(), expected, "{raw}");
        }
        let mut filter = filter_at(&start);
        let below = Pose::new(0.0, 0.0, 0.009, 0.0);
        assert!((0..100).all(|_| filter.update(Some(&below)).position == Verdict::Held));
    }

    #[test]
    fn a_flipped_heading_is_held_while_the_position_goes_on() {
        let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 0.2));
        for k in 1..=10 {
            let x = 0.02 * f64::from(k);
            let filtered = filter.update(Some(&Pose::new(x, 0.0, 1.0, 0.2 - PI)));
            assert_eq!((filtered.position, filtered.heading), (Verdict::Accepted, Verdict::Held));
            assert_eq!(filtered.o, Some(Pose::new(x, 0.0, 1.0, 0.2)));
        }
        let back = filter.update(Some(&Pose::new(0.2, 0.0, 1.0, 0.25)));
        assert_eq!(back.heading, Verdict::Accepted);
    }

    #[test]
    fn a_heading_that_is_seen_and_refused_widens_its_limit_by_its_own_growth() {
        let own = FilterTable { angle_growth_refused_rad: Some(0.01), ..table() };
        let mut filter = PoseFilter::new((&own).try_into().unwrap());
        let turned = |theta: f64| Pose::new(0.0, 0.0, 1.0, theta);
        filter.update(Some(&turned(0.0)));
        // 0.15 + 0.01 n reaches 0.595 after 45 samples.
        let held =
            (0..100).take_while(|_| filter.update(Some(&turned(0.595))).heading == Verdict::Held);
        assert_eq!(held.count(), 45);
        // Missing samples widen it as before: 0.15 + 0.04 * 9, and 0.01 for one that was refused.
        for _ in 0..9 {
            filter.update(None);
        }
        assert_eq!(filter.update(Some(&turned(0.595 + 0.515))).heading, Verdict::Held);
        assert_eq!(filter.update(Some(&turned(0.595 + 0.515))).heading, Verdict::Accepted);
        // A refused heading that is the estimate's is accepted.
        let raw = turned(-2.0);
        let filtered = filter.update(Some(&raw));
        assert_eq!(filter.confirm_heading(&raw, -1.8, filtered).heading, Verdict::Held);
        let confirmed = filter.confirm_heading(&raw, -2.1 + TAU, filtered);
        assert_eq!(confirmed.heading, Verdict::Accepted);
        assert!(wrap(confirmed.o.unwrap()[pose::THETA] + 2.0).abs() < 1e-12);
        assert_eq!(filter.update(Some(&turned(-2.1))).heading, Verdict::Accepted);
        let mut without = filter_at(&turned(0.0));
        let filtered = without.update(Some(&raw));
        assert_eq!(without.confirm_heading(&raw, -2.0, filtered), filtered);
        let error = FilterSettings::try_from(&FilterTable {
            angle_growth_refused_rad: Some(f64::NAN),
            ..table()
        })
        .unwrap_err();
        assert_eq!(error.key, "angle_growth_refused_rad");
    }

    #[test]
    fn missing_samples_widen_both_limits() {
        let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 0.0));
        let far = Pose::new(1.0, 0.0, 1.0, 0.5);
        for _ in 0..9 {
            assert_eq!(filter.update(None).position, Verdict::Missing);
        }
        let filtered = filter.update(Some(&far));
        assert_eq!((filtered.position, filtered.heading), (Verdict::Accepted, Verdict::Accepted));
    }

    #[test]
    fn a_bad_setting_is_named() {
        let bad = FilterTable { vertical_base_m: f64::NAN, ..table() };
        let error = FilterSettings::try_from(&bad).unwrap_err();
        assert_eq!(error.to_string(), "vertical_base_m = NaN violates finite and > 0");
    }
}
