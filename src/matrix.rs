// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The entries of a tally as a matrix, and the files that hold it.

pub mod closed;
pub mod daylight;

use std::f64::consts::PI;
use std::io::{self, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::error::{Error, Result};
use crate::film::{Entry, Film};
use crate::report::MatrixSize;
use crate::sensor::table::{Table, cell};
use crate::tally::{Columns, Surface, Tally, face_name};
pub use closed::Cell;
use closed::Closed;

/// Formats of matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MatrixFormat {
    /// Row, column, value and standard error, separated by commas.
    Csv,
    /// View factors as View3D writes them.
    View3d,
    /// View factors as uDALES reads them.
    Udales,
    /// View factors as EnergyPlus reads them.
    EnergyPlus,
    /// Daylight coefficients as Radiance reads them, in text or in binary
    /// numbers of single precision.
    Radiance(bool),
}

impl MatrixFormat {
    /// The format of a file for a tally of these receivers, CSV of standard
    /// output; `.mtx` may be binary.
    ///
    /// # Errors
    /// The extension is another, or not for this tally.
    pub fn of(
        path: &Path,
        tally: &Tally,
        (are_faces, is_binary): (bool, bool),
    ) -> Result<Self> {
        let ending = path.extension().and_then(|e| e.to_str());
        let is_square =
            are_faces && *tally == Tally::ViewFactors(Surface::Faces);
        let has_sky = matches!(tally, Tally::SkyPatches(_));
        let fault = match has_sky {
            true => "daylight coefficients are written as .mtx or .csv",
            false => {
                "view factors are written as .csv, and those between all \
                 faces as .vf, .svf or .json"
            }
        };
        match ending.map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(Self::Csv),
            None if path.as_os_str() == "-" => Ok(Self::Csv),
            Some("vf") if is_square => Ok(Self::View3d),
            Some("svf") if is_square => Ok(Self::Udales),
            Some("json") if is_square => Ok(Self::EnergyPlus),
            Some("mtx") if has_sky => Ok(Self::Radiance(is_binary)),
            _ => Err(Error::from(fault).of_file(path)),
        }
    }
}

/// The matrix of a tally.
pub struct Matrix<'a> {
    /// What the columns are.
    pub columns: &'a Columns,
    table: &'a Table,
    film: &'a Film,
    /// The row of each receiver on the film, if it has one.
    rows: Vec<Option<u32>>,
    /// The matrix that is reciprocal and closed, if it is wanted.
    pub closed: Option<Closed>,
}

impl<'a> Matrix<'a> {
    /// The matrix on a film.
    pub fn new(
        columns: &'a Columns,
        table: &'a Table,
        rows: Vec<Option<u32>>,
        film: &'a Film,
    ) -> Self {
        let (top, end) = (film.window.corner.1, film.window.end().1);
        let has = |&y: &u32| {
            (top..end).contains(&y) && film.pixel(0, y).count() > 0
        };
        let rows = rows.into_iter().map(|row| row.filter(has)).collect();
        Self { columns, table, film, rows, closed: None }
    }

    /// The entries of a row that are not zero, by their columns; none if the
    /// receiver has no value.
    pub fn row(&self, row: usize) -> Option<Vec<Cell>> {
        match &self.closed {
            Some(closed) => closed.row(row),
            None => self.sampled(row),
        }
    }

    /// The entries of all rows, each after the number of its row.
    fn cells(&self) -> impl Iterator<Item = (usize, Cell)> {
        (0..self.height()).flat_map(|row| {
            let cells = self.row(row).into_iter().flatten();
            cells.map(move |cell| (row, cell))
        })
    }

    /// The entries of a row as they were sampled: shares, or irradiances for a
    /// radiance of 1 of a patch.
    fn sampled(&self, row: usize) -> Option<Vec<Cell>> {
        let Self { film, columns, .. } = self;
        let at = film.at(0, self.rows[row]?);
        let (n, size) = (film.pixels[at].count(), film.net_size);
        let has_sky = matches!(columns.tally, Tally::SkyPatches(_));
        let unit = if has_sky { PI } else { 1. };
        let cell = |entry: Entry| {
            let mean = unit * entry.mean(n * size);
            (entry.column, mean, unit * entry.standard_error(n, size))
        };
        let whole = Entry::joined(&film.rows[at], columns.count);
        let mut row: Vec<_> = whole.into_iter().map(cell).collect();
        if has_sky {
            // Compare the errors of neighbouring patches
            let found = row.clone();
            for (i, cell) in row.iter_mut().enumerate() {
                let around =
                    &found[i.saturating_sub(1)..found.len().min(i + 2)];
                let near =
                    around.iter().filter(|it| it.0.abs_diff(cell.0) < 2);
                cell.2 = near.map(|it| it.2).fold(0., f64::max);
            }
        }
        Some(row)
    }

    /// The number of its rows.
    pub fn height(&self) -> usize {
        self.rows.len()
    }

    /// Its size, for a report.
    pub fn size(&self) -> MatrixSize {
        MatrixSize {
            rows: self.height(),
            columns: self.columns.count,
            entries: self.cells().count(),
            moves: self.closed.as_ref().map(|closed| closed.moves),
        }
    }

    /// The name of a row: the number of a point or a face, and its side if
    /// both receive.
    pub fn name(&self, row: usize) -> String {
        face_name(row as u32, self.table.backs.len() as u32)
    }

