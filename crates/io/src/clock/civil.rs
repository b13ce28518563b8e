//! Calendar date and time of day, for file names and for the drone's own log.
//!
//! Pure arithmetic on Unix time; UTC only, leap seconds are not counted.

use std::fmt;

use super::NS_PER_S;

const MS_PER_DAY: i64 = 86_400_000;

/// Hours to milliseconds of a day.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TimeOfDay {
    /// 0..=23
    pub hour: u8,
    /// 0..=59
    pub minute: u8,
    /// 0..=59
    pub second: u8,
    /// 0..=999
    pub millisecond: u16,
}

/// A date of the Gregorian calendar and a time of day. UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CivilTime {
    /// Year of the common era.
    pub year: u16,
    /// 1..=12
    pub month: u8,
    /// 1..=31
    pub day: u8,
    /// Time of that day.
    pub time: TimeOfDay,
}

impl CivilTime {
    /// The date and time `unix_ns` after 1970-01-01, UTC.
    pub fn from_unix_ns(unix_ns: i64) -> Self {
        let unix_ms = unix_ns.div_euclid(NS_PER_S / 1000);
        let (year, month, day) = date_of(unix_ms.div_euclid(MS_PER_DAY));
        let ms = unix_ms.rem_euclid(MS_PER_DAY);
        let time = TimeOfDay {
            hour: small(ms / 3_600_000),
            minute: small(ms / 60_000 % 60),
            second: small(ms / 1000 % 60),
            millisecond: small(ms % 1000),
        };
        Self { year: small(year), month: small(month), day: small(day), time }
    }
}

impl CivilTime {
    /// As people read it: `2026-11-21 08:22:46 UTC`.
    pub fn date_and_time(&self) -> String {
        let Self { year, month, day, time: TimeOfDay { hour, minute, second, .. } } = self;
        format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
    }
}

/// As in a file name: `2026-11-21_08-22-46`.
impl fmt::Display for CivilTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { year, month, day, time: TimeOfDay { hour, minute, second, .. } } = self;
        write!(f, "{year:04}-{month:02}-{day:02}_{hour:02}-{minute:02}-{second:02}")
    }
}

/// Year, month and day of a day counted from 1970-01-01.
///
/// Counted from 0000-03-01, a leap day is the last of its year and an era of 400 years always has
/// 146097 days; month lengths from March on repeat as 153 days in five months.
fn date_of(unix_day: i64) -> (i64, i64, i64) {
    let day = unix_day + 719_468;
    let (era, day_of_era) = (day.div_euclid(146_097), day.rem_euclid(146_097));
    let leap_days = day_of_era / 1460 - day_of_era / 36_524 + day_of_era / 146_096;
    let year_of_era = (day_of_era - leap_days) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    (year, month, day_of_month)
}

/// A part of a date in the range of its field; i64 nanoseconds reach from 1677 to 2262.
fn small<T: TryFrom<i64> + Default>(part: i64) -> T {
    T::try_from(part).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds from `date -u -d TEXT +%s`.
    const KNOWN: [(i64, &str); 7] = [
        (0, "1970-01-01_00-00-00"),
        (951_782_400, "2000-02-29_00-00-00"),
        (951_868_799, "2000-02-29_23-59-59"),
        (1_709_164_800, "2024-02-29_00-00-00"),
        (1_795_249_366, "2026-11-21_08-22-46"),
        (4_107_542_400, "2100-03-01_00-00-00"),
        (-1, "1969-12-31_23-59-59"),
    ];

    #[test]
    fn known_moments_have_their_dates() {
        for (unix_s, expected) in KNOWN {
            assert_eq!(CivilTime::from_unix_ns(unix_s * NS_PER_S).to_string(), expected);
        }
    }

    #[test]
    fn people_read_date_and_time() {
        let time = CivilTime::from_unix_ns(1_795_249_366 * NS_PER_S);
        assert_eq!(time.date_and_time(), "2026-11-21 08:22:46 UTC");
    }

    #[test]
    fn milliseconds_are_cut_not_rounded() {
        let time = CivilTime::from_unix_ns(1_795_249_366_999_999_999).time;
        assert_eq!(time, TimeOfDay { hour: 8, minute: 22, second: 46, millisecond: 999 });
    }

    #[test]
    fn days_follow_each_other_over_an_era() {
        let (mut year, mut month, mut day) = date_of(0);
        for unix_day in 1..146_097 {
            let next = date_of(unix_day);
            let follows = next == (year, month, day + 1)
                || next == (year, month + 1, 1)
                || (month == 12 && next == (year + 1, 1, 1));
            assert!(follows, "{next:?} after {:?}", (year, month, day));
            (year, month, day) = next;
        }
        assert_eq!((year, month, day), (2369, 12, 31));
    }

    #[test]
    fn the_ends_of_the_number_range_are_dates() {
        assert_eq!(CivilTime::from_unix_ns(i64::MIN).year, 1677);
        assert_eq!(CivilTime::from_unix_ns(i64::MAX).year, 2262);
    }
}
