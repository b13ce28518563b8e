//! How far ahead real flights can be predicted: the vehicle model identified from six flights, judged
//! on others, with the built-in settings of the identification.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use horizon_estim::{Ident, IdentTable, Observed, Piece, Recording, cut};
use horizon_model::rows::{Pose, Sticks, lag, motion};
use horizon_model::{Kinematic, Lagged, LaggedShape, Model};
use nalgebra::SVector;
use tello_eval::forecast::{
    ConstantVelocity, Driven, Forecast, ForecastErrors, HorizonErrors, StandStill,
    prediction_errors,
};
use tello_eval::outage::{OutageSettings, OutageTable, lost_commands};
use tello_eval::smooth::{MotionTrack, smooth, track};
use tello_sim::plant::{NOMINAL, PlantParams};
use tello_sim::{ManualFlight, MocapReport, Profile};

use crate::recorded;
use crate::support;
use recorded::{DT_S, dead_time_s, logs, setting};

/// Horizons of the table. steps
const HORIZONS: [usize; 3] = [10, 30, 50];
/// The thesis' model: its table 5.1 and its one dead time for all sticks.
const THESIS_P: [f64; 4] = [1.065, 0.447, 0.955, -0.171];
const THESIS_DEAD_TIME_S: f64 = 0.6;

struct Flight {
    /// Sticks as they act by the built-in dead times, and by the thesis'.
    applied: Vec<Sticks>,
    applied_thesis: Vec<Sticks>,
    /// Smoothed motion, by which the forecasts are judged, and the motion known at each step.
    smoothed: MotionTrack,
    causal: MotionTrack,
    is_lost: Vec<bool>,
}

impl Flight {
    /// A recorded flight; `turn_rad` is added to its headings.
    fn read(path: &Path, turn_rad: f64) -> Self {
        Self::new(&recorded::read(path, turn_rad))
    }

    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    fn new(recording: &Recording<4, 4>) -> Self {
        let applied = recording.applied(&dead_time_s(), DT_S);
        let smoothed = smooth(&recording.o, DT_S);
        let causal = track(&recording.o, DT_S);
        let outage = OutageSettings::try_from(&setting::<OutageTable>("lost_commands")).unwrap();
        let is_lost = lost_commands(&outage, &applied, &smoothed, DT_S);
        let applied_thesis = recording.applied(&Sticks::repeat(THESIS_DEAD_TIME_S), DT_S);
        Self { applied, applied_thesis, smoothed, causal, is_lost }
    }

    fn read_all(paths: &[PathBuf], turn_rad: f64) -> Vec<Self> {
        paths.iter().map(|path| Self::read(path, turn_rad)).collect()
    }
}

/// `Lagged` fitted to the flights, lost commands left out.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fit(flights: &[Flight]) -> SVector<f64, { lag::COUNT }> {
    let mut pieces = Vec::new();
    for flight in flights {
        let is_usable: Vec<bool> = flight.is_lost.iter().map(|is_lost| !is_lost).collect();
        for steps in cut(&is_usable, setting("piece_steps_min")) {
            pieces.push(Piece {
                u: flight.applied[steps.clone()].to_vec(),
                o: flight.smoothed.o[steps].to_vec(),
            });
        }
    }
    let mut table = setting::<IdentTable>("map");
    // Half of the iterations; no parameter moves by more than its last printed digits.
    table.solver.cost_tolerance = 1e-4;
    let settings = table.check::<Lagged, { motion::COUNT }, 4, 4, { lag::COUNT }>().unwrap();
    let mut ident = Ident::new(Lagged::default(), &settings, DT_S, pieces).unwrap();
    let report = ident.solve(&mut || false).unwrap();
    println!("{} iterations, {:?}, cost {:.1}", report.iterations, report.stop, report.cost);
    for (row, value) in Lagged::PARAMETER.iter().zip(ident.parameter()) {
        println!("  {:<9} {value:7.3} {}", row.name, row.unit);
    }
    *ident.parameter()
}

