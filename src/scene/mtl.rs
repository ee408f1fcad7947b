// Tangled from chapters/materials.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a library of materials to their diffuse reflectivity.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::collections::BTreeSet;
use std::collections::btree_map::{BTreeMap, Entry};

use super::encoding::{self, quoted};
use super::text::*;
use crate::error::{Diagnostic, Result};

/// The materials of a scene, as its libraries define them.
#[derive(Default)]
pub struct Library {
    /// The first `Kd` of each, in red, green and blue, from 0 to 1.
    pub diffuse: BTreeMap<String, [f64; 3]>,
    /// What is known of each that may be a pane, if panes are wanted.
    pub panes: Option<BTreeMap<String, Clear>>,
    /// For each kind of property that is not rendered, a message about the
    /// first statement, and their number.
    pub ignored: BTreeMap<&'static str, (Diagnostic, usize)>,
    /// Other messages.
    pub warnings: Vec<Diagnostic>,
}

/// A transparency that is not understood.
const ODD: &str = "transparent (d counts, then Tr, the first of each; this \
    one differs, or is no number from 0 to 1)";

/// How a material lets light through.
#[derive(Clone, Copy, Default)]
pub struct Clear {
    /// The part that it lets through according to `d`, and to `Tr`.
    parts: [Option<[f64; 1]>; 2],
    /// The colour that `Tf` gives it.
    pub filter: Option<[f64; 3]>,
}

impl Clear {
    /// The part that it lets through: what `d` says, or else `Tr`.
    pub fn part(&self) -> Option<f64> {
        self.parts.iter().flatten().flatten().next().copied()
    }

    /// Notes a statement; if it is about transparency, returns whether it is
    /// made of numbers from 0 to 1 and agrees with others.
    fn note(&mut self, line: &[u8]) -> Option<bool> {
        let word = String::from_utf8_lossy(name(line)).to_ascii_lowercase();
        let text = rest(said(line));
        let numbers = text.split_whitespace().map(str::parse);
        let numbers: Result<Vec<f64>, _> = numbers.collect();
        let is_part = |x: &f64| (0. ..=1.).contains(x);
        let numbers = numbers.ok().filter(|n| n.iter().all(is_part));
        let Self { parts: [d, tr], filter } = self;
        Some(match (&word[..], numbers.as_deref()) {
            ("d", Some(&[x])) => agrees(d, *tr, [1. - x]),
            ("tr", Some(&[x])) => agrees(tr, *d, [x]),
            ("tf", Some(&[grey])) => agrees(filter, None, [grey; 3]),
            ("tf", Some(&[r, g, b])) => agrees(filter, None, [r, g, b]),
            ("d" | "tr" | "tf", _) => false,
            _ => return None,
        })
    }
}

/// Keeps the first value; whether this one differs from it, and from
/// another, by less than a hundredth.
fn agrees<const N: usize>(
    first: &mut Option<[f64; N]>,
    other: Option<[f64; N]>,
    value: [f64; N],
) -> bool {
    let both = [Some(*first.get_or_insert(value)), other];
    let is_near = |(a, b): (f64, f64)| (a - b).abs() < 0.01;
    let known = both.into_iter().flatten();
    known.flat_map(|it| it.into_iter().zip(value)).all(is_near)
}

/// Reads a library, called `file`, for the materials that a scene uses.
///
/// # Errors
/// Those of `encoding::text`, a zero byte, or a `Kd` that is not one number
/// or three from 0 to 1 (a fourth is ignored).
pub fn read_mtl(
    source: &[u8],
    file: &str,
    used: &BTreeSet<&str>,
    library: &mut Library,
) -> Result<()> {
    let mut odd = vec![];
    let text = encoding::text(source, &mut odd)?;
    let text = &join(plain(&text)?)[..];
    library.warnings.extend(odd.into_iter().map(|odd| odd.of_file(file)));
    let mut material = String::new();
    for line in lines(text) {
        if name(line).eq_ignore_ascii_case(b"newmtl") {
            material = rest(line);
        } else if used.contains(&material[..]) {
            // Read a statement of a material
            let panes = library.panes.as_mut();
            let noted = panes.and_then(|panes| {
                panes.entry(material.clone()).or_default().note(line)
            });
            let kd = library.diffuse.entry(material.clone());
            let judged = match noted {
                Some(true) => continue,
                Some(false) => Ok(Some(ODD)),
                None => judge(line, kd),
            };
            let judged = judged.map_err(|what| at(text, line, what))?;
            let Some(kind) = judged else { continue };
            let first = || {
                let m = quoted(&material);
                let what = format!("material {m} is {kind}, not rendered");
                (at(text, line, what).of_file(file), 0)
            };
            library.ignored.entry(kind).or_insert_with(first).1 += 1;
        }
    }
    Ok(())
}

/// The kind of a statement that is not rendered; or records its `Kd`, unless
/// there is one.
fn judge(
    line: &[u8],
    kd: Entry<'_, String, [f64; 3]>,
) -> Result<Option<&'static str>> {
    let word = String::from_utf8_lossy(name(line)).to_ascii_lowercase();
    let map = word.strip_prefix("map_");
    let text = rest(if map.is_some() { line } else { said(line) });
    let (none, kind): (fn(f64) -> bool, _) = match map.unwrap_or(&word) {
        "kd" if map.is_none() => return read_kd(&text, kd),
        "kd" | "decal" => (|_| false, "textured (map_Kd)"),
        "d" => (|x| x >= 1., "transparent (d, Tr)"),
        "tr" => (|x| x <= 0., "transparent (d, Tr)"),
        "ke" => (|x| x <= 0., "luminous (Ke)"),
        "ks" | "pm" | "refl" => (|x| x <= 0., "glossy (Ks, illum)"),
        "illum" => (|x| x <= 1., "glossy (Ks, illum)"),
        _ => return Ok(None),
    };
    let is_some = |w: &str| w != "-halo" && !w.parse().is_ok_and(none);
    Ok(text.split_whitespace().any(is_some).then_some(kind))
}

/// Records the numbers after a `Kd`; returns its kind if it has none.
fn read_kd(
    text: &str,
    first: Entry<'_, String, [f64; 3]>,
) -> Result<Option<&'static str>> {
    let other = text.to_ascii_lowercase();
    let numbers = text.split_whitespace().map(str::parse);
    let kd = match numbers.collect::<Result<Vec<f64>, _>>().as_deref() {
        Ok(&[grey]) => [grey; 3],
        Ok(&[r, g, b] | &[r, g, b, _]) => [r, g, b],
        _ if other.starts_with("xyz") || other.starts_with("spectral") => {
            return Ok(Some("coloured (Kd xyz, Kd spectral)"));
        }
        _ => [f64::NAN; 3],
    };
    if !kd.iter().all(|x| (0. ..=1.).contains(x)) {
        let (name, text) = (quoted(first.key()), quoted(text));
        let what = "expected one number from 0 to 1, or three, and not";
        return Err(format!("material {name}: {what} 'Kd {text}'").into());
    }
    let is_other = *first.or_insert(kd) != kd;
    Ok(is_other.then_some("given another Kd"))
}
