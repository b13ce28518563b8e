use std::fs;

use super::*;

/// A file with these bytes.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path =
        std::env::temp_dir().join(format!("tello-ctl-convert-{}-{name}", std::process::id()));
    fs::write(&path, bytes).unwrap();
    path
}

fn arguments(out: Option<&Path>, to: Option<Format>) -> Arguments {
    Arguments {
        inputs: Vec::new(),
        out: out.map(Path::to_owned),
        out_dir: None,
        to,
        pos: Pos::Estimate,
        decimals: None,
        force: true,
        json: false,
    }
}

#[test]
fn the_format_is_that_of_the_bytes_and_not_of_the_name() {
    const MCAP: &[u8] = b"\x89MCAP";
    let long = [MCAP, &[0]].concat();
    for (name, bytes, expected) in [
        ("a.csv", MCAP, Some(Format::Mcap)),
        ("b.csv", long.as_slice(), Some(Format::Mcap)),
        ("c.mcap", b"pos,0,1,2,3,4\n", Some(Format::Csv)),
        ("d.mcap", &MCAP[..MCAP.len() - 1], Some(Format::Csv)),
        ("e.mcap", b"", None),
    ] {
        let path = file(name, bytes);
        assert_eq!(Format::of(&path).ok(), expected, "{name}");
        fs::remove_file(path).unwrap();
    }
    assert_eq!((Format::Csv.other(), Format::Mcap.other()), (Format::Mcap, Format::Csv));
}

#[test]
fn two_recordings_of_one_name_are_refused() {
    let check = |names: &[&str]| check_names(&names.iter().map(PathBuf::from).collect::<Vec<_>>());
    check(&["a/1.log", "a/2.log", "b/3.csv"]).unwrap();
    let error = check(&["a/1.log", "a/2.log", "b/1.csv"]).unwrap_err().to_string();
    assert!(error.starts_with("b/1.csv has the name of another recording"), "{error}");
}

#[test]
fn a_recording_is_never_made_of_itself() {
    let path = file("self.csv", b"pos,0,1,2,3,4\ninput,0,0,0,0,0\n");
    let refusal = |out, to| convert(&path, &arguments(out, to)).unwrap_err().to_string();
    assert_eq!(refusal(None, Some(Format::Csv)), "it is csv already");
    assert!(
        refusal(Some(path.as_path()), None)
            .ends_with("would replace itself: choose another name with -o")
    );
    assert!(fs::read(&path).unwrap().starts_with(b"pos"));
    fs::remove_file(path).unwrap();
}

#[test]
fn each_recording_has_its_line_and_what_was_left_out() {
    let converted = |to: Option<&str>, error: Option<&str>, skipped: &[&str]| Converted {
        from: "a.log".into(),
        to: to.map(Into::into),
        steps: 7,
        skipped: skipped.iter().map(ToString::to_string).collect(),
        is_complete: true,
        error: error.map(str::to_owned),
    };
    let files = vec![
        converted(Some("a.mcap"), None, &["line 3"]),
        converted(None, Some("there is no step in it"), &[]),
    ];
    assert_eq!(
        ConvertReport { files }.to_string(),
        "a.log -> a.mcap: 7 steps\n  skipped line 3\na.log: there is no step in it\n"
    );
}

#[test]
fn a_log_that_lacks_something_is_no_whole_success_whatever_its_notes_say() {
    let converted = |is_complete, error: Option<&str>| Converted {
        from: "a.mcap".into(),
        to: None,
        steps: 7,
        skipped: Vec::new(),
        is_complete,
        error: error.map(str::to_owned),
    };
    let verdict = |files| ConvertReport { files }.verdict().ok();
    assert_eq!(verdict(vec![converted(true, None)]), Some(Verdict::Good));
    assert_eq!(verdict(vec![converted(true, None), converted(false, None)]), Some(Verdict::Bad));
    let refused = || converted(true, Some("it is empty"));
    assert_eq!(verdict(vec![converted(true, None), refused()]), Some(Verdict::Bad));
    assert_eq!(verdict(vec![refused()]), None);
}

#[test]
fn of_a_log_of_ours_what_identification_uses_is_converted_and_the_rest_is_named() {
    let log = file("ours.mcap", b"");
    fs::remove_file(&log).unwrap();
    let (table, mission) = tello_io::config::fly(None, None).unwrap();
    let flight = tello_io::config::flight(&table, mission, tello_flight::Start::Grounded);
    tello_sim::logged_flight::fly(&flight, &tello_sim::settings(None).unwrap(), 1, &log).unwrap();
    let RowFlight { rows, notes, .. } = of_mcap(&log, Pos::Filtered).unwrap();
    let (used, _) = recordings::load(std::slice::from_ref(&log)).unwrap();
    assert!(used[0].is_simulated);
    assert!(rows.iter().map(|row| row.input).eq(used[0].recording.u.iter().map(|u| Some(*u))));
    for word in ["simulated", "take-off", "landing"] {
        assert!(notes.iter().any(|note| note.contains(word)), "{word}: {notes:?}");
    }
    fs::remove_file(log).unwrap();
}