/// Errors at [`HORIZONS`]; `rule` is made for each flight and what is known of it.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn errors(
    flights: &[Flight],
    case: Case,
    rule: impl for<'a> Fn(&'a Flight, &'a MotionTrack) -> Box<dyn Forecast + 'a>,
) -> [HorizonErrors; 3] {
    let mut errors = ForecastErrors::new(HORIZONS[2]);
    for flight in flights {
        let known = if case.is_causal { &flight.causal } else { &flight.smoothed };
        let is_excluded: &[bool] = if case.is_masked { &flight.is_lost } else { &[] };
        let rule = rule(flight, known);
        errors.extend(&prediction_errors(
            &*rule,
            known,
            &flight.smoothed,
            is_excluded,
            HORIZONS[2],
        ));
    }
    HORIZONS.map(|steps| errors.at(steps).unwrap())
}

/// Which start, and whether lost commands are left out.
#[derive(Debug, Clone, Copy, Default)]
struct Case {
    is_causal: bool,
    is_masked: bool,
}

/// Every rule that predicts, with its errors at [`HORIZONS`].
struct Table {
    hold: [HorizonErrors; 3],
    steady: [HorizonErrors; 3],
    thesis: [HorizonErrors; 3],
    lagged: [HorizonErrors; 3],
}

impl Table {
    fn new(flights: &[Flight], case: Case, p: &SVector<f64, { lag::COUNT }>) -> Self {
        let shape = LaggedShape::default();
        let decay_s = Pose::new(shape.decay_h_s, shape.decay_h_s, shape.decay_v_s, 0.0);
        Self {
            hold: errors(flights, case, |_, _| Box::new(StandStill)),
            steady: errors(flights, case, |_, _| Box::new(ConstantVelocity { dt_s: DT_S })),
            thesis: errors(flights, case, |flight, known| {
                let (p, u) = (THESIS_P.into(), &flight.applied_thesis);
                Box::new(Driven::new(Kinematic, &p, &Pose::zeros(), u, known, DT_S))
            }),
            lagged: errors(flights, case, |flight, known| {
                let u = &flight.applied;
                Box::new(Driven::new(Lagged::default(), p, &decay_s, u, known, DT_S))
            }),
        }
    }

    fn print(&self, name: &str, case: Case) {
        println!("{name}, {case:?}");
        for (rule, errors) in [
            ("hold", &self.hold),
            ("constant velocity", &self.steady),
            ("thesis", &self.thesis),
            ("lagged", &self.lagged),
        ] {
            let [_, middle, _] = errors;
            let xy = errors.map(|at| format!("{:.4}", at.horizontal.rmse)).join(" ");
            let (z, theta) = (middle.vertical.rmse, middle.heading.rmse);
            let (median, count) = (middle.horizontal.median, middle.horizontal.count);
            println!(
                "  {rule:<18} x-y {xy} (0.6 s: median {median:.3}, n {count}) z {z:.3} theta {theta:.3}"
            );
        }
    }
}

/// Horizontal RMSE 0.6 s ahead. m
fn xy_m(errors: &[HorizonErrors; 3]) -> f64 {
    let [_, middle, _] = errors;
    middle.horizontal.rmse
}

/// Three manual flights of another day, whose object was defined the other way round.
fn manual() -> Option<Vec<Flight>> {
    let folder = support::data("thesis/manual/raw")?;
    Some(Flight::read_all(&logs(&folder, ""), PI))
}

/// The flights of the square by the thesis' controller; their poses are its own estimates.
fn squares() -> Option<Vec<Flight>> {
    let folder = support::data("thesis/closed_loop")?;
    Some(Flight::read_all(&logs(&folder, "square"), 0.0))
}

