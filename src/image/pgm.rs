// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable greymap.

use std::io::{self, Write};

use super::data::{Image, Means};
use super::levels::levels;
use super::srgb::radiance;

/// Writes the means as 256 levels, encoded by the sRGB curve.
pub fn write(image: &dyn Means, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.size();
    writeln!(out, "P2 {width} {height}\n255")?;
    let words = Vec::from_iter((0..256).map(|level| format!("{level}\n")));
    let mut text = Vec::new();
    levels(image, 255, |levels| {
        text.clear();
        let words = levels.iter().map(|&level| &words[usize::from(level)]);
        words.for_each(|word| text.extend_from_slice(word.as_bytes()));
        out.write_all(&text)
    })
}

/// Reads the levels back; `bytes` is the whole file.
///
/// # Errors
/// The header is damaged, or there are fewer or more levels than it
/// says.
pub fn read(mut bytes: &[u8]) -> Result<Image, String> {
    let plain = word(&mut bytes) == Some(b"P2");
    let mut next = || number(word(&mut bytes)?);
    let header = [next(), next(), next()];
    let [Some(width @ 1..), Some(height @ 1..), Some(white @ 1..=65535)] =
        header
    else {
        return Err("its header is damaged".to_owned());
    };
    // Take the levels of a greymap
    let levels: Vec<u32> = if plain {
        let words = std::iter::from_fn(|| word(&mut bytes));
        let levels: Option<_> = words.map(number).collect();
        levels.ok_or("one of its levels is no number")?
    } else {
        let bytes = bytes.get(1..).unwrap_or_default();
        match white {
            ..=255 => bytes.iter().map(|&level| level.into()).collect(),
            _ => {
                let (pairs, odd) = bytes.as_chunks();
                let level = |&pair: &_| u16::from_be_bytes(pair).into();
                let half = odd.iter().map(|&byte| byte.into());
                pairs.iter().map(level).chain(half).collect()
            }
        }
    };
    let promised = u64::from(width) * u64::from(height);
    if levels.len() as u64 != promised {
        return Err(format!(
            "it holds {} levels, and its header says {promised}",
            levels.len()
        ));
    }
    let means = levels.into_iter().map(|level| {
        radiance(f64::from(level.min(white)) / f64::from(white))
    });
    Ok(Image::plain(width, height, means.collect()))
}

/// Takes the next word, past white space and comments.
fn word<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    *bytes = bytes.trim_ascii_start();
    while let Some(comment) = bytes.strip_prefix(b"#") {
        let end = comment.iter().position(|&byte| byte == b'\n')?;
        *bytes = comment[end..].trim_ascii_start();
    }
    let end = bytes.iter().position(u8::is_ascii_whitespace);
    let (word, rest) = bytes.split_at(end.unwrap_or(bytes.len()));
    *bytes = rest;
    (!word.is_empty()).then_some(word)
}

fn number(word: &[u8]) -> Option<u32> {
    std::str::from_utf8(word).ok()?.parse().ok()
}
