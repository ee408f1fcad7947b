// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable maps: of grey levels, PGM, and of 32-bit numbers, PFM, with
//! the bottom row first.

use std::io::{self, Write};

use rayon::prelude::*;

use super::data::{Image, Note, Source};
use super::levels::{COLOURS, LEVELS, levels, mean, radiance, whole};

/// Writes the means as 256 levels, encoded by the sRGB curve.
pub fn write_levels(
    image: &dyn Source,
    out: &mut dyn Write,
) -> io::Result<()> {
    let (width, height) = image.window().size;
    writeln!(out, "P2 {width} {height}\n255")?;
    let words = Vec::from_iter((0..256).map(|level| format!("{level}\n")));
    levels(image, 255, |levels| {
        let rows = levels.par_chunks(width as usize).map(|row| {
            let words = row.iter().map(|&level| &words[usize::from(level)]);
            words.map(String::as_str).collect()
        });
        let rows: Vec<String> = rows.collect();
        rows.iter().try_for_each(|text| out.write_all(text.as_bytes()))
    })
}

/// Reads levels; `bytes` is the whole file. `note` is told of their curve,
/// and of bytes after them.
///
/// # Errors
/// The header is damaged, or there are fewer levels than it says, or
/// more in the plain variant.
pub fn read_levels(mut bytes: &[u8], note: Note) -> Result<Image, String> {
    let plain = word(&mut bytes) == Some("P2");
    let mut next = || word(&mut bytes)?.parse::<u32>().ok();
    // Take the size and the white of a greymap
    let [Some(width @ 1..), Some(height @ 1..), Some(white @ 1..=65535)] =
        [next(), next(), next()]
    else {
        return Err("its header is damaged".to_owned());
    };
    let promised = u128::from(width) * u128::from(height);
    // Take the levels of a greymap
    let levels: Vec<u32> = if plain {
        let words = std::iter::from_fn(|| word(&mut bytes));
        let levels: Result<Vec<_>, _> = words.map(str::parse).collect();
        levels.map_err(|_| "one of its levels is no number")?
    } else {
        let size = if white > 255 { 2 } else { 1 };
        let levels = raster(bytes, size as u128 * promised, note)?;
        levels.chunks(size).map(whole).collect()
    };
    let held = levels.len();
    if held as u128 != promised {
        return Err(format!("it has {held} levels, and says {promised}"));
    }
    note(&format!("{LEVELS} the sRGB curve"));
    let means = levels.into_iter().map(|level| {
        radiance(f64::from(level.min(white)) / f64::from(white))
    });
    Ok(Image::plain(width, height, means.collect()))
}

/// Takes the next word, past white space and comments; U+FFFD if it is no
/// text.
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

/// The bytes of the pixels, as many as promised, of what is left after
/// the last word of a header. `note` is told of bytes after them.
///
/// # Errors
/// There are fewer.
fn raster<'a>(
    rest: &'a [u8],
    promised: u128,
    note: Note,
) -> Result<&'a [u8], String> {
    let size = usize::try_from(promised).unwrap_or(usize::MAX);
    // Find the end of the header by the length of the file
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
    // Take what was promised
    let (data, others) = data.split_at_checked(size).ok_or_else(|| {
        let held = data.len();
        format!("it has {held} bytes of pixels; its header says {promised}")
    })?;
    if !others.is_empty() {
        note(&format!("its last {} bytes are ignored", others.len()));
    }
    Ok(data)
}

/// Writes the means, as numbers of least significant byte first.
pub fn write_numbers(
    image: &dyn Source,
    out: &mut dyn Write,
) -> io::Result<()> {
    let window = image.window();
    let (width, height) = window.size;
    write!(out, "Pf\n{width} {height}\n-1.0\n")?;
    Vec::from_iter((0..height).rev()).chunks(16).try_for_each(|rows| {
        let means = rows
            .par_iter()
            .flat_map_iter(|&y| image.means(window.rows(y, 1)));
        let bytes = means.map(|x| (x as f32).to_le_bytes());
        out.write_all(bytes.collect::<Vec<_>>().as_flattened())
    })
}

/// Reads a map of one number per pixel, or of three or four, whose
/// luminance is taken; `bytes` is the whole file. `note` is told of
/// colours, and of bytes after the numbers.
///
/// # Errors
/// The header is not that of such a map, or there are fewer numbers than
/// it says.
pub fn read_numbers(mut bytes: &[u8], note: Note) -> Result<Image, String> {
    let mut next = || word(&mut bytes).ok_or("its header is damaged");
    let (kind, width, height, scale) = (next()?, next()?, next()?, next()?);
    // Take the size and the unit from the header
    let kinds = ["Pf", "", "PF", "PF4"];
    let at = kinds.iter().position(|other| *other == kind);
    let channels = 1 + at.ok_or(format!("its kind is {kind}, not PF"))?;
    let side = |text: &str| text.parse().ok().filter(|&n: &u32| n > 0);
    let size = side(width).zip(side(height));
    let (width, height) =
        size.ok_or(format!("its size is {width} by {height}"))?;
    let unit = scale.parse().ok().filter(|s: &f32| s.is_normal());
    let unit = unit.ok_or(format!("its scale is {scale}"))?;
    // Turn the rows of the map upside down
    let promised = u128::from(width) * u128::from(height);
    let promised = 4 * channels as u128 * promised;
    let words = raster(bytes, promised, note)?.as_chunks().0;
    let number = |&word: &[u8; 4]| match unit < 0. {
        true => f32::from_le_bytes(word),
        false => f32::from_be_bytes(word),
    };
    let number = |word| f64::from(number(word)) * f64::from(unit.abs());
    let numbers: Vec<f64> = words.iter().map(number).collect();
    let means: Vec<f64> = numbers.chunks(channels).map(mean).collect();
    let means = means.rchunks(width as usize).flatten().copied().collect();
    if channels > 1 {
        note(COLOURS);
    }
    Ok(Image::plain(width, height, means))
}
