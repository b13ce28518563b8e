use ratatui::backend::TestBackend;
use tello_eval::telemetry::{DroneTelemetry, LinkTelemetry, Spot};
use tello_flight::{Fault, Phase, Pilot};

use super::*;

/// A flight along a line of 2 m, in trouble.
pub(super) fn view(has_colours: bool) -> View {
    let briefing = FlightHeader {
        program: "tello-ctl".into(),
        path: vec![[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]],
        targets: vec![[2.0, 0.0, 1.0]],
        targets_count: 5,
        room: None,
        dt_s: 0.02,
        deadline_s: 0.01,
        stale_s: 0.1,
        late_ms: 5.0,
    };
    let mut view = View::new(briefing, Palette::new(has_colours));
    let mut facts = Telemetry {
        step: 7,
        t_s: 12.34,
        phase: Some(Phase::Flying),
        pilot: Some(Pilot::Controller),
        faults: vec![Fault::MocapStale, Fault::BatteryLow],
        estimate: Some(Spot { x: 1.0, y: 0.5, z: 1.2, theta: std::f64::consts::FRAC_PI_2 }),
        target: Spot { x: 2.0, y: 0.0, z: 1.0, theta: 0.0 },
        targets_reached: 3,
        link: Some(LinkTelemetry { is_down: false, score: -3.1 }),
        drone: Some(DroneTelemetry {
            age_s: 0.1,
            battery_pct: 61,
            is_battery_low: Some(false),
            is_flying: true,
            height_m: None,
        }),
        trail: vec![[0.0, 0.5, 1.0], [1.0, 0.5, 1.2]],
        plan: vec![[1.0, 0.5, 1.2], [1.5, 0.2, 1.0]],
        ..Telemetry::default()
    };
    facts.worst.late_ms = 4.0;
    facts.sticks.pitch = 0.5;
    facts.sticks.yaw = -1.0;
    view.look(Arc::new(facts));
    view.messages = vec!["warning: first".into(), "warning: last".into()];
    view
}

fn lines(view: &View, columns: u16, rows: u16) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(columns, rows)).unwrap();
    terminal.draw(|frame| draw(frame, view)).unwrap();
    let cells = &terminal.backend().buffer().content;
    let text =
        |row: &[ratatui::buffer::Cell]| row.iter().map(ratatui::buffer::Cell::symbol).collect();
    cells.chunks(usize::from(columns)).map(text).collect()
}

#[test]
fn what_a_pilot_has_to_see_is_in_a_small_picture_and_in_a_large_one() {
    for (columns, rows) in [(80, 24), (120, 40), (200, 60)] {
        let lines = lines(&view(true), columns, rows);
        let all = lines.join("\n");
        assert!(lines[0].starts_with(" FLYING  controller  12.3 s  3 of 5 targets"), "{all}");
        assert!(lines[1].contains("mocap stale, battery low"), "{all}");
        for part in [
            "61 %, flies",
            "+1.00  +0.50  +1.20   +90",
            "acts, score -3.1",
            "no pose yet",
            "worst   4.00",
            "late 4 ms",
            "warning: last",
            "Backspace EMERGENCY STOP",
            "J/L turn",
        ] {
            assert!(all.contains(part), "{columns}x{rows} has no `{part}`:\n{all}");
        }
        let gauge = |name: &str| lines.iter().find(|line| line.contains(name)).unwrap().clone();
        let filled = |line: String| {
            let (left, right) = line.rsplit_once('|').unwrap();
            [left, right].map(|side| side.matches('\u{2588}').count())
        };
        assert_eq!(filled(gauge(" pitch")), [0, 5], "{all}");
        assert_eq!(filled(gauge(" yaw")), [10, 0], "{all}");
        // It looks along y, above the reference path, and the target is on the right of it.
        let row = |mark: char| lines.iter().position(|line| line.contains(mark)).unwrap();
        assert!(row('\u{2191}') > 2, "{all}");
        assert_eq!(all.contains("from the side"), rows >= 40, "{all}");
    }
}

#[test]
fn a_terminal_of_any_size_is_drawn() {
    for (columns, rows) in [(1, 1), (20, 5), (3, 40), (200, 2), (38, 24), (39, 24)] {
        lines(&view(true), columns, rows);
        lines(&View::new(view(true).briefing, Palette::new(true)), columns, rows);
    }
    assert!(lines(&view(true), 20, 5)[0].starts_with(" FLYING "));
}

#[test]
fn without_colours_no_cell_is_coloured() {
    let colours = |has_colours| {
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        terminal.draw(|frame| draw(frame, &view(has_colours))).unwrap();
        let cells = terminal.backend().buffer().content.clone();
        let is_coloured =
            |cell: &&ratatui::buffer::Cell| [cell.fg, cell.bg] != [ratatui::style::Color::Reset; 2];
        cells.iter().filter(is_coloured).count()
    };
    assert!(colours(true) > 100, "{} cells", colours(true));
    assert_eq!(colours(false), 0);
}

#[test]
fn the_last_picture_does_not_look_like_a_flight_that_goes_on() {
    let mut view = view(true);
    view.is_over = true;
    let second = lines(&view, 80, 24).swap_remove(1);
    assert!(second.starts_with(" the control loop has ended"), "{second}");
    view.facts =
        Arc::new(Telemetry { phase: Some(Phase::Landed), ..Telemetry::clone(&view.facts) });
    let second = lines(&view, 80, 24).swap_remove(1);
    assert!(second.starts_with(" landed: the flight is over"), "{second}");
}

#[test]
fn old_facts_are_called_old_after_a_second() {
    let mut view = view(true);
    let facts = Arc::clone(&view.facts);
    for _ in 1..OLD_AFTER {
        view.look(Arc::clone(&facts));
    }
    assert!(!view.is_old());
    view.look(Arc::clone(&facts));
    assert!(lines(&view, 80, 24)[1].contains("NO NEWS"), "{:?}", lines(&view, 80, 24));
    view.look(Arc::new(Telemetry { step: facts.step + 1, ..Telemetry::clone(&facts) }));
    assert!(!view.is_old());
    for _ in 0..2 * HISTORY {
        view.look(Arc::clone(&facts));
    }
    assert_eq!((view.late_us.len(), view.solve_us.len()), (HISTORY, HISTORY));
}
