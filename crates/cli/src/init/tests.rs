use clap::Parser;

use super::*;

/// `init` with these words of the command line.
fn init_with(words: &[&str]) -> Result<Verdict> {
    let words = ["tello-ctl", "init"].iter().chain(words);
    let arguments = crate::Arguments::try_parse_from(words)?;
    let crate::Command::Init(arguments) = &arguments.command else { bail!("another command") };
    run(arguments)
}

fn empty_folder(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("tello-ctl-init-{}-{name}", std::process::id()));
    drop(fs::remove_dir_all(&dir));
    dir
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn walls_are_five_numbers() {
    let Walls(walls) = "-2, 2,-3,1, 2.5".parse().unwrap();
    assert_eq!(walls.map(f64::to_bits), [-2.0, 2.0, -3.0, 1.0, 2.5].map(f64::to_bits));
    let refusal = |text: &str| text.parse::<Walls>().unwrap_err().to_string();
    assert_eq!(refusal("-2,2,-3,1"), "4 numbers in place of five");
    assert_eq!(refusal("-2,2,-3,1,2.5,0"), "6 numbers in place of five");
    assert_eq!(refusal("-2,2,wall,1,2.5"), "\"wall\" is no finite number");
}

#[test]
fn points_are_moved_around_the_middle_with_their_shape_and_other_columns() {
    let mut points = json!([[7.0, 0.0, 10.0, 1.2], [8.0, 1.0, 14.0, 1.3]]);
    centre(&mut points, 1, [5.0, -2.0]);
    assert_eq!(points, json!([[7.0, 4.5, -4.0, 1.2], [8.0, 5.5, 0.0, 1.3]]));
}

#[test]
fn a_room_moves_the_missions_and_the_simulated_start_and_walls_are_taken_over() {
    let dir = empty_folder("room");
    init_with(&[dir.to_str().unwrap(), "--room=10,16,-3,1,2.5"]).unwrap();
    let room = &read(&dir.join("fly.json"))["cycle"]["supervisor"]["room"];
    assert_eq!((&room["x_m"], &room["y_m"]), (&json!([10.0, 16.0]), &json!([-3.0, 1.0])));
    assert_eq!(room["z_m"][1], json!(2.5));
    let start = &read(&dir.join("sim.json"))["start"]["ground"];
    assert_eq!((&start["x"], &start["y"]), (&json!(13.0), &json!(-1.0)));
    let square = &read(&dir.join("square.json"))["waypoints"]["waypoints"];
    let xs = square.as_array().unwrap().iter().map(|point| point[0].as_f64().unwrap());
    let (low, high) = xs.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
    assert!((f64::midpoint(low, high) - 13.0).abs() < 1e-9, "{low} to {high}");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn the_motion_capture_of_the_command_line_is_that_of_the_settings() {
    let dir = empty_folder("mocap");
    let words = ["--mocap", "udp", "--address", "0.0.0.0:9000", "--object", "Tello1"];
    init_with(&[&[dir.to_str().unwrap()], &words[..], &["--rate", "120"]].concat()).unwrap();
    let mocap = &read(&dir.join("fly.json"))["mocap"]["udp"];
    assert_eq!(mocap["listen"], json!("0.0.0.0:9000"));
    assert_eq!((&mocap["object"], &mocap["rate_hz"]), (&json!("Tello1"), &json!(120.0)));
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn every_source_of_poses_is_written_into_the_settings() {
    for kind in MocapKind::ALL.map(MocapKind::name) {
        let dir = empty_folder(kind);
        init_with(&[dir.to_str().unwrap(), "--mocap", kind, "--object", "Tello1"]).unwrap();
        let mocap = &read(&dir.join("fly.json"))["mocap"];
        assert_eq!(mocap.as_object().unwrap().keys().collect::<Vec<_>>(), [kind]);
        assert_eq!(mocap[kind]["object"], json!("Tello1"), "{kind}");
        fs::remove_dir_all(dir).unwrap();
    }
}

#[test]
fn a_motion_capture_has_its_usual_port_and_its_own_rate() {
    for (kind, side, address) in [
        ("relay", "address", "127.0.0.1:51602"),
        ("datastream", "address", "127.0.0.1:801"),
        ("udp", "listen", "0.0.0.0:51001"),
        ("natnet", "address", "127.0.0.1:1510"),
        ("qtm", "address", "127.0.0.1:22223"),
        ("vrpn", "address", "127.0.0.1:3883"),
    ] {
        let dir = empty_folder("usual");
        let words = [dir.to_str().unwrap(), "--mocap", kind];
        init_with(&words).unwrap();
        assert_eq!(read(&dir.join("fly.json"))["mocap"][kind][side], json!(address));
        fs::remove_dir_all(dir).unwrap();
    }
    let dir = empty_folder("rate");
    let words = [dir.to_str().unwrap(), "--mocap", "natnet", "--rate", "120"];
    let refusal = init_with(&words).unwrap_err().to_string();
    assert_eq!(refusal, "--rate is for udp and vrpn: natnet announces its own");
    assert!(!dir.exists());
}

#[test]
fn files_that_exist_are_not_touched() {
    let dir = empty_folder("exists");
    fs::create_dir_all(&dir).unwrap();
    fs::write(dir.join("square.json"), "mine").unwrap();
    let refusal = init_with(&[dir.to_str().unwrap()]).unwrap_err().to_string();
    assert!(refusal.contains("square.json exists already"), "{refusal}");
    assert_eq!(fs::read(dir.join("square.json")).unwrap(), b"mine");
    assert_eq!(fs::read_dir(&dir).unwrap().count(), 1, "other files were written");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn settings_that_are_refused_leave_nothing() {
    let dir = empty_folder("refused");
    let refusal = init_with(&[dir.to_str().unwrap(), "--room=2,-2,-3,1,2.5"]).unwrap_err();
    assert!(refusal.to_string().starts_with("nothing is written: "), "{refusal}");
    assert!(!dir.exists());
}

#[test]
fn a_room_without_place_for_the_square_gets_the_hover_and_a_smaller_one_is_named() {
    let dir = empty_folder("small");
    init_with(&[dir.to_str().unwrap(), "--room=-0.7,0.7,-0.7,0.7,2.5"]).unwrap();
    assert_eq!(read(&dir.join("fly.json"))["mission"], json!("hover.json"));
    assert!(!dir.join("square.json").exists());
    fs::remove_dir_all(&dir).unwrap();
    let refusal = init_with(&[dir.to_str().unwrap(), "--room=-1,1,-1,1,1.2"]).unwrap_err();
    assert!(refusal.to_string().contains("room is too small"), "{refusal}");
    assert!(!dir.exists());
}

#[test]
fn a_rate_that_is_not_a_positive_number_is_refused() {
    for rate in ["nan", "inf", "0", "-5"] {
        let rate = format!("--rate={rate}");
        let refusal = init_with(&["rate", "--mocap", "udp", &rate]).unwrap_err().to_string();
        assert!(refusal.contains("above 0"), "{refusal}");
    }
}
