// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What a gather has learnt, as bytes.

use std::io::{self, BufRead, BufWriter, Read, Write};
use std::sync::{Arc, OnceLock};

use bytemuck::cast_slice;

use crate::integrator::gather::cache::{Cell, Grid, RadianceCache};
use crate::integrator::gather::guide::Guide;
use crate::integrator::gather::{Allocation, Learnt};
use crate::memory::reserved;
use crate::state::key::{RunKey, whole_window};

/// Writes what was learnt, if anything was.
pub fn write(
    learnt: Option<&Learnt>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let head = learnt.map(|Learnt { cache, .. }| {
        (cache.grid, cache.cells.len(), cache.guides.len())
    });
    let out = &mut BufWriter::new(out);
    serde_json::to_writer(&mut *out, &head)?;
    out.write_all(b"\n")?;
    if let Some(Learnt { cache, allocation }) = learnt {
        let cells = cast_slice::<Cell, u32>(&cache.cells);
        let guides = cast_slice::<Guide, u16>(&cache.guides);
        put(out, cells, u32::to_le_bytes)?;
        put(out, guides, u16::to_le_bytes)?;
        put(out, &allocation.counts, u32::to_le_bytes)?;
        put(out, &allocation.scale, f64::to_le_bytes)?;
    }
    out.flush()
}

/// Writes the bytes of numbers.
fn put<T: Copy, const N: usize>(
    out: &mut impl Write,
    numbers: &[T],
    bytes: fn(T) -> [u8; N],
) -> io::Result<()> {
    numbers.iter().try_for_each(|&n| out.write_all(&bytes(n)))
}

/// Reads what a run of this key has learnt, if anything.
///
/// # Errors
/// The file ends, or has what cannot be learnt.
pub fn read(
    from: &mut dyn BufRead,
    run_key: &RunKey,
) -> io::Result<Arc<OnceLock<Learnt>>> {
    let mut line = vec![];
    from.read_until(b'\n', &mut line)?;
    let Some(head) = serde_json::from_slice(&line)? else {
        return Ok(Arc::default());
    };
    let (grid, cells, guides): (Grid, usize, usize) = head;
    let subject = &run_key.subject;
    let window = whole_window(subject.resolution, subject.crop);
    // Read the arrays
    let words = size_of::<Cell>() / 4;
    let cells = get(from, cells.saturating_mul(words), u32::from_le_bytes)?;
    let cells = cast_slice::<u32, Cell>(&cells).to_vec();
    let words = size_of::<Guide>() / 2;
    let guides =
        get(from, guides.saturating_mul(words), u16::from_le_bytes)?;
    let guides = cast_slice::<u16, Guide>(&guides).to_vec();
    let counts = get(from, window.area(), u32::from_le_bytes)?;
    let scale = get(from, window.area(), f64::from_le_bytes)?;
    let cache =
        RadianceCache { cells, guides, ..RadianceCache::empty(grid) };
    let most = run_key.sampling.replicate.saturating_mul(8).min(1 << 20);
    let is_sound = cache.is_sound()
        && counts.iter().all(|&n| (1..=most).contains(&n.into()))
        && scale.iter().all(|s: &f64| s.is_finite() && *s > 0.);
    if !is_sound {
        return Err(io::Error::other("it has what cannot be learnt"));
    }
    let allocation = Allocation::new(window, counts, scale);
    Ok(Arc::new(Learnt { cache, allocation }.into()))
}

/// Reads so many numbers.
fn get<T, const N: usize>(
    from: &mut dyn Read,
    count: usize,
    number: fn([u8; N]) -> T,
) -> io::Result<Vec<T>> {
    let mut numbers = reserved(count)?;
    for _ in 0..count {
        let mut bytes = [0; N];
        from.read_exact(&mut bytes)?;
        numbers.push(number(bytes));
    }
    Ok(numbers)
}
