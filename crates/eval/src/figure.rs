//! Figures of identification and evaluation, from plain slices to SVG and PNG.
//!
//! Owns how a figure looks: sizes, colours, axes, and one function per figure that returns a
//! [`Figure`]. It computes nothing that a report would quote except histograms, densities and the
//! autocorrelation, and refuses types of the estimator: rows come with [`horizon_model::Row`], values
//! as slices, absent values as NaN. Values that cannot be drawn (NaN, infinite) leave gaps; a panel
//! without any value says "no data". Equal data give equal bytes.
//!
//! The drawing is ours and small: `docs/decisions/0011-figures.md` has the comparison with the
//! plotting libraries.

mod axis;
mod bootstrap;
mod delay;
mod drawing;
mod fit;
mod font;
mod forecast;
mod growth;
mod legend;
mod over_time;
mod overlay;
mod panel;
mod progress;
mod raster;
mod residual;
mod space;
#[cfg(test)]
mod tests;
mod thin;
mod tracks;

use std::path::{Path, PathBuf};
use std::{fs, io};

pub use bootstrap::{BootstrapRow, bootstrap};
pub use delay::{DelayCurve, ShiftRow, delay_profile, delay_shift};
pub use drawing::Figure;
pub use fit::{FitRow, fit};
pub use forecast::{ForecastLine, ForecastPanel, forecast};
pub use growth::{GrowthCurve, growth};
pub use over_time::{TimeBars, TimeLine, TimePanel, TimeSpans, over_time};
pub use overlay::Overlay;
pub use progress::{AlongPath, band_over_progress, density_over_progress};
pub use raster::PngError;
pub use residual::{ResidualRow, autocorrelation, residuals};
pub use space::{SeenInSpace, space};
pub use tracks::{SeenFlights, tracks, tracks_among};

use horizon_model::Row;
use tello_io::whole_file;

/// Writes `figure` as `name.svg` and `name.png` to `dir`, which is created if it is missing.
///
/// Returns the paths of both files. Existing files are replaced.
///
/// # Errors
///
/// What the file system refuses, with the path in the message; a figure that cannot be painted.
pub fn save(dir: &Path, name: &str, figure: &Figure) -> io::Result<[PathBuf; 2]> {
    let at = |path: &Path, error: io::Error| {
        io::Error::new(error.kind(), format!("{}: {error}", path.display()))
    };
    fs::create_dir_all(dir).map_err(|error| at(dir, error))?;
    let paths = ["svg", "png"].map(|kind| dir.join(format!("{name}.{kind}")));
    let png = figure.png().map_err(|error| at(&paths[1], io::Error::other(error)))?;
    let contents = [figure.svg().into_bytes(), png];
    for (path, content) in paths.iter().zip(contents) {
        whole_file::write(path, true, |part| Ok(fs::write(part, content)?))
            .map_err(|error| io::Error::other(format!("{error:#}")))?;
    }
    Ok(paths)
}

/// Name and unit of a row as an axis shows them; a ratio has no unit.
fn label(row: &Row) -> String {
    quantity(row.name, row.unit)
}

/// `name [unit]`, or the name alone for a ratio.
fn quantity(name: &str, unit: &str) -> String {
    if unit == "1" { name.to_owned() } else { format!("{name} [{unit}]") }
}
