use std::sync::mpsc;

use super::*;
use crate::clock::TimeNs;
use crate::log::Ending;
use crate::log::tests::{COUNT, Count, Memory, counts, reader};

const POOL: usize = 4;
/// Longer than any test: no flush on its own.
const NO_FLUSH: Duration = Duration::from_hours(1);

fn pool() -> Vec<Count> {
    vec![Count { step: 0 }; POOL]
}

fn write(log: Option<&mut LogWriter>, record: &Count) -> Result<(), LogError> {
    log.map_or(Ok(()), |log| log.write(COUNT, TimeNs(0), record))
}

fn record(recorder: &mut Recorder<Count>, step: u64) -> bool {
    let Some(mut record) = recorder.borrow() else { return false };
    record.step = step;
    recorder.submit(record);
    true
}

/// Waits for what another thread is about to do; fails after 10 s.
fn eventually(what: &str, mut is_true: impl FnMut() -> bool) {
    for _ in 0..10_000 {
        if is_true() {
            return;
        }
        thread::sleep(Duration::from_millis(1));
    }
    panic!("not within 10 s: {what}");
}

#[test]
fn everything_submitted_is_written_in_order() {
    let memory = Memory::endless();
    let mut recorder = Recorder::start(memory.writer().unwrap(), pool(), NO_FLUSH, write).unwrap();
    for step in 0..200 {
        eventually("a record comes back", || record(&mut recorder, step));
    }
    assert_eq!(recorder.stop(|_| false).unwrap().messages, 200);
    // Each try without a record that was free is a gap.
    let (steps, _) = counts(reader(memory.bytes()).unwrap());
    assert_eq!(steps, (0..200).collect::<Vec<_>>());
}

#[test]
fn a_stuck_disk_blocks_nobody_and_the_loss_is_counted() {
    let memory = Memory::endless();
    let (release, stuck) = mpsc::channel::<()>();
    let write_stuck = move |log: Option<&mut LogWriter>, record: &Count| {
        // Returns when the test lets go of its end.
        stuck.recv().unwrap_err();
        write(log, record)
    };
    let mut recorder =
        Recorder::start(memory.writer().unwrap(), pool(), NO_FLUSH, write_stuck).unwrap();
    let taken = (0..50).filter(|step| record(&mut recorder, *step)).count();
    assert_eq!((taken, recorder.dropped()), (POOL, 50 - POOL as u64));
    drop(release);
    assert_eq!(recorder.stop(|_| false).unwrap().messages, POOL as u64);
    let (steps, ending) = counts(reader(memory.bytes()).unwrap());
    assert_eq!((steps, ending), (vec![0, 1, 2, 3], Ending::Gaps { records: 46 }));
}

#[test]
fn a_disk_that_hangs_is_given_up() {
    let memory = Memory::endless();
    let (_hold, hung) = mpsc::channel::<()>();
    let write_hung = move |_: Option<&mut LogWriter>, _: &Count| {
        hung.recv().ok();
        Ok(())
    };
    let mut recorder =
        Recorder::start(memory.writer().unwrap(), pool(), NO_FLUSH, write_hung).unwrap();
    assert!(record(&mut recorder, 0));
    let stopped = recorder.stop(|waited| waited >= 2 * POLL);
    assert!(matches!(stopped, Err(LogError::Unfinished)), "{stopped:?}");
}

#[test]
fn the_first_error_ends_the_log_alone_and_is_handed_back() {
    // Room for the head and hardly more.
    let memory = Memory::of_size(1500);
    let (see, seen) = mpsc::channel();
    let write_seen = move |log: Option<&mut LogWriter>, record: &Count| {
        see.send((record.step, log.is_some())).unwrap();
        write(log, record)
    };
    let mut recorder =
        Recorder::start(memory.writer().unwrap(), pool(), Duration::ZERO, write_seen).unwrap();
    let mut taken = 0;
    eventually("the disk is full, and 20 records more", || {
        taken += u64::from(record(&mut recorder, taken));
        seen.try_iter().filter(|(_, is_written)| !is_written).count() > 0 && {
            for _ in 0..20 {
                eventually("a record comes back", || record(&mut recorder, taken));
                taken += 1;
            }
            true
        }
    });
    eventually("each of them is seen", || seen.try_iter().any(|(step, _)| step + 1 == taken));
    assert!(recorder.dropped() >= 20, "{}", recorder.dropped());
    let message = recorder.stop(|_| false).unwrap_err().to_string();
    assert_eq!(message, "cannot write to test.mcap: no storage space");
}

#[test]
fn the_log_is_flushed_while_it_is_recorded() {
    let memory = Memory::endless();
    let mut recorder = Recorder::start(memory.writer().unwrap(), pool(), 2 * POLL, write).unwrap();
    assert!(record(&mut recorder, 5));
    eventually("the record is in the file", || {
        let (steps, ending) = counts(reader(memory.bytes()).unwrap());
        !ending.is_complete() && steps == [5]
    });
    recorder.stop(|_| false).unwrap();
}

#[test]
fn a_dropped_recorder_leaves_a_complete_log() {
    let memory = Memory::endless();
    let mut recorder = Recorder::start(memory.writer().unwrap(), pool(), NO_FLUSH, write).unwrap();
    assert!(record(&mut recorder, 8));
    drop(recorder);
    eventually("the log is closed", || {
        counts(reader(memory.bytes()).unwrap()) == (vec![8], Ending::Complete)
    });
}

#[test]
fn a_panic_of_the_thread_is_an_error() {
    let memory = Memory::endless();
    let write_panic = |_: Option<&mut LogWriter>, _: &Count| panic!("as the test wants it");
    let mut recorder =
        Recorder::start(memory.writer().unwrap(), pool(), NO_FLUSH, write_panic).unwrap();
    assert!(record(&mut recorder, 0));
    assert!(matches!(recorder.stop(|_| false), Err(LogError::ThreadPanicked)));
}
