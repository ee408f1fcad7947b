// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The state of a run in a file, from which it can go on.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::film::Film;
use crate::integrator::gather::Learnt;
use crate::key::RunKey;
use crate::plan::{Plan, is_dash};
use crate::render_loop::Convergence;
use crate::report::Report;
use crate::scene::encoding::shortened;
use crate::state::learnt;

/// The first line of a checkpoint; its number changes with the layout.
const MAGIC: &[u8] = b"litpt checkpoint 13\n";

/// A run without its sums, in the second line.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunRecord {
    /// The values that decide the samples.
    pub run_key: RunKey,
    /// The plan; its files have full names.
    pub plan: Plan,
    /// The report, with the record of its passes so far.
    pub report: Report,
    /// The row of each receiver on the film, if it has one; none without a
    /// tally.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rows: Vec<Option<u32>>,
    /// The results of a training, which are not in that line.
    #[serde(skip)]
    pub learnt: Arc<OnceLock<Learnt>>,
}

impl RunRecord {
    /// The samples of each pixel in a replicate, if they differ.
    pub fn allocation(&self) -> Option<&[u32]> {
        Some(&self.learnt.get()?.allocation.counts)
    }

    /// Checks that this is the record of a run with a key.
    ///
    /// # Errors
    /// It is not; the first entry that differs is named.
    pub fn belongs_to(&self, run_key: &RunKey) -> Result<()> {
        let differs = self.run_key.disagreement(run_key);
        differs.map_or(Ok(()), |(name, [theirs, ours])| {
            let fault = format!(
                "belongs to another run: its {name} is {theirs}, not {ours}"
            );
            Err(fault.into())
        })
    }
}

/// Writes a checkpoint.
pub fn save(
    record: &RunRecord,
    film: &Film,
    out: &mut dyn Write,
) -> io::Result<()> {
    let mut out = Checked { out, checksum: Sha256::new() };
    out.write_all(MAGIC)?;
    serde_json::to_writer(&mut out, record)?;
    out.write_all(b"\n")?;
    learnt::write(&record.learnt, &mut out)?;
    if !record.run_key.only_learns() {
        film.write(&mut out)?;
    }
    let Checked { out, checksum } = out;
    out.write_all(&checksum.finalize())
}

/// Computes the checksum of the bytes that pass.
struct Checked<'a> {
    out: &'a mut dyn Write,
    checksum: Sha256,
}

impl Write for Checked<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.checksum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// The size of a checksum in bytes.
const CHECKSUM: u64 = 32;

/// Reads through a checkpoint, and returns to the line of JSON.
fn recognise(file: &mut (impl BufRead + Seek)) -> Result<()> {
    // Compare the first line
    let mut magic = vec![];
    let mut start = file.by_ref().take(MAGIC.len() as u64);
    start.read_to_end(&mut magic).map_err(unreadable)?;
    if magic != MAGIC {
        let fault =
            "is not a checkpoint of this version of pt, a .litpt file";
        return Err(fault.into());
    }
    // Compare the checksum with the content
    let length = file.seek(SeekFrom::End(0)).map_err(unreadable)?;
    file.rewind().map_err(unreadable)?;
    let mut sink =
        Checked { out: &mut io::sink(), checksum: Sha256::new() };
    let mut content = file.by_ref().take(length.saturating_sub(CHECKSUM));
    io::copy(&mut content, &mut sink).map_err(unreadable)?;
    let mut stored = vec![];
    file.read_to_end(&mut stored).map_err(unreadable)?;
    if stored[..] != sink.checksum.finalize()[..] {
        return Err("is damaged: its checksum is wrong".into());
    }
    file.seek(SeekFrom::Start(MAGIC.len() as u64)).map_err(unreadable)?;
    Ok(())
}

fn unreadable(error: io::Error) -> Error {
    format!("cannot read: {error}").into()
}

/// A checkpoint that is whole.
pub struct Checkpoint<R = BufReader<File>> {
    /// Its name, for people.
    pub name: String,
    /// The record of its run.
    pub record: RunRecord,
    /// The file from the first sum on, if it has any.
    sums: Option<R>,
}

impl<R: BufRead + Seek> Checkpoint<R> {
    /// Reads a checkpoint up to the sums.
    ///
    /// # Errors
    /// The file is no checkpoint, or is damaged.
    pub fn open(mut file: R) -> Result<Self> {
        recognise(&mut file)?;
        let mut line = vec![];
        file.read_until(b'\n', &mut line).map_err(unreadable)?;
        let mut record: RunRecord = serde_json::from_slice(&line)
            .map_err(|e| shortened(&format!("is not a checkpoint: {e}")))?;
        record.learnt = learnt::read(&mut file, &record.run_key)
            .map_err(|e| format!("what was learnt is damaged: {e}"))?;
        let sums = (!record.run_key.only_learns()).then_some(file);
        Ok(Self { name: String::new(), record, sums })
    }

    /// Fills the `film`, and returns the record of the passes.
    ///
    /// # Errors
    /// The checkpoint belongs to another run, or cannot be read; the
    /// image may then be filled in part.
    pub fn resume(
        mut self,
        run_key: &RunKey,
        film: &mut Film,
    ) -> Result<Convergence> {
        let name = self.name.clone();
        let named = |fault: Error| fault.of_file(&name);
        self.record.belongs_to(run_key).map_err(named)?;
        self.fill(film).map_err(named)?;
        Ok(self.record.report.convergence)
    }

    /// Fills a film of the size that the run key gives.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn fill(&mut self, film: &mut Film) -> Result<()> {
        let sums = self.sums.as_mut();
        sums.map_or(Ok(()), |sums| film.read(sums)).map_err(unreadable)
    }
}

impl Checkpoint {
    /// Opens the checkpoint in a file, which the message names.
    ///
    /// # Errors
    /// Those of [`Checkpoint::open`], or the file cannot be read.
    pub fn of_file(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        if is_dash(path) {
            let fault = "cannot read a state from a pipe: name a file";
            return Err(Error::from(fault).of_file(name));
        }
        let opened = File::open(path)
            .map_err(unreadable)
            .and_then(|file| Self::open(BufReader::new(file)));
        match opened {
            Ok(state) => Ok(Self { name, ..state }),
            Err(fault) => Err(fault.of_file(name)),
        }
    }
}
