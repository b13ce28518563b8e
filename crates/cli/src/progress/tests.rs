use super::*;

fn bar(shown: &Shown<'_>) -> ProgressBar {
    shown.bar.lock().clone()
}

#[test]
fn a_part_with_a_count_has_a_bar_of_it() {
    let interrupt = Interrupt::default();
    let shown = Shown::new(true, &interrupt);
    shown.begin("bootstrap", Some(3));
    shown.advance();
    shown.advance();
    let first = bar(&shown);
    assert_eq!(
        (first.length(), first.position(), first.message().as_str()),
        (Some(3), 2, "bootstrap")
    );
    // The next part has its own, without an end.
    shown.end();
    assert!(first.is_finished());
    shown.begin("fit", None);
    shown.advance();
    assert_eq!((bar(&shown).length(), bar(&shown).position()), (None, 1));
    assert!(!shown.is_stopped());
}

#[test]
fn without_a_bar_nothing_begins() {
    let interrupt = Interrupt::default();
    let shown = Shown::new(false, &interrupt);
    shown.begin("bootstrap", Some(3));
    shown.advance();
    assert_eq!((bar(&shown).length(), bar(&shown).message().as_str()), (None, ""));
    assert!(bar(&shown).is_hidden());
}

#[test]
fn a_bar_of_seeds_is_as_long_as_they_are_or_hidden() {
    assert_eq!(of_seeds(7, true).unwrap().length(), Some(7));
    assert_eq!(of_seeds(7, false).unwrap().length(), None);
}
