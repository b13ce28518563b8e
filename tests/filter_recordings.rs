//! The outlier filter on real recordings: with the published settings it repeats what was recorded,
//! with the settings for flight it finds back after a loss and holds flipped headings.

use std::fs;
use std::path::Path;

use horizon_model::angle::wrap;
use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Pose, pose};
use tello_flight::{Acceptance, FilterTable, Filtered, PoseFilter};
use tello_io::config;

use crate::support;

/// One second of samples.
const SECOND: usize = 50;
/// The longest wrong heading of the recordings. samples
const WRONG_HEADING_MAX: usize = 73;

/// Filter of the recorded flights: text and code of the thesis differ, and the recordings show this one.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn published() -> FilterTable {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/thesis/fly.json");
    config::fly(Some(&path), None).unwrap().0.cycle.filter
}

/// The settings for flight. The vehicle does at most 0.034 m and 0.03 rad per sample; a stall of the
/// stream shows up as a jump of up to a metre. The limits grow by three times that speed, so that any
/// place of a room is accepted again within a second. The limit of a heading that is seen grows slowly, because
/// wrong headings last for up to [`WRONG_HEADING_MAX`]; in a flight the estimate confirms right ones before.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn for_flight() -> FilterTable {
    config::fly(None, None).unwrap().0.cycle.filter
}

/// The poses of a CSV log, `pos,step,x,y,z,theta`; `None` if the recordings are not here.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn poses(file: &str) -> Option<Vec<Pose>> {
    let text = fs::read_to_string(support::data(file)?).unwrap();
    let pose = |line: &str| {
        let row = line.strip_prefix("pos,")?.split_once(',')?.1;
        let numbers: Vec<f64> = row.split(',').map(|field| field.parse().unwrap()).collect();
        Some(Pose::from_column_slice(&numbers))
    };
    Some(text.lines().filter_map(pose).collect())
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn run(table: &FilterTable, raw: &[Pose]) -> Vec<Filtered> {
    let mut filter = PoseFilter::new(table.try_into().unwrap());
    raw.iter().map(|raw| filter.update(Some(raw))).collect()
}

fn is_zero(raw: &Pose) -> bool {
    [pose::X, pose::Y, pose::Z].iter().all(|row| raw[*row].abs() < 1e-3)
}

#[test]
fn the_published_settings_repeat_the_recorded_filter() {
    for flight in 1..=6 {
        let Some(raw) = poses(&format!("thesis/ident/raw/{flight}.log")) else { return };
        let Some(recorded) = poses(&format!("thesis/ident/filt/{flight}.log")) else { return };
        assert_eq!(raw.len(), recorded.len(), "flight {flight}");
        assert!(raw.len() > 3000, "flight {flight} has {} samples", raw.len());
        let mut worst = 0.0_f64;
        for (k, (filtered, recorded)) in run(&published(), &raw).iter().zip(&recorded).enumerate() {
            let gap = filtered.o.map_or(f64::NAN, |o| amax(&(o - recorded)));
            // Half of the last printed digit.
            assert!(gap < 5e-5, "flight {flight}, sample {k}: gap {gap:e}");
            worst = maximum(worst, gap);
        }
        println!("flight {flight}: {} samples, worst gap {worst:.1e}", raw.len());
    }
}

/// Longest runs of valid samples, neither zero nor repeated, whose position and whose heading the
/// filter refuses.
fn longest_refusal(raw: &[Pose], filtered: &[Filtered]) -> (usize, usize) {
    let (mut position, mut heading) = (0, 0);
    let (mut position_max, mut heading_max) = (0, 0);
    for k in 1..raw.len() {
        if is_zero(&raw[k]) || raw[k] == raw[k - 1] {
            continue;
        }
        position = if filtered[k].position == Acceptance::Held { position + 1 } else { 0 };
        heading = if filtered[k].heading == Acceptance::Held { heading + 1 } else { 0 };
        position_max = position_max.max(position);
        heading_max = heading_max.max(heading);
    }
    (position_max, heading_max)
}

#[test]
fn the_settings_for_flight_find_back_after_a_loss() {
    for flight in [2, 11] {
        let Some(raw) = poses(&format!("thesis/lockout/raw/{flight}.log")) else { return };
        let (locked_out, _) = longest_refusal(&raw, &run(&published(), &raw));
        let (position, heading) = longest_refusal(&raw, &run(&for_flight(), &raw));
        println!(
            "flight {flight}: longest refusal of valid samples {position} (position), {heading} \
             (heading); with the published settings {locked_out}"
        );
        assert!(locked_out > 10 * SECOND, "nothing to find back from: {locked_out}");
        assert!(position <= SECOND, "flight {flight}: position refused for {position} samples");
        let is_short = heading <= WRONG_HEADING_MAX;
        assert!(is_short, "flight {flight}: heading refused for {heading} samples");
    }
}

#[test]
fn the_settings_for_flight_follow_every_working_flight() {
    for flight in 1..=6 {
        let Some(raw) = poses(&format!("thesis/ident/raw/{flight}.log")) else { return };
        let (position, heading) = longest_refusal(&raw, &run(&for_flight(), &raw));
        println!("flight {flight}: longest refusal {position} (position), {heading} (heading)");
        // A stall of half a second lets the vehicle jump by a metre: eight samples at this growth.
        assert!(position <= 10, "flight {flight}: position refused for {position} samples");
    }
}

/// A flip: at most `FLIP_MAX` samples turned by more than `FLIP_RAD` between two that agree.
const FLIP_MAX: usize = 8;
const FLIP_RAD: f64 = 0.6;

#[test]
fn flipped_headings_are_held() {
    let theta = |pose: &Pose| pose[pose::THETA];
    let mut flips = 0;
    for flight in 1..=6 {
        let Some(raw) = poses(&format!("thesis/ident/raw/{flight}.log")) else { return };
        let filtered = run(&for_flight(), &raw);
        for before in 0..raw.len() {
            let follows = filtered[before].heading == Acceptance::Accepted;
            let is_turned =
                |k: &usize| wrap(theta(&raw[*k]) - theta(&raw[before])).abs() > FLIP_RAD;
            let turned = (before + 1..raw.len()).take_while(is_turned).count();
            let after = before + turned + 1;
            if !follows || !(1..=FLIP_MAX).contains(&turned) || after >= raw.len() {
                continue;
            }
            if wrap(theta(&raw[after]) - theta(&raw[before])).abs() > 0.2 {
                continue;
            }
            flips += 1;
            let held = filtered[before + 1..after].iter().all(|f| f.heading == Acceptance::Held);
            assert!(held, "flight {flight}: the flip after sample {before} was followed");
        }
    }
    println!("{flips} flips of at most {FLIP_MAX} samples held");
    assert!(flips > 50, "only {flips} flips");
}
