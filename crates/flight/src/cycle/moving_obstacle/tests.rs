use std::f64::consts::TAU;

use horizon_model::check::maximum;

use super::*;

const DT_S: f64 = 0.02;

/// After `count` periods along x with 1 m/s.
fn followed(count: u32) -> MovingObstacle {
    let mut obstacle = MovingObstacle::default();
    for k in 0..count {
        obstacle.follow(Some(position_w(k)), DT_S);
    }
    obstacle
}

fn position_w(k: u32) -> [f64; 3] {
    [DT_S * f64::from(k), 2.0, 1.0]
}

#[test]
fn a_straight_motion_is_predicted_after_half_a_second() {
    let found = followed(26).position(1.0).unwrap();
    assert!((found - Vector3::new(1.5, 2.0, 1.0)).norm() < 0.05, "{found}");
}

#[test]
fn an_oscillating_obstacle_shows_the_acceleration_of_its_sine_and_a_straight_motion_none() {
    let shown = |motion: &dyn Fn(f64) -> f64| {
        let mut obstacle = MovingObstacle::default();
        for k in 0..500 {
            let t_s = DT_S * f64::from(k);
            obstacle.follow(Some([motion(t_s), 0.8 * t_s, 1.0]), DT_S);
        }
        obstacle.acceleration_mps2()
    };
    assert!(shown(&|t_s| t_s) < 0.1, "straight");
    // 0.3 m at 0.3 Hz: 1.07 m/s^2.
    let slow = shown(&|t_s| 0.3 * (TAU * 0.3 * t_s).sin());
    assert!((0.8..1.2).contains(&slow), "{slow}");
    assert!((shown(&|t_s| 0.3 * (TAU * 0.9 * t_s).sin()) - ACCEL_MAX_MPS2).abs() < 1e-12);
}

#[test]
fn the_mean_velocity_leads_elsewhere_only_where_the_velocity_changes() {
    assert_eq!(followed(500).position_by_mean(1.0), None, "straight");
    let mut obstacle = MovingObstacle::default();
    let mut worst_m: f64 = 0.0;
    for k in 0..500 {
        let t_s = DT_S * f64::from(k);
        obstacle.follow(Some([0.3 * (TAU * t_s).sin(), 0.6 * t_s, 1.0]), DT_S);
        if t_s > 4.0
            && let Some(ahead) = obstacle.position_by_mean(1.0)
        {
            let apart_w = ahead.xy() - Vector3::new(0.0, 0.6 * (t_s + 1.0), 1.0).xy();
            worst_m = maximum(worst_m, apart_w.norm());
        }
    }
    // The obstacle oscillates by 0.3 m at up to 1.9 m/s: the present velocity alone would err by up to 1.9 m.
    assert!(worst_m < 0.65, "{worst_m}");
}

#[test]
fn what_is_not_seen_goes_on_for_two_seconds_and_is_unseen_after_half_of_one() {
    let go_on = |count: u32| {
        let mut obstacle = followed(100);
        for k in 0..count {
            let lost_w = [[f64::NAN, 0.0, 0.0], [0.0; 3]][usize::from(k % 4 == 3)];
            obstacle.follow((k % 2 == 1).then_some(lost_w), DT_S);
        }
        obstacle
    };
    let position = go_on(90).position(0.0).unwrap();
    assert!((position.x - 0.02 * 189.0).abs() < 0.06, "{position}");
    assert_eq!(go_on(102).position(0.0), None);
    assert_eq!([24, 27].map(|count| go_on(count).is_unseen()), [false, true]);
}

