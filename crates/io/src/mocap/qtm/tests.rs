use horizon_model::check::amax;
use horizon_model::rows::Pose;
use proptest::prelude::*;

use super::*;
use crate::mocap::axes::{Axes, Unit};
use crate::mocap::protocol::{SelectedProtocol, read};
use crate::mocap::{MocapCounters, matrix_of_angles};

fn source(object: &str, up: Option<SourceAxis>) -> SelectedProtocol {
    let axes = Axes::new(None, Unit::Millimetre).unwrap();
    SelectedProtocol::new(Box::new(QtmProtocol::new(up)), object, axes)
}

pub(super) fn packet(fill: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    fill(&mut bytes);
    bytes
}

fn greeting() -> Vec<u8> {
    packet(|to| encode::text(kind::COMMAND, GREETING, to))
}

fn parameters(bodies: &[&str]) -> Vec<u8> {
    packet(|to| encode::parameters(100.0, "+Z", bodies, to))
}

pub(super) fn frame(number: u32, bodies: &[Option<Placement>]) -> Vec<u8> {
    packet(|to| encode::frame(number, 0, bodies, to))
}

#[expect(clippy::unnecessary_wraps, reason = "as frames have it")]
pub(super) fn at(x_mm: f64) -> Option<Placement> {
    Some(Placement { pos_v: [x_mm, -2000.0, 1500.0], matrix: matrix_of_angles([0.0, 0.0, 0.5]) })
}

/// Commands that the source sends.
fn sent(source: &mut SelectedProtocol) -> Vec<String> {
    let mut bytes = Vec::new();
    source.protocol.take_requests(&mut bytes);
    let mut texts = Vec::new();
    Packets::default()
        .push(&bytes, |kind, body| {
            assert_eq!(kind, kind::COMMAND);
            texts.push(packet::text(body).into_owned());
            Ok(())
        })
        .unwrap();
    texts
}

