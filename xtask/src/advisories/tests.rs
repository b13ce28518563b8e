use std::env::temp_dir;

use super::*;

/// A lock file with one package of the workspace and others of a registry.
fn lock(packages: &[(&str, &str)]) -> String {
    let mut text = "version = 4\n\n[[package]]\nname = \"xtask\"\nversion = \"0.1.0\"\n".to_owned();
    for (name, version) in packages {
        write!(
            text,
            "\n[[package]]\nname = \"{name}\"\nversion = \"{version}\"\n\
             source = \"registry+https://example.org/index\"\nchecksum = \"00\"\n"
        )
        .unwrap();
    }
    text
}

fn packages(packages: &[(&str, &str)]) -> BTreeSet<Locked> {
    locked(&lock(packages)).unwrap().into_iter().collect()
}

const FACTS: &str = r#"{
"database": {"url":"https://example.org","commit":null,"date":"2026-11-25","newest":"RUSTSEC-2026-0003","note":null},
"advisories": [
{"crate":"torn","id":"RUSTSEC-2026-0001","kind":"vulnerability","patched":["^0.3.5",">=0.4.2"],"unaffected":["<0.2.0"],"url":null},
{"crate":"alone","id":"RUSTSEC-2026-0002","kind":"unmaintained","patched":[],"unaffected":[],"url":"https://example.org/2"}
],
"without": [
"quiet"
]
}
"#;

fn findings(versions: &[(&str, &str)]) -> Findings {
    kept(KEPT, FACTS).unwrap().compare(&packages(versions))
}

#[test]
fn a_vulnerable_version_is_found_and_no_other() {
    for version in ["0.2.0", "0.3.4", "0.4.0", "0.4.1", "0.4.2-rc.1"] {
        let findings = findings(&[("torn", version)]);
        assert_eq!(findings.vulnerable.len(), 1, "{version}");
        let complaint = findings.judge().unwrap_err().to_string();
        assert!(complaint.contains("RUSTSEC-2026-0001: torn"), "{complaint}");
        assert!(complaint.contains("patched in ^0.3.5 or >=0.4.2"), "{complaint}");
    }
    for version in ["0.1.9", "0.3.5", "0.3.9", "0.4.2", "1.0.0", "0.4.2+build.1"] {
        let findings = findings(&[("torn", version)]);
        assert_eq!(findings, Findings::default(), "{version}");
        findings.judge().unwrap();
    }
    assert_eq!(findings(&[("torn", "0.4.1"), ("torn", "0.4.2")]).vulnerable.len(), 1);
}

#[test]
fn what_is_unmaintained_is_a_warning() {
    let findings = findings(&[("alone", "1.0.0"), ("quiet", "2.0.0")]);
    assert_eq!(
        findings.informational,
        ["RUSTSEC-2026-0002: alone 1.0.0: unmaintained, patched never (https://example.org/2)"]
    );
    findings.judge().unwrap();
}

#[test]
fn a_crate_that_was_not_looked_up_fails_with_the_way_out() {
    let complaint = findings(&[("quiet", "1.0.0"), ("new", "1.0.0")]).judge().unwrap_err();
    let complaint = complaint.to_string();
    assert!(
        complaint.starts_with("never looked up: new; run `cargo xtask advisories"),
        "{complaint}"
    );
    assert!(complaint.contains("--update") && complaint.contains(KEPT), "{complaint}");
}

#[test]
fn a_damaged_file_is_named_with_its_line() {
    let complaint = |text: &str| format!("{:#}", kept(KEPT, text).unwrap_err());
    let torn = FACTS.find("RUSTSEC-2026-0002").unwrap();
    let complaint_torn = complaint(&FACTS[..torn]);
    assert!(
        complaint_torn.starts_with("xtask/advisories.json is damaged: EOF"),
        "{complaint_torn}"
    );
    assert!(complaint_torn.contains("at line 5 column"), "{complaint_torn}");
    let range = complaint(&FACTS.replace(">=0.4.2", "newer"));
    assert!(range.contains("at line 4 column"), "{range}");
    let field = complaint(&FACTS.replace("\"kind\":\"unmaintained\",", ""));
    assert!(field.contains("missing field `kind` at line 5"), "{field}");
    assert!(locked("[[package]]\nname = \"a").is_err() && locked("version = 4").is_err());
}

