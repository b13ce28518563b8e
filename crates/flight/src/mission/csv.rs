//! Timed poses as CSV text. Reading the file is the caller's.

#![deny(clippy::indexing_slicing)]

use std::fmt::{self, Display, Formatter};

use thiserror::Error;

use super::table::TIMED_COUNT;

/// First line of the text.
const HEADER: &str = "t,x,y,z,theta";

/// All mistakes of a text that is no table of timed poses, in its order; at least one.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub struct CsvErrors(pub Vec<CsvError>);

impl Display for CsvErrors {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let texts: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&texts.join("; "))
    }
}

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}, column {column}: {text}")]
pub struct CsvError {
    /// Line in the file, from 1.
    pub line: usize,
    /// Column in the line, in characters, from 1.
    pub column: usize,
    /// Value and rule.
    pub text: String,
}

/// Rows t, x, y, z, theta of `text`, in s, m and rad, with rising times. Empty lines and blanks around fields are
/// skipped.
///
/// # Errors
/// Another header, lines with another number of fields, fields that are no finite number, times that do not rise: all
/// of them.
pub fn parse_csv(text: &str) -> Result<Vec<[f64; TIMED_COUNT]>, CsvErrors> {
    let mut lines = text.lines().zip(1..);
    let found = lines.next().map_or("", |(header, _)| header.trim());
    if found != HEADER {
        let text = format!("`{found}` instead of `{HEADER}`");
        return Err(CsvErrors(vec![CsvError { line: 1, column: 1, text }]));
    }
    let (mut rows, mut errors) = (Vec::new(), Vec::new());
    let mut before_s = f64::NEG_INFINITY;
    for (text, line) in lines.filter(|(text, _)| !text.trim().is_empty()) {
        let before = errors.len();
        let fields = numbers(text, line, &mut errors);
        if let Some((column, t_s)) = fields.first().filter(|(_, t_s)| *t_s <= before_s) {
            let text = format!("t = {t_s}: expected above the time before, {before_s}");
            errors.push(CsvError { line, column: *column, text });
        }
        before_s = fields.first().map_or(before_s, |(_, t_s)| t_s.max(before_s));
        let values: Vec<f64> = fields.into_iter().map(|(_, value)| value).collect();
        if let (true, Ok(row)) = (errors.len() == before, <[f64; TIMED_COUNT]>::try_from(values)) {
            rows.push(row);
        }
    }
    if errors.is_empty() { Ok(rows) } else { Err(CsvErrors(errors)) }
}

/// The numbers of a line with their columns. A field that is not a number is NaN and an error in `errors`; a count
/// other than [`TIMED_COUNT`] is an error, too.
fn numbers(text: &str, line: usize, errors: &mut Vec<CsvError>) -> Vec<(usize, f64)> {
    let (mut numbers, mut next) = (Vec::new(), 1);
    for field in text.split(',') {
        let blanks = field.len() - field.trim_start().len();
        let column = next + blanks;
        next += field.chars().count() + 1;
        match field.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => numbers.push((column, number)),
            _ => {
                numbers.push((column, f64::NAN));
                let text = format!("`{}` is no finite number", field.trim());
                errors.push(CsvError { line, column, text });
            }
        }
    }
    if numbers.len() != TIMED_COUNT {
        let text = format!("{} fields instead of {TIMED_COUNT}", numbers.len());
        errors.push(CsvError { line, column: 1, text });
    }
    numbers
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn refusal(text: &str) -> String {
        parse_csv(text).unwrap_err().to_string()
    }

    #[test]
    fn rows_are_read_in_order_and_empty_lines_skipped() {
        let rows = parse_csv("t,x,y,z,theta\r\n0,1,2,3,4\r\n\r\n 0.5 ,-1,2e-1,3,4\n").unwrap();
        assert_eq!(rows, [[0.0, 1.0, 2.0, 3.0, 4.0], [0.5, -1.0, 0.2, 3.0, 4.0]]);
        assert_eq!(parse_csv(HEADER).unwrap(), Vec::<[f64; TIMED_COUNT]>::new());
    }

    #[test]
    fn each_defect_is_named_with_its_line_and_column() {
        assert_eq!(refusal(""), "line 1, column 1: `` instead of `t,x,y,z,theta`");
        assert_eq!(
            refusal("t,x,y,theta\n"),
            "line 1, column 1: `t,x,y,theta` instead of `t,x,y,z,theta`"
        );
        let after = |line: &str| refusal(&format!("{HEADER}\n0,0,0,0,0\n\n{line}"));
        assert_eq!(after("1,2,3,4"), "line 4, column 1: 4 fields instead of 5");
        assert_eq!(after("1,2,3,4,5,6"), "line 4, column 1: 6 fields instead of 5");
        assert_eq!(after("1,2, up,4,5"), "line 4, column 6: `up` is no finite number");
        assert_eq!(after("1,2,NaN,4,5"), "line 4, column 5: `NaN` is no finite number");
        assert_eq!(after("1,2,,4,5"), "line 4, column 5: `` is no finite number");
        assert_eq!(after("up,-1,3,4,5"), "line 4, column 1: `up` is no finite number");
        let time = "line 4, column 1: t = 0: expected above the time before, 0";
        assert_eq!(after("0,2,3,4,5"), time);
        let all =
            "line 5, column 3: `a` is no finite number; line 5, column 7: `b` is no finite number";
        assert_eq!(after("0,2,3,4,5\n1,a,3,b,5\n2,2,3,4,5"), format!("{time}; {all}"));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_and_what_is_cut_off_never_panics(
            mut rows in prop::collection::vec(prop::array::uniform5(-1e6..1e6), 0..20)
        ) {
            rows.sort_by(|a: &[f64; TIMED_COUNT], b| a[0].total_cmp(&b[0]));
            rows.dedup_by_key(|row| row[0]);
            let lines = rows.iter().map(|[t, x, y, z, theta]| format!("{t},{x},{y},{z},{theta}"));
            let text = [HEADER.to_owned()].into_iter().chain(lines).collect::<Vec<_>>().join("\n");
            prop_assert_eq!(&parse_csv(&text).unwrap(), &rows);
            for end in 0..text.len() {
                let read = parse_csv(&text[..end]);
                prop_assert!(read.map_or(0, |read| read.len()) <= rows.len());
            }
        }

        #[test]
        fn garbage_is_refused_without_a_panic(garbage in "\\PC{0,40}") {
            prop_assert!(parse_csv(&garbage).is_err());
            let below_header = [HEADER, &garbage].join("\n");
            prop_assert!(parse_csv(&below_header).map_or(0, |read| read.len()) <= 1);
        }
    }
}
