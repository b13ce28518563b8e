//! Output of `tello-ctl report`: its JSON, and the numbers of its page.

use std::path::Path;

use serde_json::Value;

use crate::program::{tello_ctl, text};

/// Output of `report --json` with `arguments`, run in `folder`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn report(folder: &Path, arguments: &[&str]) -> Value {
    let output = tello_ctl(folder, &[&["report", "--json"], arguments].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The numbers of a page that say where they stand in the JSON, as (pointer, text).
pub(crate) fn numbers(html: &str) -> Vec<(&str, &str)> {
    let cells = html.split("data-json=\"").skip(1);
    let number = |cell: &'_ str| -> Option<(usize, usize, usize)> {
        let (pointer, rest) = cell.split_once("\">")?;
        let (number, _) = rest.split_once('<')?;
        Some((pointer.len(), pointer.len() + 2, number.len()))
    };
    cells
        .filter_map(|cell| {
            let (end, begin, length) = number(cell)?;
            Some((&cell[..end], &cell[begin..begin + length]))
        })
        .collect()
}

/// Compares every number of the page with the JSON, and says how many there were.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn assert_equal(html: &str, json: &Value) -> usize {
    let numbers = numbers(html);
    for (pointer, shown) in &numbers {
        let value = json.pointer(pointer).and_then(Value::as_f64);
        let digits = shown.split_once('.').map_or(0, |(_, digits)| digits.len());
        let expected = format!("{:.digits$}", value.unwrap());
        assert_eq!(*shown, expected, "{pointer}");
    }
    numbers.len()
}