#[test]
fn the_kept_facts_are_whole_and_in_their_own_format() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join(KEPT);
    let kept_text = fs::read_to_string(file).unwrap();
    assert_eq!(text(&kept(KEPT, &kept_text).unwrap()).unwrap(), kept_text);
    assert_eq!(text(&kept(KEPT, FACTS).unwrap()).unwrap(), FACTS);
}

/// A folder in the database's format, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str, files: &[(&str, &str)]) -> Self {
        let folder = temp_dir().join(format!("advisories-{name}-{}", std::process::id()));
        for (path, text) in files {
            let file = folder.join("crates").join(path);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, text).unwrap();
        }
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

fn names(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

const TORN: &str = r#"```toml
[advisory]
id = "RUSTSEC-2026-0001"
package = "torn"
date = "2026-01-07"
aliases = ["CVE-2026-0001",
    "GHSA-xxxx",
]

[affected]
os = ["linux"]
functions = { "torn::read" = [">= 0.2, < 0.4.2"] }

[versions]
patched = [
    "^0.3.5",
    ">= 0.4.2",
]
unaffected = ["< 0.2.0"]
```

# A title

patched = []
"#;

#[test]
fn a_clone_of_the_database_says_the_same() {
    let alone = "```toml\n[advisory]\nid = \"RUSTSEC-2026-0002\"\npackage = \"alone\"\ndate = \"2026-02-01\"\n\
                 url = \"https://example.org/2\"\ninformational = \"unmaintained\"\n\n[versions]\npatched = []\n```\n";
    let withdrawn = alone.replace("alone", "quiet").replace("0002", "0003");
    let withdrawn = withdrawn.replace("informational", "withdrawn = \"2026-03-01\"\ninformational");
    let other = alone.replace("alone", "other").replace("0002", "0004").replace("02-01", "11-25");
    let folder = Folder::new(
        "same",
        &[
            ("torn/RUSTSEC-2026-0001.md", TORN),
            ("torn/RUSTSEC-0000-0000.md", "a draft"),
            ("alone/RUSTSEC-2026-0002.md", alone),
            ("quiet/RUSTSEC-2026-0003.md", &withdrawn),
            ("other/RUSTSEC-2026-0004.md", &other),
        ],
    );
    let facts = database::read(&folder.0, names(&["alone", "quiet", "torn"])).unwrap();
    let expected = kept(KEPT, FACTS).unwrap();
    assert_eq!(facts.database.newest, "RUSTSEC-2026-0004");
    assert_eq!(
        (facts.database.date.as_str(), facts.database.commit.as_ref()),
        ("2026-11-25", None)
    );
    assert_eq!(facts.without, expected.without);
    assert!(facts.advisories.iter().all(|advisory| expected.advisories.contains(advisory)));
    assert_eq!(facts.advisories.len(), expected.advisories.len());
    assert_eq!(kept(KEPT, &text(&facts).unwrap()).unwrap(), facts);
}

#[test]
fn a_bad_file_of_the_database_is_named() {
    for (bad, why) in [
        (TORN.replace("```toml", ""), "no TOML"),
        (TORN.replace("package = \"torn\"", ""), "no `advisory.package`"),
        (TORN.replace("\"< 0.2.0\"", "\"newer\""), "`versions.unaffected`: newer"),
        (TORN.replace("aliases", "informational = \"odd\"\naliases"), "`informational` is odd"),
        (TORN.replace("date = \"", "date = "), "TOML parse error at line"),
    ] {
        let folder = Folder::new("bad", &[("torn/RUSTSEC-2026-0001.md", &bad)]);
        let error = format!("{:#}", database::read(&folder.0, names(&["torn"])).unwrap_err());
        assert!(error.contains("torn/RUSTSEC-2026-0001.md") && error.contains(why), "{error}");
    }
    let empty = Folder::new("empty", &[("torn/README.md", "")]);
    assert!(database::read(&empty.0, names(&["torn"])).is_err());
    assert!(database::read(Path::new("/nowhere"), names(&["torn"])).is_err());
}
