// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The results of the training of a gather, as bytes.

use std::io::{self, BufRead, Read, Write};
use std::sync::{Arc, OnceLock};

use bytemuck::{Pod, cast_slice, cast_slice_mut};

use crate::integrator::gather::cache::{Grid, RadianceCache};
use crate::integrator::gather::{Allocation, Learnt};
use crate::key::RunKey;
use crate::memory::zeroed;

/// Writes the results of a training, if there was one.
pub fn write(
    learnt: &OnceLock<Learnt>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let head = learnt.get().map(|Learnt { cache, pilot, .. }| {
        let pilot: Vec<_> = pilot.iter().map(Vec::len).collect();
        let (cells, guides) = (cache.cells.len(), cache.guides.len());
        (cache.grid, cells, guides, IS_BIG, pilot, cache.columns)
    });
    serde_json::to_writer(&mut *out, &head)?;
    out.write_all(b"\n")?;
    let Some(Learnt { cache, allocation, pilot, .. }) = learnt.get() else {
        return Ok(());
    };
    out.write_all(cast_slice(&cache.cells))?;
    out.write_all(cast_slice(&cache.guides))?;
    out.write_all(cast_slice(&cache.rows))?;
    out.write_all(cast_slice(&allocation.counts))?;
    out.write_all(cast_slice(&allocation.scale))?;
    let mut pilot = pilot.iter();
    pilot.try_for_each(|tile| out.write_all(cast_slice(tile)))
}

/// Whether the most significant byte of a number comes first.
const IS_BIG: bool = cfg!(target_endian = "big");

/// Reads the results of a training for a run of this key, if there are any.
///
/// # Errors
/// The file ends, or has what no training produces.
pub fn read(
    from: &mut dyn BufRead,
    run_key: &RunKey,
) -> io::Result<Arc<OnceLock<Learnt>>> {
    let mut line = vec![];
    from.read_until(b'\n', &mut line)?;
    let Some(head) = serde_json::from_slice(&line)? else {
        return Ok(Arc::default());
    };
    type Head = (Grid, usize, usize, bool, Vec<usize>, usize);
    let (grid, cells, guides, is_big, pilot, columns): Head = head;
    let window = run_key.subject.sensed.window();
    let (cells, guides) = (get(from, cells)?, get(from, guides)?);
    let rows = get(from, columns.saturating_mul(cells.len()))?;
    let counts = get::<u32>(from, window.area())?;
    let scale = get::<f64>(from, window.area())?;
    let pilot = pilot.into_iter().map(|count| get(from, count));
    let pilot = pilot.collect::<io::Result<_>>()?;
    let empty = RadianceCache::empty(grid);
    let cache = RadianceCache { cells, guides, columns, rows, ..empty };
    let most = run_key.sampling.net_size.saturating_mul(8).min(1 << 20);
    let is_sound = is_big == IS_BIG
        && cache.is_sound()
        && counts.iter().all(|&n| (1..=most).contains(&n.into()))
        && scale.iter().all(|s| s.is_finite() && *s > 0.);
    if !is_sound {
        return Err(io::Error::other("it has what cannot be learnt"));
    }
    let allocation = Allocation::new(window, counts, scale);
    let (cache, twin) = (cache.into(), None);
    Ok(Arc::new(Learnt { cache, allocation, twin, pilot }.into()))
}

/// Reads an array.
fn get<T: Pod>(from: &mut dyn Read, length: usize) -> io::Result<Vec<T>> {
    let mut array = zeroed(length)?;
    from.read_exact(cast_slice_mut(&mut array))?;
    Ok(array)
}
