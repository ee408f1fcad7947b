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

use crate::sensor::table::{Shape, Table, cell};
use crate::tally::{Columns, Surface, Tally};
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
        let ending = ending.map(str::to_ascii_lowercase);
        let is_square = *tally == Tally::ViewFactors(Surface::Faces);
        let is_square = is_square && are_faces;
        let has_sky = matches!(tally, Tally::SkyPatches(_));
        Ok(match ending.as_deref() {
            Some("csv") => Self::Csv,
            None if path.as_os_str() == "-" => Self::Csv,
            Some("vf") if is_square => Self::View3d,
            Some("svf") if is_square => Self::Udales,
            Some("json") if is_square => Self::EnergyPlus,
            Some("mtx") if has_sky => Self::Radiance(is_binary),
            _ => {
                let fault = match has_sky {
                    true => {
                        "daylight coefficients are written as .mtx or .csv"
                    }
                    false => {
                        "view factors are written as .csv, and those between \
                         all faces as .vf, .svf or .json"
                    }
                };
                return Err(Error::from(fault).of_file(path));
            }
        })
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
        mut rows: Vec<Option<u32>>,
        film: &'a Film,
    ) -> Self {
        let (top, end) = (film.window.corner.1, film.window.end().1);
        for row in &mut rows {
            *row = row.filter(|y| (top..end).contains(y));
            *row = row.filter(|&y| film.pixel(0, y).count() > 0);
        }
        Self { columns, table, film, rows, closed: None }
    }

    /// The number of its rows.
    pub fn height(&self) -> usize {
        self.rows.len()
    }

    /// Its size, for a report.
    pub fn size(&self) -> MatrixSize {
        let row = |i| self.row(i).map_or(0, |row| row.len());
        let entries = (0..self.height()).map(row);
        MatrixSize {
            rows: self.height(),
            columns: self.columns.count,
            entries: entries.sum(),
            moves: self.closed.as_ref().map(|closed| closed.moves),
        }
    }

    /// The samples of a row.
    pub fn samples(&self, row: usize) -> u64 {
        let y = self.rows[row];
        y.map_or(0, |y| self.film.pixel(0, y).count() * self.film.net_size)
    }

    /// The entries of a row that are not zero, by their columns; none if the
    /// receiver has no value.
    pub fn row(&self, row: usize) -> Option<Vec<Cell>> {
        if let Some(closed) = &self.closed {
            return closed.row(row);
        }
        self.sampled(row)
    }

    /// The entries of a row as they were sampled.
    fn sampled(&self, row: usize) -> Option<Vec<Cell>> {
        let (film, count) = (self.film, self.columns.count);
        let at = film.at(0, self.rows[row]?);
        let (n, size) = (film.pixels[at].count(), film.net_size);
        let unit = self.unit();
        let cell = |entry: Entry| {
            let mean = unit * entry.mean(n * size);
            (entry.column, mean, unit * entry.standard_error(n, size))
        };
        let whole = Entry::joined(&film.rows[at], count).into_iter();
        Some(whole.map(cell).collect())
    }

    /// The irradiance for which an entry is 1: in units of the radiance of a
    /// patch, or a share.
    fn unit(&self) -> f64 {
        match self.columns.tally {
            Tally::SkyPatches(_) => PI,
            _ => 1.,
        }
    }

    /// The name of a row: the number of a point or a face, and its side if
    /// both receive.
    pub fn name(&self, row: usize) -> String {
        let sides = self.table.backs.len();
        match &self.table.shape {
            Shape::Faces(_) if sides == 2 => {
                let side = ["front", "back"][row % 2];
                format!("{} {side}", row / 2 + 1)
            }
            _ => (row + 1).to_string(),
        }
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
        let areas = self.areas();
        let closed =
            Closed::new(&areas, &|row| self.sampled(row), &|row| {
                self.samples(row)
            })?;
        self.closed = Some(closed);
        Ok(())
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
        let value = match self.columns.tally {
            Tally::SkyPatches(_) => "coefficient",
            _ => "factor",
        };
        writeln!(out, "row,column,{value},stderr")?;
        let names =
            (0..self.columns.count).map(|column| self.columns.name(column));
        let names: Vec<_> = names.map(|name| cell(&name)).collect();
        for row in 0..self.height() {
            let name = self.name(row);
            for (column, mean, error) in self.row(row).into_iter().flatten()
            {
                let column = &names[column as usize];
                writeln!(out, "{name},{column},{mean:?},{error:?}")?;
            }
        }
        Ok(())
    }

    /// The value of the first column of each row, and its error.
    pub fn first_cells(&self) -> Vec<[f64; 2]> {
        let first = |row| {
            let cells = self.row(row)?;
            let (_, value, error) =
                cells.first().copied().unwrap_or_default();
            Some([value, error])
        };
        let first = (0..self.height()).map(first);
        first.map(|cell| cell.unwrap_or([f64::NAN; 2])).collect()
    }

    /// All entries of a row; not numbers if the receiver has no value.
    pub fn dense(&self, row: usize) -> Vec<f64> {
        let none = if self.rows[row].is_some() { 0. } else { f64::NAN };
        let mut values = vec![none; self.columns.count as usize];
        for (column, mean, _) in self.row(row).into_iter().flatten() {
            values[column as usize] = mean;
        }
        values
    }

    fn view3d(&self, out: &mut dyn Write) -> io::Result<()> {
        let n = self.height();
        let head = format!(
            "View3D 3.3.1 0 {} 0 {n}",
            u8::from(self.closed.is_some())
        );
        writeln!(out, "{head:30}")?;
        let join = |values: &[f64], decimals: usize| {
            let text = |value: &f64| format!("{value:.decimals$}");
            values.iter().map(text).collect::<Vec<_>>().join(" ")
        };
        let areas = self.areas().into_iter().map(|a| a.to_string());
        writeln!(out, "{}", areas.collect::<Vec<_>>().join(" "))?;
        for row in 0..n {
            writeln!(out, "{}", join(&self.dense(row)[..n], 6))?;
        }
        writeln!(out, "{}", join(&vec![1.; n], 3))
    }

    fn udales(&self, out: &mut dyn Write) -> io::Result<()> {
        let n = self.height() as u32;
        for row in 0..self.height() {
            for (column, mean, _) in self.row(row).into_iter().flatten() {
                if column < n && mean >= 5e-7 {
                    writeln!(out, "{} {} {mean:.8}", row + 1, column + 1)?;
                }
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
        let key = json!(format!("{kind} 1"));
        writeln!(out, "{{\"{kind}\": {{{key}: {{")?;
        let zone = "zone_or_zonelist_or_space_or_spacelist_name";
        write!(out, "\"{zone}\": {}, \"view_factors\": [", json!(scene))?;
        let (mut sign, n) = ("", self.height());
        for row in 0..n {
            let from = json!(self.name(row));
            for (column, value) in
                self.dense(row).iter().take(n).enumerate()
            {
                let to = json!(self.columns.name(column as u32));
                write!(
                    out,
                    "{sign}\n{{\"from_surface\": {from}, \"to_surface\": \
                     {to}, \"view_factor\": {value:?}}}"
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
        let format = match is_binary {
            true => "BigEndian=0\nFORMAT=float",
            false => "FORMAT=ascii",
        };
        write!(
            out,
            "#?RADIANCE\npt {version}: irradiance for a patch of radiance 1\n\
             NROWS={rows}\nNCOLS={columns}\nNCOMP=3\n{format}\n\n"
        )?;
        for row in 0..rows {
            for value in self.dense(row) {
                match is_binary {
                    true => out.write_all(
                        &[(value as f32).to_le_bytes(); 3].concat(),
                    )?,
                    false => write!(
                        out,
                        "{value:.7e} {value:.7e} {value:.7e}\t"
                    )?,
                }
            }
            if !is_binary {
                writeln!(out)?;
            }
        }
        Ok(())
    }
}
