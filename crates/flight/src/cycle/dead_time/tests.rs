use horizon_model::check::amax;

use super::*;

const DT_S: f64 = 0.02;
const DEAD_TIME_S: [f64; stick::COUNT] = [0.34, 0.34, 0.04, 0.19];

fn dead_time(change_s: f64) -> DeadTime {
    let text = include_str!("../../../../../configs/fly.json");
    let settings: serde_json::Value = serde_json::from_str(text).unwrap();
    let link = settings["cycle"]["link"].clone();
    let table: LinkTable = serde_json::from_value(link).unwrap();
    let table = LinkTable { dead_time_change_s: change_s, ..table };
    DeadTime::new(&table, &Sticks::from(DEAD_TIME_S), DT_S)
}

/// What is known of roll and pitch alone.
fn common(mean_s: f64, sd_s: f64) -> DeadTimeErrors {
    DeadTimeErrors { horizontal: DeadTimeError { mean_s, sd_s }, throttle: None, yaw: None }
}

fn steps(dead_time: &DeadTime) -> [i32; stick::COUNT] {
    dead_time.change().map_or([0; stick::COUNT], |change| change.steps)
}

/// The corrections of roll in 250 periods of a vehicle whose dead times are wrong by `error_s`, known to `sd_s`. steps
fn corrected(change_s: f64, error_s: f64, sd_s: f64) -> i32 {
    let mut dead_time = dead_time(change_s);
    for period in 0..250_u32 {
        let before = steps(&dead_time)[stick::ROLL];
        let left_s = error_s - f64::from(before) * DT_S;
        let is_changed = dead_time.correct(Some(common(left_s, sd_s)));
        let step = steps(&dead_time)[stick::ROLL] - before;
        assert_eq!(is_changed, step != 0);
        assert!(step.abs() <= 1 && (step == 0 || period % PERIODS_BETWEEN == 4));
    }
    steps(&dead_time)[stick::ROLL]
}

#[test]
fn an_error_is_followed_as_far_as_it_is_known_and_allowed() {
    for (change_s, error_s, sd_s, steps) in [
        (0.3, 0.1, 0.02, 5),
        (0.3, -0.1, 0.02, -5),
        // Within three quarters of a period, or one standard deviation.
        (0.3, 0.014, 0.001, 0),
        (0.3, 0.1, 0.03, 4),
        (0.3, 0.02, 0.03, 0),
        // Two thirds of the prior standard deviation are left: not excited.
        (0.3, 0.1, 0.04, 0),
        (0.06, 0.1, 0.02, 3),
        (0.06, -0.1, 0.02, -3),
        // Half of the dead time stays: at least 8.5 of 17 periods.
        (0.3, -0.3, 0.02, -8),
        (0.0, 0.1, 0.02, 0),
    ] {
        assert_eq!(corrected(change_s, error_s, sd_s), steps, "{error_s} +- {sd_s} s");
    }
}

/// The corrections after 200 periods of a vehicle whose dead times of pitch, throttle and yaw are wrong by `errors_s`;
/// what is known of throttle and yaw has the standard deviation `sd_s`. steps
fn corrected_each(errors_s: [f64; 3], sd_s: f64) -> [i32; stick::COUNT] {
    let mut dead_time = dead_time(0.3);
    for _ in 0..200 {
        let steps = steps(&dead_time).map(f64::from);
        let [pitch, throttle, yaw] = [stick::PITCH, stick::THROTTLE, stick::YAW];
        let left_s = |axis: usize, error_s: f64| error_s - steps[axis] * DT_S;
        let own = |axis, error_s| Some(DeadTimeError { mean_s: left_s(axis, error_s), sd_s });
        dead_time.correct(Some(DeadTimeErrors {
            horizontal: DeadTimeError { mean_s: left_s(pitch, errors_s[0]), sd_s: 0.01 },
            throttle: own(throttle, errors_s[1]),
            yaw: own(yaw, errors_s[2]),
        }));
    }
    steps(&dead_time)
}

#[test]
fn throttle_and_yaw_follow_roll_and_pitch_until_their_own_motion_shows_their_dead_time() {
    // Roll, pitch, yaw, throttle.
    assert_eq!(corrected_each([0.1, 0.0, 0.0], 0.04), [5; stick::COUNT], "not excited");
    assert_eq!(corrected_each([0.1, 0.0, 0.0], 0.01), [5, 5, 0, 0]);
    assert_eq!(corrected_each([0.1, 0.1, 0.1], 0.01), [5; stick::COUNT]);
    assert_eq!(corrected_each([0.0, 0.2, -0.1], 0.01), [0, 0, -1, 10], "half of yaw's stays");
    assert_eq!(corrected_each([0.26, 0.4, -0.4], 0.01), [13, 13, -1, 15], "no more than 0.3 s");
    assert_eq!(corrected_each([-0.1, -0.2, 0.04], 0.01), [-5, -5, 2, -4], "half of throttle's");
}

#[test]
fn what_was_known_of_an_axis_is_forgotten_when_it_follows_the_others() {
    let mut dead_time = dead_time(0.3);
    let own = |mean_s| Some(DeadTimeError { mean_s, sd_s: 0.01 });
    dead_time.correct(Some(DeadTimeErrors { yaw: own(0.01), ..common(0.0, 0.01) }));
    assert_eq!(dead_time.change().unwrap().yaw_error, own(0.01));
    for _ in 0..PERIODS_BETWEEN {
        dead_time.correct(Some(common(0.05, 0.01)));
    }
    let change = dead_time.change().unwrap();
    assert_eq!((change.steps, change.yaw_error), ([1; stick::COUNT], None));
}

