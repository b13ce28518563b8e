//! Commands for an installation: help, completions, manual pages, first settings.

use std::fs;

use serde_json::{Value, json};

use crate::program::{folder, tello_ctl, text};

/// Commands that people type.
const COMMANDS: [&str; 15] = [
    "fly",
    "sim",
    "ident",
    "replay",
    "report",
    "log",
    "tune",
    "convert",
    "check",
    "bench",
    "mocap",
    "merge",
    "init",
    "completions",
    "man",
];

#[test]
fn help_teaches_every_command() {
    let folder = folder("install-help");
    let help = text(&tello_ctl(&folder, &["--help"]));
    assert!(help.contains("Exit codes"));
    for command in COMMANDS {
        assert!(help.contains(&format!("\n  {command} ")), "{command}: {help}");
        let output = tello_ctl(&folder, &[command, "--help"]);
        assert!(output.status.success() && text(&output).len() > 200, "{}", text(&output));
    }
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let folder = folder("install-install");
    for shell in ["bash", "zsh", "fish"] {
        let output = tello_ctl(&folder, &["completions", shell]);
        assert!(output.status.success(), "{}", text(&output));
        for command in COMMANDS {
            assert!(text(&output).contains(command), "{shell}: {command}");
        }
    }
    assert!(tello_ctl(&folder, &["man", "pages"]).status.success());
    for command in COMMANDS {
        let page = fs::read_to_string(folder.join(format!("pages/tello-ctl-{command}.1"))).unwrap();
        assert!(page.contains(".SH SYNOPSIS"), "{command}");
    }
}

#[test]
fn first_settings_are_valid_and_are_written_once() {
    let folder = folder("install-init");
    for (kind, address) in [
        ("relay", "10.0.0.2:51602"),
        ("datastream", "10.0.0.2:801"),
        ("udp", "0.0.0.0:51001"),
        ("natnet", "10.0.0.2:1510"),
        ("qtm", "10.0.0.2:22223"),
        ("vrpn", "10.0.0.2:3883"),
    ] {
        let arguments = ["init", kind, "--mocap", kind, "--address", address, "--object", "drone"];
        let output = tello_ctl(&folder, &[&arguments[..], &["--room=-2,2,-4,1.5,2.5"]].concat());
        assert!(output.status.success(), "{}", text(&output));
        // The schemas beside them are passed over.
        let inside = fs::read_dir(folder.join(kind)).unwrap().map(|file| file.unwrap().path());
        let all: Vec<_> = inside.map(|path| path.display().to_string()).collect();
        for file in ["fly.json", "sim.json", "square.json", "hover.json", ".schema.json"] {
            assert!(all.iter().any(|path| path.ends_with(file)), "{file}: {all:?}");
        }
        let all = ["check"].into_iter().chain(all.iter().map(String::as_str));
        let output = tello_ctl(&folder, &all.collect::<Vec<_>>());
        assert!(output.status.success(), "{}", text(&output));
        let written = fs::read_to_string(folder.join(kind).join("fly.json")).unwrap();
        let written: Value = serde_json::from_str(&written).unwrap();
        assert_eq!(written["mocap"][kind]["object"], "drone");
        assert_eq!(written["cycle"]["supervisor"]["room"]["z_m"][1], 2.5);
        let simulator = fs::read_to_string(folder.join(kind).join("sim.json")).unwrap();
        let simulator: Value = serde_json::from_str(&simulator).unwrap();
        let ground = &simulator["start"]["ground"];
        assert_eq!((&ground["x"], &ground["y"]), (&json!(0.0), &json!(-1.25)));
    }
    let again = tello_ctl(&folder, &["init", "relay"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(text(&again).contains("exists already"), "{}", text(&again));
    let wrong = tello_ctl(&folder, &["init", "wrong", "--mocap", "sonar"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong).contains("sonar"), "{}", text(&wrong));
    assert!(!folder.join("wrong").exists());
}
