use std::f64::consts::TAU;
use std::os::unix::ffi::OsStrExt as _;

use tello_flight::cycle::{Inbox, PoseRecord, Topic};
use tello_io::clock::TimeNs;
use tello_io::log::{Channel, Head, LogWriter};

use super::*;

fn flight_filter() -> FilterSettings {
    (&config::fly(None, None).unwrap().0.cycle.filter).try_into().unwrap()
}

/// Recording loaded from the text of a CSV file.
fn read(text: &str) -> Result<Loaded> {
    static COUNT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let number = COUNT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let name = format!("tello-ctl-recording-{}-{number}.log", std::process::id());
    let path = std::env::temp_dir().join(name);
    fs::write(&path, text).unwrap();
    let loaded = load_one(&path, flight_filter());
    fs::remove_file(path).unwrap();
    loaded
}

fn refusal(text: &str) -> String {
    format!("{:#}", read(text).unwrap_err())
}

/// A step that moves a little, with sticks that move.
fn step(k: u64) -> String {
    let x = 0.5 + 0.01 * k as f64;
    let roll = 0.1 * (k as f64).sin();
    format!("pos,{k},{x:.4},0.5000,1.0000,0.1000\ninput,{k},{roll:.4},0.0000,0.0000,0.0000\n")
}

fn steps(range: std::ops::Range<u64>) -> String {
    range.map(step).collect()
}

fn present(loaded: &Loaded) -> Vec<bool> {
    loaded.recording.o.iter().map(|o| o.is_present == [true; pose::COUNT]).collect()
}

#[test]
fn numbers_in_names_count_as_numbers() {
    let mut names =
        ["10.log", "2.log", "flight-2-10.csv", "flight-2-9.csv", "1b.log", "1.log", "001.log"];
    names.sort_by(|a, b| natural(a, b));
    let expected =
        ["001.log", "1.log", "1b.log", "2.log", "10.log", "flight-2-9.csv", "flight-2-10.csv"];
    assert_eq!(names, expected);
}

