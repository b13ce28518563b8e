//! Timed poses as CSV text. Reading the file is the caller's.

#![deny(clippy::indexing_slicing)]

use thiserror::Error;

use super::table::TIMED_COUNT;

/// First line of the text.
const HEADER: &str = "t,x,y,z,theta";

/// A text that is no table of timed poses. Lines count from 1.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CsvError {
    /// The first line is another one.
    #[error("line 1 is `{found}` instead of `{HEADER}`")]
    Header {
        /// The line.
        found: String,
    },
    /// A line has another number of fields.
    #[error("line {line} has {found} fields instead of {TIMED_COUNT}")]
    Fields {
        /// Number of the line.
        line: usize,
        /// Number of fields.
        found: usize,
    },
    /// A field is no number.
    #[error("line {line}: `{text}` is no finite number")]
    Number {
        /// Number of the line.
        line: usize,
        /// The field.
        text: String,
    },
}

/// Rows t, x, y, z, theta of `text`, in s, m and rad. Empty lines and blanks around fields are skipped.
///
/// # Errors
/// Another header, a line with another number of fields, a field that is no finite number.
pub fn parse_csv(text: &str) -> Result<Vec<[f64; TIMED_COUNT]>, CsvError> {
    let mut lines = text.lines().enumerate();
    let found = lines.next().map_or("", |(_, line)| line.trim());
    if found != HEADER {
        return Err(CsvError::Header { found: found.to_owned() });
    }
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, line)| parse_line(index + 1, line))
        .collect()
}

fn parse_line(line: usize, text: &str) -> Result<[f64; TIMED_COUNT], CsvError> {
    let numbers: Result<Vec<f64>, CsvError> = text
        .split(',')
        .map(|field| match field.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(CsvError::Number { line, text: field.trim().to_owned() }),
        })
        .collect();
    let numbers = numbers?;
    let found = numbers.len();
    <[f64; TIMED_COUNT]>::try_from(numbers).or(Err(CsvError::Fields { line, found }))
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
    fn each_defect_is_named_with_its_line() {
        assert_eq!(refusal(""), "line 1 is `` instead of `t,x,y,z,theta`");
        assert_eq!(refusal("t,x,y,theta\n"), "line 1 is `t,x,y,theta` instead of `t,x,y,z,theta`");
        let after = |line: &str| refusal(&format!("{HEADER}\n0,0,0,0,0\n\n{line}"));
        assert_eq!(after("1,2,3,4"), "line 4 has 4 fields instead of 5");
        assert_eq!(after("1,2,3,4,5,6"), "line 4 has 6 fields instead of 5");
        assert_eq!(after("1,2,up,4,5"), "line 4: `up` is no finite number");
        assert_eq!(after("1,2,NaN,4,5"), "line 4: `NaN` is no finite number");
        assert_eq!(after("1,2,,4,5"), "line 4: `` is no finite number");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_and_what_is_cut_off_never_panics(
            rows in prop::collection::vec(prop::array::uniform5(-1e6..1e6), 0..20)
        ) {
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
