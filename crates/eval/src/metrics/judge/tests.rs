//! Synthetic tracks whose figures are known.

use nalgebra::Vector2;

use super::*;
use crate::metrics::corners;

const DT_S: f64 = 0.02;

fn square() -> ReferencePath {
    let targets: Vec<Pose> = [[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]]
        .map(|[x, y]| Pose::new(x, y, 1.0, 0.0))
        .to_vec();
    ReferencePath {
        outline: targets.clone(),
        targets_count: targets.len(),
        targets,
        reach: 0.2,
        ends_with_mission: false,
        laps: 1,
        rounds: 1.0,
    }
}

/// Poses every `step_m` along the polyline through `corners`, at the height of the reference path.
fn along(corners: &[[f64; 2]], step_m: f64) -> Vec<Pose> {
    let mut poses = vec![];
    for side in corners.windows(2) {
        let [from, to] = [side[0], side[1]].map(Vector2::from);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some hundred steps"
        )]
        let steps = ((to - from).norm() / step_m).round() as u32;
        poses.extend((0..steps).map(|k| {
            let at_w = from + (to - from) * (f64::from(k) / f64::from(steps));
            Pose::new(at_w.x, at_w.y, 1.0, 0.0)
        }));
    }
    poses
}

fn judged(poses: &[Pose], begins_at: usize) -> Judge {
    let mut judge = Judge::new(&square(), DT_S);
    let u = Sticks::new(0.3, 0.4, 0.0, 0.0);
    for (k, at) in poses.iter().enumerate() {
        judge.add(k as f64 * DT_S, at, &u, usize::from(k >= begins_at));
    }
    judge
}

fn near(got: f64, expected: f64, what: &str) {
    assert!((got - expected).abs() < 1e-9, "{what}: {got} instead of {expected}");
}

#[test]
fn a_perfect_square_at_constant_speed_takes_its_length() {
    let poses = along(&[[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]], 0.01);
    let score = judged(&poses, 0).score().unwrap();
    // Within 0.2 m of the end after 5.8 m of 0.01 m a tick: 581 ticks, the first one included.
    near(score.metrics.finish_s.unwrap(), 581.0 * DT_S, "finish");
    near(score.since_entry_s.unwrap(), 581.0 * DT_S, "since entry");
    near(score.metrics.distance_max_m, 0.0, "distance");
    near(score.metrics.speed_median_mps, 0.5, "speed");
    near(score.metrics.input_norm_median, 0.5, "norm");
    assert_eq!(score.overshoots_m, [0.0; 3]);
}

#[test]
fn overshoot_is_the_way_beyond_a_corner_along_the_side_that_led_there() {
    // 0.1 m too far at the first corner, 0.05 m at the third; sideways errors do not count.
    let corners =
        [[0.0, 0.0], [1.6, 0.0], [1.6, 1.5], [0.0, 1.5], [-0.05, 1.5], [-0.05, 0.0], [0.0, 0.0]];
    let judge = judged(&along(&corners, 0.01), 0);
    let score = judge.score().unwrap();
    for (got, expected) in score.overshoots_m.iter().zip([0.1, 0.0, 0.05]) {
        near(*got, expected, "overshoot");
    }
    assert_eq!(score.overshoots_m.len(), 3);
    near(score.metrics.distance_max_m, 0.1, "largest distance");
    near(judge.fence().distance_m, 0.1, "fence");
}

#[test]
fn who_waits_at_the_start_pays_since_entry_alone() {
    let square = along(&[[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]], 0.01);
    let mut poses = vec![square[0]; 100];
    poses.extend(&square);
    let score = judged(&poses, 100).score().unwrap();
    near(score.metrics.finish_s.unwrap(), 581.0 * DT_S, "finish");
    near(score.since_entry_s.unwrap(), 681.0 * DT_S, "since entry");
}

#[test]
fn a_target_left_out_is_not_made_up_for_later() {
    // Cuts the second corner by more than the reach.
    let corners = [[0.0, 0.0], [1.5, 0.0], [1.5, 1.0], [1.0, 1.5], [0.0, 1.5], [0.0, 0.0]];
    let judge = judged(&along(&corners, 0.01), 0);
    let score = judge.score().unwrap();
    assert!(!judge.is_finished() && score.metrics.finish_s.is_none(), "{score:?}");
    assert_eq!(score.overshoots_m.len(), 1, "only the first corner was reached");
}

#[test]
fn nothing_counts_before_the_start_or_after_the_end() {
    let far = Pose::new(9.0, 9.0, 1.5, 0.0);
    let mut poses = vec![far];
    poses.extend(along(&[[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]], 0.01));
    poses.push(far);
    let judge = judged(&poses, 1);
    let score = judge.score().unwrap();
    near(score.metrics.distance_max_m, 0.0, "distance");
    assert!(judged(&poses, poses.len()).score().is_none());
    // The fence knows the whole flight.
    assert!(judge.fence().distance_m > 9.0, "{:?}", judge.fence());
    near(judge.fence().height_m, 0.5, "height");
}

#[test]
fn a_turn_of_less_than_a_right_angle_is_no_corner() {
    let turn = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [3.0, 0.5], [2.0, 0.5]];
    let targets: Vec<Pose> = turn.map(|[x, y]| Pose::new(x, y, 1.0, 0.0)).to_vec();
    let found: Vec<usize> = corners(&targets).iter().map(|corner| corner.target).collect();
    assert_eq!(found, [3], "the turn back alone");
}