#[test]
fn a_name_that_is_not_utf_8_is_left_out_and_named() {
    let dir = std::env::temp_dir().join(format!("tello-ctl-names-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    fs::write(dir.join("1.log"), steps(0..30)).unwrap();
    fs::write(dir.join(std::ffi::OsStr::from_bytes(b"fl\xff.mcap")), "").unwrap();
    let (loaded, unusable) = load(std::slice::from_ref(&dir)).unwrap();
    assert_eq!(loaded[0].path, dir.join("1.log"));
    let why = "its name is not UTF-8: choose another one".to_owned();
    assert_eq!(unusable, [FileSkipped { path: dir.join("fl\u{fffd}.mcap"), why }]);
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_copy_of_a_recording_does_not_count_twice() {
    let dir = std::env::temp_dir().join(format!("tello-ctl-copies-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    // A copy, the same flight by a few steps longer, and another one.
    for (name, steps) in [
        ("1.log", steps(0..60)),
        ("2.log", steps(0..60)),
        ("3.log", steps(0..64)),
        ("4.log", steps(40..90)),
    ] {
        fs::write(dir.join(name), steps).unwrap();
    }
    let (loaded, unusable) = load(std::slice::from_ref(&dir)).unwrap();
    let names: Vec<_> = loaded.iter().map(|log| log.path.clone()).collect();
    assert_eq!(names, [dir.join("3.log"), dir.join("4.log")], "the longer one");
    let copy = |name| FileSkipped {
        path: dir.join(name),
        why: format!("its poses are those of {}", dir.join("3.log").display()),
    };
    assert_eq!(unusable, [copy("1.log"), copy("2.log")]);
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_whole_flight_is_used_step_by_step() {
    let loaded = read(&steps(0..30)).unwrap();
    assert_eq!(loaded.skipped, [""; 0]);
    assert_eq!(present(&loaded), [true; 30]);
    assert!((loaded.recording.o[7].o[pose::X] - 0.57).abs() < 1e-12);
    assert!((loaded.recording.u[7][stick::ROLL] - 0.0657).abs() < 1e-12);
    // The same bytes by sha256sum.
    let text = "pos,0,1,2,3,4\ninput,0,0,0,0,0\npos,1,1,2,3,4\ninput,1,0.5,0,0,0\n";
    let sha256 = "b7d3fe5ab8638e8ed6eedea3bbd26ec3b4dab873fd7e6431990341997f127baf";
    assert_eq!(read(text).unwrap().sha256, sha256);
}

#[test]
fn missing_steps_are_missing_observations_with_the_input_held() {
    let text = steps(0..10) + &steps(13..20) + "pos,20,1.0,0.5,three,0.1\n" + &step(21);
    let loaded = read(&text).unwrap();
    let mut expected = [true; 22];
    for k in [10, 11, 12, 20] {
        expected[k] = false;
    }
    assert_eq!(present(&loaded), expected);
    assert_eq!(loaded.recording.u[12], loaded.recording.u[9]);
    assert_eq!(loaded.recording.u[20], loaded.recording.u[19]);
    let [line, missing] = &loaded.skipped[..] else { panic!("{:?}", loaded.skipped) };
    assert!(line.contains("line 35, value 3 is not a finite number"), "{line}");
    assert_eq!(missing, "4 steps missing");
}

#[test]
fn of_a_recording_with_a_long_gap_the_longest_part_is_used() {
    let text = steps(0..10) + &steps(100..140) + &step(9_000);
    let loaded = read(&text).unwrap();
    assert_eq!(loaded.recording.o.len(), 40);
    assert!((loaded.recording.o[0].o[pose::X] - 1.5).abs() < 1e-12);
    assert_eq!(
        loaded.skipped,
        ["11 steps beyond a gap of more than a second or a jump of the pose"]
    );
}

#[test]
fn a_recording_is_cut_where_its_poses_jump() {
    let (whole, moved) = (steps(0..100), steps(0..100).replace(",0.5000,1.0000", ",0.5000,2.6000"));
    let after: String = moved.lines().skip(80).map(|line| line.to_owned() + "\n").collect();
    let before: String = whole.lines().take(80).map(|line| line.to_owned() + "\n").collect();
    let loaded = read(&(before + &after)).unwrap();
    // The filter refuses the new place for 22 steps: 0.3 m and 0.06 m for each.
    let length = loaded.recording.o.len();
    assert_eq!(length, 40 + 22);
    assert!(loaded.recording.o.iter().all(|o| !o.is_present[pose::Z] || o.o[pose::Z] < 1.5));
    let cut =
        format!("{} steps beyond a gap of more than a second or a jump of the pose", 100 - length);
    assert!(loaded.skipped.contains(&cut), "{:?}", loaded.skipped);
    // One outlier is none.
    let outlier = whole.replace("pos,50,1.0000,0.5000", "pos,50,9.0000,0.5000");
    let loaded = read(&outlier).unwrap();
    assert_eq!((loaded.recording.o.len(), present(&loaded)[50]), (100, false));
}

#[test]
fn a_recording_in_other_units_is_refused() {
    let millimetres = |k| format!("pos,{k},{},500,1000,0.1\ninput,{k},0.{k},0,0,0\n", 500 + 10 * k);
    let in_millimetres = (0..40).map(millimetres).collect::<Vec<_>>().concat();
    let why = refusal(&in_millimetres);
    assert!(why.contains("line 1, value 1 is beyond 100") && why.contains("in m,"), "{why}");
    let degrees = |k| {
        let theta_deg = (170 + 3 * k + 180) % 360 - 180;
        format!("pos,{k},0.{k},0.5,1,{theta_deg}\ninput,{k},0.{k},0,0,0\n")
    };
    let in_degrees = (0..200).map(degrees).collect::<Vec<_>>().concat();
    let why = refusal(&in_degrees);
    assert!(why.contains("headings jump") && why.contains("theta is in rad"), "{why}");
}

#[test]
fn a_repeated_pose_is_a_stall_unless_the_file_is_rounded() {
    let line = |k: u64, x: &str| format!("pos,{k},{x},0.5,1.0,0.1\ninput,{k},0.{k},0,0,0\n");
    let fine = line(0, "0.5001") + &line(1, "0.5001") + &line(2, "0.5002");
    let loaded = read(&fine).unwrap();
    assert_eq!(present(&loaded), [true, false, true]);
    assert_eq!(loaded.skipped, ["1 pose repeated while the stream stalled"]);
    let coarse = line(0, "0.50") + &line(1, "0.50") + &line(2, "0.51");
    let loaded = read(&coarse).unwrap();
    assert_eq!(present(&loaded), [true; 3]);
    assert_eq!(loaded.skipped, [""; 0]);
}

#[test]
fn a_raw_recording_runs_through_the_filter_of_the_flight() {
    let heading = |k: u64| 3.0 + 0.02 * k as f64;
    let raw = |k: u64| {
        // Wraps at step 8, is flipped in step 20 and lost in step 30.
        let theta = heading(k) - if k >= 8 { TAU } else { 0.0 } + if k == 20 { 1.5 } else { 0.0 };
        let x = 0.5 + 0.01 * k as f64;
        let pos = if k == 30 { "0,0,0,0".into() } else { format!("{x:.4},0.5,1.0,{theta:.4}") };
        format!("pos,{k},{pos}\ninput,{k},{:.4},0,0,0\n", 0.1 * (k as f64).sin())
    };
    let loaded = read(&(0..40).map(raw).collect::<String>()).unwrap();
    for (k, o) in loaded.recording.o.iter().enumerate() {
        let mut is_present = [k != 30; pose::COUNT];
        is_present[pose::THETA] &= k != 20;
        assert_eq!(o.is_present, is_present, "step {k}");
        let gap = o.o[pose::THETA] - heading(k as u64);
        // Half a digit of the file.
        assert!(!is_present[pose::THETA] || gap.abs() < 1e-4, "step {k}: {gap}");
    }
    let expected = ["1 pose of a lost object", "1 heading not accepted by the filter"];
    assert_eq!(loaded.skipped, expected);
}

#[test]
fn what_cannot_be_used_says_why() {
    let constant: String =
        steps(0..20).split_inclusive('\n').filter(|line| line.starts_with("pos")).collect();
    let constant = constant + "input,0,0.1000,0.0000,0.0000,0.0000\n";
    let nan = steps(0..20).replace("0.5000,1.0000", "nan,nan");
    let poseless = steps(0..20).replace("pos,", "param,");
    for (text, reason) in [
        ("", "it is empty"),
        ("no flight in here\n", "no line of a flight log: line 1, unknown tag"),
        (&constant, "constant sticks"),
        (&nan, "no pose that can be used; line 1, value 2 is not a finite number"),
        (&poseless, "no pose that can be used"),
        ("\u{89}MCAP and nothing else", "no line of a flight log"),
    ] {
        assert!(refusal(text).contains(reason), "{reason:?} is not in {:?}", refusal(text));
    }
    let many = refusal(&nan);
    assert!(many.contains("17 more lines") && many.len() < 400, "{many}");
}

#[test]
fn sticks_and_poses_beyond_what_can_be_flown_are_left_out() {
    let sample = |step: u64, u: f64, x_m: f64| {
        let o = Observed::full(Pose::new(x_m, 0.0, 1.0, 0.0));
        Sample { step, u: Some(Sticks::repeat(u)), o, has_jumped: false }
    };
    let samples = [sample(0, 0.1, 0.0), sample(1, 0.2, 0.1), sample(2, 1.5, 1e200)];
    let mut skipped = Vec::new();
    let recording = assemble(&samples, &mut skipped).unwrap();
    assert_eq!((recording.u[2], recording.o[2].is_present), (Sticks::repeat(0.2), [false; 4]));
    assert_eq!(skipped, ["1 input beyond full sticks", "1 pose out of any room"]);
    let wide = steps(0..10) + "pos,10,1e200,0,1,0\ninput,10,1.5,0,0,0\n" + &steps(11..20);
    let loaded = read(&wide).unwrap();
    assert!(!present(&loaded)[10] && loaded.recording.u[10] == loaded.recording.u[9]);
    let [pose, input, missing] = &loaded.skipped[..] else { panic!("{:?}", loaded.skipped) };
    assert!(pose.contains("line 21, value 1 is beyond 100"), "{pose}");
    assert!(input.contains("line 22, value 1 is beyond 1"), "{input}");
    assert_eq!(missing, "1 step missing");
}

#[test]
fn a_damaged_file_does_not_stop_the_others() {
    let folder = std::env::temp_dir().join(format!("tello-ctl-recordings-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let whole = steps(0..40);
    let torn = steps(0..20) + "pos,20,0.7\npospos,20,0.7,0.5,1\n" + &steps(21..40);
    for (name, text) in [("10.log", &*whole), ("2.csv", &torn), ("3.log", ""), ("notes.txt", "x")] {
        fs::write(folder.join(name), text).unwrap();
    }
    // Named twice, read once.
    let (loaded, unusable) = load(&[folder.clone(), folder.join("2.csv")]).unwrap();
    let names: Vec<_> =
        loaded.iter().map(|log| log.path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["2.csv", "10.log"]);
    assert_eq!(loaded[0].recording.o.len(), 40);
    assert_eq!(loaded[0].skipped.len(), 3, "{:?}", loaded[0].skipped);
    let why = "it is empty".to_owned();
    assert_eq!(unusable, [FileSkipped { path: folder.join("3.log"), why }]);
    assert!(load(&[folder.join("4.log")]).unwrap_err().to_string().contains("cannot read"));
    fs::remove_dir_all(&folder).unwrap();
    fs::create_dir_all(&folder).unwrap();
    assert!(load(std::slice::from_ref(&folder)).unwrap_err().to_string().contains("no recording"));
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_converted_recording_loads_as_its_original() {
    let path =
        std::env::temp_dir().join(format!("tello-ctl-converted-{}.mcap", std::process::id()));
    let text = steps(0..30) + &steps(33..60) + "input,60,0.1";
    rows::write_log(&path, "a.log".into(), &csv::parse(text.as_bytes()).into()).unwrap();
    let converted = load_one(&path, flight_filter()).unwrap();
    fs::remove_file(&path).unwrap();
    let original = read(&text).unwrap();
    assert_eq!(converted.recording, original.recording);
    assert_eq!(converted.skipped, original.skipped);
}

#[test]
fn a_pose_keeps_its_rows_in_a_record() {
    let pose = Pose::new(1.0, 2.0, -0.0, 4.0);
    let json = serde_json::to_string(&PoseRecord::new(7, &pose)).unwrap();
    let read: PoseRecord = serde_json::from_str(&json).unwrap();
    let bits = |pose: Pose| pose.map(f64::to_bits);
    assert_eq!(bits(read.pose()), bits(pose), "{json}");
}

/// A log with an inbox and an estimate of each of these steps, by hand in step 3.
fn ticks_of(name: &str, steps: &[u64]) -> (Vec<ticks::TickRow>, Vec<String>) {
    let path = std::env::temp_dir().join(format!("tello-ctl-ticks-{}-{name}", std::process::id()));
    let topics = [Topic::Inbox, Topic::State];
    let schema = schemars::schema_for!(PoseRecord);
    let channels = topics.map(|topic| Channel {
        topic: topic.name(),
        schema_name: "Any",
        schema: schema.clone().into(),
    });
    let mut log = LogWriter::create(&path, &Head::default(), &channels).unwrap();
    let mut inbox = Inbox::new();
    for step in steps {
        let now = TimeNs(20_000_000 * i64::try_from(*step).unwrap());
        inbox.open(*step, now);
        inbox.manual = (*step == 3).then_some([0.0; stick::COUNT]);
        log.write(Topic::Inbox.name(), now, &inbox).unwrap();
        let pose = PoseRecord::new(*step, &Pose::new(*step as f64, 0.0, 1.0, 0.0));
        log.write(Topic::State.name(), now, &pose).unwrap();
    }
    log.finish().unwrap();
    let mut notes = Vec::new();
    let ticks = ticks::read(&mut LogReader::open(&path).unwrap(), &mut notes).unwrap();
    fs::remove_file(path).unwrap();
    (ticks, notes)
}

#[test]
fn a_tick_that_comes_again_counts_once_and_one_that_is_missing_is_known() {
    let (ticks, notes) = ticks_of("twice", &[0, 1, 1, 2, 0, 1, 2, 3, 4, 7]);
    let periods: Vec<u64> = ticks.iter().map(|tick| tick.period).collect();
    assert_eq!(periods, [0, 1, 2, 3, 4, 7]);
    let missing: Vec<u64> = ticks.iter().map(|tick| tick.missing_before).collect();
    assert_eq!(missing, [0, 0, 0, 0, 0, 2]);
    assert_eq!(notes, ["2 ticks missing", "4 ticks repeated"]);
    assert!(ticks::is_repetition(&notes[1]) && !ticks::is_repetition(&notes[0]));
    let by_hand: Vec<bool> = ticks.iter().map(|tick| tick.is_by_hand).collect();
    assert_eq!(by_hand, [false, false, false, true, false, false]);
    let x = |tick: &ticks::TickRow| tick.estimate.unwrap()[pose::X];
    assert!(ticks.iter().all(|tick| (x(tick) - tick.period as f64).abs() < 1e-9));
}