#[test]
fn an_axis_that_follows_is_limited_but_keeps_pace_when_the_others_return() {
    let mut dead_time = dead_time(0.3);
    let mut follow = |mean_s: f64| {
        for _ in 0..PERIODS_BETWEEN {
            dead_time.correct(Some(common(mean_s, 0.01)));
        }
        steps(&dead_time)
    };
    for _ in 0..SHORT_PERIODS / PERIODS_BETWEEN + 3 {
        follow(-0.1);
    }
    assert_eq!(follow(-0.1), [-5; stick::COUNT], "the FIFO keeps the least dead time of yaw");
    assert_eq!(follow(0.1), [-4; stick::COUNT]);
    assert_eq!(follow(-0.1), [-5; stick::COUNT]);
    // Half of 0.04 and of 0.19 s.
    let applied_s = dead_time.change().unwrap().change_s;
    assert!(amax(&(applied_s - Sticks::new(-0.1, -0.1, -0.02, -0.095))) < 1e-12, "{applied_s}");
}

#[test]
fn a_dead_time_is_too_long_when_much_is_left_of_the_largest_correction() {
    let followed = |change_s: f64, errors: DeadTimeErrors| {
        let mut dead_time = dead_time(change_s);
        for _ in 0..100 {
            dead_time.correct(Some(errors));
        }
        dead_time.is_too_long()
    };
    let is_long = |change_s, mean_s, sd_s| followed(change_s, common(mean_s, sd_s));
    assert!(is_long(0.3, 0.09, 0.02));
    assert!(!is_long(0.3, LEFT_MAX_S, 0.02), "the limit itself");
    assert!(!is_long(0.3, 0.07, 0.02) && !is_long(0.3, -0.09, 0.02), "little left, or early");
    assert!(!is_long(0.5, 0.09, 0.02), "after 20 of 25 steps");
    assert!(!is_long(0.3, 0.09, 0.05) && !is_long(0.0, 0.09, 0.02), "unknown, or not corrected");
    let late = Some(DeadTimeError { mean_s: LEFT_OWN_MAX_S.next_up(), sd_s: 0.02 });
    let flown = Some(DeadTimeError { mean_s: LEFT_OWN_MAX_S, sd_s: 0.02 });
    let right = common(0.0, 0.02);
    assert!(!followed(0.3, DeadTimeErrors { throttle: flown, yaw: flown, ..right }));
    assert!(followed(0.3, DeadTimeErrors { throttle: late, ..right }));
    assert!(followed(0.3, DeadTimeErrors { yaw: late, ..right }));
    assert!(!followed(0.5, DeadTimeErrors { throttle: late, yaw: late, ..right }));
}

#[test]
fn what_is_left_is_reported_with_the_correction() {
    let mut dead_time = dead_time(0.3);
    let change = dead_time.change().unwrap();
    assert_eq!((change.steps, change.error, change.found_s()), ([0; 4], None, None));
    let own = |mean_s| Some(DeadTimeError { mean_s, sd_s: 0.02 });
    let errors = DeadTimeErrors { throttle: own(0.01), ..common(0.05, 0.02) };
    let stepped = (0..5).filter(|_| dead_time.correct(Some(errors))).count();
    let change = dead_time.change().unwrap();
    assert_eq!((stepped, change.steps), (1, [1, 1, 1, 0]));
    assert!((change.error.unwrap().mean_s - 0.03).abs() < 1e-12);
    // Throttle by its own motion, yaw as roll and pitch.
    let expected_s = Sticks::new(0.05, 0.05, 0.05, 0.01);
    assert!(amax(&(change.found_s().unwrap() - expected_s)) < 1e-12, "{change:?}");
    // Motion that shows nothing leaves it.
    assert!(!dead_time.correct(None));
    assert_eq!(dead_time.change(), Some(change));
    assert_eq!(self::dead_time(0.0).change(), None);
}

#[test]
fn a_dead_time_that_was_shortened_finish_return_when_the_link_goes_down_again_and_again() {
    let mut dead_time = dead_time(0.3);
    for _ in 0..10 {
        dead_time.note_outage();
    }
    assert!(!dead_time.end_return_if_done(), "nothing was shortened");
    for _ in 0..SHORT_PERIODS + 15 {
        dead_time.correct(Some(common(-0.1, 0.02)));
    }
    assert_eq!(steps(&dead_time)[stick::ROLL], -4);
    for _ in 0..OUTAGES_MAX - 1 {
        dead_time.note_outage();
        assert!(!dead_time.correct(None));
    }
    dead_time.note_outage();
    let changes = (0..100).filter(|_| dead_time.correct(None)).count();
    assert_eq!((steps(&dead_time)[stick::ROLL], changes), (0, 4));
    assert!(!dead_time.correct(Some(common(-0.1, 0.02))), "it waits for the new filter");
    assert!(dead_time.end_return_if_done() && !dead_time.end_return_if_done());
    // A longer one stays.
    for _ in 0..20 {
        dead_time.correct(Some(common(0.1, 0.02)));
    }
    for _ in 0..20 {
        dead_time.note_outage();
        dead_time.correct(None);
    }
    assert_eq!(steps(&dead_time)[stick::ROLL], 4);
}

#[test]
fn a_gust_that_looks_like_an_early_answer_shortens_nothing() {
    let mut dead_time = dead_time(0.3);
    for mean_s in [-0.13, 0.05, -0.13] {
        for _ in 0..SHORT_PERIODS - 1 {
            dead_time.correct(Some(common(mean_s, 0.02)));
            assert!(steps(&dead_time)[stick::ROLL] >= -SHORT_STEPS);
        }
    }
}
