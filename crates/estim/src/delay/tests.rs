use std::f64::consts::TAU;

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::{Kinematic, Vector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;
use crate::ident::IdentSettings;
use crate::levenberg::LmTable;
use crate::recording::cut;
use crate::residual::Observed;

const DT_S: f64 = 0.02;
const STEPS: usize = 400;
const GROUPS: [&[usize]; 3] = [&[stick::ROLL, stick::PITCH], &[stick::YAW], &[stick::THROTTLE]];

/// Uniform in `[0, 1)`.
fn uniform(generator: &mut ChaCha8Rng) -> f64 {
    (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(generator)).ln()).sqrt();
    radius * (TAU * uniform(generator)).cos()
}

/// Two flights under keys that are pressed and released at random and reach the sticks by `fraction` of
/// the way per step: 1 is abrupt. Transitions are disturbed by `noise` in velocity.
pub(super) fn flights(
    dead_time_s: Sticks,
    fraction: f64,
    noise: f64,
    seed: u64,
) -> [Recording<4, 4>; 2] {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    [(); 2].map(|()| {
        let (mut keys, mut sticks) = (Sticks::zeros(), Sticks::zeros());
        let u = (0..STEPS).map(|_| {
            for key in &mut keys {
                if uniform(&mut generator) < 0.03 {
                    *key = (3.0 * uniform(&mut generator)).floor() - 1.0;
                }
            }
            sticks += (keys - sticks) * fraction;
            sticks
        });
        let mut recording = Recording { u: u.collect(), o: vec![Observed::missing(); STEPS] };
        let p = Vector::from([1.3, 0.5, 1.0, 0.1]);
        let mut s = Pose::new(0.0, 0.0, 1.0, 0.3);
        for (applied, o) in recording.applied(&dead_time_s, DT_S).iter().zip(&mut recording.o) {
            *o = Observed::full(s);
            let gust = Pose::from_fn(|_, _| noise * normal(&mut generator));
            s = Kinematic.step(&s, applied, &p, DT_S) + gust * DT_S;
        }
        recording
    })
}

pub(super) fn settings() -> DelaySettings {
    let table = DelayTable { dead_time_max_s: 0.6, grid_s: 0.06, tolerance_s: 0.005, rounds: 20 };
    DelaySettings::try_from(&table).unwrap()
}

/// An identification of the flights' pieces.
fn ident(flights: &Flights<'_, 4, 4>, dead_time_s: &Sticks) -> Ident<Kinematic, 4, 4, 4, 4> {
    let solver = LmTable {
        damping_start: 1e-8,
        step_tolerance: 1e-10,
        iterations_max: 50,
        ..LmTable::default()
    };
    let settings = IdentSettings::builder([1.0, 1.0, 1.0, 0.0])
        .c_o([300.0; 4])
        .c_s([10.0; 4])
        .c_p([0.1; 4])
        .bounds([-9.0; 4], [9.0; 4])
        .solver(solver)
        .build(&Kinematic)
        .unwrap();
    Ident::new(Kinematic, &settings, DT_S, flights.pieces(dead_time_s)).unwrap()
}

/// Pieces of at least `min_steps` of each recording. The first second is left out: what was sent before the recording
/// began is unknown.
fn spans(recordings: usize, min_steps: usize) -> Vec<Span> {
    let usable: Vec<bool> = (0..STEPS).map(|k| k >= 50).collect();
    let pieces = cut(&usable, min_steps);
    let span = |recording| pieces.iter().map(move |steps| Span { recording, steps: steps.clone() });
    (0..recordings).flat_map(span).collect()
}

