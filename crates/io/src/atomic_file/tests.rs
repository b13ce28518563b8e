use std::os::unix::fs::PermissionsExt as _;

use super::*;

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("tello-ctl-{}-{name}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_file_is_kept_unless_it_may_be_replaced() {
    let folder = folder("kept");
    let path = folder.join("a.txt");
    let fill = |text: &'static str| move |part: &Path| Ok(fs::write(part, text)?);
    write(&path, false, fill("first")).unwrap();
    let error = write(&path, false, fill("second")).unwrap_err();
    assert!(error.to_string().contains("--force"), "{error}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "first");
    write(&path, true, fill("third")).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "third");
    fs::remove_file(&path).unwrap();
    let late = write(&path, false, |part| {
        assert!(UNFINISHED.lock().iter().any(|unfinished| unfinished == part));
        write(&path, false, fill("another process"))?;
        Ok(fs::write(part, "late")?)
    });
    assert!(late.unwrap_err().to_string().contains("another process"));
    assert_eq!(fs::read_to_string(&path).unwrap(), "another process");
    assert_eq!(names(&folder), ["a.txt"]);
    assert!(!UNFINISHED.lock().iter().any(|part| part.starts_with(&folder)));
    // A link to nothing is a name that is taken, too.
    let link = folder.join("link");
    std::os::unix::fs::symlink(folder.join("missing"), &link).unwrap();
    assert!(prepare(&link, false).is_err() && write(&link, false, fill("no")).is_err());
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_cannot_be_written_is_known_before() {
    let folder = folder("probe");
    let path = folder.join("a.txt");
    fs::write(&path, "before").unwrap();
    probe(&path).unwrap();
    assert_eq!(
        (fs::read_to_string(&path).unwrap(), names(&folder)),
        ("before".into(), vec!["a.txt".into()])
    );
    for wrong in [folder.clone(), folder.join("no/a.txt"), path.join("a.txt"), folder.join("..")] {
        assert!(probe(&wrong).is_err(), "{}", wrong.display());
    }
    let folder_there = prepare(&folder, false).unwrap_err().to_string();
    assert!(folder_there.ends_with("it is a folder"), "{folder_there}");
    let link = folder.join("link");
    std::os::unix::fs::symlink(folder.join("missing"), &link).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).unwrap();
    for (wrong, why) in [(link, "a link to nothing"), (path, "read-only")] {
        let errors = [probe(&wrong), write_contents(&wrong, true, "after")];
        let errors = errors.map(|it| it.unwrap_err().to_string());
        assert!(errors.iter().all(|error| error.contains(why)), "{errors:?}");
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_file_that_is_replaced_keeps_its_permissions() {
    let folder = folder("mode");
    let path = folder.join("a.txt");
    fs::write(&path, "before").unwrap();
    for mode in [0o600, 0o664] {
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        write_contents(&path, true, "after").unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, mode);
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn devices_and_pipes_are_written_and_stay() {
    let folder = folder("pipe");
    let pipe = folder.join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let is_unfinished = |part: &Path| UNFINISHED.lock().iter().any(|it| part.starts_with(it));
    let fill = |part: &Path| {
        assert!(is_unfinished(part), "a signal would leave {}", part.display());
        Ok(fs::write(part, "all of it")?)
    };
    let reader = {
        let pipe = pipe.clone();
        std::thread::spawn(move || fs::read_to_string(pipe).unwrap())
    };
    probe(&pipe).unwrap();
    assert!(write(&pipe, false, fill).is_err());
    write(&pipe, true, fill).unwrap();
    assert_eq!(reader.join().unwrap(), "all of it");
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    let passed = std::env::temp_dir().join(format!("tello-ctl-{}.part", std::process::id()));
    assert!(!(passed.exists() || is_unfinished(&passed)));
    // A file behind a link is replaced, not the link.
    let (file, link) = (folder.join("file"), folder.join("link"));
    fs::write(&file, "before").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    write(&link, true, fill).unwrap();
    assert_eq!(fs::read_to_string(&file).unwrap(), "all of it");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    let socket = folder.join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    assert!(write(&socket, true, fill).is_err() && probe(&socket).is_err());
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_is_unfinished_is_a_file_or_a_folder_that_has_one() {
    let folder = folder("unfinished");
    fs::write(folder.join("part"), "half").unwrap();
    remove(folder.join("part"));
    assert_eq!(names(&folder), Vec::<String>::new());
    fs::write(folder.join("part"), "half").unwrap();
    remove(folder.clone());
    assert!(!folder.exists());
}

#[test]
fn what_never_ends_is_not_read() {
    let zeros = Path::new("/dev/zero");
    assert!(read(zeros, 1000).unwrap_err().to_string().contains("more than 1000 bytes"));
    let folder = folder("read");
    let path = folder.join("a.txt");
    fs::write(&path, "1234").unwrap();
    assert_eq!(read(&path, 4).unwrap(), b"1234");
    assert!(read(&path, 3).is_err());
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_failure_leaves_nothing_and_spoils_nothing() {
    let folder = folder("failure");
    let path = folder.join("a.txt");
    fs::write(&path, "before").unwrap();
    let half = |part: &Path| -> Result<()> {
        fs::write(part, "half")?;
        bail!("the disk is full")
    };
    let error = write(&path, true, half).unwrap_err();
    assert_eq!(format!("{error:#}"), format!("cannot write {}: the disk is full", path.display()));
    assert_eq!(fs::read_to_string(&path).unwrap(), "before");
    assert_eq!(names(&folder), ["a.txt"]);
    assert!(write(&folder.join("no/a.txt"), true, |part| Ok(fs::write(part, "")?)).is_err());
    fs::remove_dir_all(folder).unwrap();
}
