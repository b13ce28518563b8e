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
fn a_progress_without_a_bar_stays_hidden() {
    let interrupt = Interrupt::default();
    let shown = Shown::new(false, &interrupt);
    shown.begin("bootstrap", Some(3));
    shown.advance();
    assert_eq!((bar(&shown).length(), bar(&shown).message().as_str()), (None, ""));
    assert!(bar(&shown).is_hidden());
}

#[test]
fn seeds_are_counted_in_words_where_no_terminal_is() {
    let hidden = Seeds::of(7, false).unwrap();
    assert!(hidden.bar.length().is_none() && hidden.line_at.is_none());
    // In tests the standard error may be a terminal or not.
    let seeds = Seeds::of(7, true).unwrap();
    assert_eq!(seeds.line_at.is_some(), seeds.bar.is_hidden());
    (0..3).for_each(|_| seeds.advance());
    assert!(seeds.line().starts_with("3 of 7 seeds, about "), "{}", seeds.line());
}