/// Calls `with` with a search at the dead times `start_s`, not solved yet, over pieces of at least `min_steps`.
pub(super) fn with_search<T>(
    recordings: &[Recording<4, 4>],
    min_steps: usize,
    start_s: Sticks,
    settings: &DelaySettings,
    with: impl FnOnce(&mut Search<'_, Kinematic, 4, 4, 4, 4>) -> T,
) -> T {
    let spans = spans(recordings.len(), min_steps);
    let recordings: Vec<_> = recordings.iter().map(Cow::Borrowed).collect();
    let flights = Flights { recordings: &recordings, spans: &spans, dt_s: DT_S };
    let mut dead_time_s = start_s;
    with(&mut Search {
        flights: &flights,
        ident: &mut ident(&flights, &start_s),
        groups: &GROUPS,
        dead_time_s: &mut dead_time_s,
        settings,
        is_late: &mut || false,
    })
}

/// Profiles of the flights' dead times, from a start far away.
fn search(
    recordings: &[Recording<4, 4>],
    is_late: &mut dyn FnMut() -> bool,
) -> Option<Vec<DelayProfile<4>>> {
    let spans = spans(recordings.len(), 50);
    let recordings: Vec<_> = recordings.iter().map(Cow::Borrowed).collect();
    let flights = Flights { recordings: &recordings, spans: &spans, dt_s: DT_S };
    let mut dead_time_s = Sticks::repeat(0.5);
    let mut ident = ident(&flights, &dead_time_s);
    let found =
        flights.search(&mut ident, &GROUPS, &mut dead_time_s, &settings(), is_late).unwrap();
    for profile in found.iter().flatten() {
        for row in &profile.rows {
            assert_eq!(dead_time_s[*row].to_bits(), profile.dead_time_s.to_bits());
        }
        assert!(
            profile.curve.is_sorted_by(|left, right| left.dead_time_s < right.dead_time_s),
            "{profile:?}"
        );
    }
    found
}

pub(super) fn dead_time_s(horizontal: f64, yaw: f64, throttle: f64) -> Sticks {
    let mut dead_time_s = Sticks::repeat(horizontal);
    dead_time_s[stick::YAW] = yaw;
    dead_time_s[stick::THROTTLE] = throttle;
    dead_time_s
}

#[test]
fn fractional_dead_times_are_found_where_there_is_no_noise() {
    // Of a step: 0.65, 0.35 and 0.5.
    let truth = [0.313, 0.047, 0.19];
    let [horizontal, yaw, throttle] = truth;
    for fraction in [0.015, 1.0] {
        let flights = flights(dead_time_s(horizontal, yaw, throttle), fraction, 0.0, 1);
        let profiles = search(&flights, &mut || false).unwrap();
        for (profile, truth) in profiles.iter().zip(truth) {
            let gap_s = (profile.dead_time_s - truth).abs();
            // A parabola through candidates 5 ms apart.
            assert!(
                gap_s < 1e-3,
                "fraction {fraction}: {} s instead of {truth}",
                profile.dead_time_s
            );
            let spread = profile.spread.unwrap();
            assert!(spread.std_s < 1e-3, "{spread:?}");
            assert!((spread.lower_s..=spread.upper_s).contains(&profile.dead_time_s));
        }
    }
}

#[test]
fn the_spread_is_that_of_the_error() {
    // Most of a cost over whole and half steps could be the smoothing of the interpolation: both kinds
    // of truth, and abrupt sticks, which it smooths most.
    for truth in [0.3, 0.31] {
        let seeds = 0..12_u32;
        let count = f64::from(seeds.end);
        let (mut bias, mut square, mut claimed, mut claimed_white) = (0.0, 0.0, 0.0, 0.0);
        for seed in seeds {
            let flights = flights(dead_time_s(truth, 0.1, 0.2), 1.0, 0.1, u64::from(seed));
            let profiles = search(&flights, &mut || false).unwrap();
            let [horizontal, ..] = &profiles[..] else { panic!("{profiles:?}") };
            let error = horizontal.dead_time_s - truth;
            let spread = horizontal.spread.unwrap();
            bias += error / count;
            square += error * error / count;
            claimed += spread.std_s.powi(2) / count;
            claimed_white += spread.std_white_s.powi(2) / count;
        }
        let (error, claimed, white) = (square.sqrt(), claimed.sqrt(), claimed_white.sqrt());
        assert!(bias.abs() < 3.0 * error / count.sqrt(), "bias {bias} s of an error of {error} s");
        // Twelve errors know their deviation to 20 %.
        for claimed in [claimed, white] {
            let ratio = claimed / error;
            assert!((0.5..2.0).contains(&ratio), "truth {truth}: claimed {claimed}, error {error}");
        }
    }
}

#[test]
fn zero_is_a_dead_time_and_the_upper_end_of_the_range_is_none() {
    let flights = flights(dead_time_s(0.2, 0.0, 0.9), 1.0, 0.0, 2);
    let profiles = search(&flights, &mut || false).unwrap();
    let [_, yaw, throttle] = &profiles[..] else { panic!("{profiles:?}") };
    assert_eq!(yaw.verdict, DelayVerdict::Zero);
    assert!(yaw.dead_time_s < 2e-3, "{yaw:?}");
    let DelaySpread { lower_s, upper_s, .. } = yaw.spread.unwrap();
    assert!(lower_s <= 0.0 && upper_s > yaw.dead_time_s && upper_s < 0.04, "{lower_s}, {upper_s}");
    assert!(yaw.influence.is_none(), "{yaw:?}");
    assert_eq!(throttle.verdict, DelayVerdict::EndOfRange);
    assert!((throttle.dead_time_s - 0.5).abs() < 1e-12, "as given: {throttle:?}");
    assert!(throttle.spread.is_none(), "{throttle:?}");
}

#[test]
fn a_likelihood_that_does_not_decide_says_so_and_keeps_what_was_given() {
    // Sticks for which any dead time is as good.
    let mut flights = flights(dead_time_s(0.2, 0.1, 0.2), 0.1, 0.1, 4);
    for recording in &mut flights {
        for (u, o) in recording.u.iter_mut().zip(&mut recording.o) {
            u[stick::YAW] = 0.0;
            o.is_present[pose::THETA] = true;
            o.o[pose::THETA] = 0.3;
        }
    }
    let profiles = search(&flights, &mut || false).unwrap();
    let [horizontal, yaw, _] = &profiles[..] else { panic!("{profiles:?}") };
    assert_eq!(horizontal.verdict, DelayVerdict::Minimum);
    assert!((horizontal.dead_time_s - 0.2).abs() < 0.1, "{horizontal:?}");
    assert_ne!(yaw.verdict, DelayVerdict::Minimum, "{yaw:?}");
    assert!(yaw.spread.is_none());
}

#[test]
fn groups_one_after_the_other_find_the_same() {
    let truth = [0.313, 0.047, 0.19];
    let [horizontal, yaw, throttle] = truth;
    let flights = flights(dead_time_s(horizontal, yaw, throttle), 0.015, 0.0, 1);
    let (start_s, settings) = (Sticks::repeat(0.25), settings());
    let candidates_s: Vec<f64> = settings.grid().collect();
    let found = with_search(&flights, 50, start_s, &settings, |search| {
        search.coordinate_descent(&candidates_s).ok().unwrap()
    });
    for (found, truth) in found.iter().zip(truth) {
        assert!((found.at_s - truth).abs() < 0.01, "{} s instead of {truth}", found.at_s);
        assert!(found.curve.iter().all(|point| point.cost >= 0.0), "{:?}", found.curve);
    }
}

#[test]
fn what_is_no_search_is_refused_with_the_reason() {
    let truth = dead_time_s(0.3, 0.1, 0.2);
    let recordings = flights(truth, 0.2, 0.0, 3);
    let recordings: Vec<_> = recordings.iter().map(Cow::Borrowed).collect();
    let spans = [Span { recording: 0, steps: 50..200 }];
    let flights = |dt_s| Flights { recordings: &recordings, spans: &spans, dt_s };
    let mut problem = ident(&flights(DT_S), &truth);
    let mut refusal = |dt_s: f64, group: &[usize], start_s: f64| {
        let mut at_s = Sticks::repeat(start_s);
        let found =
            flights(dt_s).search(&mut problem, &[group], &mut at_s, &settings(), &mut || false);
        found.unwrap_err().to_string()
    };
    assert_eq!(refusal(DT_S, &[4], 0.2), "input row 4: expected 0..=3");
    for dt_s in [0.04, f64::NAN] {
        assert!(refusal(dt_s, &[0], 0.2).contains("the identification one of 0.02 s"), "{dt_s}");
    }
    for start_s in [f64::NAN, f64::INFINITY, -0.1] {
        assert!(refusal(DT_S, &[0], start_s).contains("of the start: expected"), "{start_s}");
    }
}

#[test]
fn a_late_search_finds_nothing() {
    let flights = flights(dead_time_s(0.2, 0.1, 0.2), 0.1, 0.0, 3);
    let mut polls = 0;
    let mut is_late = || {
        polls += 1;
        polls > 20
    };
    assert!(search(&flights, &mut is_late).is_none());
    assert_eq!(polls, 21);
}

#[test]
fn the_gradient_of_the_profile_is_that_of_differences() {
    let recordings = flights(dead_time_s(0.31, 0.25, 0.37), 0.015, 0.5, 7);
    // Inside of periods: the profile is nonsmooth at whole ones.
    let start_s = dead_time_s(0.293, 0.271, 0.352);
    with_search(&recordings, STEPS - 50, start_s, &settings(), |search| {
        search.solve().ok().unwrap();
        for (group, gradient) in search.gradients().into_iter().enumerate() {
            let mut cost = |offset_s: f64| {
                search.set_dead_time(group, start_s[GROUPS[group][0]] + offset_s);
                search.solve().ok().unwrap()
            };
            let numeric = (cost(1e-3) - cost(-1e-3)) / 2e-3;
            cost(0.0);
            let gap = (gradient / numeric - 1.0).abs();
            assert!(gap < 1e-3, "group {group}: {gradient} instead of {numeric}");
        }
    });
}
