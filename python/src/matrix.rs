// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Matrices of view factors and of daylight coefficients, and a year of light.

use std::fs;
use std::path::PathBuf;

use litpt::error::{Error, Result};
use litpt::matrix::daylight::{
    Daylight, Demand, Interval, SkyMatrix, Year,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::rendering::{Numbers, Rendering};
use crate::{on_threads, refused};

/// Where each row begins, with the end of the last, and the column of each
/// entry; values and standard errors; the names of rows and of columns; and
/// how closing has moved the entries.
type Entries<'py> = (
    [Bound<'py, PyArray1<i64>>; 2],
    [Numbers<'py>; 2],
    [Vec<String>; 2],
    Option<[f64; 2]>,
);

/// The matrix of a tally, closed or not, if there is one. A row without a
/// value has one entry, in the last column, which is no number.
#[pyfunction]
pub fn matrix<'py>(
    py: Python<'py>,
    rendering: &Rendering,
    closes: bool,
) -> PyResult<Option<Entries<'py>>> {
    let Rendering { world, record, film, .. } = rendering;
    let Some(mut matrix) = world.matrix(film) else { return Ok(None) };
    let list = || {
        if closes {
            matrix.close()?;
        }
        // List each row
        let count = matrix.columns.count;
        let (mut starts, mut columns) = (vec![0], vec![]);
        let (mut values, mut errors) = (vec![], vec![]);
        for row in 0..matrix.height() {
            let none = vec![(count - 1, f64::NAN, f64::NAN)];
            for (column, value, error) in matrix.row(row).unwrap_or(none) {
                columns.push(column.into());
                values.push(value);
                errors.push(error);
            }
            starts.push(columns.len() as i64);
        }
        // Name the rows and the columns
        let rows = (0..matrix.height()).map(|row| matrix.name(row));
        let names = (0..count).map(|column| matrix.columns.name(column));
        let names = [rows.collect(), names.collect()];
        let moves = matrix.closed.map(|closed| closed.moves);
        Ok(([starts, columns], [values, errors], names, moves))
    };
    let threads = record.plan.threads;
    let (places, numbers, names, moves) =
        py.detach(|| on_threads(threads, list))?;
    let places = places.map(|list| PyArray1::from_vec(py, list));
    let numbers = numbers.map(|list| PyArray1::from_vec(py, list));
    Ok(Some((places, numbers, names, moves)))
}

/// The radiances of a sky.
#[pyclass(frozen, module = "litpt._core")]
pub struct Sky(SkyMatrix);

#[pymethods]
impl Sky {
    /// Reads a matrix of Radiance.
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        let read = || {
            let bytes = fs::read(&path);
            let bytes = bytes.map_err(Error::cannot("read", &path))?;
            SkyMatrix::read(&bytes).map_err(|fault| fault.of_file(&path))
        };
        py.detach(read).map(Self).map_err(refused)
    }

    #[getter]
    fn patches(&self) -> usize {
        self.0.patches
    }

    #[getter]
    fn steps(&self) -> usize {
        self.0.steps
    }

    /// The illuminance of each sensor at each step, and its standard error.
    fn lux<'py>(
        &self,
        py: Python<'py>,
        rendering: &Rendering,
    ) -> PyResult<[Numbers<'py>; 2]> {
        let steps: Vec<usize> = (0..self.0.steps).collect();
        let numbers = on_daylight(py, rendering, |daylight| {
            // Fill the illuminances of all sensors
            let none = vec![f64::NAN; daylight.rows.len() * steps.len()];
            let [mut lux, mut errors] = [none.clone(), none];
            let rows = lux.par_chunks_mut(steps.len());
            let rows = rows.zip(errors.par_chunks_mut(steps.len()));
            rows.enumerate().for_each(|(sensor, (lux, errors))| {
                let light = daylight.illuminance(sensor, &self.0, &steps);
                if let Some(light) = light {
                    lux.copy_from_slice(&light.lux);
                    errors.copy_from_slice(&light.standard_errors());
                }
            });
            Ok([lux, errors])
        })?;
        Ok(numbers.map(|list| PyArray1::from_vec(py, list)))
    }

    /// The parts of these steps with enough light and with useful light at
    /// each sensor, and the part of the sensors that have enough in a part of
    /// the steps: each a number and an interval.
    fn year<'py>(
        &self,
        py: Python<'py>,
        rendering: &Rendering,
        steps: Vec<usize>,
        enough: f64,
        useful: [f64; 2],
        part: f64,
    ) -> PyResult<(Numbers<'py>, [f64; 3])> {
        let demand = Demand { enough, useful, hours: part };
        let year = on_daylight(py, rendering, |daylight| {
            Year::new(daylight, &self.0, &steps, demand)
        })?;
        let three = |it: Interval| [it.value, it.ends[0], it.ends[1]];
        let both = |sensor: Option<[Interval; 2]>| {
            sensor.map_or([[f64::NAN; 3]; 2], |both| both.map(three))
        };
        let sensors = year.sensors.into_iter().flat_map(both).flatten();
        let sensors = PyArray1::from_iter(py, sensors);
        Ok((sensors, three(year.spatial)))
    }
}

/// Works on the daylight coefficients of a result.
fn on_daylight<T: Send>(
    py: Python,
    rendering: &Rendering,
    work: impl FnOnce(&Daylight) -> Result<T> + Send,
) -> PyResult<T> {
    let Rendering { world, record, film, .. } = rendering;
    let rows = &world.rows();
    let columns = world.columns.as_ref().map_or(0, |it| it.count);
    let daylight = Daylight { film, rows, columns };
    py.detach(|| on_threads(record.plan.threads, || work(&daylight)))
}
