use super::super::mocap::tests::{ANY, Viewer, WAND, watch};
use super::super::{MocapAddresses, MocapServers};
use super::*;

/// Answers of a session to `command`: kinds and texts.
fn answers(session: &mut QtmSession, command: &str) -> Vec<(u32, String)> {
    let mut bytes = Vec::new();
    encode::text(kind::COMMAND, command, &mut bytes);
    session.receive(&bytes).unwrap();
    let mut answers = Vec::new();
    let sent = std::mem::take(&mut session.answers);
    Packets::default()
        .push(&sent, |kind, body| {
            answers.push((kind, text(body).into_owned()));
            Ok(())
        })
        .unwrap();
    answers
}

#[test]
fn a_client_sees_both_objects_and_that_one_is_not_there() {
    let asked = MocapAddresses { qtm: Some(ANY), ..MocapAddresses::default() };
    for (object, body) in [("tello", None), ("wand", Some(WAND))] {
        let mut servers = MocapServers::bind(asked).unwrap();
        let mut viewer = Viewer::tcp("qtm", servers.addresses().qtm.unwrap(), object);
        watch(&mut servers, &mut viewer);
        viewer.assert_sees(31, body);
    }
}

#[test]
fn questions_are_answered_in_any_case_of_letters() {
    let mut session = QtmSession::default();
    for (command, answer) in [
        ("Version", "Version is 1.19"),
        ("version 1.13", "Version set to 1.13"),
        ("ByteOrder", "Byte order is little endian"),
    ] {
        assert_eq!(answers(&mut session, command), [(kind::COMMAND, answer.to_owned())]);
    }
    let state = answers(&mut session, "GetState");
    assert_eq!(state.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [kind::EVENT]);
}

#[test]
fn what_would_change_a_measurement_is_refused() {
    let mut session = QtmSession::default();
    for command in ["TakeControl secret", "Start", "Close", ""] {
        let refused = vec![(kind::ERROR, "Command not supported".to_owned())];
        assert_eq!(answers(&mut session, command), refused, "{command:?}");
    }
    let QtmSession { wants_parameters, wants_every_frame, wants_frame, .. } = session;
    assert!(!(wants_parameters || wants_every_frame || wants_frame));
}

#[test]
fn frames_begin_and_end_as_asked_and_one_may_be_asked_for() {
    let mut session = QtmSession::default();
    assert!(answers(&mut session, "StreamFrames AllFrames 6D").is_empty());
    assert!(session.wants_every_frame && !session.wants_frame);
    assert!(answers(&mut session, "StreamFrames Stop").is_empty());
    assert!(!session.wants_every_frame);
    assert!(answers(&mut session, "GetCurrentFrame 6D").is_empty());
    assert!(session.wants_frame && !session.wants_every_frame);
    assert!(answers(&mut session, "GetParameters 6D").is_empty());
    assert!(session.wants_parameters);
}

#[test]
fn a_command_in_pieces_is_obeyed_once_it_is_whole_and_an_unknown_packet_ends_the_connection() {
    let mut session = QtmSession::default();
    let mut bytes = Vec::new();
    encode::text(kind::COMMAND, "GetCurrentFrame 6D", &mut bytes);
    let (last, rest) = bytes.split_last().unwrap();
    session.receive(rest).unwrap();
    assert!(!session.wants_frame);
    session.receive(&[*last]).unwrap();
    assert!(session.wants_frame);
    assert!(session.receive(&[0xff; 16]).is_err());
}
