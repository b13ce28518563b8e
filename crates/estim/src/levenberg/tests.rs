//! The loop on dense curve fits with certified answers: the nonlinear regression set of NIST.

use horizon_model::{Bounds, Vector};

use super::*;
use crate::reduced_system::ReducedSystem;

/// A curve `y = f(b, x)` and its fit, in units of the start so that identity damping is fair.
struct Curve<const N: usize> {
    f: fn(&Vector<N>, f64) -> f64,
    data: &'static [(f64, f64)],
    unit: Vector<N>,
    b: Vector<N>,
    candidate: Vector<N>,
    parameter_block: ReducedSystem<N>,
}

impl<const N: usize> Curve<N> {
    fn new(f: fn(&Vector<N>, f64) -> f64, data: &'static [(f64, f64)], start: [f64; N]) -> Self {
        let b = Vector::from(start);
        // A start of zero has no unit of its own.
        let unit = b.map(|entry: f64| if entry.abs() > 0.0 { entry.abs() } else { 0.01 });
        let scaled = b.component_div(&unit);
        Self {
            f,
            data,
            unit,
            b: scaled,
            candidate: scaled,
            parameter_block: ReducedSystem::zeros(),
        }
    }

    fn residual(&self, b: &Vector<N>, (x, y): (f64, f64)) -> f64 {
        (self.f)(&b.component_mul(&self.unit), x) - y
    }

    fn cost(&self, b: &Vector<N>) -> f64 {
        0.5 * self.data.iter().map(|point| self.residual(b, *point).powi(2)).sum::<f64>()
    }

    /// Central differences: the certified digits ask for no more.
    fn gradient(&self, point: (f64, f64)) -> Vector<N> {
        Vector::from_fn(|row, _| {
            let h = f64::EPSILON.cbrt() * self.b[row].abs().max(1e-3);
            let (mut right, mut left) = (self.b, self.b);
            right[row] += h;
            left[row] -= h;
            let gradient = self.residual(&right, point) - self.residual(&left, point);
            gradient / (right[row] - left[row])
        })
    }
}

impl<const N: usize> LeastSquares for Curve<N> {
    fn linearize(&mut self) -> Result<IterateScale, LmError> {
        let mut parameter_block = ReducedSystem::zeros();
        for (k, point) in self.data.iter().enumerate() {
            let (r, j) = (self.residual(&self.b, *point), self.gradient(*point));
            if !r.is_finite() {
                return Err(LmError::NonFinite { block: "curve", k });
            }
            parameter_block.gradient += j * r;
            parameter_block.hessian += j * j.transpose();
        }
        self.parameter_block = parameter_block;
        Ok(IterateScale {
            cost: self.cost(&self.b),
            diagonal_max: self.parameter_block.hessian.diagonal().max(),
        })
    }

    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive> {
        let free =
            Bounds { lo: Vector::repeat(f64::NEG_INFINITY), hi: Vector::repeat(f64::INFINITY) };
        let (candidate, decrease) = self.parameter_block.solve(damping, &self.b, &free)?;
        let norm = (candidate - self.b).norm();
        self.candidate = candidate;
        let decrease = decrease + 0.5 * damping * norm * norm;
        Ok(Step { decrease, norm, iterate_norm: self.b.norm() })
    }

    fn candidate_cost(&mut self) -> f64 {
        self.cost(&self.candidate)
    }

    fn accept(&mut self) {
        self.b = self.candidate;
    }
}

fn settings() -> LmSettings {
    LmSettings {
        damping_start: 1e-3,
        cost_tolerance: 1e-15,
        step_tolerance: 1e-12,
        iterations_max: 1000,
        confirms_undamped: true,
    }
}

/// Fits from both starts of the certificate and compares with its values to 1e-7.
fn certify<const N: usize>(
    name: &str,
    f: fn(&Vector<N>, f64) -> f64,
    data: &'static [(f64, f64)],
    starts: [[f64; N]; 2],
    (certified, sum_of_squares): ([f64; N], f64),
) {
    for start in starts {
        let mut curve = Curve::new(f, data, start);
        let report = solve(&mut curve, &settings(), &mut || false).unwrap();
        let b = curve.b.component_mul(&curve.unit);
        for row in 0..N {
            let gap = (b[row] / certified[row] - 1.0).abs();
            assert!(gap < 1e-7, "{name} from {start:?}: b[{row}] = {}, {report:?}", b[row]);
        }
        let gap = (2.0 * report.cost / sum_of_squares - 1.0).abs();
        // The certificate has eleven digits.
        assert!(gap < 1e-9, "{name} from {start:?}: gap {gap:e}, {report:?}");
    }
}

