//! The commands that README and the pages of `docs/` show, against the parser of the program.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Parser;

use super::Arguments;

/// What stands for the program in a line of a shell.
const PROGRAMS: [&str; 2] = ["cargo run --release -- ", "tello-ctl "];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// README and all pages of `docs/`, without the measurements, which name commands of their revision.
fn pages() -> Vec<PathBuf> {
    let mut pages = vec![root().join("README.md")];
    for folder in ["docs", "docs/decisions"] {
        let entries = fs::read_dir(root().join(folder)).unwrap();
        pages.extend(entries.map(|entry| entry.unwrap().path()));
    }
    pages.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    pages.sort();
    pages
}

/// Lines of the blocks of `sh` in a page, those with a `\` at the end joined.
fn shell_lines(text: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let (mut is_shell, mut goes_on) = (false, false);
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_shell = line.trim() == "```sh";
            continue;
        }
        if !is_shell {
            continue;
        }
        let part = line.trim().trim_end_matches('\\').trim_end();
        match lines.last_mut() {
            Some(last) if goes_on => *last = format!("{last} {part}"),
            _ => lines.push(part.to_owned()),
        }
        goes_on = line.trim_end().ends_with('\\');
    }
    lines
}

/// The words of a line up to what only a shell reads.
fn words(line: &str) -> Vec<String> {
    let line = line.split(" #").next().unwrap_or(line);
    let ends = |word: &&str| !["|", "||", "&&", ">", "2>", "&", ";"].contains(word);
    let words = line.split_whitespace().take_while(ends);
    words.map(|word| word.trim_matches(['"', '\'']).to_owned()).collect()
}

#[test]
fn every_documented_command_line_is_accepted() {
    let (mut count, mut wrong) = (0, Vec::new());
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for line in shell_lines(&text) {
            let command = PROGRAMS.into_iter().find_map(|program| line.strip_prefix(program));
            let Some(command) = command else { continue };
            count += 1;
            let words = ["tello-ctl".to_owned()].into_iter().chain(words(command));
            if let Err(error) = Arguments::try_parse_from(words) {
                // Help and version are shown as errors.
                if error.use_stderr() {
                    let page = page.file_name().unwrap_or_default().display();
                    wrong.push(format!("{page}: {line}\n{error}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count > 60, "only {count} commands");
}

#[test]
fn a_command_with_a_wrong_flag_is_found() {
    let lines = shell_lines("```sh\ntello-ctl sim --batch 3 \\\n    --sped 1   # fast\n```\n`x`\n");
    assert_eq!(lines, ["tello-ctl sim --batch 3 --sped 1   # fast"]);
    let words = words(&lines[0]);
    assert_eq!(words, ["tello-ctl", "sim", "--batch", "3", "--sped", "1"]);
    assert!(Arguments::try_parse_from(words).is_err());
}
