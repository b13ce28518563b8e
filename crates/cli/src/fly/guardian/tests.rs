use std::process::Stdio;

use clap::Parser;

use super::*;

impl Guardian {
    /// The parent's end of another process.
    pub(crate) fn of(process: Child) -> Self {
        Self { process }
    }
}

#[derive(Debug, Parser)]
struct Program {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Debug, clap::Subcommand)]
enum Subcommand {
    Guardian(Arguments),
}

#[test]
fn the_guardian_reads_from_its_arguments_the_drone_and_the_protocol_of_its_parent() {
    let drone = SocketAddr::from(([192, 168, 10, 1], 8889));
    for protocol in [Protocol::Binary, Protocol::Text] {
        let command = command(drone, protocol);
        assert_eq!(command.get_program(), OURSELVES);
        let words = [NAME.as_ref()].into_iter().chain(command.get_args());
        let Subcommand::Guardian(read) = Program::try_parse_from(words).unwrap().command;
        assert_eq!((read.drone, read.protocol), (drone, protocol));
    }
}

#[test]
fn a_guardian_that_has_ended_is_waited_for_and_leaves_no_zombie() {
    let process = Command::new("true").stdin(Stdio::null()).spawn().unwrap();
    let stat = format!("/proc/{}/stat", process.id());
    Guardian::of(process).end();
    assert!(!std::path::Path::new(&stat).exists());
}

#[test]
fn a_guardian_of_the_first_process_of_a_container_would_end_with_it() {
    for (id, parent, first, ends) in [
        (1, 0, "tello-ctl", true),
        (7, 1, "docker-init", true),
        (7, 1, "systemd", false),
        (9, 7, "docker-init", false),
        // By `docker exec`.
        (9, 0, "sleep", false),
    ] {
        assert_eq!(ends_with_parent(id, parent, first), ends, "{id} {parent} {first}");
    }
}

#[test]
fn a_simulated_drone_is_flown_from_any_process() {
    Guardian::probe(([127, 0, 0, 1], 8889).into()).unwrap();
}