#[test]
fn the_lagged_model_predicts_flights_that_it_was_not_fitted_to() {
    let Some(ident) = support::data("thesis/ident/raw") else { return };
    let (Some(manual), Some(squares)) = (manual(), squares()) else { return };
    let p = fit(&Flight::read_all(&logs(&ident, ""), 0.0));
    // The lagged model's goals, all samples and without lost commands. m
    for (name, flights, goal_m, goal_masked_m) in
        [("manual", &manual, 0.053, 0.036), ("squares", &squares, 0.070, 0.046)]
    {
        let lost = flights.iter().flat_map(|flight| &flight.is_lost).filter(|lost| **lost).count();
        let steps: usize = flights.iter().map(|flight| flight.is_lost.len()).sum();
        println!("{name}: commands lost in {:.3} of the steps", lost as f64 / steps as f64);
        // Leaving out more would make the masked goal easy: another detector found 5 % and 25 to 28 %.
        assert!(lost * 100 < steps * 25, "{lost} of {steps} steps of {name} called lost");
        for is_causal in [false, true] {
            for (is_masked, goal_m) in [(false, goal_m), (true, goal_masked_m)] {
                let case = Case { is_causal, is_masked };
                let table = Table::new(flights, case, &p);
                table.print(name, case);
                let lagged = xy_m(&table.lagged);
                assert!(lagged < xy_m(&table.steady).min(xy_m(&table.thesis)), "{name} {case:?}");
                assert!(is_causal || lagged <= goal_m, "{name} {case:?}: {lagged} m");
            }
        }
    }
    // What another fit to the same flights found, by another method.
    for (row, expected, tolerance) in [
        (lag::LAMBDA_H, 2.0, 0.15),
        (lag::THETA_0, -0.06, 0.04),
        (lag::TAU_H, 0.63, 0.1),
        (lag::DEAD_H, 0.07, 0.02),
        (lag::A_MAX, 1.04, 0.15),
    ] {
        let name = Lagged::PARAMETER[row].name;
        assert!((p[row] - expected).abs() < tolerance, "{name} = {} not {expected}", p[row]);
    }
}

#[test]
fn the_figures_that_need_no_fit_are_those_of_others() {
    let (Some(manual), Some(squares)) = (manual(), squares()) else { return };
    let nothing = SVector::zeros();
    let manual = Table::new(&manual, Case::default(), &nothing);
    let squares = Table::new(&squares, Case::default(), &nothing);
    // Computed by others on these flights with other smoothers; 3 % is what smoothing may move.
    for (what, errors, expected) in [
        ("constant velocity, manual", &manual.steady, 0.088),
        ("thesis, manual", &manual.thesis, 0.147),
        ("thesis, squares", &squares.thesis, 0.159),
    ] {
        let xy = xy_m(errors);
        assert!((xy / expected - 1.0).abs() < 0.03, "{what}: {xy} m instead of {expected}");
    }
    // Here the smoother decides: the estimates of the MHE jump. Ours is the harder judge.
    let xy = xy_m(&squares.steady);
    assert!((0.078..0.092).contains(&xy), "constant velocity, squares: {xy} m");
}

#[test]
fn lost_commands_are_found_in_simulated_flights() {
    let params = PlantParams::try_from(NOMINAL).unwrap();
    // Steps from a lost command to the moment when it should have been applied.
    let dead_steps = 16;
    let (mut up, mut down, mut wrong, mut found) = (0, 0, 0, 0);
    for seed in 1..=8 {
        let flight = ManualFlight::fly(&params, Profile::Outages, seed, 3000).unwrap();
        let observed = |report: &MocapReport| match report {
            MocapReport::Pose(pose) => Observed::full(*pose),
            MocapReport::Lost | MocapReport::Silent => Observed::missing(),
        };
        let o = flight.reports.iter().map(observed).collect();
        let judged = Flight::new(&Recording { u: flight.u_sent, o });
        for (k, link_is_up) in flight.link_is_up.iter().enumerate() {
            let Some(is_lost) = judged.is_lost.get(k + dead_steps) else { break };
            up += u32::from(*link_is_up);
            down += u32::from(!*link_is_up);
            wrong += u32::from(*link_is_up && *is_lost);
            found += u32::from(!*link_is_up && *is_lost);
        }
    }
    let false_alarms = f64::from(wrong) / f64::from(up);
    let recall = f64::from(found) / f64::from(down);
    println!("false alarms {false_alarms:.3} of {up} steps, recall {recall:.2} of {down}");
    // Another detector, on other simulated flights. What happens while no key is pressed
    // cannot be seen.
    assert!(false_alarms < 0.019, "{false_alarms}");
    assert!(recall > 0.68, "{recall}");
}
