// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable greymap.

use std::io::{self, Write};

use rayon::prelude::*;

use super::data::{Image, Note, Source};
use super::levels::levels;
use super::srgb::{LEVELS, radiance, whole};

/// Writes the means as 256 levels, encoded by the sRGB curve.
pub fn write(image: &dyn Source, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.size();
    writeln!(out, "P2 {width} {height}\n255")?;
    let words = Vec::from_iter((0..256).map(|level| format!("{level}\n")));
    levels(image, 255, |levels| {
        let rows = levels.par_chunks(width as usize).map(|row| {
            let mut text = Vec::with_capacity(4 * row.len());
            let words = row.iter().map(|&level| &words[usize::from(level)]);
            words.for_each(|word| text.extend_from_slice(word.as_bytes()));
            text
        });
        let rows: Vec<_> = rows.collect();
        rows.iter().try_for_each(|text| out.write_all(text))
    })
}

/// Reads the levels back; `bytes` is the whole file. `note` is told of
/// their curve, and of bytes after them.
///
/// # Errors
/// The header is damaged, or there are fewer levels than it says, or
/// more in the plain variant.
pub fn read(mut bytes: &[u8], note: Note) -> Result<Image, String> {
    let plain = word(&mut bytes) == Some(b"P2");
    let mut next = || number(word(&mut bytes)?);
    let [Some(width @ 1..), Some(height @ 1..), Some(white @ 1..=65535)] =
        [next(), next(), next()]
    else {
        return Err("its header is damaged".to_owned());
    };
    let promised = u128::from(width) * u128::from(height);
    // Take the levels of a greymap
    let levels: Vec<u32> = if plain {
        let words = std::iter::from_fn(|| word(&mut bytes));
        let levels: Option<_> = words.map(number).collect();
        levels.ok_or("one of its levels is no number")?
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

/// Takes the next word, past white space and comments.
pub fn word<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    *bytes = bytes.trim_ascii_start();
    while let Some(comment) = bytes.strip_prefix(b"#") {
        let end = comment.iter().position(|&byte| byte == b'\n')?;
        *bytes = comment[end..].trim_ascii_start();
    }
    let ends = |byte: &u8| byte.is_ascii_whitespace() || *byte == b'#';
    let end = bytes.iter().position(ends);
    let (word, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
    *bytes = rest;
    (!word.is_empty()).then_some(word)
}

fn number(word: &[u8]) -> Option<u32> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The bytes of the pixels, as many as promised, of what is left after
/// the last word of a header. `note` is told of bytes after them.
///
/// # Errors
/// There are fewer.
pub fn raster<'a>(
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
    let (data, others) = data.split_at_checked(size).ok_or_else(|| {
        let held = data.len();
        format!("it has {held} bytes of pixels; its header says {promised}")
    })?;
    if !others.is_empty() {
        note(&format!("its last {} bytes are ignored", others.len()));
    }
    Ok(data)
}
