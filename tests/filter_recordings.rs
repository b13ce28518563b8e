//! The Vicon filter on real recordings: the published settings repeat the recorded filter, the
//! settings of `configs/fly.json` find back after a loss and hold flipped headings.

mod support;

use std::fs;

use tello_estim::{FilterSettings, FilterTable, Filtered, PoseFilter, Verdict};
use tello_model::angle::wrap;
use tello_model::rows::{Pose, pose};

/// One second of samples.
const SECOND: usize = 50;

/// What flew: text and code of the thesis differ, and this is what the recordings show.
fn published() -> FilterTable {
    FilterTable {
        horizontal_base_m: 1.0,
        horizontal_growth_m: 0.0,
        vertical_base_m: 3.0,
        vertical_growth_m: 1.0,
        angle_base_rad: 0.15,
        angle_growth_rad: 0.05,
        floor_m: 0.01,
        origin_m: 0.001,
    }
}

/// The default for flight.
fn default() -> FilterTable {
    FilterTable {
        horizontal_base_m: 0.3,
        horizontal_growth_m: 0.1,
        vertical_base_m: 0.3,
        vertical_growth_m: 0.06,
        angle_base_rad: 0.15,
        angle_growth_rad: 0.04,
        floor_m: 0.01,
        origin_m: 0.001,
    }
}

/// The poses of a CSV log, `pos,step,x,y,z,theta`; `None` if the recordings are not here.
fn poses(file: &str) -> Option<Vec<Pose>> {
    let text = fs::read_to_string(support::data(file)?).unwrap();
    let pose = |line: &str| {
        let row = line.strip_prefix("pos,")?.split_once(',')?.1;
        let numbers: Vec<f64> = row.split(',').map(|field| field.parse().unwrap()).collect();
        Some(Pose::from_column_slice(&numbers))
    };
    Some(text.lines().filter_map(pose).collect())
}

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
        let filtered = run(&published(), &raw);
        let worst = filtered
            .iter()
            .zip(&recorded)
            .map(|(filtered, recorded)| filtered.o.map_or(f64::NAN, |o| (o - recorded).amax()))
            .enumerate()
            .fold((0, 0.0), |worst, (k, gap)| if gap <= worst.1 { worst } else { (k, gap) });
        println!("flight {flight}: {} samples, worst gap {:.1e}", raw.len(), worst.1);
        // Four printed digits, and the raw ones were rounded before they were added up.
        assert!(worst.1 < 1.5e-4, "flight {flight}, sample {}: gap {}", worst.0, worst.1);
    }
}