#[rustfmt::skip]
const MISRA1A: [(f64, f64); 14] = [
    (77.6, 10.07), (114.9, 14.73), (141.1, 17.94), (190.8, 23.93), (239.9, 29.61), (289.0, 35.18),
    (332.8, 40.02), (378.4, 44.82), (434.8, 50.76), (477.3, 55.05), (536.8, 61.01), (593.1, 66.40),
    (689.1, 75.47), (760.0, 81.78),
];

#[rustfmt::skip]
const MGH09: [(f64, f64); 11] = [
    (4.0, 0.1957), (2.0, 0.1947), (1.0, 0.1735), (0.5, 0.16), (0.25, 0.0844), (0.167, 0.0627),
    (0.125, 0.0456), (0.1, 0.0342), (0.0833, 0.0323), (0.0714, 0.0235), (0.0625, 0.0246),
];

#[rustfmt::skip]
const RAT43: [(f64, f64); 15] = [
    (1.0, 16.08), (2.0, 33.83), (3.0, 65.80), (4.0, 97.20), (5.0, 191.55), (6.0, 326.20),
    (7.0, 386.87), (8.0, 520.53), (9.0, 590.03), (10.0, 651.92), (11.0, 724.93), (12.0, 699.56),
    (13.0, 689.96), (14.0, 637.56), (15.0, 717.41),
];

#[rustfmt::skip]
const THURBER: [(f64, f64); 37] = [
    (-3.067, 80.574), (-2.981, 84.248), (-2.921, 87.264), (-2.912, 87.195),
    (-2.840, 89.076), (-2.797, 89.608), (-2.702, 89.868), (-2.699, 90.101),
    (-2.633, 92.405), (-2.481, 95.854), (-2.363, 100.696), (-2.322, 101.060),
    (-1.501, 401.672), (-1.460, 390.724), (-1.274, 567.534), (-1.212, 635.316),
    (-1.100, 733.054), (-1.046, 759.087), (-0.915, 894.206), (-0.714, 990.785),
    (-0.566, 1090.109), (-0.545, 1080.914), (-0.400, 1122.643), (-0.309, 1178.351),
    (-0.109, 1260.531), (-0.103, 1273.514), (0.010, 1288.339), (0.119, 1327.543),
    (0.377, 1353.863), (0.790, 1414.509), (0.963, 1425.208), (1.006, 1421.384),
    (1.115, 1442.962), (1.572, 1464.350), (1.841, 1468.705), (2.047, 1447.894),
    (2.200, 1457.628),
];

#[rustfmt::skip]
#[expect(clippy::unreadable_literal, reason = "digits as in the certificate")]
const ECKERLE4: [(f64, f64); 35] = [
    (400.0, 0.0001575), (405.0, 0.0001699), (410.0, 0.0002350), (415.0, 0.0003102),
    (420.0, 0.0004917), (425.0, 0.0008710), (430.0, 0.0017418), (435.0, 0.0046400),
    (436.5, 0.0065895), (438.0, 0.0097302), (439.5, 0.0149002), (441.0, 0.0237310),
    (442.5, 0.0401683), (444.0, 0.0712559), (445.5, 0.1264458), (447.0, 0.2073413),
    (448.5, 0.2902366), (450.0, 0.3445623), (451.5, 0.3698049), (453.0, 0.3668534),
    (454.5, 0.3106727), (456.0, 0.2078154), (457.5, 0.1164354), (459.0, 0.0616764),
    (460.5, 0.0337200), (462.0, 0.0194023), (463.5, 0.0117831), (465.0, 0.0074357),
    (470.0, 0.0022732), (475.0, 0.0008800), (480.0, 0.0004579), (485.0, 0.0002345),
    (490.0, 0.0001586), (495.0, 0.0001143), (500.0, 0.0000710),
];

#[test]
fn misra1a_reaches_its_certificate() {
    certify(
        "Misra1a",
        |b: &Vector<2>, x| b[0] * (1.0 - (-b[1] * x).exp()),
        &MISRA1A,
        [[500.0, 1e-4], [250.0, 5e-4]],
        ([2.389_421_291_8E+02, 5.501_564_318_1E-04], 1.245_513_889_4E-01),
    );
}