/// Frame 1000 after a second, with [`NUMBERED`] as its only body.
pub(super) fn documented() -> Vec<u8> {
    let mut bytes = b"\x58\0\0\0\x03\0\0\0\x40\x42\x0f\0\0\0\0\0\xe8\x03\0\0\x01\0\0\0\
        \x40\0\0\0\x05\0\0\0\x01\0\0\0\0\0\0\0"
        .to_vec();
    // Position, then the matrix column by column.
    for value in [1.0, 2.0, 3.0, 1.0, 4.0, 7.0, 2.0, 5.0, 8.0, 3.0, 6.0, 9.0_f32] {
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

/// The body of [`documented`]; its matrix has no two equal entries.
pub(super) const NUMBERED: Placement =
    Placement { pos_v: [1.0, 2.0, 3.0], matrix: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0] };

#[test]
fn the_conversation_ends_in_frames_of_the_body() {
    for length in [1, 7, 64, 4096] {
        let mut source = source("tello", None);
        source.protocol.beat();
        assert!(sent(&mut source).is_empty(), "the server speaks first");
        read(&mut source, greeting().chunks(length));
        assert_eq!(sent(&mut source), [VERSION, GET_PARAMETERS]);
        read(&mut source, parameters(&["wand", "tello"]).chunks(length));
        assert_eq!(sent(&mut source), [STREAM]);
        let bytes = [frame(7, &[at(9000.0), at(1000.0)]), frame(8, &[at(9000.0), None])].concat();
        let (frames, counters) = read(&mut source, bytes.chunks(length));
        let [seen, lost] = *frames else { panic!("{frames:?}") };
        assert_eq!((seen.number, seen.rate_hz), (7, 100.0));
        let gap = seen.pose.unwrap() - Pose::new(1.0, -2.0, 1.5, 0.5);
        assert!(amax(&gap) < 1e-6, "{gap}");
        assert_eq!((lost.number, lost.pose), (8, None));
        assert_eq!((counters.messages.get(), counters.malformed.get()), (2, 0));
        source.protocol.beat();
        assert!(sent(&mut source).is_empty());
        // A measurement that ended.
        source.protocol.beat();
        assert_eq!(sent(&mut source), [GET_PARAMETERS]);
    }
}

#[test]
fn parameters_of_old_and_new_servers_are_read() {
    let text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\r\n<QTM_Parameters_Ver_1.27>\
        <General><Frequency>240</Frequency></General><The_3D><AxisUpwards>+Y</AxisUpwards></The_3D>\
        <The_6D><Bodies>2</Bodies><Body><Name>a &amp; b</Name><Enabled>false</Enabled><Mesh><Name>m</Name></Mesh>\
        </Body><Body><Name> tello </Name></Body></The_6D></QTM_Parameters_Ver_1.27>";
    let parameters = Parameters::parse(text).unwrap();
    let bodies = vec![("a & b".to_owned(), false), ("tello".to_owned(), true)];
    assert_eq!(parameters, Parameters { rate_hz: 240.0, up: Some("+Y".to_owned()), bodies });
    // A frame has all bodies, or the enabled ones; else it is not known which.
    assert_eq!(parameters.name(1, 2), Some("tello"));
    assert_eq!(parameters.name(0, 1), Some("tello"));
    assert_eq!(parameters.name(0, 3), None);
    assert_eq!(Parameters::parse("<a>"), None);
    assert_eq!(Parameters::parse("<a/>"), Some(Parameters::default()));
}

#[test]
fn an_axis_that_the_settings_do_not_take_for_up_ends_the_connection() {
    for (written, up, is_accepted) in [
        ("+Z", None, true),
        ("Z", Some(SourceAxis::Z), true),
        ("+Y", None, false),
        ("+Y", Some(SourceAxis::Y), true),
        ("-Z", None, false),
        ("-Z", Some(SourceAxis::MinusZ), true),
    ] {
        let mut source = source("tello", up);
        let bytes =
            [greeting(), packet(|to| encode::parameters(100.0, written, &["tello"], to))].concat();
        let result = source.push(&bytes, &MocapCounters::default(), &mut |_| ());
        assert_eq!(result.is_ok(), is_accepted, "{written}: {result:?}");
    }
}

#[test]
fn other_servers_and_refusals_have_a_reason() {
    let counters = MocapCounters::default();
    let push = |bytes: &[u8]| source("tello", None).push(bytes, &counters, &mut |_| ());
    assert_eq!(push(b"vrpn: ver. 07.35  0\0\0\0\0\0"), Err(SourceError::NoQtm));
    // The big-endian port of the server is refused: its first length is not one of little-endian packets.
    assert_eq!(push(b"\0\0\0\x23\0\0\0\x01QTM RT"), Err(SourceError::NoQtm));
    assert_eq!(push(&packet(|to| encode::text(kind::XML, GREETING, to))), Err(SourceError::NoQtm));
    let refused = packet(|to| encode::text(kind::ERROR, "No\nlicense", to));
    let error = push(&[greeting(), refused].concat()).unwrap_err();
    assert_eq!(error.to_string(), "QTM reports: Nolicense");
}

#[test]
fn of_a_refused_frame_nothing_is_left_for_the_next_one() {
    let mut short = frame(7, &[at(1.0), at(2.0)]);
    // A second component is announced behind head, time and number.
    assert_eq!(short[20], 1);
    short[20] = 2;
    let bytes = [greeting(), parameters(&["wand", "tello"]), short, frame(8, &[at(1.0), at(2.0)])];
    let (frames, counters) = read(&mut source("tello", None), [bytes.concat()]);
    assert_eq!((counters.malformed.get(), counters.doubled.get()), (1, 0));
    let [frame] = *frames else { panic!("{frames:?}") };
    assert!(frame.number == 8 && frame.pose.is_some(), "{frame:?}");
}

#[test]
fn changed_settings_are_asked_for() {
    let mut source = source("tello", None);
    let bytes = [greeting(), parameters(&["wand"]), frame(1, &[at(1.0)])].concat();
    let (frames, _) = read(&mut source, bytes.chunks(4096));
    assert!(frames[0].pose.is_none());
    sent(&mut source);
    let (frames, _) = read(&mut source, frame(2, &[at(1.0), at(2.0)]).chunks(4096));
    assert!(frames[0].pose.is_none(), "which is which is not known");
    source.protocol.beat();
    assert_eq!(sent(&mut source), [GET_PARAMETERS]);
    read(&mut source, parameters(&["wand", "tello"]).chunks(4096));
    let (frames, _) = read(&mut source, frame(3, &[at(1.0), at(2.0)]).chunks(4096));
    assert!(frames[0].pose.is_some());
    sent(&mut source);
    // An event costs no frame, and is asked about until there is an answer.
    let event = [packet(|to| encode::event(11, to)), frame(4, &[at(1.0), at(2.0)])].concat();
    let (frames, _) = read(&mut source, event.chunks(4096));
    assert!(frames[0].pose.is_some());
    assert_eq!(sent(&mut source), [GET_PARAMETERS]);
    source.protocol.beat();
    assert_eq!(sent(&mut source), [GET_PARAMETERS]);
    read(&mut source, parameters(&["tello", "wand"]).chunks(4096));
    source.protocol.beat();
    sent(&mut source);
    read(&mut source, frame(5, &[at(1.0), at(2.0)]).chunks(4096));
    source.protocol.beat();
    assert!(sent(&mut source).is_empty());
}

fn push_all(bytes: &[u8], length: usize) -> Result<(), TestCaseError> {
    let mut source = source("tello", None);
    let counters = MocapCounters::default();
    for piece in bytes.chunks(length.max(1)) {
        let mut poses = Vec::new();
        let result = source.push(piece, &counters, &mut |frame| poses.extend(frame.pose));
        if result.is_err() {
            source.restart();
        }
        for pose in poses {
            prop_assert!(pose.iter().all(|value| value.is_finite()));
        }
        source.protocol.beat();
        source.protocol.take_requests(&mut Vec::new());
    }
    Ok(())
}

proptest! {
    #[test]
    fn random_bytes_give_finite_poses_or_nothing(
        noise in prop::collection::vec(any::<u8>(), 0..400), length in 1..100_usize,
    ) {
        push_all(&noise, length)?;
        push_all(&[greeting(), parameters(&["tello"]), noise].concat(), length)?;
    }

    #[test]
    fn packets_with_other_bytes_give_finite_poses_or_nothing(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        length in 1..300_usize,
    ) {
        let frames = [frame(1, &[at(9000.0), at(1000.0)]), frame(2, &[None, at(1.0)])].concat();
        let mut bytes = [greeting(), parameters(&["wand", "tello"]), frames].concat();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        push_all(&bytes, length)?;
    }

    #[test]
    fn any_document_is_read_or_refused(text in "[<>/a-zA-Z_0-9 &;]{0,60}") {
        Parameters::parse(&text);
        Parameters::parse(&format!("<Q><The_6D><Body><Name>{text}</Name></Body></The_6D></Q>"));
    }
}