    /// The area of the face of each row.
    pub fn areas(&self) -> Vec<f64> {
        let areas = self.table.areas();
        let sides = self.table.backs.len();
        areas.into_iter().flat_map(|a| vec![a; sides]).collect()
    }

    /// Replaces it by the nearest matrix that is reciprocal and closed.
    ///
    /// # Errors
    /// There is none.
    pub fn close(&mut self) -> Result<()> {
        let samples =
            |y| self.film.pixel(0, y).count() * self.film.net_size;
        let samples = |row: usize| self.rows[row].map_or(0, samples);
        let row = |row| self.sampled(row);
        self.closed = Some(Closed::new(&self.areas(), &row, &samples)?);
        Ok(())
    }

    /// The value of the first column of each row, and its error.
    pub fn first_cells(&self) -> Vec<[f64; 2]> {
        let first = |row| match self.row(row).as_deref() {
            None => [f64::NAN; 2],
            Some([]) => [0.; 2],
            Some(&[(_, value, error), ..]) => [value, error],
        };
        (0..self.height()).map(first).collect()
    }

    /// All entries of a row. Of a sensor without a value they are not numbers; a
    /// face without area sees nothing.
    pub fn dense(&self, row: usize) -> Vec<f64> {
        let has_value = self.columns.tally.is_of_surfaces();
        let has_value = has_value || self.rows[row].is_some();
        let none = if has_value { 0. } else { f64::NAN };
        let mut values = vec![none; self.columns.count as usize];
        for (column, mean, _) in self.row(row).into_iter().flatten() {
            values[column as usize] = mean;
        }
        values
    }

    /// Writes it.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(
        &self,
        format: MatrixFormat,
        scene: &str,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        match format {
            MatrixFormat::Csv => self.csv(out),
            MatrixFormat::View3d => self.view3d(out),
            MatrixFormat::Udales => self.udales(out),
            MatrixFormat::EnergyPlus => self.energyplus(scene, out),
            MatrixFormat::Radiance(is_binary) => {
                self.radiance(is_binary, out)
            }
        }
    }

    fn csv(&self, out: &mut dyn Write) -> io::Result<()> {
        let has_sky = matches!(self.columns.tally, Tally::SkyPatches(_));
        let value = if has_sky { "coefficient" } else { "factor" };
        writeln!(out, "row,column,{value},stderr")?;
        let name = |column| cell(&self.columns.name(column));
        let names: Vec<_> = (0..self.columns.count).map(name).collect();
        for (row, (column, mean, error)) in self.cells() {
            let (row, column) = (self.name(row), &names[column as usize]);
            writeln!(out, "{row},{column},{mean:?},{error:?}")?;
        }
        Ok(())
    }

    fn view3d(&self, out: &mut dyn Write) -> io::Result<()> {
        let n = self.height();
        let is_closed = u8::from(self.closed.is_some());
        let head = format!("View3D 3.3.1 0 {is_closed} 0 {n}");
        writeln!(out, "{head:30}")?;
        let areas = self.areas().into_iter().map(|a| a.to_string());
        writeln!(out, "{}", areas.collect::<Vec<_>>().join(" "))?;
        for row in 0..n {
            let values = self.dense(row).into_iter().take(n);
            let values = values.map(|value| format!("{value:.6}"));
            writeln!(out, "{}", values.collect::<Vec<_>>().join(" "))?;
        }
        writeln!(out, "{}", vec!["1.000"; n].join(" "))
    }

    fn udales(&self, out: &mut dyn Write) -> io::Result<()> {
        let n = self.height();
        for (row, (column, mean, _)) in self.cells() {
            let column = column as usize;
            if column < n && mean >= 5e-7 {
                writeln!(out, "{} {} {mean:.8}", row + 1, column + 1)?;
            }
        }
        Ok(())
    }

    fn energyplus(
        &self,
        scene: &str,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let kind = "ZoneProperty:UserViewFactors:BySurfaceName";
        let zone = "zone_or_zonelist_or_space_or_spacelist_name";
        write!(
            out,
            "{{\"{kind}\": {{\"{kind} 1\": {{\n\"{zone}\": {}, \
             \"view_factors\": [",
            json!(scene)
        )?;
        let (mut sign, n) = ("", self.height());
        for row in 0..n {
            let from = self.name(row);
            for (k, value) in self.dense(row)[..n].iter().enumerate() {
                let to = self.name(k);
                write!(
                    out,
                    "{sign}\n{{\"from_surface\": \"{from}\", \
                     \"to_surface\": \"{to}\", \"view_factor\": {value:?}}}"
                )?;
                sign = ",";
            }
        }
        writeln!(out, "\n]}}}}}}")
    }

    fn radiance(
        &self,
        is_binary: bool,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let (rows, columns) = (self.height(), self.columns.count);
        let version = env!("CARGO_PKG_VERSION");
        let (format, end) = match is_binary {
            true => ("BigEndian=0\nFORMAT=float", ""),
            false => ("FORMAT=ascii", "\n"),
        };
        write!(
            out,
            "#?RADIANCE\npt {version}: irradiance for a patch of radiance 1\n\
             NROWS={rows}\nNCOLS={columns}\nNCOMP=3\n{format}\n\n"
        )?;
        for row in 0..rows {
            for value in self.dense(row) {
                if is_binary {
                    let bytes = (value as f32).to_le_bytes();
                    out.write_all(&[bytes; 3].concat())?;
                } else {
                    write!(out, "{value:.7e} {value:.7e} {value:.7e}\t")?;
                }
            }
            write!(out, "{end}")?;
        }
        Ok(())
    }
}
