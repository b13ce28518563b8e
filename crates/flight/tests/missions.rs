//! The missions that come along: each can be flown to its end.

use std::fs;
use std::path::Path;

use tello_flight::{Mission, MissionTable, PointsTable, Reference, parse_csv};

/// Period. s
const DT_S: f64 = 0.02;

/// Longest mission. periods
const PERIODS_MAX: usize = 5000;

#[test]
fn a_vehicle_that_follows_exactly_ends_every_mission_that_comes_along() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions");
    let mut count = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "json") {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let mut table: MissionTable = serde_json::from_str(&text).unwrap();
        if let MissionTable::Trajectory(timed) = &mut table
            && let PointsTable::Csv(name) = &timed.points
        {
            let csv = fs::read_to_string(folder.join(name)).unwrap();
            timed.points = PointsTable::Rows(parse_csv(&csv).unwrap());
        }
        let mut mission = Mission::new(&table, DT_S).unwrap();
        let mut next = [Reference::default()];
        for _ in 0..PERIODS_MAX {
            mission.fill(0, &[1], &mut next);
            mission.advance(&next[0].pose);
        }
        assert!(mission.is_finished(), "{}", path.display());
        count += 1;
    }
    assert!(count >= 8, "{count} missions");
}