#[test]
fn a_person_who_was_hidden_walks_on_and_one_who_appears_is_seen_when_the_velocity_is_known() {
    // It turned round while hidden for 1.4 s: the displacement over the gap gives the velocity.
    let mut obstacle = followed(100);
    (0..70).for_each(|_| obstacle.follow(None, DT_S));
    obstacle.follow(Some([0.58, 2.0, 1.0]), DT_S);
    assert!(!obstacle.is_unseen());
    let ahead = obstacle.position(1.0).unwrap();
    assert!((ahead.x - (0.58 - 1.4 / 1.42)).abs() < 0.02, "{ahead}");
    let mut found = MovingObstacle::default();
    let seen_after = (0..50).find(|k| {
        found.follow(Some(position_w(*k)), DT_S);
        !found.is_unseen()
    });
    assert_eq!(seen_after, Some(14), "0.3 s");
    assert!((found.position(1.0).unwrap().x - 1.28).abs() < 0.1, "{found:?}");
}

#[test]
fn short_glimpses_give_the_velocity_of_a_continuous_view() {
    for gap in [2, 5, 10, 15, 20] {
        let mut obstacle = MovingObstacle::default();
        for k in 0..200 {
            obstacle.follow((k % gap == 0).then(|| position_w(k)), DT_S);
            let ahead = obstacle.position(0.5).unwrap();
            if k > 3 * gap.max(8) {
                assert!((ahead.x - position_w(k + 25)[0]).abs() < 0.05, "{gap}, {k}: {ahead}");
            }
        }
    }
}

#[test]
fn an_outlier_moves_nothing_and_an_obstacle_that_is_elsewhere_is_found() {
    let mut obstacle = followed(100);
    for k in 100..110 {
        let [x, y, z] = position_w(k);
        obstacle.follow(Some([x, y + if k == 100 { 0.5 } else { 0.0 }, z]), DT_S);
        let ahead = obstacle.position(0.5).unwrap();
        let [x, y, z] = position_w(k + 25);
        assert!((ahead - Vector3::new(x, y, z)).norm() < 0.02, "{k}: {ahead}");
    }
    // 1.1 m away: not at once, but before it is unseen, and at rest at first.
    let there_w = |k: u32| [1.1, 2.0, 1.0 + 1e-4 * f64::from(k % 3)];
    let mut found_after = None;
    for k in 0..24 {
        obstacle.follow(Some(there_w(k)), DT_S);
        let is_there = (obstacle.position(0.5).unwrap() - Vector3::from(there_w(k))).norm() < 0.01;
        found_after = found_after.or(is_there.then_some(k));
    }
    assert!(found_after.is_some_and(|k| (8..20).contains(&k)), "{found_after:?}");
}

#[test]
fn a_stream_that_stands_still_is_no_obstacle_that_stops() {
    let mut stuck = followed(100);
    for _ in 0..26 {
        stuck.follow(Some(position_w(99)), DT_S);
    }
    assert!(stuck.is_unseen());
    // Neither is one that repeats the position of somebody who stood and swayed.
    let mut stuck = MovingObstacle::default();
    for k in 0..60 {
        stuck.follow(Some([1.0 + 1e-4 * f64::from(k % 3), 2.0, 1.0]), DT_S);
    }
    let unseen_after = (0..60).find(|_| {
        stuck.follow(Some([1.0, 2.0, 1.0]), DT_S);
        stuck.is_unseen()
    });
    assert!(
        unseen_after.is_some_and(|k| (38..42).contains(&k)),
        "0.3 s and 0.5 s: {unseen_after:?}"
    );
    // One that has slowed down and stands is known, also without noise.
    let mut slow = followed(100);
    let mut x_m = position_w(99)[0];
    for k in 0..200 {
        x_m += DT_S * (1.0 - 4.0 * DT_S * f64::from(k)).max(0.0);
        slow.follow(Some([x_m, 2.0, 1.0]), DT_S);
    }
    let stands_w = Vector3::new(x_m, 2.0, 1.0);
    assert!((slow.position(0.5).unwrap() - stands_w).norm() < 1e-3);
    // Also after it was hidden.
    (0..102).for_each(|_| slow.follow(None, DT_S));
    assert_eq!(slow.position(0.0), None);
    slow.follow(Some(stands_w.into()), DT_S);
    assert_eq!(slow.position(0.5), Some(stands_w));
}