#[test]
fn mgh09_reaches_its_certificate() {
    certify(
        "MGH09",
        |b: &Vector<4>, x| b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3]),
        &MGH09,
        [[25.0, 39.0, 41.5, 39.0], [0.25, 0.39, 0.415, 0.39]],
        (
            [1.928_069_345_8E-01, 1.912_823_287_3E-01, 1.230_565_069_3E-01, 1.360_623_306_8E-01],
            3.075_056_038_5E-04,
        ),
    );
}

#[test]
fn rat43_reaches_its_certificate() {
    certify(
        "Rat43",
        |b: &Vector<4>, x| b[0] / (1.0 + (b[1] - b[2] * x).exp()).powf(1.0 / b[3]),
        &RAT43,
        [[100.0, 10.0, 1.0, 1.0], [700.0, 5.0, 0.75, 1.3]],
        (
            [6.996_415_127_0E+02, 5.277_125_302_5E+00, 7.596_293_832_9E-01, 1.279_248_385_9E+00],
            8.786_404_908_0E+03,
        ),
    );
}

#[test]
fn thurber_reaches_its_certificate() {
    certify(
        "Thurber",
        |b: &Vector<7>, x| {
            let above = b[0] + x * (b[1] + x * (b[2] + x * b[3]));
            above / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))
        },
        &THURBER,
        [
            [1000.0, 1000.0, 400.0, 40.0, 0.7, 0.3, 0.03],
            [1300.0, 1500.0, 500.0, 75.0, 1.0, 0.4, 0.05],
        ],
        (
            [
                1.288_139_680_0E+03,
                1.491_079_253_5E+03,
                5.832_383_687_7E+02,
                7.541_664_429_1E+01,
                9.662_950_286_4E-01,
                3.979_728_579_7E-01,
                4.972_729_734_9E-02,
            ],
            5.642_708_239_7E+03,
        ),
    );
}

#[test]
fn eckerle4_reaches_its_certificate() {
    certify(
        "Eckerle4",
        |b: &Vector<3>, x| b[0] / b[1] * (-0.5 * ((x - b[2]) / b[1]).powi(2)).exp(),
        &ECKERLE4,
        [[1.0, 10.0, 500.0], [1.5, 5.0, 450.0]],
        ([1.554_382_717_8E+00, 4.088_832_175_4E+00, 4.515_412_184_4E+02], 1.463_588_748_7E-03),
    );
}

/// The straight line through four points: its normal equations are solved on paper.
fn line() -> Curve<2> {
    const POINTS: [(f64, f64); 4] = [(0.0, 1.0), (1.0, 3.0), (2.0, 2.0), (3.0, 5.0)];
    Curve::new(|b, x| b[0] + b[1] * x, &POINTS, [10.0, -10.0])
}

#[test]
fn a_straight_line_meets_its_closed_form() {
    let mut curve = line();
    let report = solve(&mut curve, &settings(), &mut || false).unwrap();
    let b = curve.b.component_mul(&curve.unit);
    assert!((b - Vector::from([1.1, 1.1])).norm() < 1e-9, "{b}");
    assert!((report.cost - 1.35).abs() < 1e-9, "{report:?}");
    assert!(report.cost_start > report.cost && report.rejected == 0, "{report:?}");
}

#[test]
fn a_step_that_the_damping_made_short_is_no_end() {
    // Curvatures 1e18 and 1: the damping, in units of the larger one, would hold the second parameter for ever.
    let f = |b: &Vector<2>, x| if x > 0.0 { 1e9 * b[0] } else { b[1] };
    for tolerances in [1e-12, 0.0] {
        let mut curve = Curve::new(f, &[(0.0, 5.0), (1.0, 1e9)], [1.0, 1.0]);
        let settings =
            LmSettings { step_tolerance: tolerances, cost_tolerance: 1e-9, ..settings() };
        let report = solve(&mut curve, &settings, &mut || false).unwrap();
        assert!((curve.b - Vector::from([1.0, 5.0])).norm() < 1e-6, "{report:?}");
        assert!(report.cost_start > 7.9 && report.iterations < 6, "{report:?}");
    }
}

#[test]
fn a_gain_that_is_predicted_right_by_chance_is_no_end() {
    // Curvatures of both signs, whose errors of the predicted gain cancel at this start.
    let f = |b: &Vector<2>, x| match x {
        0.0 => b[0],
        1.0 => 0.25 * b[0] * b[0],
        2.0 => b[1],
        _ => -0.25 * b[1] * b[1],
    };
    let data = &[(0.0, 0.0), (1.0, -1.0), (2.0, 0.0), (3.0, -1.0)];
    let mut curve = Curve::new(f, data, [1.5, 3.493_707_744_036_844]);
    let settings = LmSettings { damping_start: 1e-9, cost_tolerance: 1e-3, ..settings() };
    let report = solve(&mut curve, &settings, &mut || false).unwrap();
    assert!((report.cost - 1.0).abs() < 2e-3, "{report:?}");
}

