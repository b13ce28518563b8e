//! Shows each check of the parent a bad text, which it must see, and a good one, which it must not.

use super::rows::index_complaints;
use super::words::snake_case;
use super::*;

fn manifest(name: &str, dependencies: &str) -> File {
    let text = format!(
        "[package]\nname = \"{name}\"\n[lints]\nworkspace = true\n[dependencies]\n{dependencies}\n"
    );
    File::new("crates/x/Cargo.toml", &text)
}

#[test]
fn a_reversed_arrow_is_seen_in_every_form() {
    for dependency in [
        "tello-sim.workspace = true",
        "tello-sim = { path = \"../sim\" }",
        "plant = { package = \"tello-sim\", path = \"../sim\" }",
        "[dev-dependencies.tello-sim]\nworkspace = true",
    ] {
        let complaints = manifest_complaints(&manifest("horizon-control", dependency));
        assert_eq!(complaints.len(), 1, "{dependency}: {complaints:?}");
    }
    assert_eq!(
        manifest_complaints(&manifest("horizon-estim", "tello-io.workspace = true")).len(),
        1
    );
    for below in ["tello-io", "tello-eval", "tello-sim", "tello-ctl"] {
        let dependency = format!("{below}.workspace = true");
        let complaints = manifest_complaints(&manifest("tello-flight", &dependency));
        assert_eq!(complaints.len(), 1, "{below}");
    }
    for (crate_name, other) in
        [("tello-io", "tello-eval"), ("tello-eval", "tello-sim"), ("tello-sim", "tello-ctl")]
    {
        let complaints =
            manifest_complaints(&manifest(crate_name, &format!("{other}.workspace = true")));
        assert_eq!(complaints.len(), 1, "{crate_name} must not depend on {other}");
    }
    assert!(manifest_complaints(&manifest("tello-sim", "tello-io.workspace = true")).is_empty());
    assert!(manifest_complaints(&manifest("tello-io", "# not tello-sim")).is_empty());
}

#[test]
fn an_unknown_crate_and_missing_lints_are_seen() {
    assert_eq!(manifest_complaints(&manifest("tello-new", "")).len(), 1);
    let bare = File::new("crates/io/Cargo.toml", "name = \"tello-io\"\n");
    assert_eq!(manifest_complaints(&bare).len(), 1);
}

#[test]
fn every_impure_word_is_seen_and_only_as_a_word() {
    for word in IMPURE {
        let file = File::new("crates/estim/src/mhe.rs", &format!("use {word};\n"));
        assert_eq!(purity_complaints(&file).len(), 1, "{word}");
    }
    let text = "use tokio::net;\n";
    assert_eq!(purity_complaints(&File::new("crates/flight/src/cycle/inbox.rs", text)).len(), 1);
    assert_eq!(purity_complaints(&File::new("crates/io/src/mocap/new.rs", text)).len(), 1);
    assert!(purity_complaints(&File::new("crates/io/src/tello/client.rs", text)).is_empty());
    let prose = File::new("crates/estim/src/mhe.rs", "// asynchronous, for instance\n");
    assert!(purity_complaints(&prose).is_empty());
}

#[test]
fn long_unnamed_and_unfinished_files_are_seen() {
    let complaints = |path: &str, text: &str| shape_complaints(&File::new(path, text)).len();
    assert_eq!(complaints("crates/io/src/clock.rs", &"\n".repeat(LINES_MAX + 1)), 1);
    assert_eq!(complaints("crates/io/src/clock.rs", &"\n".repeat(LINES_MAX)), 0);
    assert_eq!(complaints("crates/io/src/mod.rs", ""), 1);
    assert_eq!(complaints("crates/io/src/utils/clock.rs", ""), 1);
    assert_eq!(complaints("crates/io/src/clock.rs", concat!("// TO", "DO: later")), 1);
    assert_eq!(complaints("crates/io/src/clock.rs", concat!("// TO", "DO(#12): later")), 0);
    let long = "x".repeat(COLUMNS_MAX - 3);
    assert_eq!(complaints("crates/io/src/clock.rs", &format!("// {long}\n/// | {long}")), 0);
    assert_eq!(complaints("crates/io/src/clock.rs", &format!("    // {long}")), 1);
}

#[test]
fn a_literal_index_is_seen_and_an_array_is_not() {
    let complaints = |text: &str| index_complaints(&File::new("crates/model/src/x.rs", text)).len();
    for text in ["s[3] = 0.0;", "j[(0, 3)]", "s_hat()[0]", "m[k][2]", "repair[0]", "pair[0][2]"] {
        assert_eq!(complaints(text), 1, "{text}");
    }
    for text in [
        "[0.0; 4]",
        "&[1.0, 2.0]",
        "vec![0; n]",
        "s[pose::X]",
        "#[cfg(x)]",
        "// s[3]",
        "\"s[3]\"",
        "pair[1]",
    ] {
        assert_eq!(complaints(text), 0, "{text}");
    }
    assert_eq!(complaints("#[cfg(test)]\nmod tests {\n    s[3]\n}\n"), 0);
}

#[test]
fn quoted_equations_are_found_and_other_numbers_are_not() {
    let quoted =
        |text: &str| quoted_equations(&File::new("x.rs", text)).into_iter().collect::<Vec<_>>();
    assert_eq!(quoted("/// Thesis equation 4.1, see\n"), [(4, 1)]);
    assert_eq!(quoted("// equations 3.43,\n    // 3.44 and 3.45"), [(3, 43), (3, 44), (3, 45)]);
    assert_eq!(
        quoted("//! the filter (4.10-4.12) and (4.26)."),
        [(4, 10), (4, 11), (4, 12), (4, 26)]
    );
    assert!(quoted("// section 4.3.11, 3.2 us, Drake 4.1\nlet x = 3.5;").is_empty());
}

#[test]
fn a_path_that_is_gone_is_seen() {
    let complaints_of = |path, text: &str| path_complaints(&File::new(path, text), |_| false);
    let complaints = |text: &str| complaints_of("docs/a.md", text);
    assert_eq!(complaints_of("a.rs", concat!("x; /", "/ see `docs/gone.md`")).len(), 1);
    assert!(complaints_of("a.rs", "let x = \"`docs/gone.md`\";").is_empty());
    assert_eq!(complaints("see `crates/gone.rs` and [b](b.md)").len(), 2);
    assert_eq!(complaints("run `bash .ci/gone`").len(), 1);
    assert!(complaints("crates/gone.rs, `crates/*/src`, [x](https://x.org)").is_empty());
}

#[test]
fn keys_are_not_values() {
    let text = r#"{ "a": 1, "b": { "c d": ["e", "f"] }, "g": "h" }"#;
    assert_eq!(keys(text), BTreeSet::from(["a", "b", "c d", "g"]));
}

#[test]
fn a_variant_is_found_under_its_name_in_logs() {
    assert_eq!(snake_case("BatteryLow"), "battery_low");
    assert_eq!(snake_case("Idle"), "idle");
}

#[test]
fn a_tested_failure_without_its_file_is_seen() {
    let table = "test,failure,reaction\ntests/a.rs,x,\"y, z\"\ntests/b.rs,x,y\ntests/c.rs,x,y\n";
    let complaints = failure_complaints(table, |test| test != "tests/b.rs");
    assert_eq!(complaints, ["tests/b.rs"]);
}
