use std::fs;

use super::*;

/// A flight that was recorded by an earlier version.
fn kept() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/flight_7a8414a7.mcap")
}

#[test]
fn a_complete_log_is_counted_by_channel() {
    let info = Info::of(&kept()).unwrap();
    assert!(info.is_complete, "{}", info.ending);
    assert_eq!(info.messages, info.channels.values().sum::<u64>());
    assert_eq!(info.bytes, fs::metadata(kept()).unwrap().len());
    assert!(info.lasts_s > 1.0, "{} s", info.lasts_s);
    assert_eq!(info.documents, ["config.json"]);
    let text = info.to_string();
    for (topic, count) in &info.channels {
        assert!(text.contains(&format!("{topic:<24} {count:>8}")), "{topic} is missing:\n{text}");
    }
    assert!(!text.contains("recover"), "{text}");
}

#[test]
fn a_log_without_its_end_has_all_before_and_the_way_out() {
    let whole = fs::read(kept()).unwrap();
    let torn = std::env::temp_dir().join(format!("tello-ctl-log-{}.mcap", std::process::id()));
    fs::write(&torn, &whole[..whole.len() - 8]).unwrap();
    let (info, complete) = (Info::of(&torn).unwrap(), Info::of(&kept()).unwrap());
    fs::remove_file(torn).unwrap();
    assert!(!info.is_complete);
    assert_eq!(info.channels, complete.channels);
    assert!(info.to_string().contains("`tello-ctl log recover`"), "{info}");
}

#[test]
fn only_a_log_that_is_not_complete_is_bad() {
    let file = Path::new("flight.mcap");
    assert_eq!(whole(file, None), Verdict::Good);
    assert_eq!(whole(file, Some(Ending::Complete)), Verdict::Good);
    let torn = Ending::Torn { messages: 3, last: None, bytes: 99, why: "no footer".into() };
    assert_eq!(whole(file, Some(torn)), Verdict::Bad);
    assert_eq!(whole(file, Some(Ending::Gaps { records: 1 })), Verdict::Bad);
}

#[test]
fn a_recovery_that_saves_nothing_is_bad() {
    let verdict = |messages, was_torn| {
        let recovered = Recovered { messages, was_torn, ..Recovered::default() };
        report_recovered(Path::new("a"), Path::new("b"), recovered).unwrap()
    };
    assert_eq!(verdict(0, true), Verdict::Bad);
    assert_eq!([verdict(1, true), verdict(0, false)], [Verdict::Good; 2]);
}
