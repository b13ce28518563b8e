//! Long series thinned to what pixels can show, so that a figure of an hour stays a small file.
//!
//! Owns which points are left out. Outliers never are.

use std::collections::BTreeSet;

use super::drawing::Point;

/// Side of the squares of which each keeps one dot. px
const CELL_PX: f64 = 2.0;

/// `points` with no more than four in a row within one column of pixels: the first, the highest, the
/// lowest and the last.
///
/// A line through them covers the same pixels as a line through all.
pub(super) fn line(points: &[Point]) -> Vec<Point> {
    let mut thinned = Vec::new();
    for column in points.chunk_by(|(a, _), (b, _)| (a.floor() - b.floor()).abs() < 0.5) {
        let by_y = |&a: &usize, &b: &usize| column[a].1.total_cmp(&column[b].1);
        let places = 0..column.len();
        let ends = [0, column.len() - 1].into_iter();
        let mut kept: Vec<_> =
            ends.chain(places.clone().min_by(by_y)).chain(places.max_by(by_y)).collect();
        kept.sort_unstable();
        kept.dedup();
        thinned.extend(kept.into_iter().map(|place| column[place]));
    }
    thinned
}

/// The first of `points` in each square of two pixels: the others would be painted over it.
pub(super) fn dots(points: impl Iterator<Item = Point>) -> Vec<Point> {
    let mut taken = BTreeSet::new();
    #[expect(
        clippy::cast_possible_truncation,
        reason = "cells of a figure of some thousand pixels"
    )]
    let cell = |(x, y): &Point| ((x / CELL_PX).floor() as i64, (y / CELL_PX).floor() as i64);
    points.filter(|point| taken.insert(cell(point))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 27,000 samples on 711 pixels, two of them far off.
    fn flight() -> (Vec<Point>, [Point; 2]) {
        let mut points: Vec<_> = (0..27_000).map(|k| (f64::from(k) / 38.0, 50.5)).collect();
        points[13_777].1 = 7.0;
        points[20_001].1 = 93.0;
        let outliers = [points[13_777], points[20_001]];
        (points, outliers)
    }

    #[test]
    fn outliers_survive_thinning() {
        let (points, outliers) = flight();
        let kept_line = line(&points);
        let kept_dots = dots(points.iter().copied());
        for outlier in outliers {
            assert!(kept_line.contains(&outlier), "{outlier:?} is not on the line");
            assert!(kept_dots.contains(&outlier), "{outlier:?} has no dot");
        }
        assert!(kept_line.len() <= 4 * 711, "{} points for 711 columns", kept_line.len());
        assert!(kept_dots.len() <= 358, "{} dots for 356 squares", kept_dots.len());
    }

    #[test]
    fn a_thinned_line_keeps_order_and_ends() {
        let (points, _) = flight();
        let kept = line(&points);
        assert_eq!((kept.first(), kept.last()), (points.first(), points.last()));
        assert!(kept.is_sorted_by(|(a, _), (b, _)| a <= b));
    }

    #[test]
    fn few_points_stay_as_they_are() {
        let points = [(0.1, 3.0), (0.2, 1.0), (0.9, 9.0), (1.5, 2.0)];
        assert_eq!(line(&points), points);
        assert_eq!(line(&[]), []);
    }
}
