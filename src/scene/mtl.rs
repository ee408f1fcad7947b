// Tangled from chapters/materials.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a library of materials to what diffuse surfaces reflect.

use std::collections::{BTreeMap, BTreeSet};

use super::encoding;
use super::text::{
    at, join, lines, name, number, plain, quoted, rest, said,
};

/// A material, as far as diffuse surfaces ask.
#[derive(Default)]
pub struct Material {
    /// Its name.
    pub name: String,
    /// The line, from 1, where its definition begins.
    pub line: usize,
    /// What it reflects of red, green and blue, each from 0 to 1.
    pub diffuse: Option<[f64; 3]>,
    /// What it is beside that, each with the first line that says so.
    pub asides: BTreeMap<&'static str, usize>,
}

const CLEAR: &str =
    "are transparent (d, Tr), and let no light through here";
const TEXTURE: &str = "have a texture (map_Kd), which is not read";
const LUMINOUS: &str = "are luminous (Ke), and give no light";
const GLOSSY: &str = "are glossy (Ks, illum), and are diffuse here";
const COLOUR: &str = "have a Kd xyz or Kd spectral, which is not read";
const NO_KD: &str =
    "have no Kd r g b, and are given the albedo of -r or --albedo";
/// Told of a definition that follows another one.
pub const AGAIN: &str =
    "are defined again with another Kd; the first counts";

/// The materials of a library that are `used`, in its order; what is left
/// out goes to `warnings`.
///
/// # Errors
/// Those of `encoding::text`, a zero byte, or a `Kd` that is not one number
/// or three from 0 to 1; to be put behind the name of the file.
pub fn read(
    source: &[u8],
    used: &BTreeSet<&str>,
    warnings: &mut Vec<String>,
) -> Result<Vec<Material>, String> {
    let text = encoding::text(source, warnings)?;
    let text = &join(plain(&text)?)[..];
    let (mut materials, mut current) = (vec![], None::<Material>);
    let (mut count, mut left) = (1, text);
    for line in lines(text) {
        // Count the lines up to this one
        count += number(left, line) - 1;
        let end = line.as_ptr_range().end.addr() - left.as_ptr().addr();
        left = &left[end..];
        // Read one line of a library
        if name(line) == b"newmtl" {
            materials.extend(current.take());
            let name = rest(line);
            let is_used = used.contains(&name[..]);
            let begin =
                || Material { name, line: count, ..Material::default() };
            current = is_used.then(begin);
        } else if let Some(material) = &mut current {
            read_statement(line, count, material)
                .map_err(|what| at(text, line, &what))?;
        }
    }
    materials.extend(current);
    for material in materials.iter_mut().filter(|m| m.diffuse.is_none()) {
        material.asides.insert(NO_KD, material.line);
    }
    Ok(materials)
}

/// Reads the statement in a line, of this number, of a material.
fn read_statement(
    line: &[u8],
    number: usize,
    material: &mut Material,
) -> Result<(), String> {
    let word = String::from_utf8_lossy(name(line)).to_ascii_lowercase();
    let map = word.strip_prefix("map_");
    let text = rest(if map.is_some() { line } else { said(line) });
    let what = map.unwrap_or(&word);
    let (aside, nothing): (_, fn(f64) -> bool) = match what {
        "kd" if map.is_none() => return read_kd(&text, number, material),
        "kd" | "decal" => (TEXTURE, |_| false),
        "d" => (CLEAR, |x| x >= 1.),
        "tr" => (CLEAR, |x| x <= 0.),
        "ke" => (LUMINOUS, |x| x <= 0.),
        "ks" | "pm" | "refl" => (GLOSSY, |x| x <= 0.),
        "illum" => (GLOSSY, |x| x <= 1.),
        _ => return Ok(()),
    };
    let is_nothing = |word: &str| {
        map.is_none() && word.parse().is_ok_and(nothing) || word == "-halo"
    };
    if !text.split_whitespace().all(is_nothing) {
        material.asides.entry(aside).or_insert(number);
    }
    Ok(())
}

/// Reads what stands behind a `Kd`.
fn read_kd(
    text: &str,
    number: usize,
    Material { name, diffuse, asides, .. }: &mut Material,
) -> Result<(), String> {
    if text.starts_with("xyz") || text.starts_with("spectral") {
        asides.entry(COLOUR).or_insert(number);
        return Ok(());
    }
    let numbers = text.split_whitespace().map(str::parse);
    let kd = match numbers.collect::<Result<Vec<f64>, _>>().as_deref() {
        Ok(&[grey]) => [grey; 3],
        Ok(&[r, g, b]) => [r, g, b],
        _ => [f64::NAN; 3],
    };
    if !kd.iter().all(|x| (0. ..=1.).contains(x)) {
        let (name, text) = (quoted(name), quoted(text));
        let what = "expected Kd and one number from 0 to 1, or three, and";
        return Err(format!("material {name}: {what} not 'Kd {text}'"));
    }
    if *diffuse.get_or_insert(kd) != kd {
        asides.entry(AGAIN).or_insert(number);
    }
    Ok(())
}
