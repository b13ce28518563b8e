//! Every command that README shows, run as it is typed there.

use std::fs;
use std::path::Path;

use crate::{program, rig};

/// Lines of README that are run elsewhere: the package is installed by contrib/package/try.sh, the sources by
/// .ci/run all, and `cargo test` runs this test.
const ELSEWHERE: [&str; 3] =
    ["sudo dpkg --install ", "cargo install --locked --path ", "cargo test"];

/// The lines of its blocks of `sh`, without comments.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn lines() -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../README.md");
    let readme = fs::read_to_string(path).unwrap();
    let blocks = readme.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
    let lines = blocks.flat_map(str::lines).filter_map(|line| line.split(" #").next());
    lines.map(|line| line.trim().to_owned()).collect()
}

/// The newest log in `folder`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn log(folder: &Path) -> String {
    let entries = fs::read_dir(folder.join("logs")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter_map(|name| Some(name.strip_suffix(".mcap")?.to_owned())).max().unwrap()
}

#[test]
fn every_command_of_the_readme_works() {
    let folder = program::folder("readme");
    // It sends poses until the end of the test; its settings have its address.
    let (settings, _emulator) = rig::start("readme-mocap", |relay| relay);
    let settings = settings.join("fly.json").display().to_string();
    let mut count = 0;
    for line in lines() {
        let programs = ["cargo run --release -- ", "tello-ctl "];
        let Some(command) = programs.into_iter().find_map(|program| line.strip_prefix(program))
        else {
            assert!(ELSEWHERE.iter().any(|start| line.starts_with(start)), "not tested: {line}");
            continue;
        };
        let command = if command.contains("LOG") {
            command.replace("LOG", &log(&folder))
        } else {
            command.to_owned()
        };
        let mut words: Vec<&str> = command.split_whitespace().collect();
        // Where cameras and a drone are meant, there are simulated ones.
        match words.first() {
            Some(&"mocap") => words.extend(["--config", &settings, "--seconds", "2"]),
            Some(&"fly") if !words.contains(&"--sim") => words.push("--sim"),
            _ => {}
        }
        let output = program::tello_ctl(&folder, &words);
        assert!(output.status.success(), "{line}\n{}", program::text(&output));
        count += 1;
    }
    assert!(count >= 8, "only {count} commands");
}
