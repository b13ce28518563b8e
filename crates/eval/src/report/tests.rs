use super::*;

#[test]
fn flights_are_called_by_their_path_or_the_ends_of_their_paths() {
    let called = |paths: &[&str]| name_of(&paths.iter().map(PathBuf::from).collect::<Vec<_>>());
    assert_eq!(called(&[]), "");
    assert_eq!(called(&["logs/a.mcap"]), "a");
    assert_eq!(called(&["logs/a.mcap", "b.mcap", "c/d.csv"]), "a .. d");
    assert_eq!(called(&["/"]), "flights");
}

#[test]
fn a_group_without_a_flight_says_what_is_wrong_with_each_of_its_own_files() {
    let folder = std::env::temp_dir().join(format!("tello-eval-report-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("a.log"), "no recording").unwrap();
    let file = "an-earlier.log".into();
    let mut unusable = vec![Unusable { file, why: "an earlier group's".to_owned() }];
    let message = read(std::slice::from_ref(&folder), &mut unusable).unwrap_err().to_string();
    assert!(message.starts_with("there is no flight to report: "), "{message}");
    assert!(!message.contains("earlier"), "{message}");
    assert_eq!(unusable.len(), 2);
    assert_eq!(unusable[1].file, folder.join("a.log"));
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_path_that_does_not_exist_is_refused() {
    let missing = PathBuf::from("/nonexistent/flight.mcap");
    assert!(page_of(&[missing], &[], Path::new("page.html")).is_err());
}

#[test]
fn the_text_names_each_group_what_was_left_out_and_the_page() {
    let report = FlightsReport {
        verdicts: vec!["1 of 1 flights were good".to_owned()],
        groups: vec![Group::of("square".to_owned(), Vec::new())],
        comparison: None,
        unusable: vec![Unusable { file: "b.log".into(), why: "b.log is empty".to_owned() }],
        definitions: BTreeMap::new(),
        page: "out/page.html".into(),
        revision: REVISION,
    };
    let text = report.to_string();
    assert!(text.starts_with("square: 1 of 1 flights were good\n"), "{text}");
    assert!(text.ends_with("not in the report: b.log is empty\npage  out/page.html\n"), "{text}");
}

#[test]
fn a_page_is_replaced_and_a_log_is_not() {
    let path = std::env::temp_dir().join(format!("tello-ctl-page-{}", std::process::id()));
    assert!(replaces_a_page(&path).is_ok(), "there is no file");
    let page = format!("<!DOCTYPE html>\n<html>\n<head>\n{GENERATOR}");
    for (text, is_fine) in
        [("", true), (&page, true), ("<!DOCTYPE html>", false), ("\u{89}MCAP0", false)]
    {
        fs::write(&path, text).unwrap();
        assert_eq!(replaces_a_page(&path).is_ok(), is_fine, "{text:?}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn a_copy_of_a_log_is_no_second_flight() {
    let folder = std::env::temp_dir().join(format!("tello-eval-copies-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let recorded = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data");
    let log = recordings::find(&[recorded]).unwrap().0.into_iter().next().unwrap();
    for name in ["a", "b"] {
        let name = folder.join(name).with_extension(log.extension().unwrap_or_default());
        fs::copy(&log, name).unwrap();
    }
    let bytes = fs::read(&log).unwrap();
    fs::write(folder.join("torn.mcap"), &bytes[..bytes.len() - 100]).unwrap();
    let mut unusable = Vec::new();
    let group = read(std::slice::from_ref(&folder), &mut unusable).unwrap();
    assert_eq!((group.flights.len(), unusable.len()), (1, 2), "{unusable:?}");
    assert!(unusable[1].why.starts_with("its poses are those of "), "{unusable:?}");
    let (file, line) = (unusable[0].file.display().to_string(), unusable[0].to_string());
    assert!(line.starts_with(&format!("{file}: its bytes are those of ")), "{line}");
    let why = format!("{file} is empty");
    assert_eq!(Unusable { why: why.clone(), ..unusable[0].clone() }.to_string(), why);
    fs::remove_dir_all(&folder).unwrap();
}
