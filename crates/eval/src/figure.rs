//! Figures of identification and evaluation, from plain slices to SVG and PNG.
//!
//! Owns how a figure looks: sizes, colours, axes, and one function per figure that returns a
//! [`Figure`]. It computes nothing that a report would quote except histograms, densities and the
//! autocorrelation, and refuses types of the estimator: rows come with [`horizon_model::Row`], values
//! as slices, absent values as NaN. Values that cannot be drawn (NaN, infinite) leave gaps; a panel
//! without any value shows "no data". Equal data give equal bytes.
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

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use horizon_model::Row;
use tello_io::atomic_file;

pub use drawing::Figure;
pub use raster::PngError;
pub use tracks::{SeenFlights, tracks_among};

pub(crate) use bootstrap::{BootstrapRow, bootstrap};
pub(crate) use delay::{DelayCurve, ShiftRow, delay_profile, delay_shift};
pub(crate) use fit::{FitRow, fit};
pub(crate) use forecast::{ForecastLine, ForecastPanel, forecast};
pub(crate) use over_time::{TimeBars, TimeLine, TimePanel, TimeSpans, over_time};
pub(crate) use overlay::Overlay;
pub(crate) use progress::{AlongPath, band_over_progress, density_over_progress};
pub(crate) use residual::{ResidualRow, autocorrelation, residuals};
pub(crate) use space::{SeenInSpace, space};
pub(crate) use tracks::tracks;

/// Where a figure goes: a folder that exists, and a name without its ending.
#[derive(Debug, Clone)]
pub struct FigureFiles {
    dir: PathBuf,
    stem: String,
}

impl FigureFiles {
    /// The place of `name.svg` and `name.png`, whose folder is created if it is missing. An ending of `name` is
    /// dropped.
    ///
    /// # Errors
    /// `name` has no file name, or its folder cannot be written; a file is there and `is_replaced` is false.
    pub fn of(name: &Path, is_replaced: bool) -> Result<Self> {
        let stem = name.file_stem().with_context(|| format!("{} is no name", name.display()))?;
        let stem = stem.to_string_lossy().into_owned();
        let dir = name.parent().unwrap_or(Path::new(""));
        let place = Self::inside(dir, stem)?;
        place.paths().iter().try_for_each(|path| atomic_file::prepare(path, is_replaced))?;
        Ok(place)
    }

    fn inside(dir: &Path, stem: String) -> Result<Self> {
        fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
        Ok(Self { dir: dir.to_owned(), stem })
    }

    /// The name without folder and ending, for a title.
    pub fn stem(&self) -> &str {
        &self.stem
    }

    fn paths(&self) -> [PathBuf; 2] {
        ["svg", "png"].map(|kind| self.dir.join(format!("{}.{kind}", self.stem)))
    }

    /// Writes `figure` as SVG and PNG in place of those that are there, and returns their paths.
    ///
    /// # Errors
    /// An error of the file system, with the path; a figure that cannot be painted.
    pub fn save(&self, figure: &Figure) -> Result<[PathBuf; 2]> {
        let paths = self.paths();
        let png = figure.png().with_context(|| paths[1].display().to_string())?;
        for (path, content) in paths.iter().zip([figure.svg().into_bytes(), png]) {
            atomic_file::write_contents(path, true, content)?;
        }
        Ok(paths)
    }
}

/// Writes `figure` to `dir`, which is created if it is missing, as [`FigureFiles::save`].
///
/// # Errors
/// The folder cannot be made; those of [`FigureFiles::save`].
pub fn save(dir: &Path, name: &str, figure: &Figure) -> Result<[PathBuf; 2]> {
    FigureFiles::inside(dir, name.to_owned())?.save(figure)
}

/// Name and unit of a row as an axis shows them; a ratio has no unit.
fn label(row: &Row) -> String {
    quantity(row.name, row.unit)
}

/// `name [unit]`, or the name alone for a ratio.
fn quantity(name: &str, unit: &str) -> String {
    if unit == "1" { name.to_owned() } else { format!("{name} [{unit}]") }
}
