// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable maps: of grey levels, PGM, and of 32-bit numbers, PFM, with
//! the bottom row first.

use std::io::{self, Write};
use std::iter;

use super::data::{Image, Note, Source, write_rows};
use super::levels::{self, COLOURS, LEVELS, luminance, radiance, whole};
use crate::error::Result;

/// Writes the means as 256 levels, encoded by the sRGB curve.
pub fn write_levels(
    image: &dyn Source,
    out: &mut dyn Write,
) -> io::Result<()> {
    let (width, height) = image.window().size;
    writeln!(out, "P2 {width} {height}\n255")?;
    let words = Vec::from_iter((0..256).map(|level| format!("{level}\n")));
    let word = |level: u16| words[usize::from(level)].bytes();
    levels::write_levels(image, false, 255, word, out)
}

/// Writes the means as numbers, the least significant byte first.
pub fn write_numbers(
    image: &dyn Source,
    out: &mut dyn Write,
) -> io::Result<()> {
    let (width, height) = image.window().size;
    write!(out, "Pf\n{width} {height}\n-1.0\n")?;
    let rows = Vec::from_iter((0..height).rev());
    let row = |_, part: Image| {
        let bytes = part.means.iter().map(|&x| (x as f32).to_le_bytes());
        bytes.flatten().collect::<Vec<_>>()
    };
    write_rows(image, &rows, false, row, out)
}

/// Reads a map of levels, or of one number per pixel, or of three or four,
/// which become a luminance; `bytes` is the whole file. `note` receives the
/// curve of levels, colours, and bytes after the pixels.
///
/// # Errors
/// The header is damaged, or there are fewer pixels than it says, or
/// more in the plain variant.
pub fn read(mut bytes: &[u8], note: Note) -> Result<Image> {
    let mut next = || word(&mut bytes).ok_or("its header is damaged");
    let (kind, width, height, unit) = (next()?, next()?, next()?, next()?);
    // Parse the size and the unit in the header
    let side = |text: &str| text.parse().ok().filter(|&n: &u32| n > 0);
    let size = side(width).zip(side(height));
    let (width, height) = size
        .ok_or(format!("its header has a size of {width} by {height}"))?;
    let has_levels = ["P2", "P5"].contains(&kind);
    let scale = unit.parse().ok().filter(|scale: &f32| match has_levels {
        true => (1. ..=65535.).contains(scale),
        false => scale.is_normal(),
    });
    let unit = scale.ok_or(format!("its header has a scale of {unit}"))?;
    let unit = f64::from(unit);
    // Read the words of a portable map
    let (channels, size) = match kind {
        "P2" | "P5" => (1, if unit > 255. { 2 } else { 1 }),
        "Pf" => (1, 4),
        "PF" => (3, 4),
        "PF4" => (4, 4),
        _ => return Err(format!("its kind is {kind}, not PF").into()),
    };
    let promised =
        channels as u128 * u128::from(width) * u128::from(height);
    let words: Vec<u32> = if kind == "P2" {
        let words = iter::from_fn(|| word(&mut bytes)).map(str::parse);
        let words: Result<_, _> = words.collect();
        words.map_err(|_| "one of its levels is no number")?
    } else {
        let words = raster(bytes, size as u128 * promised, note)?;
        words.chunks(size).map(whole).collect()
    };
    let held = words.len();
    if held as u128 != promised {
        let fault = format!("it has {held} levels, and says {promised}");
        return Err(fault.into());
    }
    // Turn the words into means
    let real = |bits| f64::from(f32::from_bits(bits)) * unit.abs();
    let number = |&word: &u32| match (has_levels, unit < 0.) {
        (true, _) => radiance(f64::from(word).min(unit) / unit),
        (_, true) => real(word.swap_bytes()),
        (_, false) => real(word),
    };
    let numbers: Vec<f64> = words.iter().map(number).collect();
    let mut means: Vec<f64> =
        numbers.chunks(channels).map(luminance).collect();
    if has_levels {
        note(&format!("{LEVELS} the sRGB curve"));
    } else {
        let rows = means.rchunks(width as usize);
        means = rows.flatten().copied().collect();
    }
    if channels > 1 {
        note(COLOURS);
    }
    Ok(Image::plain(width, height, means))
}

/// Splits off the next word after white space and comments; U+FFFD if it is
/// no text.
fn word<'a>(bytes: &mut &'a [u8]) -> Option<&'a str> {
    *bytes = bytes.trim_ascii_start();
    while let Some(comment) = bytes.strip_prefix(b"#") {
        let end = comment.iter().position(|&byte| byte == b'\n')?;
        *bytes = comment[end..].trim_ascii_start();
    }
    let ends = |byte: &u8| byte.is_ascii_whitespace() || *byte == b'#';
    let end = bytes.iter().position(ends);
    let (word, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
    *bytes = rest;
    let text = str::from_utf8(word).unwrap_or("\u{fffd}");
    (!word.is_empty()).then_some(text)
}

/// The promised bytes of the pixels, out of those after the last word of a
/// header. `note` receives the number of bytes after them.
///
/// # Errors
/// There are fewer.
fn raster<'a>(
    rest: &'a [u8],
    promised: u128,
    note: Note,
) -> Result<&'a [u8]> {
    let size = usize::try_from(promised).unwrap_or(usize::MAX);
    let most = rest.len().saturating_sub(size);
    let blank = |end: usize| {
        rest[..end].ends_with(b"\n") && word(&mut &rest[..end]).is_none()
    };
    let start = match rest.iter().position(|&byte| byte == b'\n') {
        _ if rest[..most].contains(&b'#') && blank(most) => most,
        Some(end) if end < most && blank(end + 1) => end + 1,
        _ => 1,
    };
    let data = rest.get(start..).unwrap_or_default();
    let (data, others) = data.split_at_checked(size).ok_or_else(|| {
        let held = data.len();
        format!("it has {held} bytes of pixels; its header says {promised}")
    })?;
    if !others.is_empty() {
        note(&format!("its last {} bytes are ignored", others.len()));
    }
    Ok(data)
}
