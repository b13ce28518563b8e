//! `NumPy` arrays in and out, with checked shapes.

use nalgebra::SVector;
use numpy::{Element, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::TelloError;

/// The numbers of a vector argument of `count` rows, all finite.
///
/// # Errors
/// Another length, or a number that is not finite; the message begins with `name`.
pub(crate) fn vector(
    name: &str,
    values: &PyReadonlyArray1<'_, f64>,
    count: usize,
) -> PyResult<Vec<f64>> {
    checked(name, values.as_array().to_vec(), count)
}

/// These numbers, checked as by [`vector`].
///
/// # Errors
/// As [`vector`].
pub(crate) fn checked(name: &str, values: Vec<f64>, count: usize) -> PyResult<Vec<f64>> {
    if values.len() != count {
        let message = format!("{name}: expected {count} values, given {}", values.len());
        return Err(TelloError::new_err(message));
    }
    finite(name, &values)?;
    Ok(values)
}

/// The numbers of an observation argument of `count` rows, of which a NaN is one that is absent.
///
/// # Errors
/// As [`vector`].
pub(crate) fn observation(
    name: &str,
    values: &PyReadonlyArray1<'_, f64>,
    count: usize,
) -> PyResult<Vec<f64>> {
    let values = values.as_array().to_vec();
    checked(name, present(&values), count)?;
    Ok(values)
}

/// The rows of a matrix argument of observations, of which a NaN is one that is absent.
///
/// # Errors
/// As [`matrix`].
pub(crate) fn observations(
    name: &str,
    values: &PyReadonlyArray2<'_, f64>,
    columns: usize,
) -> PyResult<Vec<Vec<f64>>> {
    check_shape(name, values, (None, columns))?;
    let rows = rows(values);
    rows.iter().try_for_each(|row| finite(name, &present(row)))?;
    Ok(rows)
}

/// With a zero for each NaN.
fn present(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| if value.is_nan() { 0.0 } else { *value }).collect()
}

fn rows(values: &PyReadonlyArray2<'_, f64>) -> Vec<Vec<f64>> {
    values.as_array().rows().into_iter().map(|row| row.iter().copied().collect()).collect()
}

/// The rows of a matrix argument with `columns` columns, and `count` rows if that is fixed, all finite.
///
/// # Errors
/// Another shape, or a number that is not finite; the message begins with `name`.
pub(crate) fn matrix(
    name: &str,
    values: &PyReadonlyArray2<'_, f64>,
    (count, columns): (Option<usize>, usize),
) -> PyResult<Vec<Vec<f64>>> {
    check_shape(name, values, (count, columns))?;
    let rows = rows(values);
    rows.iter().try_for_each(|row| finite(name, row))?;
    Ok(rows)
}

/// The rows of a matrix argument with `N` columns and `rows` rows, all finite.
///
/// # Errors
/// As [`matrix`].
pub(crate) fn fixed_rows<const N: usize>(
    name: &str,
    values: &PyReadonlyArray2<'_, f64>,
    rows: usize,
) -> PyResult<Vec<SVector<f64, N>>> {
    check_shape(name, values, (Some(rows), N))?;
    let array = values.as_array();
    let rows = array.rows().into_iter().map(|row| SVector::from_fn(|column, _| row[column]));
    let rows: Vec<SVector<f64, N>> = rows.collect();
    rows.iter().try_for_each(|row| finite(name, row.as_slice()))?;
    Ok(rows)
}

fn check_shape(
    name: &str,
    values: &PyReadonlyArray2<'_, f64>,
    (rows, columns): (Option<usize>, usize),
) -> PyResult<()> {
    let shape = values.shape();
    let (given_rows, given_columns) = (shape[0], shape[1]);
    if given_columns == columns && rows.is_none_or(|rows| rows == given_rows) {
        return Ok(());
    }
    let rows = rows.map_or_else(|| "n".to_owned(), |rows| rows.to_string());
    let given = format!("given ({given_rows}, {given_columns})");
    Err(TelloError::new_err(format!("{name}: expected shape ({rows}, {columns}), {given}")))
}

fn finite(name: &str, values: &[f64]) -> PyResult<()> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(TelloError::new_err(format!("{name}: {value} is not a finite number"))),
        None => Ok(()),
    }
}

/// An array with these columns, filled row by row, of numbers that Python takes over.
///
/// # Errors
/// Python is out of memory.
pub(crate) fn owned<T: Element>(
    py: Python<'_>,
    columns: usize,
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    use numpy::{IntoPyArray, PyArrayMethods};
    let rows = values.len().checked_div(columns).unwrap_or(0);
    values.into_pyarray(py).reshape([rows, columns])
}