#[test]
fn every_limit_has_its_own_stop_and_keeps_the_best_iterate() {
    let stop = |settings: LmSettings, late_after: u32| {
        let mut curve = line();
        let mut polls = 0;
        let mut is_late = || {
            polls += 1;
            polls > late_after
        };
        let report = solve(&mut curve, &settings, &mut is_late).unwrap();
        let cost = curve.cost(&curve.b);
        assert_eq!(cost.to_bits(), report.cost.to_bits(), "{report:?}");
        (report.stop, report.iterations)
    };
    let slow = LmSettings { damping_start: 1.0, ..settings() };
    assert_eq!(stop(slow, 0), (LmStop::Late, 0));
    assert_eq!(stop(slow, 3), (LmStop::Late, 3));
    assert_eq!(stop(LmSettings { iterations_max: 2, ..slow }, 9), (LmStop::IterationLimit, 2));
    assert_eq!(stop(LmSettings { cost_tolerance: 0.1, ..slow }, 99).0, LmStop::CostTolerance);
    assert_eq!(stop(LmSettings { step_tolerance: 0.1, ..slow }, 99).0, LmStop::StepTolerance);
}

#[test]
fn a_curve_without_descent_ends_at_the_damping_limit() {
    // A sharp minimum on a gentle gradient: the derivative points down, every step goes up.
    let cusp = |b: &Vector<1>, _| 1.0 + (b[0] - 1.0).abs().sqrt() + 1e-3 * b[0];
    let mut curve = Curve::new(cusp, &[(0.0, 0.0)], [1.0]);
    let no_tolerance = LmSettings { step_tolerance: 0.0, ..settings() };
    let report = solve(&mut curve, &no_tolerance, &mut || false).unwrap();
    assert_eq!(report.stop, LmStop::DampingLimit, "{report:?}");
    assert_eq!(report.rejected, report.iterations);
    assert_eq!(report.cost.to_bits(), report.cost_start.to_bits());
}

#[test]
fn nan_at_the_start_is_an_error() {
    let mut curve = Curve::new(|b, _| b[0].sqrt(), &[(0.0, 0.0)], [-1.0]);
    let error = solve(&mut curve, &settings(), &mut || false).unwrap_err();
    assert_eq!(error.to_string(), "curve is not finite at window step 0");
}

#[test]
fn a_setting_out_of_range_is_named() {
    let table = LmTable {
        damping_start: 1e-6,
        cost_tolerance: 0.2,
        step_tolerance: 1e-9,
        iterations_max: 10,
    };
    let error = LmSettings::try_from(&table).unwrap_err();
    assert_eq!(error.to_string(), "cost_tolerance = 0.2: expected 0.0..=0.1");
}

#[test]
fn the_name_of_each_reason_to_stop_is_that_of_serde() {
    let all = [
        LmStop::CostTolerance,
        LmStop::StepTolerance,
        LmStop::IterationLimit,
        LmStop::Late,
        LmStop::DampingLimit,
    ];
    // The schema has one entry for each variant, in their order.
    let schema = serde_json::to_value(schemars::schema_for!(LmStop)).unwrap();
    let variants = schema["oneOf"].as_array().unwrap();
    assert_eq!(variants.len(), all.len(), "{variants:?}");
    for (stop, variant) in all.into_iter().zip(variants) {
        assert_eq!(serde_json::to_value(stop).unwrap(), stop.name());
        assert_eq!(variant["const"], stop.name());
    }
}

/// Line `y = b_0 + b_1 x` in units that are 1e12 apart.
#[test]
fn a_row_that_the_damping_alone_holds_back_is_no_end() {
    let data: &[(f64, f64)] = &[(1e-12, 3.0), (2e-12, 5.0), (3e-12, 7.0), (4e-12, 9.0)];
    let line = |b: &Vector<2>, x: f64| b[0] + b[1] * x;
    let mut fit = Curve::new(line, data, [1.0, 1.0]);
    fit.b = [0.9, 1e12].into();
    let report = solve(&mut fit, &settings(), &mut || false).unwrap();
    assert!(report.is_converged(), "{report:?}");
    assert!((fit.b[0] - 1.0).abs() < 1e-6 && (fit.b[1] / 2e12 - 1.0).abs() < 1e-6, "{}", fit.b);
}
