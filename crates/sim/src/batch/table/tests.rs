use tello_eval::metrics::Fence;

use super::*;

/// A flight with its fence, outages and ending.
fn flown(finish_s: Option<f64>, fence: (f64, f64), outages: u64) -> Flown {
    let mut flown = Flown::example(finish_s, 0.2);
    flown.row.fence = Fence { distance_m: fence.0, height_m: fence.1 };
    flown.row.outages = Outages { count: outages, down_s: 1.5 * outages as f64 };
    flown.row.solvers =
        SolverCounts { ticks: 100, estimator_failures: 1, controller_failures: 2, old_plans: 3 };
    flown
}

#[test]
fn flights_are_counted_by_their_ending_and_fault() {
    let mut landed = flown(None, (0.0, 0.0), 0);
    landed.row.ending = Ending::Landed;
    landed.row.landed_by = vec![Fault::FenceLeft];
    let mut missed = flown(Some(10.0), (0.0, 0.0), 0);
    missed.row.ending = Ending::Missed;
    let finished = flown(Some(10.0), (0.0, 0.0), 0);
    let late = flown(None, (0.0, 0.0), 0);
    let batch = Batch::of(&[landed.clone(), landed, missed, finished, late]);
    let Batch { finished_count, missed_count, landed_count, unfinished_count, .. } = batch;
    assert_eq!((finished_count, missed_count, landed_count, unfinished_count), (1, 1, 2, 1));
    assert_eq!(batch.landed_by, BTreeMap::from([(Fault::FenceLeft, 2)]));
    // Wilson's interval of 1 in 5: (0.2 + z^2 / 10 +- z sqrt(0.2 * 0.8 / 5 + z^2 / 100)) / (1 + z^2 / 5), z = 1.96.
    let [low, high] = batch.finished_interval;
    assert!((low - 0.0362).abs() < 1e-4 && (high - 0.6245).abs() < 1e-4, "{low}, {high}");
    let text = batch.to_string();
    let counts = "5: 1 finished, 1 missed a target, 2 landed early, 1 not done after 120 s";
    assert!(text.contains(counts), "{text}");
}

#[test]
fn the_fence_is_left_aside_or_up_and_sums_are_per_flight() {
    let batch = Batch::of(&[
        flown(Some(10.0), (0.4, 0.1), 0),
        flown(Some(20.0), (0.7, 0.2), 2),
        flown(Some(30.0), (0.1, 0.6), 1),
        flown(Some(40.0), (0.5, 0.5), 1),
    ]);
    // 0.5 m is not beyond 0.5 m.
    assert!((batch.outside_fence - 0.5).abs() < 1e-15, "{}", batch.outside_fence);
    let largest = [batch.fence_distance_m, batch.fence_height_m];
    assert_eq!(largest.map(f64::to_bits), [0.7_f64, 0.6].map(f64::to_bits));
    assert!((batch.outages_per_flight - 1.0).abs() < 1e-15);
    assert!((batch.down_s_per_flight - 1.5).abs() < 1e-15);
    let sum =
        SolverCounts { ticks: 400, estimator_failures: 4, controller_failures: 8, old_plans: 12 };
    assert_eq!(batch.solvers, sum);
}

#[test]
fn an_unfinished_flight_counts_with_the_time_limit_and_a_wide_one_as_invalid() {
    let mut wide = flown(Some(30.0), (0.0, 0.0), 0);
    wide.row.by_truth.as_mut().unwrap().metrics.distance_max_m = 0.31;
    let batch = Batch::of(&[
        flown(Some(10.0), (0.0, 0.0), 0),
        flown(Some(20.0), (0.0, 0.0), 0),
        wide,
        flown(None, (0.0, 0.0), 0),
        flown(None, (0.0, 0.0), 0),
    ]);
    let spread = batch.by_truth.unwrap();
    assert_eq!(
        spread.finish_quartiles_s.map(f64::to_bits),
        [20.0_f64, 30.0, 120.0].map(f64::to_bits)
    );
    assert!((spread.within_valid_distance - 0.4).abs() < 1e-15, "{spread:?}");
    // 0.1, 0.0 and 0.2 in each flight.
    let [median_m, high_m] = spread.overshoot_m.unwrap();
    assert!((median_m - 0.1).abs() < 1e-15 && (high_m - 0.2).abs() < 1e-15, "{spread:?}");
    assert_eq!(batch.by_estimate, None);
}

#[test]
fn the_worst_hover_is_the_one_furthest_from_zero() {
    let hover = |height_mean_m: f64| HoverScore {
        position_rms_m: height_mean_m.abs(),
        horizontal_rms_m: 0.02,
        height_mean_m,
        height_rms_m: 0.04,
        heading_rms_rad: 0.05,
    };
    let spread = HoverSpread::of(&[hover(0.1), hover(-0.3), hover(0.2)]).unwrap();
    let got = [spread.height_mean_m, spread.position_rms_m].as_flattened().to_vec();
    for (got, expected) in got.iter().zip([0.1, -0.3, 0.2, 0.3]) {
        assert!((got - expected).abs() < 1e-15, "{spread:?}");
    }
    assert_eq!(HoverSpread::of(&[]), None);
}
